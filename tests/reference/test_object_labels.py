"""3-D labels against slow references: MuJoCo's own poses and rays, all vertices, fine grids of rays, closed forms.

The world is the city park of the default data set with its walking people.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.dataset.formats.boxes import SeenObject
from hil.apps.dataset.formats.labels import Catalogue, LabelReader
from hil.apps.dataset.object_reader import ObjectReader
from hil.config import load_bench
from hil.config.files import find
from signals.rotation import matrix_of
from signals.samples import ImageSample, PointCloudSample, TruthState
from sim._kernels import Geometry, RayCaster
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.lone_objects import LoneGeometry, LoneObjects
from sim.frame.mount import Mount
from sim.frame.mujoco_backend import WorldPose
from sim.frame.object_box import BoxedPoints, ObjectBox, tight_boxes
from sim.frame.object_shapes import ObjectShapes
from sim.frame.scenery import alpha_masks
from sim.frame.source import SharedFrames
from sim.scene.world import World
from sim.sensors.catalog import make_sensor
from sim.sensors.sensor import Installation

T_NS = 3_720_000_000
SHAPES = mujoco.mjtGeom
Array = NDArray[Any]


@pytest.fixture(scope="module")
def frames() -> SharedFrames:
    bench = load_bench(find("mission", "rigs/datasets/park_loop.yaml", ()), flown=False)
    return SharedFrames(bench.world)


@pytest.fixture(scope="module")
def catalogue(frames: SharedFrames) -> Catalogue:
    world = frames.world
    return Catalogue.of_geoms(frames.classes, world.geom_instance, world.geom_class)


def surface_points(model: mujoco.MjModel, geom: int) -> tuple[Array, bool]:
    """Return points of a geom's surface in its frame, and True if they are all its corners."""
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind == SHAPES.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first = int(model.mesh_vertadr[mesh])
        return model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])].astype(float), True
    if kind == SHAPES.mjGEOM_BOX:
        return size * [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], True
    around, up = np.meshgrid(np.linspace(0, 2 * math.pi, 181), np.linspace(-math.pi / 2, math.pi / 2, 91))
    unit = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=-1).reshape(-1, 3)
    if kind == SHAPES.mjGEOM_SPHERE:
        return size[0] * unit, False
    if kind == SHAPES.mjGEOM_ELLIPSOID:
        return size * unit, False
    if kind == SHAPES.mjGEOM_CAPSULE:
        return size[0] * unit + np.where(unit[:, 2:] >= 0, 1.0, -1.0) * [0, 0, size[1]], False
    assert kind == SHAPES.mjGEOM_CYLINDER
    rim = np.stack([np.cos(around[0]), np.sin(around[0]), np.zeros(181)], axis=-1) * size[0]
    end = np.array([0.0, 0.0, size[1]])
    return np.concatenate([rim + end, rim - end]), False


def instances(world: World, catalogue: Catalogue) -> Iterator[int]:
    for instance, class_id in catalogue.class_of_instance.items():
        if class_id in catalogue.object_classes and np.any(world.geom_visible[world.geom_instance == instance]):
            yield instance


def check_box(world: World, data: mujoco.MjData, instance: int, box: ObjectBox) -> bool:
    """Check that all points of an instance are in its box and each face is touched; return True if to 1e-6 m."""
    geoms = np.flatnonzero((world.geom_instance == instance) & world.geom_visible).tolist()
    found = [surface_points(world.model, geom) for geom in geoms]
    poses = [(data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]) for geom in geoms]
    points_W = np.concatenate([p @ R.T + at for (R, at), (p, _) in zip(poses, found, strict=True)])
    local = (points_W - box.centre_W) @ box.axes_W.T
    half = 0.5 * box.size_m
    assert (np.abs(local) <= half + 1e-6).all(), world.instance_names[instance]
    corners_only = all(are_corners for _, are_corners in found)
    gap = max(float((half - local.max(axis=0)).max()), float((local.min(axis=0) + half).max()))
    assert gap <= (1e-6 if corners_only else 4e-4 * max(1.0, float(half.max()))), world.instance_names[instance]
    return corners_only


