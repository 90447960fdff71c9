"""The native raster: the same picture however it is made, and nothing but a clear refusal for what it cannot make."""

from __future__ import annotations

import hashlib
import math
import resource
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from signals.channels import CHANNELS
from signals.units import TURN_RAD
from sim._kernels import Daylight, Geometry, Picture, RayCaster, Scenery, SunShadows, frame_isa
from sim.frame.camera_model import CameraModel
from sim.frame.distortion import BrownConrady
from sim.frame.geometry import FrameGeometry
from sim.frame.renderer import CameraPose, Execution, FrameRenderer, RenderSkips
from sim.scene.scene import load_scene
from sim.scene.world import World
from sim.world_loader import load_world

CAMERA = CameraModel.from_fov(160, 120, 90.0)
ALL = tuple(CHANNELS)
# Every set includes the ones before it.
ISAS = ("base", "avx2", "avx512")[: 1 + ("base", "avx2", "avx512").index(frame_isa())]


def looking(p_W: tuple[float, float, float], at_W: tuple[float, float, float]) -> CameraPose:
    p = np.array(p_W)
    forward = np.array(at_W) - p
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward], axis=1)
    return CameraPose(p_W, tuple(R.ravel().tolist()), (1.0, -2.0, 0.5))


VIEWS = (looking((-30.0, -35.0, 20.0), (0.0, 5.0, 0.0)), looking((5.0, -8.0, 2.5), (0.0, 12.0, 1.0)))


def digest(out: Mapping[str, NDArray[Any]]) -> str:
    return hashlib.sha256(b"".join(out[name].tobytes() for name in sorted(out))).hexdigest()


def picture(renderer: FrameRenderer, pose: CameraPose, *channels: str) -> dict[str, NDArray[Any]]:
    out = renderer.buffers(*(channels or ALL))
    for array in out.values():
        array.view(np.uint8)[...] = 0xA5
    renderer.render(pose, out)
    return out


@pytest.fixture(scope="module")
def park() -> World:
    return load_world(load_scene("city_park"))


@pytest.fixture(scope="module")
def geometry(park: World) -> FrameGeometry:
    made = FrameGeometry(park)
    made.pose(4_000_000_000)
    return made


@pytest.mark.parametrize("shadows", [False, True])
def test_one_picture_for_any_threads_and_instruction_set(geometry: FrameGeometry, shadows: bool) -> None:
    for pose in VIEWS:
        expected = digest(picture(FrameRenderer(geometry, CAMERA, shadows=shadows), pose))
        for threads in (2, 3, 7):
            made = picture(FrameRenderer(geometry, CAMERA, shadows=shadows, execution=Execution(threads=threads)), pose)
            assert digest(made) == expected, f"{threads} threads"
        for isa in ("base", "avx2", "avx512"):
            if isa in ISAS:
                assert (
                    digest(
                        picture(FrameRenderer(geometry, CAMERA, shadows=shadows, execution=Execution(isa=isa)), pose)
                    )
                    == expected
                ), isa
            else:
                with pytest.raises(ValueError, match="this CPU has no"):
                    FrameRenderer(geometry, CAMERA, shadows=shadows, execution=Execution(isa=isa))


def test_an_actor_comes_back_into_sight(park: World) -> None:
    geometry = FrameGeometry(park)
    renderer = FrameRenderer(geometry, CAMERA)
    sky = replace(VIEWS[0], R_WC=(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))
    for k, pose in enumerate((VIEWS[0], sky, VIEWS[0], VIEWS[1])):
        geometry.expect(700_000_000 * k)
        fresh = FrameGeometry(park)
        fresh.pose(700_000_000 * k)
        assert digest(picture(renderer, pose)) == digest(picture(FrameRenderer(fresh, CAMERA), pose))


def test_a_channel_is_the_same_whatever_else_is_asked_for(geometry: FrameGeometry) -> None:
    renderer = FrameRenderer(geometry, CAMERA)
    together = picture(renderer, VIEWS[1])
    for name in ALL:
        assert np.array_equal(picture(renderer, VIEWS[1], name)[name], together[name]), name
        assert np.unique(together[name]).size > 1, f"{name} is constant"


