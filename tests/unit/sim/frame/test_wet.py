"""Rain on the window and on surfaces: closed forms of opacity, number and albedo, and what stays the same."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from signals.noise import noise_key
from sim.frame.camera_model import CameraModel
from sim.frame.geometry import FrameGeometry
from sim.frame.lens_drops import Drop, LensDrops
from sim.frame.renderer import FrameRenderer
from sim.frame.source import SharedFrames
from sim.frame.wet_surface import wet_albedo, wet_colour, wetness
from sim.scene.precipitation import rain
from sim.scene.scene import load_scene
from sim.scene.srgb import linear, srgb
from sim.scene.weather import Weather
from sim.sensors.camera_parameters import LensDrops as Settings
from sim.world_loader import load_world
from tests.unit.sim.frame.test_thermal import NOON, lit, pose, shot

CAMERA = CameraModel.from_fov(160, 120, 90.0)
S_NS = 1_000_000_000


def drops(rate: float = 20.0, seed: int = 1, **values: Any) -> LensDrops:
    return LensDrops(rain(rate), CAMERA, Settings(**values), noise_key(seed, "front.window"))


def test_as_many_drops_as_the_rain_brings() -> None:
    """Little's law: the number on the window is the rate of arrival times the mean stay."""
    window = drops(20.0)
    widths = np.linspace(0.3, 6.0, 20_000)
    falling = rain(20.0)
    n = falling.n0_per_m3_mm * np.exp(-falling.slope_per_mm * widths)
    flux = np.trapezoid(n * np.maximum(9.65 - 10.3 * np.exp(-0.6 * widths), 0.1), widths)
    assert window.flux_per_m2_s == pytest.approx(flux, rel=0.01)
    area_m2 = (2.0 * 10e-3 + 2e-3) * (1.5 * 10e-3 + 2e-3)
    wanted = 0.3 * area_m2 * flux * 4.0
    counts = [len(window.on_window(k * 7 * S_NS)) for k in range(1500)]
    assert float(np.mean(counts)) == pytest.approx(wanted, abs=4.0 * math.sqrt(wanted / 1000.0))
    assert float(np.var(counts)) == pytest.approx(wanted, rel=0.25)  # Poisson


