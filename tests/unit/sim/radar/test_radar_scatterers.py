"""Pictures to echoes: what is kept, what is left out and counted, and the same bits from every instruction set."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pydantic
import pytest
from numpy.typing import NDArray

from signals.channels import CHANNELS
from sim.frame.camera_model import CameraModel
from sim.frame.distortion import BrownConrady
from sim.radar.antenna import Antenna, Pattern
from sim.radar.echoes import Echoes
from sim.radar.mask import Mask
from sim.radar.reflection import Reflection
from sim.radar.scatterers import PATTERN_FLOOR, Scatterers, solid_angles
from sim.scene.world import World
from tests.worlds.radar_scenes import ANTENNA, CHIRP, LAMBERT, POWER_SCALE, RECEIVER, WIDE, world_of

CAMERA = CameraModel.from_fov(37, 11, 60.0)  # 407 pixels: the last block of 16 is not whole
Picture = dict[str, NDArray[Any]]


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    geoms = '<geom size="1" material="m"/><geom type="plane" size="0 0 1"/>'
    return world_of(tmp_path_factory.mktemp("world"), geoms, LAMBERT)


def facing(camera: CameraModel, range_m: float = 5.0) -> Picture:
    """Everything at one distance, facing the camera, at rest."""
    picture = {name: CHANNELS[name].empty(camera.height, camera.width) for name in CHANNELS}
    picture["range"][:] = range_m
    picture["normal"][:] = -camera.rays()
    picture["material"][:] = 1
    picture["segmentation"][:] = 1
    picture["radial_velocity"][:] = 0.0
    return picture


def copies(echoes: Echoes) -> list[bytes]:
    return [a.tobytes() for a in (echoes.range_m, echoes.speed_mps, echoes.direction_R, echoes.amplitude)]


def random_picture(camera: CameraModel, world: World, seed: int) -> Picture:
    """Everything that a picture can hold, and what it should not."""
    rng = np.random.default_rng(seed)
    picture = facing(camera)
    size = (camera.height, camera.width)
    picture["range"][:] = rng.uniform(0.1, 30.0, size)
    picture["radial_velocity"][:] = rng.normal(0.0, 3.0, size)
    normal = rng.normal(size=(*size, 3))
    picture["normal"][:] = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    picture["material"][:] = rng.integers(0, len(world.surfaces), size)
    picture["segmentation"][:] = rng.integers(0, len(world.class_names), size)
    for name in ("range", "radial_velocity", "normal"):
        flat = picture[name].reshape(-1)
        flat[rng.integers(0, flat.size, flat.size // 20)] = np.nan
        flat[rng.integers(0, flat.size, flat.size // 20)] = np.inf
        flat[rng.integers(0, flat.size, flat.size // 40)] = -np.inf
        flat[rng.integers(0, flat.size, flat.size // 40)] = 0.0
    return picture


def test_one_echo_a_pixel_in_closed_form(world: World) -> None:
    made = Scatterers(CAMERA, world, CHIRP, ANTENNA, RECEIVER)
    picture = facing(CAMERA)
    picture["radial_velocity"][:] = np.arange(407).reshape(11, 37)
    echoes = made.collect(picture)
    assert made.last.kept == len(echoes.range_m) == made.last.pixels == 407
    assert np.all(echoes.range_m == 5.0)
    assert np.array_equal(echoes.speed_mps, np.arange(407.0))  # in the order of the pixels
    x, y, z = CAMERA.rays().reshape(-1, 3).T
    assert np.array_equal(echoes.direction_R, np.stack([z, -x, -y], axis=1))
    sigma0 = Reflection().backscatter(world.surfaces[1], CHIRP.center_frequency_hz, np.ones(1))[0]
    share = ANTENNA.share(echoes.direction_R)
    expected = POWER_SCALE * share * sigma0 * solid_angles(CAMERA).reshape(-1) / 5.0**2
    assert echoes.amplitude**2 == pytest.approx(
        expected, rel=3e-5
    )  # its lobe makes 50 times as much of a float's last bit
    for column in (echoes.range_m, echoes.speed_mps, echoes.direction_R, echoes.amplitude):
        assert column.flags.c_contiguous
        assert column.dtype == np.float64


def test_each_pixel_left_out_counts_once(world: World) -> None:
    picture = facing(CAMERA)
    first = {name: array.reshape(407, -1) for name, array in picture.items()}
    first["range"][0:3] = np.inf
    first["material"][2:5] = 0  # pixel 2 is sky already
    first["range"][5] = np.nan
    first["range"][6] = -np.inf
    first["range"][7] = 0.0
    first["normal"][8, 1] = np.nan
    first["normal"][9] = 1e30
    first["normal"][10] = -np.inf
    first["radial_velocity"][11] = np.nan
    first["radial_velocity"][12] = np.inf
    first["normal"][13:15] *= -1.0
    first["normal"][15] = 0.0
    first["range"][400:407] = 9.0
    first["segmentation"][390:400] = 2
    name = world.class_names[1]
    made = Scatterers(CAMERA, world, CHIRP, ANTENNA, RECEIVER, Mask(max_range_m=8.0, classes=(name,)))
    assert "segmentation" in made.channels
    echoes = made.collect(picture)
    last = made.last
    assert (last.sky, last.nothing, last.away, last.range, last.classes) == (3, 2, 3, 7, 10)
    assert last.invalid == 8
    assert last.kept == len(echoes.amplitude) == 407 - 33
    assert sum(asdict(last).values()) == 2 * 407  # the report holds their number, too
    first_R = echoes.direction_R[0].copy()  # what follows uses the buffer again
    everything = Scatterers(CAMERA, world, CHIRP, ANTENNA, RECEIVER).collect(facing(CAMERA))
    assert np.array_equal(first_R, everything.direction_R[16])


@pytest.mark.parametrize("camera", [CAMERA, CameraModel.from_fov(5, 3, 90.0), CameraModel.from_fov(64, 4, 90.0)])
def test_no_nan_gets_through_and_all_instruction_sets_agree(world: World, camera: CameraModel) -> None:
    mask = Mask(classes=tuple(world.class_names[1:4]), azimuth_deg=(-40.0, 35.0), max_range_m=25.0)
    for seed in range(3):
        picture = random_picture(camera, world, seed)
        answers = []
        for isa in ("base", "avx2", "avx512"):
            try:
                made = Scatterers(camera, world, CHIRP, ANTENNA, RECEIVER, mask, isa=isa)
                echoes = made.collect(picture)
            except ValueError as error:
                assert "this CPU has no" in str(error)  # noqa: PT017
                continue
            answers.append((made.last, copies(echoes)))
            assert sum(asdict(made.last).values()) == 2 * made.last.pixels
            for column in (echoes.range_m, echoes.speed_mps, echoes.direction_R, echoes.amplitude):
                assert np.all(np.isfinite(column))
            assert np.all(echoes.amplitude > 0.0)
        assert all(answer == answers[0] for answer in answers)


def test_the_buffers_are_used_again_and_a_second_picture_forgets_the_first(world: World) -> None:
    made = Scatterers(CAMERA, world, CHIRP, ANTENNA, RECEIVER)
    pictures = [random_picture(CAMERA, world, seed) for seed in (1, 2)]
    first = copies(made.collect(pictures[0]))
    address = made.collect(pictures[1]).amplitude.ctypes.data
    again = made.collect(pictures[0])
    assert copies(again) == first
    assert again.amplitude.ctypes.data == address


def test_solid_angles_add_up_to_the_view() -> None:
    camera = CameraModel.from_fov(320, 240, 90.0)
    a, b = camera.cx / camera.fx, camera.cy / camera.fy
    view = 4.0 * math.asin(a * b / math.sqrt((1.0 + a * a) * (1.0 + b * b)))  # a rectangle seen from before its middle
    each = solid_angles(camera)
    assert each.sum() == pytest.approx(view, rel=1e-12)
    assert each[120, 160] == pytest.approx(1.0 / camera.fx**2, rel=1e-4)  # on the axis a pixel is 1 / f across


def test_solid_angles_of_a_distorted_lens() -> None:
    """The Jacobian of the rays, by differences, is the same."""
    camera = CameraModel.from_fov(80, 60, 80.0, BrownConrady(-0.12, 0.02, 0.001, -0.0005))
    h = 1e-4
    right, down = np.array([h, 0.0]), np.array([0.0, h])
    x, y = (np.arange(80) + 0.5 - camera.cx) / camera.fx, (np.arange(60) + 0.5 - camera.cy) / camera.fy
    seen = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    d_x = (camera.directions(seen + right) - camera.directions(seen - right)) / (2.0 * h * camera.fx)
    d_y = (camera.directions(seen + down) - camera.directions(seen - down)) / (2.0 * h * camera.fy)
    jacobian = np.linalg.norm(np.cross(d_x, d_y), axis=1)
    assert solid_angles(camera).reshape(-1) == pytest.approx(jacobian, rel=2e-3)


def test_windows_and_pattern_leave_out_what_they_say(world: World) -> None:
    mask = Mask(azimuth_deg=(0.0, 20.0), elevation_deg=(-90.0, 0.0))
    made = Scatterers(CAMERA, world, CHIRP, ANTENNA, RECEIVER, mask)
    d = made.collect(facing(CAMERA)).direction_R
    azimuth, elevation = np.degrees(np.arctan2(d[:, 1], d[:, 0])), np.degrees(np.arcsin(d[:, 2]))
    assert azimuth.min() >= 0.0
    assert azimuth.max() <= 20.0
    assert elevation.max() <= 1e-12
    assert made.last.window == 407 - len(d) > 0

    narrow = Pattern(gain_dbi=20.0, azimuth_beamwidth_deg=12.0, elevation_beamwidth_deg=12.0)
    antenna = Antenna(rx_positions_m=((0.0, 0.0, 0.0),), tx=narrow, rx=WIDE)
    made = Scatterers(CAMERA, world, CHIRP, antenna, RECEIVER)
    d = made.collect(facing(CAMERA)).direction_R
    every = CAMERA.rays().reshape(-1, 3)
    share = antenna.share(np.stack([every[:, 2], -every[:, 0], -every[:, 1]], axis=1))
    assert len(d) == np.count_nonzero(share >= PATTERN_FLOOR) < 407
    assert made.last.pattern == 407 - len(d)
    assert share[share < PATTERN_FLOOR].sum() < 1e-4 * share.sum()  # what is left out does not matter


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"classes": ()}, "holds no visible class"),
        ({"classes": ("none",)}, "holds no visible class"),
        ({"azimuth_deg": (10.0, 10.0)}, "is empty"),
        ({"elevation_deg": (10.0, -10.0)}, "is empty"),
        ({"max_range_m": 0.0}, "greater than 0"),
        ({"max_range_m": math.nan}, "finite"),
    ],
)
def test_masks_that_cannot_be(values: dict[str, Any], words: str) -> None:
    with pytest.raises(pydantic.ValidationError, match=words):
        Mask.model_validate(values)


def test_pictures_that_do_not_fit(world: World) -> None:
    made = Scatterers(CAMERA, world, CHIRP, ANTENNA, RECEIVER)
    picture = facing(CAMERA)
    with pytest.raises(KeyError, match="no channel 'normal'; a radar needs range, normal"):
        made.collect({name: array for name, array in picture.items() if name != "normal"})
    with pytest.raises(ValueError, match="not of the camera's"):
        made.collect(facing(CameraModel.from_fov(37, 12, 60.0)))
    with pytest.raises(ValueError, match="differ in size"):
        made.collect(picture | {"material": np.ones((11, 36), np.uint8)})
    with pytest.raises(TypeError):
        made.collect(picture | {"range": picture["range"].astype(float)})
    picture["material"][3, 4] = len(world.surfaces)
    with pytest.raises(ValueError, match="1 pixels show a surface beyond the world's"):
        made.collect(picture)


def test_air_has_no_echo(tmp_path: Path) -> None:
    """Air sends nothing back: no echo of amplitude 0 goes on."""
    air = {"lidar_reflectivity": 0.0, "relative_permittivity": 1.0, "conductivity_s_per_m": 0.0, "roughness_m": 1e-3}
    empty = world_of(tmp_path, '<geom size="1" material="m"/>', air)
    picture = facing(CAMERA)
    picture["material"][:] = empty.geom_surface[0]
    made = Scatterers(CAMERA, empty, CHIRP, ANTENNA, RECEIVER)
    assert len(made.collect(picture).amplitude) == 0
    assert made.last.nothing == 407