def test_rows_alone_are_the_rows_of_the_whole(geometry: FrameGeometry) -> None:
    for supersample in (1, 2):
        renderer = FrameRenderer(geometry, CAMERA, supersample=supersample, shadows=True)
        whole = picture(renderer, VIEWS[1])
        parts = renderer.buffers(*ALL)
        for first in range(0, 120, 20):
            renderer.render(VIEWS[1], parts, rows=(first, first + 20))
        for name in ALL:
            assert np.array_equal(whole[name], parts[name]), name


def test_supersampling_changes_colour_alone_and_averages_light(geometry: FrameGeometry) -> None:
    plain = picture(FrameRenderer(geometry, CAMERA), VIEWS[0])
    fine = picture(FrameRenderer(geometry, CAMERA, supersample=2), VIEWS[0])
    for name in ALL:
        assert np.array_equal(plain[name], fine[name]) == (name != "rgb")
    assert abs(float(plain["rgb"].mean()) - float(fine["rgb"].mean())) < 1.0


def test_a_table_of_rays_sees_what_the_pinhole_sees(geometry: FrameGeometry) -> None:
    # The same camera, told ray by ray: all but the pixels on edges agree.
    table = Picture(geometry.native, geometry.scenery, np.ascontiguousarray(CAMERA.rays(), np.float64))
    light = FrameRenderer(geometry, CAMERA)._light
    for pose in VIEWS:
        expected = picture(FrameRenderer(geometry, CAMERA), pose, "depth", "range", "geom", "normal", "radial_velocity")
        out = {name: np.empty_like(array) for name, array in expected.items()}
        table.take(pose.p_WC, pose.R_WC, pose.v_WC_W, light, None, out, 0.05, 10_000.0, True, True, True, 0, 120, 1)
        same = out["geom"] == expected["geom"]
        assert same.mean() > 0.999
        seen = same & (expected["geom"] >= 0) & (expected["range"] < 100.0)
        for name, within in (("depth", 2e-4), ("range", 2e-4), ("radial_velocity", 1e-5)):
            assert float(np.quantile(np.abs(out[name][seen] - expected[name][seen]), 0.999)) < within, name
        unculled = {name: np.empty_like(array) for name, array in expected.items()}
        table.take(
            pose.p_WC, pose.R_WC, pose.v_WC_W, light, None, unculled, 0.05, 10_000.0, False, False, True, 0, 120, 1
        )
        assert digest(unculled) == digest(out)


@pytest.mark.parametrize("distortion", [None, BrownConrady(k1=-0.1, k2=0.01)])
def test_leaving_out_backs_changes_single_pixels_of_outlines(
    geometry: FrameGeometry, distortion: BrownConrady | None
) -> None:
    """There front and back of a fine mesh are closer than the rounding of their distances."""
    camera = replace(CAMERA, distortion=distortion)
    skipped = FrameRenderer(geometry, camera)
    whole = FrameRenderer(geometry, camera, execution=Execution(skips=RenderSkips(mesh_backs=False)))
    differing, drawn = 0, 0
    for i in range(24):
        angle = TURN_RAD * i / 24.0
        at = (25.0 * math.cos(angle), 25.0 * math.sin(angle), 1.8 + 0.4 * i)
        a, b = (picture(renderer, looking(at, (0.0, 0.0, 1.0)), "depth", "instance") for renderer in (skipped, whole))
        other = a["depth"] != b["depth"]
        same_thing = other & (a["instance"] == b["instance"])
        assert np.abs(a["depth"][same_thing] - b["depth"][same_thing]).max(initial=0.0) < 2e-3
        differing, drawn = differing + int(other.sum()), drawn + other.size
    assert differing <= 1e-5 * drawn


CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
CUBE_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
     [1, 5, 7], [1, 7, 3]],
    np.int32,
)  # fmt: skip


def native(vertex: NDArray[np.float32], triangle: NDArray[np.int32]) -> tuple[Geometry, Scenery]:
    """A mesh at (0, 0, 5), moving."""
    geometry, scenery = Geometry(), Scenery()
    mesh = geometry.add_mesh(vertex, triangle, None, None)
    identity = (1.0, 0, 0, 0, 1, 0, 0, 0, 1)
    geometry.add_geom(7, (1.0, 1, 1), (0.0, 0, 5), identity, mesh, False, True, 1, 1, 1)
    geometry.finish()
    scenery.add_geom((0.5, 0.5, 0.5), 0.0, -1, 1.0, 1.0, False)
    return geometry, scenery


