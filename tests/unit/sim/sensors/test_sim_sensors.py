"""Sensors: means, signs and that config errors are found. Statistics are in tests/accuracy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pydantic
import pytest

import signals.noise
import sim.sensors.imu
from signals.errors import ModelRangeError
from signals.geodesy import LocalFrame
from signals.noise import noise_key
from signals.samples import TruthState, Vec3
from sim._kernels import ideal_imu
from sim.physics import multirotor
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.atmosphere import geopotential_m, pressure_pa
from sim.scene.scene import Scene, Site, load_scene
from sim.sensors.catalog import KINDS, PRESETS
from sim.sensors.drift import gauss_markov
from sim.sensors.magnetometer import magnetic_field_W_tesla
from sim.sensors.rounding import rounded
from sim.sensors.sensor import Installation
from tests.worlds.installed_sensor import installed
from tests.worlds.rotation_matrices import rotation

TICK_NS = 4_000_000
SCENE = load_scene("airfield")
G = SCENE.gravity_mps2
RATE_HZ = {
    "imu": 250.0,
    "barometer": 50.0,
    "magnetometer": 100.0,
    "gps": 10.0,
    "range_finder": 50.0,
    "optical_flow": 50.0,
    "pitot": 50.0,
}
NOISELESS: dict[str, dict[str, Any]] = {
    "icm20689": {
        "accel_noise_mps2_per_rthz": 0.0,
        "gyro_noise_radps_per_rthz": 0.0,
        "accel_bias_instability_mps2": 0.0,
        "gyro_bias_instability_radps": 0.0,
        "accel_walk_mps3_per_rthz": 0.0,
        "gyro_walk_radps2_per_rthz": 0.0,
        "accel_turn_on_bias_mps2": 0.0,
        "gyro_turn_on_bias_radps": 0.0,
        "accel_scale_error": 0.0,
        "gyro_scale_error": 0.0,
        "accel_misalignment_rad": 0.0,
        "gyro_misalignment_rad": 0.0,
        "accel_output_rate_hz": 0.0,
        "gyro_output_rate_hz": 0.0,
    },
    "ms5611": {"noise_pa": 0.0, "drift_pa": 0.0, "resolution_pa": 1e-6},
    "ist8310": {"noise_tesla": 0.0, "hard_iron_tesla": 0.0, "soft_iron": 0.0, "resolution_tesla": 2e-9},
    "here_plus": {
        "horizontal_noise_m": 0.0,
        "vertical_noise_m": 0.0,
        "horizontal_drift_m": 0.0,
        "vertical_drift_m": 0.0,
        "horizontal_speed_noise_mps": 0.0,
        "vertical_speed_noise_mps": 0.0,
    },
}


def sensor(preset: str, *, seed: int = 1, name: str = "s", scene: Scene = SCENE, **overrides: Any) -> Any:
    kind = PRESETS[preset].kind
    return installed(name, scene, preset=preset, overrides=overrides, rate_hz=RATE_HZ.get(kind, 50.0), seed=seed)


def at_rest(**changes: Any) -> TruthState:
    zero = (0.0, 0.0, 0.0)
    # Two metres up, where the ground is within reach of every downward sensor.
    truth = TruthState(0, 0, (0.0, 0.0, 2.0), (1.0, 0.0, 0.0, 0.0), zero, zero, zero, zero, (0.0,) * 4, True)
    return truth._replace(**changes)


HALF = math.sqrt(0.5)
NOSE_DOWN_90 = (HALF, 0.0, HALF, 0.0)  # turned about left: forward points to the ground
ROLL_RIGHT_90 = (HALF, HALF, 0.0, 0.0)  # turned about forward: left points up
FACING_NORTH = (HALF, 0.0, 0.0, HALF)


@pytest.mark.parametrize(
    ("q_WB", "force"),
    [
        ((1.0, 0.0, 0.0, 0.0), (0, 0, G)),
        (NOSE_DOWN_90, (-G, 0, 0)),
        (ROLL_RIGHT_90, (0, G, 0)),
        (FACING_NORTH, (0, 0, G)),
    ],
)
def test_imu_at_rest_feels_the_ground_push_up(q_WB: tuple[float, ...], force: tuple[float, ...]) -> None:
    sample = sensor("icm20689", **NOISELESS["icm20689"]).sample(at_rest(q_WB=q_WB), 0)
    assert sample.accel_mps2 == pytest.approx(force, abs=3e-3)
    assert sample.gyro_radps == (0.0, 0.0, 0.0)


def test_imu_in_free_fall_feels_nothing() -> None:
    sample = sensor("icm20689", **NOISELESS["icm20689"]).sample(at_rest(a_WB_W=(0.0, 0.0, -G)), 0)
    assert sample.accel_mps2 == (0.0, 0.0, 0.0)


def test_imu_integrates_back_to_the_motion() -> None:
    """Strapdown integration of noise-free samples follows the truth: means are taken and turned rightly."""
    physics = VehiclePhysics(load_vehicle("x500"), SCENE, TICK_NS, start=FlightStart(p_WB=(0.0, 0.0, 300.0)))
    h = multirotor.hover_control(physics.vehicle)
    truth = physics.advance(0, (h,) * 4)
    v, q = np.array(truth.v_WB_W), np.array(truth.q_WB)
    dt, fastest = TICK_NS * 1e-9, 0.0
    for tick in range(1, 251):
        swing = 0.1 * math.sin(tick * 0.05)
        truth = physics.advance(tick, (h + swing, h - swing, h + 0.5 * swing, h - 0.3 * swing))
        f = ideal_imu(truth.q_WB, truth.a_WB_W, truth.w_WB_B, truth.alpha_WB_B, dt, G)
        angle = np.array(f[3:]) * dt
        q_half = _turn(q, 0.5 * angle)
        v = v + dt * (rotation(q_half) @ f[:3] - [0, 0, G])
        q = _turn(q, angle)
        fastest = max(fastest, *(abs(w) for w in truth.w_WB_B))
    assert fastest > 1.0  # it did turn
    # Turned with the step-end attitude instead, v would be off by some g |angle turned| dt / 2: 0.02 m/s and more.
    assert np.linalg.norm(v - truth.v_WB_W) < 1e-3
    assert np.linalg.norm(q - truth.q_WB) < 5e-5


def _turn(q: np.ndarray, angle: np.ndarray) -> np.ndarray:
    size = float(np.linalg.norm(angle)) or 1e-300
    w, (x, y, z) = math.cos(size / 2), math.sin(size / 2) * angle / size
    a, b, c, d = q
    return np.array(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ]
    )


def test_imu_rounds_to_16_bits_and_saturates() -> None:
    assert rounded(0.26, 0.1) == pytest.approx(0.3)
    assert rounded(-0.26, 0.1) == pytest.approx(-0.3)
    imu = sensor("icm20689", **NOISELESS["icm20689"])
    sample = imu.sample(at_rest(a_WB_W=(1e4, -1e4, 0.0)), 0)
    assert sample.accel_mps2[0] == pytest.approx(16 * 9.80665 * 32767 / 32768)
    assert sample.accel_mps2[1] == pytest.approx(-16 * 9.80665)
    lsb = imu.resolution["gyro_radps"]
    assert lsb == pytest.approx(math.radians(1 / 16.4), rel=1e-12)
    sample = imu.sample(at_rest(w_WB_B=(0.1234, 0.0, 0.0)), 0)
    assert sample.gyro_radps[0] / lsb == pytest.approx(round(sample.gyro_radps[0] / lsb), abs=1e-9)


def test_barometer_follows_the_standard_atmosphere() -> None:
    baro = sensor("ms5611", **NOISELESS["ms5611"])
    sample = baro.sample(at_rest(p_WB=(0.0, 0.0, 12.0)), 0)
    assert sample.pressure_pa == pytest.approx(pressure_pa(geopotential_m(500.0)), abs=1e-5)
    assert sample.pressure_altitude_m == pytest.approx(500.0 - 0.0393, abs=1e-4)  # z^2 / r less


def test_barometer_works_to_20_km_and_names_the_end_of_its_range() -> None:
    baro = sensor("ms5611", **NOISELESS["ms5611"])
    heights = [baro.sample(at_rest(p_WB=(0.0, 0.0, z)), 0).pressure_altitude_m for z in (10_000.0, 12_000.0, 19_000.0)]
    assert heights == pytest.approx([geopotential_m(488.0 + z) for z in (10_000.0, 12_000.0, 19_000.0)], abs=1e-3)
    with pytest.raises(ModelRangeError, match=r"altitude_m = 204.* \(-5000 to 20000 m, the range of the standard"):
        baro.sample(at_rest(p_WB=(0.0, 0.0, 20_000.0)), 0)


@pytest.mark.parametrize(
    ("q_WB", "axes"),
    [((1.0, 0.0, 0.0, 0.0), (0, 1, 2)), (FACING_NORTH, (1, -1, 2))],
)
def test_magnetometer_sees_the_field_from_the_body(q_WB: tuple[float, ...], axes: tuple[int, ...]) -> None:
    """Facing east, forward reads east and left reads north; facing north, forward reads north and left reads west."""
    east, north, up = magnetic_field_W_tesla(SCENE.site)
    expected = (east, north, up) if axes[0] == 0 else (north, -east, up)
    mag = sensor("ist8310", **NOISELESS["ist8310"])
    assert mag.sample(at_rest(q_WB=q_WB), 0).field_tesla == pytest.approx(expected, abs=1.1e-9)


def test_gps_without_errors_is_the_truth() -> None:
    gps = sensor("here_plus", **NOISELESS["here_plus"])
    sample = gps.sample(at_rest(p_WB=(120.0, -40.0, 15.0), v_WB_W=(1.0, 2.0, 3.0)), 0)
    at = LocalFrame(SCENE.site).enu_from_geodetic(sample.latitude_deg, sample.longitude_deg, sample.altitude_m)
    assert at == pytest.approx((120.0, -40.0, 15.0), abs=1e-8)
    assert sample.v_W == (1.0, 2.0, 3.0)


def test_gps_measures_at_its_antenna() -> None:
    """p + R r and v + R (w x r), each axis by a different amount."""
    r_B, w_B, v_W = np.array((0.3, -0.2, 0.15)), np.array((0.5, -1.0, 2.0)), np.array((1.0, 2.0, 3.0))
    q = (math.sqrt(0.1), 0.5, -0.3, math.sqrt(0.56))
    gps = sensor("here_plus", **NOISELESS["here_plus"], antenna_m=tuple(r_B))
    sample = gps.sample(at_rest(q_WB=q, v_WB_W=tuple(v_W), w_WB_B=tuple(w_B)), 0)
    at = LocalFrame(SCENE.site).enu_from_geodetic(sample.latitude_deg, sample.longitude_deg, sample.altitude_m)
    assert at == pytest.approx((0.0, 0.0, 2.0) + rotation(q) @ r_B, abs=1e-8)
    assert sample.v_W == pytest.approx(v_W + rotation(q) @ np.cross(w_B, r_B), abs=1e-12)


@pytest.mark.parametrize(
    ("latitude_deg", "p_W", "turned_deg"),
    [
        (89.9, (1000.0, 0.0, 0.0), 5.117),
        (60.0, (10_000.0, 0.0, 0.0), 0.1552),
        (60.0, (0.0, 10_000.0, 0.0), 0.0),
        (-60.0, (10_000.0, 0.0, 0.0), -0.1552),
    ],
)
def test_gps_velocity_is_along_the_meridian_of_its_place(latitude_deg: float, p_W: Vec3, turned_deg: float) -> None:
    """Two positions a moment apart give the same velocity as the receiver: geodetic differences, at its own place."""
    scene = SCENE.model_copy(update={"site": SCENE.site.model_copy(update={"latitude_deg": latitude_deg})})
    gps = sensor("here_plus", scene=scene, **NOISELESS["here_plus"])
    north, dt_s = (0.0, 10.0, 0.0), 0.1
    first = gps.sample(at_rest(p_WB=p_W, v_WB_W=north), 0)
    second = gps.sample(at_rest(p_WB=tuple(p + v * dt_s for p, v in zip(p_W, north, strict=True)), v_WB_W=north), 1)
    here = LocalFrame(
        Site(latitude_deg=first.latitude_deg, longitude_deg=first.longitude_deg, altitude_m=first.altitude_m)
    )
    moved = here.enu_from_geodetic(second.latitude_deg, second.longitude_deg, second.altitude_m)
    assert first.v_W == pytest.approx([x / dt_s for x in moved], abs=2e-3)
    assert math.degrees(math.atan2(-first.v_W[0], first.v_W[1])) == pytest.approx(-turned_deg, rel=2e-3, abs=3e-3)


def test_drift_does_not_depend_on_how_it_was_read() -> None:
    installation = Installation("d", 10.0, 1, SCENE, TICK_NS)
    steady, jumping = (gauss_markov(installation, lanes=2, sigma=1.0, time_constant_s=3.0) for _ in range(2))
    read = {k: steady.at(k) for k in range(600)}
    for k in (0, 599, 3, 3, 300, 599, 0):
        assert jumping.at(k) == read[k]


def test_every_noise_has_the_name_of_its_sensor_and_is_used_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two sensors of one kind would else err alike, or two errors of one sensor."""
    names: list[str] = []

    def told(seed: int, name: str) -> tuple[int, int]:
        names.append(name)
        return noise_key(seed, name)

    for module in (signals.noise, sim.sensors.imu):
        monkeypatch.setattr(module, "noise_key", told)
    for name, preset in PRESETS.items():
        if not KINDS[preset.kind].needs_frames:
            names.clear()
            sensor(name, name="mine")
            assert names, name
            assert all(stream.startswith("mine.") for stream in names), (name, names)
            assert len(set(names)) == len(names), (name, names)


def test_config_errors_are_found() -> None:
    with pytest.raises(KeyError):
        installed("x", SCENE, preset="here_pluss")
    with pytest.raises(ValueError, match="not a imu"):
        installed("x", SCENE, preset="ms5611", kind="imu")
    with pytest.raises(ValueError, match="preset or a kind"):
        installed("x", SCENE)
    with pytest.raises(pydantic.ValidationError, match="noise_paa"):
        sensor("ms5611", noise_paa=1.0)
    with pytest.raises(pydantic.ValidationError, match="latency_s"):
        sensor("ms5611", latency_s=-1.0)
    with pytest.raises(pydantic.ValidationError):
        installed("x", SCENE, kind="gps")


def test_a_kind_with_all_its_parameters_needs_no_preset() -> None:
    for preset in PRESETS.values():
        if KINDS[preset.kind].needs_frames:
            continue
        made = installed("x", SCENE, kind=preset.kind, overrides=preset.parameters.model_dump())
        assert isinstance(made, KINDS[preset.kind].sensor)