def test_drops_stay_and_are_a_function_of_the_time_alone() -> None:
    window = drops(50.0)
    now, soon, late = (set(window.on_window(t)) for t in (10 * S_NS, 10 * S_NS + S_NS // 10, 30 * S_NS))
    assert len(now & soon) > 0.8 * len(now)
    assert not now & late
    assert window.on_window(10 * S_NS) == drops(50.0).on_window(10 * S_NS)
    assert window.on_window(10 * S_NS) != drops(50.0, seed=2).on_window(10 * S_NS)


@pytest.mark.parametrize("width_mm", [1.0, 2.0, 4.0])
def test_opacity_is_that_of_two_discs(width_mm: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """A picture that is white in one small part: the drop shows the blurred mean by its share of the pupil."""
    window = drops()
    monkeypatch.setattr(window, "on_window", lambda _: [Drop(80.5, 60.5, width_mm)])
    rgb = np.zeros((120, 160, 3), np.uint8)
    rgb[59:61, 79:82] = 255  # where the drop's middle is: it is hidden by the share a
    before = rgb.copy()
    window.draw(rgb, 0)
    a = min(1.0, (width_mm / 2.0) ** 2)
    seen = linear(int(rgb[60, 80, 0]) / 255.0)
    if a < 1.0:
        assert 1.0 - a <= seen <= 1.0 - a + a * 0.2
    else:
        assert seen <= 0.2
    reach_px = 0.5 * (width_mm + 2.0) / 10.0 * CAMERA.fx
    v, u = np.mgrid[0:120, 0:160]
    outside = np.hypot(u + 0.5 - 80.5, v + 0.5 - 60.5) > reach_px + 1.0
    np.testing.assert_array_equal(rgb[outside], before[outside])


def test_a_drop_shows_the_picture_upside_down(monkeypatch: pytest.MonkeyPatch) -> None:
    window = drops()
    monkeypatch.setattr(window, "on_window", lambda _: [Drop(80.0, 60.0, 4.0)])
    rgb = np.zeros((120, 160, 3), np.uint8)
    rgb[:60] = 200  # sky
    window.draw(rgb, 0)
    assert rgb[54, 80, 0] < 20
    assert rgb[65, 80, 0] > 180


def test_a_camera_without_rain_or_key_keeps_its_bits() -> None:
    dry = SharedFrames(load_world(lit(NOON)))
    plain = shot(dry, channels=("rgb",)).channels["rgb"]
    np.testing.assert_array_equal(shot(dry, channels=("rgb",), lens_drops={}).channels["rgb"], plain)


def test_impossible_windows_are_refused() -> None:
    dry = SharedFrames(load_world(lit(NOON)))
    with pytest.raises(ValueError, match="stay_s"):
        shot(dry, channels=("rgb",), lens_drops={"stay_s": 1000.0})


# Wet surfaces ----------------------------------------------------------------------------------------------------


def test_the_albedo_is_angstrom_s() -> None:
    assert wet_albedo(0.0) == 0.0
    assert wet_albedo(1.0) == 1.0
    assert wet_albedo(0.3) == pytest.approx(0.3 / (1.33**2 * 0.7 + 0.3))
    codes = np.linspace(0.0, 1.0, 50)
    assert [srgb(linear(code)) for code in codes] == pytest.approx(codes, abs=1e-6)
    assert (wetness(0.0), wetness(1.0), wetness(50.0)) == (0.0, 0.5, 1.0)
    r, g, b = wet_colour((0.8, 0.5, 0.2), (1.0, 1.0, 1.0), 1.0)
    assert linear(r) == pytest.approx(wet_albedo(linear(0.8)))
    assert b / g < 0.2 / 0.5  # more saturated
    assert g < 0.5


def ground(weather: Weather) -> NDArray[np.float64]:
    """Return the linear light of level ground, without the air between."""
    scene = lit(NOON).model_copy(update={"weather": weather})
    renderer = FrameRenderer(FrameGeometry(load_world(scene)), CAMERA, light=NOON)
    out = renderer.buffers("rgb")
    renderer.render(pose((0.0, 90.0, 0.0), 20.0), out)
    return np.array([linear(code / 255.0) for code in out["rgb"][5, 5].tolist()])


def test_wet_ground_is_darker_by_its_albedo() -> None:
    dry, damp, wet = (ground(Weather(rain_mm_per_h=rate)) for rate in (0.0, 1.0, 10.0))
    world = load_world(lit(NOON))
    rgba = (
        world.model.mat_rgba[world.model.geom_matid[0]] if world.model.geom_matid[0] >= 0 else world.model.geom_rgba[0]
    )
    for channel in range(3):
        albedo = linear(float(rgba[channel]))
        assert wet[channel] / dry[channel] == pytest.approx(wet_albedo(albedo) / albedo, rel=0.03)
        assert damp[channel] == pytest.approx(0.5 * (dry[channel] + wet[channel]), rel=0.03)


def test_snow_and_haze_wet_nothing() -> None:
    for weather in (Weather(snow_mm_per_h=2.0), Weather(visibility_m=100.0)):
        np.testing.assert_array_equal(ground(weather), ground(Weather()))


def test_leaves_and_glass_stay_as_they_are() -> None:
    from sim.frame.wet_surface import soaks
    from sim.scene import surfaces

    assert [soaks(s) for s in (surfaces.ASPHALT, surfaces.CONCRETE, surfaces.BRICK, surfaces.WOOD)] == [True] * 4
    assert not any(soaks(s) for s in (surfaces.GLASS, surfaces.METAL, surfaces.LEAVES, surfaces.GRASS, surfaces.SKIN))
    assert load_scene("city_park").weather.rain_mm_per_h == 0.0