def depths(made: tuple[Geometry, Scenery], z_m: float, *, backs: bool) -> NDArray[np.float32]:
    """Return the depths that a camera at (0.1, 0.1, z) sees along +z."""
    light = FrameRenderer(FrameGeometry(load_world(load_scene("airfield"))), CAMERA)._light
    camera = Picture(*made, 16, 16, 16.0, 16.0, 8.0, 8.0)
    out = {"depth": np.zeros((16, 16), np.float32)}
    pose = ((0.1, 0.1, z_m), (1.0, 0, 0, 0, 1, 0, 0, 0, 1), (0.0, 0, 0))
    camera.take(*pose, light, None, out, 0.05, 100.0, True, True, backs, 0, 16, 1)
    return out["depth"]


@pytest.mark.parametrize("z_m", [0.0, 3.9, 3.96, 3.98, 3.9999, 4.5, 5.9])
def test_a_closed_mesh_is_seen_from_far_near_and_within(z_m: float) -> None:
    # Where the near limit of 5 cm cuts the front away, the back is seen, as of a box.
    front, back = 4.0 - z_m, 6.0 - z_m
    middle = depths(native(CUBE, CUBE_FACES), z_m, backs=True)[8, 8]
    assert middle == pytest.approx(front if front >= 0.05 else back, abs=1e-5)


@pytest.mark.parametrize("wound", ["outwards", "inwards", "second inwards", "open"])
def test_leaving_out_the_backs_of_meshes_changes_no_bit(wound: str) -> None:
    second = CUBE * 1.5 + np.float32([0, 0, 6])
    faces = [CUBE_FACES, CUBE_FACES + 8]
    if wound == "inwards":
        faces = [f[:, ::-1] for f in faces]
    elif wound == "second inwards":
        faces = [CUBE_FACES[:, ::-1], CUBE_FACES + 8]
    elif wound == "open":
        faces = [CUBE_FACES[:-1], CUBE_FACES[1:] + 8]
    made = native(np.concatenate([CUBE, second]), np.ascontiguousarray(np.concatenate(faces)))
    for z_m in (-3.0, 3.0, 3.97, 4.4, 7.0):
        assert np.array_equal(depths(made, z_m, backs=True), depths(made, z_m, backs=False)), z_m


@pytest.mark.parametrize("lens", ["pinhole", "table"])
def test_a_triangle_of_kilometres_is_hidden_by_a_wall_before_it(lens: str) -> None:
    # All of it is more than 10.6 m away, but rounding of its far corner gives hits from 6.0 m on.
    far = np.array(
        [[8452.25, -8749.073, 73008.93], [-3.8728821, 1.1025521, 10.643814], [-2.176363, -2.403555, 10.94445]]
    )
    geometry, scenery = Geometry(), Scenery()
    mesh = geometry.add_mesh(far.astype(np.float32), np.array([[0, 1, 2]], np.int32), None, None)
    identity = (1.0, 0, 0, 0, 1, 0, 0, 0, 1)
    geometry.add_geom(7, (1.0, 1, 1), (0.0, 0, 0), identity, mesh, False, True, 1, 1, 1)
    geometry.add_geom(6, (50.0, 50, 0.1), (0.0, 0, 9), identity, -1, False, True, 1, 1, 1)
    geometry.finish()
    for _ in range(2):
        scenery.add_geom((0.5, 0.5, 0.5), 0.0, -1, 1.0, 1.0, False)
    model = CameraModel(16, 16, 16.0, 16.0, 8.0, 8.0)
    table = np.ascontiguousarray(model.rays(), np.float64)
    camera = (
        Picture(geometry, scenery, table)
        if lens == "table"
        else Picture(geometry, scenery, 16, 16, 16.0, 16.0, 8.0, 8.0)
    )
    light = FrameRenderer(FrameGeometry(load_world(load_scene("airfield"))), CAMERA)._light
    for occlusion in (True, False):
        out = {"geom": np.zeros((16, 16), np.int32)}
        camera.take((0.0, 0, 0), identity, (0.0, 0, 0), light, None, out, 0.05, 1e6, True, occlusion, True, 0, 16, 1)
        assert (out["geom"] == 1).all(), f"occlusion {occlusion}"