def test_every_vertex_is_in_its_box_and_every_face_is_touched(frames: SharedFrames, catalogue: Catalogue) -> None:
    world, shapes = frames.world, ObjectShapes(frames.world)
    data = WorldPose(world).at(T_NS)
    checked = exact = moving = 0
    up = np.array([0.3, -0.2, 0.9]) / math.sqrt(0.94)  # of a camera that is tilted
    for up_W in (np.array([0.0, 0.0, 1.0]), up):
        for instance in instances(world, catalogue):
            box = tight_boxes(shapes, [shapes.posed(instance, T_NS)], up_W)[0]
            if box is not None:
                exact += check_box(world, data, instance, box)
                checked, moving = checked + 1, moving + shapes.moves(instance)
    assert checked > 250
    assert exact > 100
    assert moving > 60


def test_a_vehicle_in_flight_has_its_box_and_its_points() -> None:
    """Tilted, turned and with rotors at an angle; seen by the LiDAR of another vehicle."""
    bench = load_bench(find("mission", "rigs/delivery_pair.yaml", ()), flown=False)
    frames = SharedFrames(bench.world)
    world, shapes = frames.world, ObjectShapes(frames.world)
    watcher, other = "watcher", next(name for name in bench.vehicles if name != "watcher")
    rotors = len(bench.vehicles[other].vehicle.rotors)
    truth = truth_at((5.0, 3.0, 30.0), (12.0, -20.0, 70.0))
    states = [truth._replace(t_ns=t, rotor_speed_radps=(700.0,) * rotors) for t in (T_NS - 10_000_000, T_NS)]
    for state in states:
        frames.place(other, state)
    instance = world.instance_names.index(f"drone:{other}")
    box = tight_boxes(shapes, [shapes.posed(instance, T_NS)])[0]
    assert box is not None
    check_box(world, WorldPose(world).at(T_NS), instance, box)
    assert math.degrees(box.yaw_rad) == pytest.approx(70.0, abs=1e-6)
    seen = frames.seen_by(watcher)
    lidar, sample = swept(seen, truth_at((2.5, 2.9, 30.0), (0.0, 0.0, 0.0)), rolling=False, range_noise_m=0.0)
    points_W = np.asarray(sample.points_L) + sample.p_WL
    mine = points_W[lidar.instances() == instance]
    assert len(mine) > 5
    assert (np.abs((mine - box.centre_W) @ box.axes_W.T) <= 0.5 * box.size_m + 2e-3).all()
    assert (sample.segmentation[lidar.instances() == instance] == world.class_names.index("drone")).all()


def test_a_walker_looks_where_it_goes(frames: SharedFrames, catalogue: Catalogue) -> None:
    shapes = ObjectShapes(frames.world)
    person = frames.world.class_names.index("person")
    walked = 0
    for instance, class_id in catalogue.class_of_instance.items():
        if class_id != person or not shapes.moves(instance):
            continue
        now, later = (tight_boxes(shapes, [shapes.posed(instance, t)])[0] for t in (T_NS, T_NS + 200_000_000))
        assert now is not None
        assert later is not None
        step = (later.centre_W - now.centre_W)[:2]
        if np.linalg.norm(step) > 0.15:
            walked += 1
            turn = math.remainder(math.atan2(step[1], step[0]) - now.yaw_rad, 2 * math.pi)
            assert abs(turn) < 0.5
            assert now.size_m[2] > now.size_m[1]
    assert walked >= 5


def truth_at(p_WB: tuple[float, float, float], rpy_deg: tuple[float, float, float], t_ns: int = T_NS) -> TruthState:
    zero = (0.0, 0.0, 0.0)
    q = Mount(zero, rpy_deg, optical=False).q_BC
    return TruthState(0, t_ns, p_WB, q, zero, zero, zero, zero, (0.0,) * 4, False)


