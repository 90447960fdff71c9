"""Thermal camera: apparent temperatures against Planck's law, the sky, shade, people, noise and counts."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.constants import c, h, k, sigma
from scipy.integrate import quad
from scipy.optimize import brentq

from signals.samples import ImageSample, TruthState
from sim.frame.band_radiance import band_radiance, radiance_of, temperature_of
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.geometry import FrameGeometry
from sim.frame.infrared_air import AirTransmission, gas_transmission, haze_per_m
from sim.frame.mount import Mount
from sim.frame.renderer import FrameRenderer
from sim.frame.source import SharedFrames
from sim.scene.heat import climate_of, heat_of
from sim.scene.light import Light
from sim.scene.scene import Box, Scene, load_scene
from sim.scene.surfaces import DEFAULT_SURFACE
from sim.sensors.catalog import make_sensor
from sim.sensors.sensor import Installation
from sim.world_loader import load_world

ZERO = (0.0, 0.0, 0.0)
CAMERA = CameraModel.from_fov(64, 48, 90.0)
NIGHT = Light(sun_elevation_deg=-20.0, clouds=0.0)
NOON = Light(sun_azimuth_deg=180.0, sun_elevation_deg=50.0, clouds=0.0)
FIELD = Scene(
    name="field",
    description="bare ground with a box",
    site=load_scene("airfield").site,
    ground_friction=0.8,
    boxes=(Box(name="box", center_m=(8.0, 0.0, 2.0), size_m=(2.0, 4.0, 4.0)),),
)


def planck(temperature_k: float) -> float:
    def spectrum(wavelength_m: float) -> float:
        return 2 * h * c**2 / wavelength_m**5 / math.expm1(h * c / (wavelength_m * k * temperature_k))

    return quad(spectrum, 8e-6, 14e-6)[0]


def apparent_k(radiance: float) -> float:
    return float(brentq(lambda temperature: planck(temperature) - radiance, 100.0, 450.0))


def picture(scene: Scene, rpy_deg: Any = ZERO, *, shadows: bool = False, z: float = 2.0) -> dict[str, NDArray[Any]]:
    renderer = FrameRenderer(FrameGeometry(load_world(scene)), CAMERA, shadows=shadows)
    out = renderer.buffers("temperature", "infrared", "range", "geom", "normal")
    renderer.render(pose(rpy_deg, z), out)
    return out


def pose(rpy_deg: Any, z: float) -> CameraPose:
    truth = TruthState(0, 0, (0.0, 0.0, z), (1.0, 0.0, 0.0, 0.0), ZERO, ZERO, ZERO, ZERO, (), False)
    return Mount(ZERO, rpy_deg).pose(truth)


def lit(light: Light, **weather: Any) -> Scene:
    scene = FIELD.model_copy(update={"light": light})
    return scene.model_copy(update={"weather": scene.weather.model_copy(update=weather)})


@pytest.mark.parametrize("temperature_k", [150.0, 223.4, 288.15, 305.97, 400.0])
def test_the_band_radiance_is_planck_s(temperature_k: float) -> None:
    assert band_radiance(temperature_k) == pytest.approx(planck(temperature_k), rel=1e-8)
    values = np.array([temperature_k])
    assert radiance_of(values)[0] == pytest.approx(planck(temperature_k), rel=2e-6)
    assert temperature_of(np.array([planck(temperature_k)]))[0] == pytest.approx(temperature_k, abs=2e-3)


def test_a_grey_body_under_the_sky_has_the_apparent_temperature_of_the_formula() -> None:
    """Level ground straight below, at night: e L(T_s) + (1 - e) L_sky, and the air of the range between."""
    scene = lit(NIGHT)
    climate, heat = climate_of(scene), heat_of(DEFAULT_SURFACE)
    air_k = scene.site.air_degc + 273.15
    vapour = 0.5 * 6.112 * math.exp(17.62 * (air_k - 273.15) / (243.12 + air_k - 273.15))
    loss = sigma * air_k**4 * (1.0 - 0.52 - 0.065 * math.sqrt(vapour))
    surface_k = air_k - heat.share * heat.emissivity * loss / (5.7 + 3.8 + 4 * sigma * air_k**3)
    sky = 0.24 + 2.98e-8 * vapour**2 * math.exp(3000.0 / air_k)
    assert climate.sky_hemisphere == pytest.approx(sky, rel=1e-9)
    sent = heat.emissivity * planck(surface_k) + (1 - heat.emissivity) * sky * planck(air_k)
    tau = gas_transmission(20.0, air_k)
    wanted = apparent_k(tau * sent + (1 - tau) * planck(air_k))
    seen = picture(scene, (0.0, 90.0, 0.0), z=20.0)["temperature"][24, 32]
    assert seen == pytest.approx(wanted, abs=0.01)
    assert wanted < air_k - 2.0


def test_the_sky_is_coldest_overhead() -> None:
    scene = lit(NIGHT)
    climate, air = climate_of(scene), planck(scene.site.air_degc + 273.15)
    up = picture(scene, (0.0, -90.0, 0.0))["temperature"][24, 32]
    # The pixel is half a pixel off the zenith.
    assert up == pytest.approx(apparent_k(climate.sky_zenith * air), abs=0.02)
    column = picture(scene, (0.0, -45.0, 180.0))["temperature"][:, 32]
    sky = column[: int(np.argmax(column > 270.0)) or len(column)]
    assert (np.diff(sky) >= 0.0).all()
    rays = CAMERA.rays()[10, 32]
    sine = math.sin(math.radians(45.0) + math.atan2(-rays[1], rays[2]))
    flat = math.hypot(rays[1], rays[2])
    assert column[10] == pytest.approx(
        apparent_k((1 - (1 - climate.sky_zenith) ** (1 / (sine * flat))) * air), abs=0.05
    )


def test_sunlit_ground_is_warm_by_the_balance_and_shade_is_cool() -> None:
    scene = lit(NOON)
    climate, heat = climate_of(scene), heat_of(DEFAULT_SURFACE)
    beam = 1361.0 * 0.7 ** ((1.0 / math.sin(math.radians(50.0))) ** 0.678)
    assert climate.beam_w_per_m2 == pytest.approx(beam, rel=1e-9)
    sun = beam * math.sin(math.radians(50.0)) + 0.1 * beam
    per_w = heat.share / climate.exchange_w_per_m2_k
    lit_k = climate.air_k + per_w * (heat.absorptance * sun - heat.emissivity * climate.loss_w_per_m2)
    shade_k = climate.air_k + per_w * (heat.absorptance * 0.1 * beam - heat.emissivity * climate.loss_w_per_m2)
    # North of the box, 4 m high, its shadow is 4 / tan 50 = 3.4 m long. The camera looks down on both.
    below = lit(NOON).model_copy(
        update={"boxes": (Box(name="box", center_m=(0.0, -2.0, 2.0), size_m=(4.0, 2.0, 4.0)),)}
    )
    with_shade = picture(below, (0.0, 90.0, 0.0), shadows=True, z=20.0)
    without = picture(below, (0.0, 90.0, 0.0), z=20.0)["temperature"]
    ground = (with_shade["geom"] == with_shade["geom"][0, 0]) & (with_shade["geom"] >= 0)
    cooler = ground & (with_shade["temperature"] < without - 1.0)
    assert 20 < cooler.sum() < 200
    tau, e = gas_transmission(20.0, climate.air_k), heat.emissivity
    air = planck(climate.air_k)
    for temperature_k, where in ((lit_k, ground & ~cooler), (shade_k, cooler)):
        sent = e * planck(temperature_k) + (1 - e) * climate.sky_hemisphere * air
        wanted = apparent_k(tau * sent + (1 - tau) * air)
        assert float(np.median(with_shade["temperature"][where])) == pytest.approx(wanted, abs=0.1)


def test_people_are_warmer_than_what_is_round_them() -> None:
    scene = load_scene("city_park").model_copy(update={"light": NIGHT})
    world = load_world(scene)
    geometry = FrameGeometry(world)
    geometry.pose(0)
    renderer = FrameRenderer(geometry, CameraModel.from_fov(320, 240, 90.0))
    out = renderer.buffers("temperature", "segmentation")
    truth = TruthState(0, 0, (0.0, 0.0, 3.0), (1.0, 0.0, 0.0, 0.0), ZERO, ZERO, ZERO, ZERO, (), False)
    people = []
    for yaw in range(0, 360, 60):
        renderer.render(Mount(ZERO, (0.0, 8.0, float(yaw))).pose(truth), out)
        is_person = out["segmentation"] == world.class_names.index("person")
        others = out["temperature"][~is_person]
        people += out["temperature"][is_person].tolist()
        assert others.max() < scene.site.air_degc + 273.15 + 20.0
    assert len(people) > 50
    assert float(np.median(people)) > scene.site.air_degc + 273.15 + 5.0
    assert max(people) < 306.0


def test_fog_hides_by_its_transmission() -> None:
    for visibility_m in (50.0, 500.0):
        clear, foggy = lit(NIGHT), lit(NIGHT, visibility_m=visibility_m)
        climate = climate_of(foggy)
        beta = 3.912 / visibility_m * (10.0 / 0.55) ** (-0.585 * (visibility_m / 1000.0) ** (1 / 3))
        assert haze_per_m(3.912 / visibility_m) == pytest.approx(beta, rel=1e-9)
        ranges = np.array([1.0, 30.0, 300.0])
        ratio = AirTransmission(foggy, climate.air_k).of(ranges) / AirTransmission(clear, climate.air_k).of(ranges)
        assert ratio == pytest.approx(np.exp(-beta * ranges), rel=2e-3)


# The device ------------------------------------------------------------------------------------------------------


def shot(frames: Any, seq: int = 0, **values: Any) -> ImageSample:
    made = make_sensor(
        Installation("thermal", rate_hz=9.0, seed=1, scene=lit(NIGHT), step_ns=4_000_000, frames=frames),
        preset="camera_320x240",
        overrides={"resolution": (160, 120), "mount_rpy_deg": (0.0, 90.0, 0.0)} | values,
    )
    truth = TruthState(0, 0, (0.0, 0.0, 20.0), (1.0, 0.0, 0.0, 0.0), ZERO, ZERO, ZERO, ZERO, (), False)
    sample = made.sample(truth, seq)
    assert isinstance(sample, ImageSample)
    return sample


@pytest.fixture(scope="module")
def frames() -> SharedFrames:
    return SharedFrames(load_world(lit(NIGHT)))


def test_counts_are_hundredths_of_a_kelvin(frames: SharedFrames) -> None:
    sample = shot(frames, channels=("temperature", "infrared"))
    wanted = np.round(100.0 * sample.channels["temperature"].astype(float))
    assert np.abs(sample.channels["infrared"] - wanted).max() <= 1.0
    alone = shot(frames, channels=("infrared",))
    assert set(alone.channels) == {"infrared"}
    np.testing.assert_array_equal(alone.channels["infrared"], sample.channels["infrared"])


def test_noise_is_the_netd_at_its_temperature(frames: SharedFrames) -> None:
    """NETD is stated at 300 K; at another temperature it is larger by the ratio of the slopes of Planck's law."""
    truth_k = shot(frames, channels=("temperature",)).channels["temperature"].astype(float)
    device = {"netd_k": 0.05, "counts_per_k": 1000.0, "zero_k": 250.0}
    noisy = [shot(frames, seq, channels=("infrared",), infrared=device) for seq in range(8)]
    off_k = np.stack([each.channels["infrared"] / 1000.0 + 250.0 - truth_k for each in noisy])
    here_k = float(np.median(truth_k))
    slope = [planck(t + 0.5) - planck(t - 0.5) for t in (300.0, here_k)]
    assert off_k.std() == pytest.approx(0.05 * slope[0] / slope[1], rel=0.02)
    assert abs(off_k.mean()) < 4.0 * 0.05 / math.sqrt(off_k.size) + 1e-4
    assert abs(np.corrcoef(off_k[0].ravel(), off_k[1].ravel())[0, 1]) < 0.04
    again = shot(frames, 3, channels=("infrared", "temperature"), infrared=device)
    np.testing.assert_array_equal(again.channels["infrared"], noisy[3].channels["infrared"])


def test_counts_end_at_the_bits(frames: SharedFrames) -> None:
    device = {"netd_k": 0.0, "counts_per_k": 100.0, "zero_k": 0.0, "bits": 14}
    assert (shot(frames, channels=("infrared",), infrared=device).channels["infrared"] == (1 << 14) - 1).all()
    device |= {"zero_k": 400.0}
    assert (shot(frames, channels=("infrared",), infrared=device).channels["infrared"] == 0).all()


@pytest.mark.parametrize(
    "values", [{"netd_k": -1.0}, {"netd_k": 0.05, "bits": 20}, {"netd_k": 0.05, "zero_k": -3.0}, {}]
)
def test_impossible_devices_are_refused(frames: SharedFrames, values: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"netd_k|bits|zero_k"):
        shot(frames, channels=("infrared",), infrared=values)