def test_geometry_refuses_what_would_break_it() -> None:
    geometry, scenery = native(CUBE, CUBE_FACES)
    index, one, rotation = np.zeros(1, np.int32), np.zeros((1, 3)), np.eye(3)[None].copy()
    for refused in (
        lambda: geometry.move(index, one, rotation, one, one),
        lambda: geometry.add_mesh(CUBE, CUBE_FACES, None, None),
        lambda: geometry.add_geom(2, (1.0, 0, 0), (0.0, 0, 0), (1.0, 0, 0, 0, 1, 0, 0, 0, 1), -1, False, True, 0, 0, 0),
        lambda: Geometry().add_mesh(CUBE, CUBE_FACES + 1, None, None),
        lambda: scenery.add_texture([np.zeros((8192, 4, 3), np.uint8)] * 2, False),
        lambda: scenery.add_texture([np.zeros((6, 6, 3), np.uint8)], False),
        lambda: scenery.add_geom((1.0, 1, 1), 0.0, 5, 1.0, 1.0, False),
    ):
        with pytest.raises(ValueError):  # noqa: PT011 (each says what is wrong in words of its own)
            refused()


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads Linux's count of pages")
def test_scenes_that_are_gone_give_back_their_memory() -> None:
    texels = [np.full((edge, edge, 3), edge % 251, np.uint8) for edge in (512, 256, 128, 64)]

    def scenes(count: int) -> int:
        for i in range(count):
            kept.append(native(np.tile(CUBE, (500 + 100 * i, 1)), np.tile(CUBE_FACES, (500, 1))))
            kept[-1][1].add_texture(texels, False)
            del kept[:-2]
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()

    kept: list[tuple[Geometry, Scenery]] = []
    before = scenes(5)
    assert scenes(30) - before < 25 * 2**20  # 30 scenes have 75 MiB


def test_shadows_do_not_depend_on_when_they_were_first_drawn() -> None:
    world = load_world(load_scene("radar_range"))
    pose = looking((-3.0, -4.0, 2.5), (3.0, 0.5, 0.5))
    pictures = []
    for first_ns in (0, 7_000_000_000):
        geometry = FrameGeometry(world)
        geometry.pose(first_ns)
        renderer = FrameRenderer(geometry, CAMERA, shadows=True)
        renderer.render(pose, renderer.buffers("rgb"))
        geometry.pose(7_000_000_000)
        pictures.append(digest(picture(renderer, pose, "rgb")))
    assert pictures[0] == pictures[1]


def test_a_lens_leaves_out_what_it_cannot_see(geometry: FrameGeometry) -> None:
    lens = replace(CAMERA, distortion=BrownConrady(k1=-0.1, k2=0.01))
    counts = []
    for pose in VIEWS:
        culled = FrameRenderer(geometry, lens)
        everything = FrameRenderer(geometry, lens, execution=Execution(skips=RenderSkips.none()))
        assert digest(picture(culled, pose)) == digest(picture(everything, pose))
        counts.append((culled._picture.counts.geoms, everything._picture.counts.geoms))
    # The first sees most of the park from a corner, the second half of it.
    assert counts[1][0] < 0.7 * counts[1][1]


@pytest.mark.parametrize("size", [(1, 1), (3, 5), (4, 4), (33, 2), (161, 121)])
def test_sizes_that_are_no_multiple_of_a_block(geometry: FrameGeometry, size: tuple[int, int]) -> None:
    width, height = size
    camera = CameraModel(width, height, 80.0, 80.0, width / 2, height / 2)
    out = {name: channel.empty(height + 2, width) for name, channel in CHANNELS.items()}
    for array in out.values():
        array.view(np.uint8)[...] = 0x5A
    inner = {name: array[1:-1] for name, array in out.items()}
    FrameRenderer(geometry, camera).render(VIEWS[0], inner)
    for array in out.values():
        assert (array[[0, -1]].view(np.uint8) == 0x5A).all()


def test_poses_that_are_nowhere_see_nothing(geometry: FrameGeometry) -> None:
    renderer = FrameRenderer(geometry, CAMERA, shadows=True)
    for bad in (float("nan"), float("inf"), 1e300):
        out = picture(renderer, replace(VIEWS[0], p_WC=(bad, 0.0, 0.0)))
        assert (out["geom"] == -1).all()
        assert np.isposinf(out["depth"]).all()
        assert not out["normal"].any()