def sensor(frames: SharedFrames, **options: Any) -> Any:
    rate_hz = options.pop("rate_hz", 10.0)
    installation = Installation(
        options.pop("name"), rate_hz=rate_hz, seed=1, scene=frames.world.scene, step_ns=4_000_000, frames=frames
    )
    return make_sensor(installation, **options)


CAMERA = {"channels": ("segmentation", "instance", "range"), "fov_deg": 80.0, "mount_m": (0.1, 0.0, 0.05)}
VIEWS = {
    "level": ((-3.0, -27.0, 2.0), (0.0, 0.0, 20.0)),
    "downwards": ((4.0, -14.0, 9.0), (4.0, 40.0, -130.0)),
    "towards trees": ((0.0, 0.0, 3.0), (-10.0, 5.0, -140.0)),
}


def seen_from(
    frames: SharedFrames, catalogue: Catalogue, view: str, **changes: Any
) -> tuple[Any, TruthState, tuple[SeenObject, ...]]:
    camera = sensor(
        frames, name="front", preset="camera_320x240", overrides={"resolution": (160, 120), **CAMERA, **changes}
    )
    truth = truth_at(*VIEWS[view])
    picture: ImageSample = camera.sample(truth, 0)
    labels = LabelReader(catalogue).read(picture.channels)
    reader = ObjectReader(frames.geometry, catalogue, camera, across=True)
    return camera, truth, reader.of_picture(truth, labels)


def alone_by_mujoco(world: World, data: mujoco.MjData, geoms: Array, pose: Any, rays_C: Array) -> Array:
    """Return True for each ray that meets one of these geoms, by mj_ray over a model that shows no others."""
    model = world.model
    groups = model.geom_group.copy()
    try:
        model.geom_group[:] = 5
        model.geom_group[geoms] = 0
        met = np.zeros(1, np.int32)
        only = np.array([1, 0, 0, 0, 0, 0], np.uint8)
        d = rays_C @ np.array(pose.R_WC).reshape(3, 3).T
        return np.array([mujoco.mj_ray(model, data, np.array(pose.p_WC), one, only, True, -1, met) >= 0 for one in d])
    finally:
        model.geom_group[:] = groups


@pytest.fixture(scope="module")
def masked(frames: SharedFrames) -> set[int]:
    """Instances with leaves that have holes, which MuJoCo's rays do not know."""
    return {int(frames.world.geom_instance[geom]) for geom in alpha_masks(frames.world.model, Geometry())}


@pytest.mark.parametrize("view", VIEWS)
def test_occlusion_is_that_of_rays_through_every_pixel(
    frames: SharedFrames, catalogue: Catalogue, masked: set[int], view: str
) -> None:
    """Pixels with and without all else, by MuJoCo's rays at the object alone and the caster's at the whole scene."""
    camera, truth, seen = seen_from(frames, catalogue, view)
    world, pose = frames.world, camera.mount.pose(truth)
    data = WorldPose(world).at(T_NS)
    rays_C = camera.model.rays()
    frames.geometry.pose(T_NS)
    n = rays_C.shape[0] * rays_C.shape[1]
    d = np.ascontiguousarray(rays_C.reshape(-1, 3) @ np.array(pose.R_WC).reshape(3, 3).T)
    range_m, geom = np.empty(n), np.empty(n, np.int32)
    RayCaster(frames.geometry.native).cast(np.tile(np.array(pose.p_WC), (n, 1)), d, 0.0, 1e4, range_m, geom)
    first = np.where(geom >= 0, world.geom_instance[geom], 0).reshape(rays_C.shape[:2])
    hidden = differing = total = compared = 0
    for o in seen:
        instance = o.label.instance
        geoms = np.flatnonzero((world.geom_instance == instance) & world.geom_visible)
        assert o.alone_px >= o.label.area_px
        if instance in masked:
            continue
        alone = alone_by_mujoco(world, data, geoms, pose, rays_C.reshape(-1, 3)).sum()
        visible = np.count_nonzero(first == instance)
        differing += abs(int(alone) - o.alone_px) + abs(visible - o.label.area_px)
        total += o.alone_px + o.label.area_px
        assert o.occlusion == pytest.approx(max(0.0, 1.0 - visible / alone), abs=max(0.003, 2.0 / alone))
        compared += 1
        hidden += o.occlusion > 0.05
    assert compared >= 5
    assert hidden >= 2
    assert differing <= 1e-3 * total + 1  # an edge within rounding of a pixel's centre falls either way


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("lens", ["pinhole", "fisheye", "rolling"])
def test_no_pixel_is_visible_and_not_alone(frames: SharedFrames, catalogue: Catalogue, view: str, lens: str) -> None:
    changes: dict[str, Any] = {
        "pinhole": {},
        "fisheye": {"fov_deg": 190.0, "distortion": {"model": "kannala_brandt", "k1": -0.02, "k2": 0.003}},
        "rolling": {"rolling_shutter_s": 0.02},
    }[lens]
    *_, seen = seen_from(frames, catalogue, view, **changes)
    assert len(seen) > 5
    for o in seen:
        assert o.alone_px >= o.label.area_px
        assert 0.0 <= o.truncation <= 1.0


