"""Levels of quality: what each draws, that geometry is the same at all, and which key wins where several speak."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hil.config import load_bench, save_bench
from signals.errors import ConfigError
from sim.frame.geometry import FrameGeometry
from sim.frame.quality import QUALITIES, with_quality
from sim.frame.renderer import FrameRenderer
from sim.scene.scene import load_scene
from sim.sensors.camera_parameters import CameraParameters
from sim.sensors.catalog import PRESETS, make_sensor
from sim.sensors.sensor import Installation
from sim.world_loader import load_world
from tests.unit.sim.frame.test_frame_raster import ALL, CAMERA, VIEWS, digest, picture
from tests.worlds.spheres_world import FormulaFrames

# Levels with shadows know what is in the shade, which is cooler.
GEOMETRY = tuple(name for name in ALL if name not in ("rgb", "temperature", "infrared"))


@pytest.fixture(scope="module")
def geometry() -> FrameGeometry:
    return FrameGeometry(load_world(load_scene("city_park")))


def drawn_at(geometry: FrameGeometry, name: str, **options: Any) -> FrameRenderer:
    q = QUALITIES[name]
    told = {"shadows": q.shadows, "supersample": q.supersample, "shading": q.shading} | options
    return FrameRenderer(geometry, CAMERA, **told)


def test_geometry_is_the_same_at_every_level_and_colour_at_none(geometry: FrameGeometry) -> None:
    geometries, colours = set(), set()
    for name in QUALITIES:
        supersample = QUALITIES[name].supersample * QUALITIES[name].resolution_factor  # as at one resolution
        renderer = drawn_at(geometry, name, supersample=supersample)
        geometries.add(digest(picture(renderer, VIEWS[0], *GEOMETRY)))
        colours.add(digest(picture(renderer, VIEWS[0], "rgb")))
    assert len(geometries) == 1
    assert len(colours) == len(QUALITIES)


def test_without_textures_surfaces_have_their_mean_colours(geometry: FrameGeometry) -> None:
    """Over each geom that fills many pixels, light is the same on the whole."""
    fine = picture(drawn_at(geometry, "medium", supersample=4), VIEWS[0], "rgb", "geom")
    plain = picture(drawn_at(geometry, "low"), VIEWS[0], "rgb")["rgb"]
    geoms, counts = np.unique(fine["geom"], return_counts=True)
    compared = 0
    for geom in geoms[(counts > 1500) & (geoms >= 0)]:
        pixels = fine["geom"] == geom
        mean = [np.mean((picture_[pixels] / 255.0) ** 2.2, axis=0) for picture_ in (fine["rgb"], plain)]
        assert np.allclose(mean[0], mean[1], rtol=0.15, atol=0.01), geom
        compared += 1
    assert compared >= 1


def test_sixteen_samples_are_the_mean_of_a_picture_four_times_as_fine(geometry: FrameGeometry) -> None:
    made = picture(FrameRenderer(geometry, CAMERA, supersample=4), VIEWS[1], "rgb")["rgb"]
    fine = picture(FrameRenderer(geometry, CAMERA.scaled(4)), VIEWS[1], "rgb")["rgb"]
    c = fine / 255.0
    light = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    mean = light.reshape(CAMERA.height, 4, CAMERA.width, 4, 3).mean(axis=(1, 3))
    code = 255.0 * np.where(mean <= 0.0031308, 12.92 * mean, 1.055 * mean ** (1.0 / 2.4) - 0.055)
    assert np.abs(made - code).max() < 1.2  # two roundings
    rows = picture(FrameRenderer(geometry, CAMERA, supersample=4), VIEWS[1], "rgb")
    part = np.zeros_like(rows["rgb"])
    FrameRenderer(geometry, CAMERA, supersample=4).render(VIEWS[1], {"rgb": part}, rows=(8, 20))
    assert np.array_equal(part[8:20], made[8:20])
    assert not part[:8].any()


def camera(*settings: str) -> CameraParameters:
    texts = [f"sensors.front={{{settings[0]}}}", *settings[1:]]
    found: CameraParameters = load_bench(settings=texts).config.sensors["front"].parameters
    return found


PRESET = "preset: camera_320x240, rate_hz: 10"
OWN = "kind: camera, resolution: [320, 240], fov_deg: 90, rate_hz: 10"


def look(p: CameraParameters) -> tuple[tuple[int, int], int, bool, bool]:
    return p.resolution, p.supersample, p.textures, p.shadows


def test_a_camera_says_its_level_and_keys_beside_it_win() -> None:
    assert look(camera(PRESET)) == ((320, 240), 1, True, False)
    assert look(camera(f"{PRESET}, quality: low")) == ((320, 240), 1, False, False)
    assert look(camera(f"{PRESET}, quality: medium")) == ((320, 240), 1, True, False)
    assert look(camera(f"{PRESET}, quality: high")) == ((320, 240), 1, True, True)
    assert look(camera(f"{PRESET}, quality: epic")) == ((320, 240), 2, True, True)
    assert look(camera(f"{PRESET}, quality: cinematic")) == ((640, 480), 2, True, True)
    assert look(camera(f"{PRESET}, quality: epic, shadows: false")) == ((320, 240), 2, True, False)
    assert look(camera(f"{OWN}, quality: low, textures: true")) == ((320, 240), 1, True, False)
    assert look(camera(f"{OWN}, quality: cinematic")) == ((320, 240), 4, True, True)


def test_the_bench_says_the_level_of_cameras_that_say_none(tmp_path) -> None:  # type: ignore[no-untyped-def]
    assert look(camera(PRESET, "quality=high")) == ((320, 240), 1, True, True)
    assert look(camera(f"{PRESET}, quality: low", "quality=high")) == ((320, 240), 1, False, False)
    bench = load_bench(settings=[f"sensors.front={{{PRESET}}}", "quality=cinematic"])
    again = load_bench(save_bench(bench, tmp_path))
    assert again.config.sensors == bench.config.sensors  # not twice as fine again


def test_a_calibration_goes_with_the_pixels() -> None:
    values = {"resolution": [320, 240], "intrinsics": {"fx": 160.0, "fy": 150.0, "cx": 159.5, "cy": 110.0}}
    coarse, fine = CameraParameters(**values), CameraParameters(**with_quality(values, "cinematic"))
    a, b = coarse.model(), fine.model()
    assert (b.width, b.height) == (640, 480)
    assert np.allclose(np.array([b.fx, b.fy, b.cx, b.cy]), 2.0 * np.array([a.fx, a.fy, a.cx, a.cy]))


def test_whoever_makes_a_camera_in_a_program_names_a_level_too() -> None:
    frames = FormulaFrames()
    told = {"rate_hz": 10.0, "seed": 1, "scene": load_scene("airfield"), "step_ns": 4_000_000, "frames": frames}
    made = make_sensor(
        Installation("c", **told), preset="camera_320x240", overrides={"quality": "epic", "shadows": False}
    )
    assert frames.options[0]["supersample"] == 2
    assert frames.options[0]["shadows"] is False
    assert made.model.width == PRESETS["camera_320x240"].parameters.resolution[0]  # type: ignore[attr-defined]


def test_cameras_that_mujoco_draws_take_shadows_and_pixels_only() -> None:
    values = with_quality({"resolution": [320, 240], "fov_deg": 90.0, "colour": "egl"}, "cinematic")
    assert look(CameraParameters(**values)) == ((640, 480), 1, True, True)


def test_an_unknown_level_is_reported() -> None:
    with pytest.raises(ConfigError, match="quality must be 'low', 'medium'"):
        camera(f"{PRESET}, quality: ultra")
    with pytest.raises(ConfigError, match="quality: must be 'low'"):
        camera(PRESET, "quality=best")