def test_an_empty_world_has_a_sky() -> None:
    native, scenery = Geometry(), Scenery()
    native.finish()
    light = FrameRenderer(FrameGeometry(load_world(load_scene("airfield"))), CAMERA)._light
    camera = Picture(native, scenery, 8, 8, 8.0, 8.0, 4.0, 4.0)
    out = {"rgb": np.zeros((8, 8, 3), np.uint8), "geom": np.zeros((8, 8), np.int32)}
    shadows = SunShadows(native, (0.0, 0.6, 0.8), 64)
    shadows.update(True, None, VIEWS[0].p_WC, VIEWS[0].R_WC)
    camera.take(VIEWS[0].p_WC, VIEWS[0].R_WC, (0, 0, 0), light, shadows, out, 0.1, 100.0, True, True, True, 0, 8, 1)
    assert (out["geom"] == -1).all()
    assert out["rgb"].min() > 0


def test_shadows_of_what_is_out_of_sight_are_drawn_and_others_change_nothing() -> None:
    """Spheres around, above and behind two cameras that share a shadow map, each seen before and after they move."""
    rng = np.random.Generator(np.random.Philox(8))
    native, scenery, sun_W = Geometry(), Scenery(), (0.48, 0.64, 0.6)
    native.add_geom(0, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), tuple(np.eye(3).ravel()), -1, False, True, 0, 0, 0)
    native.add_geom(6, (20.0, 20.0, 0.1), (0.0, 0.0, 0.0), tuple(np.eye(3).ravel()), -1, False, True, 0, 0, 0)
    for _ in range(60):
        native.add_geom(2, (0.3, 0.0, 0.0), (0.0, 0.0, 1.0), tuple(np.eye(3).ravel()), -1, True, True, 0, 0, 0)
    native.finish()
    for _ in range(62):
        scenery.add_geom((0.5, 0.5, 0.5), 0.0, -1, 1.0, 1.0, False)
    grey = (0.3, 0.3, 0.3)
    light = Daylight(sun_W, (1.0, 1.0, 1.0), grey, grey, grey, grey, grey, 0.0, 1.0)
    camera = Picture(native, scenery, 80, 60, 45.0, 45.0, 40.0, 30.0)
    some, every = (SunShadows(native, sun_W, 512) for _ in range(2))
    rgb = np.zeros((2, 60, 80, 3), np.uint8)
    drawn = {"geom": np.zeros((60, 80), np.int32)}
    cast_from_beyond = 0
    for _ in range(4):
        centres = rng.uniform((-12.0, -12.0, 0.5), (12.0, 12.0, 8.0), (60, 3))
        still = np.zeros((60, 3))
        native.move(np.arange(2, 62, dtype=np.int32), centres, np.tile(np.eye(3), (60, 1, 1)), still, still)
        for pose in (looking((-8.0, -6.0, 3.0), (0.0, 0.0, 0.0)), looking((7.0, 8.0, 2.0), (9.0, 9.0, 1.0))):
            some.update(True, camera, pose.p_WC, pose.R_WC)
            every.update(True, None, pose.p_WC, pose.R_WC)
            for shadows, colour in zip((some, every), rgb, strict=True):
                out = {**drawn, "rgb": colour}
                camera.take(
                    pose.p_WC, pose.R_WC, (0, 0, 0), light, shadows, out, 0.1, 100.0, True, True, True, 0, 60, 1
                )
            assert np.array_equal(rgb[0], rgb[1])
            # A sphere out of sight whose shadow on the floor lies in the middle of the picture.
            feet = centres - centres[:, 2:] / sun_W[2] * np.array(sun_W)
            to_C = np.reshape(pose.R_WC, (3, 3))
            seen = [_is_within((points - np.array(pose.p_WC)) @ to_C) for points in (centres, feet)]
            cast_from_beyond += int(np.count_nonzero(~seen[0] & seen[1]))
    assert cast_from_beyond >= 5


def _is_within(points_C: NDArray[np.float64]) -> NDArray[np.bool_]:
    x, y, z = points_C.T
    return (z > 0.1) & (np.abs(x) < 0.8 * z) & (np.abs(y) < 0.6 * z)