@pytest.mark.parametrize("view", VIEWS)
def test_the_projected_box_encloses_the_mask(frames: SharedFrames, catalogue: Catalogue, view: str) -> None:
    camera, truth, seen = seen_from(frames, catalogue, view)
    pose = camera.mount.pose(truth)
    R_WC = np.array(pose.R_WC).reshape(3, 3)
    enclosed = 0
    for o in seen:
        for box in (o.box, o.across):
            assert box is not None
            corners_C = (box.corners_W - np.array(pose.p_WC)) @ R_WC
            if (corners_C[:, 2] > 0.0).all():
                low, high = (f(camera.model.project(corners_C), axis=0) for f in (np.min, np.max))
                # The centres of the visible pixels lie in the projection of the box.
                assert (low <= np.array([o.label.x_min, o.label.y_min]) + 0.5 + 1e-6).all()
                assert (high >= np.array([o.label.x_max, o.label.y_max]) + 0.5 - 1e-6).all()
                enclosed += 1
        assert o.across is not None
        assert np.abs(o.across.axes_W[2] @ R_WC - [0.0, -1.0, 0.0]).max() < 1e-12
    assert enclosed >= 12


def fine_truncation(frames: SharedFrames, o: SeenObject, pose: Any, camera: CameraModel, rays: int = 512) -> float:
    """Return the truncation by rays over all directions, where the object is found first and then refined."""
    shapes = ObjectShapes(frames.world)
    lone = LoneGeometry(frames.geometry)
    lone.show(shapes.posed(o.label.instance, T_NS))
    R_WC = np.array(pose.R_WC).reshape(3, 3)
    total = outside = 0.0
    corners_C = (o.box.corners_W - np.array(pose.p_WC)) @ R_WC
    for axis in range(3):
        for sign in (-1.0, 1.0):  # a cube around the camera
            depth = sign * corners_C[:, axis]
            if depth.max() <= 0.0:
                continue
            u, v = (axis + 1) % 3, (axis + 2) % 3
            low, high = np.array([-1.0, -1.0]), np.array([1.0, 1.0])
            if depth.min() > 1e-3:
                plane = corners_C[:, [u, v]] / depth[:, None]
                low, high = np.maximum(low, plane.min(axis=0)), np.minimum(high, plane.max(axis=0))
                if (low >= high).any():
                    continue
            grid = (np.arange(rays) + 0.5) / rays
            a, b = np.meshgrid(low[0] + grid * (high - low)[0], low[1] + grid * (high - low)[1])
            d = np.empty((rays * rays, 3))
            d[:, axis], d[:, u], d[:, v] = sign, a.ravel(), b.ravel()
            squared = (d * d).sum(axis=1)
            n = len(d)
            range_m, geom = np.empty(n), np.empty(n, np.int32)
            unit = d / np.sqrt(squared)[:, None]
            lone.caster.cast(
                np.tile(np.array(pose.p_WC), (n, 1)), np.ascontiguousarray(unit @ R_WC.T), 0, 1e4, range_m, geom
            )
            weight = np.where(geom >= 0, np.prod(high - low) / n / squared**1.5, 0.0)
            with np.errstate(invalid="ignore", divide="ignore"):
                at = camera.project(d)
                within = (at >= 0).all(axis=1) & (at[:, 0] <= camera.width) & (at[:, 1] <= camera.height)
            total += float(weight.sum())
            outside += float(weight[~within].sum())
    return outside / total if total else math.nan


