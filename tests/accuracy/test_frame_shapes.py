"""Every shape, turned and overlapping, against `mj_ray`, through every kind of lens."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.bench_suite.sensors.raster import buffers
from hil.apps.bench_suite.sensors.raster_cases import camera_pose, looking, world_of
from sim.frame.camera_model import CameraModel
from sim.frame.distortion import BrownConrady, KannalaBrandt
from sim.frame.geometry import FrameGeometry
from sim.frame.renderer import FrameRenderer
from tests.worlds.mjcf_world import GROUPS

Float64 = NDArray[np.float64]
CAMERAS = {
    "pinhole": CameraModel(120, 90, 60.0, 60.0, 60.0, 45.0),
    "off_centre": CameraModel(101, 75, 70.0, 55.0, 40.3, 52.1),
    "brown_conrady": CameraModel.from_fov(120, 90, 80.0, BrownConrady(-0.2, 0.05, 0.001, -0.0005, 0.0)),
    "fisheye": CameraModel.from_fov(100, 100, 180.0, KannalaBrandt(0.02, -0.003, 0.0, 0.0)),
}
_TRIANGLES = (int(mujoco.mjtGeom.mjGEOM_MESH), int(mujoco.mjtGeom.mjGEOM_HFIELD))
_SIZES = {"sphere": 1, "box": 3, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "mesh": 0}


def shapes_mjcf(seed: int) -> str:
    """Return MJCF of 40 random geoms on 20 x 20 m over a plane, a third of them mocap bodies, and a height field."""
    random = np.random.Generator(np.random.Philox(seed))
    parts = []
    for i in range(40):
        kind = list(_SIZES)[i % len(_SIZES)]
        size = random.uniform(0.2, 1.2, 3)
        position = random.uniform((-10, -10, 0.2), (10, 10, 6))
        turn = random.normal(size=4)
        shape = 'mesh="wedge"' if kind == "mesh" else f'size="{_text(size[: _SIZES[kind]])}"'
        colour = _text([*random.uniform(0.1, 1.0, 3), 1.0])
        mocap = ' mocap="true"' if i % 3 == 0 else ""
        parts.append(
            f'<body name="thing_{i:02d}" pos="{_text(position)}" quat="{_text(turn)}"{mocap}>'
            f'<geom name="thing_{i:02d}" type="{kind}" {shape} rgba="{colour}" contype="0" conaffinity="0"/></body>'
        )
    parts.append('<body name="hidden"><geom type="sphere" size="3" pos="0 0 3" group="3"/></body>')
    parts.append('<body name="clear"><geom type="sphere" size="3" pos="0 0 3" rgba="1 0 0 0"/></body>')
    heights = _text(np.round(random.uniform(0.0, 1.0, 63), 3))
    field = f'<hfield name="hill" nrow="7" ncol="9" size="4 3 2 0.5" elevation="{heights}"/>'
    hill = '<body name="hill" pos="9 6 0.2"><geom type="hfield" hfield="hill"/></body>'
    wedge = _text(np.array([[0, 0, 0], [1.4, 0, 0], [0, 1.0, 0], [0, 0, 1.2], [1.0, 0.8, 0.3]]).ravel())
    return (
        f'<mujoco><asset><mesh name="wedge" vertex="{wedge}"/>{field}</asset>'
        '<visual><global offwidth="1280" offheight="720"/></visual>'
        '<worldbody><light pos="0 0 50" dir="0 0 -1" directional="true"/>'
        f'<geom name="ground" type="plane" size="30 30 1"/>{"".join(parts)}{hill}</worldbody></mujoco>'
    )


def _text(values: object) -> str:
    return " ".join(f"{value:.6g}" for value in np.asarray(values, float).ravel())


def mujoco_hits(
    model: mujoco.MjModel, p_W: Float64, rays_W: Float64, near_m: Float64
) -> tuple[NDArray[np.int32], Float64, Float64]:
    """Return geom (or -1), range and normal towards the camera by mj_ray, which starts each ray at its near limit."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    geom, found = np.zeros(len(rays_W), np.int32), np.zeros(1, np.int32)
    range_m, normal = np.full(len(rays_W), np.inf), np.zeros((len(rays_W), 3))
    for i, (ray, near) in enumerate(zip(rays_W, near_m, strict=True)):
        distance = mujoco.mj_ray(model, data, p_W + near * ray, ray, GROUPS, 1, -1, found, normal[i])
        geom[i] = found[0]
        if found[0] >= 0:
            range_m[i] = near + distance
    return geom, range_m, normal * -np.sign(np.einsum("ij,ij->i", normal, rays_W))[:, None]


@pytest.mark.parametrize("lens", CAMERAS)
@pytest.mark.parametrize(
    ("seed", "p_W", "azimuth_deg", "down_deg"), [(1, (-13, 0, 5), 0, 15), (2, (2, 12, 8), -100, 40)]
)
def test_against_mj_ray(lens: str, seed: int, p_W: tuple[float, ...], azimuth_deg: float, down_deg: float) -> None:
    camera = CAMERAS[lens]
    world = world_of(shapes_mjcf(seed))
    R_WC = looking(azimuth_deg, down_deg, roll_deg=7.0)
    rays_C = camera.rays().reshape(-1, 3)
    # The near plane of a pinhole is a plane, that of other cameras a sphere.
    near_m = 0.05 / rays_C[:, 2] if camera.pinhole else np.full(len(rays_C), 0.05)
    true_geom, true_m, normal_W = mujoco_hits(world.model, np.array(p_W, float), rays_C @ R_WC.T, near_m)
    out = buffers(camera, ("geom", "range", "depth", "normal", "instance"))
    FrameRenderer(FrameGeometry(world), camera).render(camera_pose(np.array(p_W, float), R_WC), out)
    shape = (camera.height, camera.width)
    geom, range_m = true_geom.reshape(shape), true_m.reshape(shape)
    assert (out["geom"] == geom).mean() >= 0.998
    inside = np.ones(shape, bool)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            inside &= np.roll(geom, (dy, dx), (0, 1)) == geom
    inside[[0, -1]] = inside[:, [0, -1]] = False
    assert (out["geom"][inside] == geom[inside]).mean() >= 0.9995
    compared = inside & (geom >= 0) & (out["geom"] == geom)
    assert len(np.unique(geom[compared])) >= 10
    assert np.abs(out["range"][compared] - range_m[compared]).max() <= 1e-4
    depth = range_m[compared] * camera.rays()[..., 2][compared]
    assert np.abs(out["depth"][compared] - depth).max() <= 1e-4
    primitive = compared & ~np.isin(world.model.geom_type[geom], _TRIANGLES)
    normal_C = (normal_W @ R_WC).reshape(*shape, 3)
    sine = np.linalg.norm(np.cross(out["normal"].astype(float), normal_C), axis=-1)[primitive]
    # At a crease of one geom (the rim of a cylinder, the edge of a box) the last bits choose the side.
    assert np.mean(sine > np.sin(np.deg2rad(0.1))) <= 1e-3
    assert (np.einsum("ijk,ijk->ij", out["normal"], normal_C)[primitive] > 0).mean() >= 0.999
    np.testing.assert_array_equal(out["instance"][geom < 0], 0)
    assert np.isinf(out["range"][(geom < 0) & inside]).all()