@pytest.mark.parametrize("isa", ISAS)
def test_the_floor_is_shaded_where_a_ray_to_the_sun_meets_a_shape(isa: str) -> None:
    rng = np.random.Generator(np.random.Philox(5))
    native, scenery, sun_W = Geometry(), Scenery(), (0.36, 0.48, 0.8)
    native.add_geom(0, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), tuple(np.eye(3).ravel()), -1, False, True, 0, 0, 0)
    for i in range(40):
        shape, moving = (2, 4, 6)[i % 3], i % 2 == 1
        size, place = rng.uniform(0.2, 0.7, 3), rng.uniform((-5.0, -5.0, 1.0), (5.0, 5.0, 3.0))
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        native.add_geom(shape, tuple(size), tuple(place), tuple(turn.ravel()), -1, moving, True, 0, 0, 0)
    native.finish()
    for _ in range(41):
        scenery.add_geom((0.5, 0.5, 0.5), 0.0, -1, 1.0, 1.0, False)
    grey = (0.3, 0.3, 0.3)
    light = Daylight(sun_W, (1.0, 1.0, 1.0), grey, grey, grey, grey, grey, 0.0, 1.0)
    camera, pose = (
        Picture(native, scenery, 160, 120, 90.0, 90.0, 80.0, 60.0, isa),
        looking((-6.0, -4.0, 14.0), (0.0, 0.0, 0.0)),
    )
    shadows = SunShadows(native, sun_W, 512, isa)
    shadows.update(True, camera, pose.p_WC, pose.R_WC)
    rgb = np.zeros((2, 120, 160, 3), np.uint8)
    out = {"depth": np.zeros((120, 160), np.float32), "geom": np.zeros((120, 160), np.int32)}
    for shade, colour in zip((None, shadows), rgb, strict=True):
        out["rgb"] = colour
        camera.take(pose.p_WC, pose.R_WC, (0, 0, 0), light, shade, out, 0.1, 100.0, True, True, True, 0, 120, 1)
    y, x = np.nonzero(out["geom"] == 0)
    d_C = np.stack([(x - 79.5) / 90.0, (y - 59.5) / 90.0, np.ones(len(x))], axis=1)
    p_W = np.array(pose.p_WC) + out["depth"][y, x, None] * (d_C @ np.reshape(pose.R_WC, (3, 3)).T)
    p_W[:, 2] = 0.001
    range_m, met = np.empty(len(x)), np.empty(len(x), np.int32)
    RayCaster(native).cast(p_W, np.tile(sun_W, (len(x), 1)), 0.0, 100.0, range_m, met)
    near = np.abs(p_W[:, :2]).max(axis=1) < 5.0
    shaded = (rgb[0] != rgb[1]).any(axis=-1)[y, x]
    assert 0.2 < shaded[near].mean() < 0.8
    assert np.count_nonzero(shaded[near] != (met[near] >= 0)) <= 2


def test_arrays_that_do_not_fit_are_refused(geometry: FrameGeometry) -> None:
    renderer = FrameRenderer(geometry, CAMERA)
    good = renderer.buffers("depth")["depth"]
    for bad in (good[:-1], good.T.copy(), good.astype(np.float64), np.asfortranarray(good), good[:, ::2]):
        with pytest.raises(TypeError, match="depth"):
            renderer.render(VIEWS[0], {"depth": bad})
    fixed = good.copy()
    fixed.flags.writeable = False
    with pytest.raises(TypeError, match="depth"):
        renderer.render(VIEWS[0], {"depth": fixed})
    with pytest.raises(KeyError, match="no channel 'colour'"):
        renderer.render(VIEWS[0], {"colour": good})
    for rows in ((2, 8), (0, 6), (8, 4), (-4, 8), (0, 124)):
        with pytest.raises(ValueError, match="rows"):
            renderer.render(VIEWS[0], {"depth": good}, rows=rows)
    for message, wrong in (
        (r"planes_m \(0, 1\)", {"planes_m": (0.0, 1.0)}),
        (r"planes_m \(0.05, 0.01\)", {"planes_m": (0.05, 0.01)}),
        ("supersample", {"supersample": 3}),
        ("threads", {"execution": Execution(threads=0)}),
    ):
        with pytest.raises(ValueError, match=message):
            FrameRenderer(geometry, CAMERA, **wrong)