def test_truncation_is_that_of_a_fine_grid_of_rays(frames: SharedFrames, catalogue: Catalogue) -> None:
    worst, cut = 0.0, 0
    for view in VIEWS:
        camera, truth, seen = seen_from(frames, catalogue, view)
        for o in sorted(seen, key=lambda o: -o.truncation)[:4] + list(seen[:2]):
            expected = fine_truncation(frames, o, camera.mount.pose(truth), camera.model)
            if not math.isnan(expected):
                worst = max(worst, abs(o.truncation - expected))
                cut += 0.02 < expected < 0.98
    assert cut >= 6
    assert worst <= 0.02, f"worst error {worst:.4f}"


def swept(frames: SharedFrames, truth: TruthState, **overrides: Any) -> tuple[Any, PointCloudSample]:
    lidar = sensor(frames, name="lidar", preset="vlp16", overrides=overrides)
    sample: PointCloudSample = lidar.sample(truth, 0)
    return lidar, sample


@pytest.mark.parametrize("rolling", [False, True])
def test_points_of_an_instance_lie_in_its_box(frames: SharedFrames, catalogue: Catalogue, rolling: bool) -> None:
    """Within range noise (5 sigma and the device's step); of a flying vehicle, once its motion is taken out."""
    truth = truth_at((-3.0, -27.0, 2.0), (0.0, 5.0, 20.0))._replace(v_WB_W=(6.0, -3.0, 0.5), w_WB_B=(0.1, 0.3, 1.2))
    lidar, sample = swept(frames, truth, rolling=rolling, subsweeps=10)
    reader = ObjectReader(frames.geometry, catalogue, None)
    instance = lidar.instances()
    assert len(instance) == len(sample.points_L)
    points_L = lidar.points_at_capture(sample)
    R_WL = np.array(matrix_of(sample.q_WL)).reshape(3, 3)
    points_W = points_L @ R_WL.T + np.array(sample.p_WL)
    objects = reader.of_sweep(truth, BoxedPoints(points_W), instance)
    noise_m = 5 * 0.03 + 0.002
    shapes = ObjectShapes(frames.world)
    assert len(objects) > 20
    assert sum(o.points for o in objects) > 1000
    for o in objects:
        mine = points_W[instance == o.instance]
        assert len(mine) == o.points
        moved_m = (0.1 * 2.5 if rolling and shapes.moves(o.instance) else 0.0) + 1e-3
        local = np.abs((mine - o.box.centre_W) @ o.box.axes_W.T)
        assert (local <= 0.5 * o.box.size_m + noise_m + moved_m).all(), frames.world.instance_names[o.instance]
        inside = (np.abs((points_W - o.box.centre_W) @ o.box.axes_W.T) <= 0.5 * o.box.size_m).all(axis=1)
        assert o.inside == np.count_nonzero(inside)
    if rolling:  # as measured, the points of the turning vehicle are elsewhere
        assert np.abs(points_L - sample.points_L).max() > 0.5
    else:
        assert np.abs(points_L - sample.points_L).max() < 1e-4


def test_sweep_and_picture_agree_on_instances(frames: SharedFrames) -> None:
    """Points that both see: the pixel's neighbours are of one instance and at the point's distance."""
    truth = truth_at((-3.0, -27.0, 2.0), (0.0, 0.0, 20.0))
    lidar, sample = swept(frames, truth, rolling=False, range_noise_m=0.0, mount_m=(0.1, 0.0, 0.05))
    camera = sensor(frames, name="front", preset="camera_320x240", overrides={"resolution": (640, 480), **CAMERA})
    picture = camera.sample(truth, 0)
    points_C = sample.points_L @ np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # forward, left, up to right, down, on
    with np.errstate(invalid="ignore"):
        at = camera.model.project(points_C.astype(float))
    instance = lidar.instances()
    shown, range_m = picture.channels["instance"], picture.channels["range"]
    compared = objects = 0
    for i in np.flatnonzero(np.isfinite(at).all(axis=1)).tolist():
        column, row = math.floor(at[i, 0]), math.floor(at[i, 1])
        if not (1 <= column < 639 and 1 <= row < 479):
            continue
        near = shown[row - 1 : row + 2, column - 1 : column + 2]
        if (near == near[0, 0]).all() and abs(float(range_m[row, column]) - float(sample.range_m[i])) < 0.5:
            assert near[0, 0] == instance[i]
            compared += 1
            objects += frames.world.instance_names[instance[i]] not in ("ground", "none")
    assert compared > 500
    assert objects > 200


def test_boxed_points_are_those_of_the_definition() -> None:
    rng = np.random.default_rng(4)
    points = rng.uniform(-10, 10, (5000, 3))
    boxed = BoxedPoints(points)
    for _ in range(50):
        yaw = rng.uniform(-4, 4)
        axes = np.array([[math.cos(yaw), math.sin(yaw), 0], [-math.sin(yaw), math.cos(yaw), 0], [0, 0, 1.0]])
        box = ObjectBox(rng.uniform(-10, 10, 3), axes, rng.uniform(0.1, 8, 3), np.zeros(3))
        inside = (np.abs((points - box.centre_W) @ axes.T) <= 0.5 * box.size_m).all(axis=1)
        assert boxed.count(box) == np.count_nonzero(inside)
    assert BoxedPoints(np.empty((0, 3))).count(box) == 0


def test_truncation_of_a_crate_before_and_behind_the_camera() -> None:
    """Closed forms: all, nothing, a half, and the share of the front face that the picture is too small for."""
    from sim.scene.scene import Box, load_scene
    from sim.world_loader import load_world

    scene = load_scene("airfield").model_copy(
        update={"boxes": (Box(name="crate", center_m=(-8.0, 0.0, 1.0), size_m=(2.0, 2.0, 2.0)),)}
    )
    frames = SharedFrames(load_world(scene))
    shapes = ObjectShapes(frames.world)
    posed = shapes.posed(frames.world.instance_names.index("crate"), 0)
    box = tight_boxes(shapes, [posed])[0]
    assert box is not None
    assert box.size_m == pytest.approx([2.0, 2.0, 2.0])
    assert box.centre_W == pytest.approx([-8.0, 0.0, 1.0])
    lone = LoneObjects(LoneGeometry(frames.geometry), CameraModel.from_fov(160, 120, 90.0), (0.05, 1e4))

    def truncation(at: tuple[float, float, float], yaw_deg: float) -> float:
        pose: CameraPose = Mount((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)).pose(truth_at(at, (0.0, 0.0, yaw_deg), 0))
        return lone.measure([posed], [box], pose, lambda *_: None, one_pose=True)[0][1]

    assert truncation((0.0, 0.0, 1.0), 0.0) == 1.0
    assert truncation((0.0, 0.0, 1.0), 180.0) == 0.0
    # The right edge of 90 degrees halves the crate, by symmetry.
    assert truncation((0.0, 0.0, 1.0), 225.0) == pytest.approx(0.5, abs=0.01)
    # Half a metre before its front face, which alone is seen: a rectangle of half edges a and b at the distance d has
    # the solid angle 4 arctan(a b / (d sqrt(a^2 + b^2 + d^2))); the picture's half edges there are d and 0.75 d.
    d, half_v = 0.5, 0.375  # tangent of half the vertical field of view: 0.75
    whole = 4.0 * math.atan(1.0 / (d * math.sqrt(2.0 + d * d)))
    inside = 4.0 * math.atan(d * half_v / (d * math.sqrt(d * d + half_v * half_v + d * d)))
    assert truncation((-6.5, 0.0, 1.0), 180.0) == pytest.approx(1.0 - inside / whole, abs=0.02)
