"""GPS, barometer and magnetometer of every preset: variance and correlation against closed forms, many seeds.

A first-order process of deviation d and time constant T with white noise w has

    var = d^2 + w^2,    cov(t) = d^2 e^{-t/T},    var of x(t + dt) - x(t) = 2 w^2 + 2 d^2 (1 - e^{-dt/T})

Means are over seeds, not over time: the spread between runs is tested, and no estimate has to wait for the drift.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from signals.geodesy import LocalFrame
from signals.samples import TruthState
from sim.scene.atmosphere import geopotential_m, pressure_pa
from sim.scene.scene import load_scene
from sim.sensors.catalog import PRESETS, make_sensor
from sim.sensors.magnetometer import magnetic_field_W_tesla
from sim.sensors.rounding import drawn_sigma, rounded
from sim.sensors.sensor import Installation
from tests.worlds.street_canyon import frames_of

TICK_NS = 4_000_000
SCENE = load_scene("airfield")
ZERO = (0.0, 0.0, 0.0)
SEEDS = 600
# 4.5 standard deviations of the estimate of a standard deviation from that many seeds.
REL = 4.5 / math.sqrt(2 * SEEDS)


def still(**changes: Any) -> TruthState:
    truth = TruthState(0, 0, ZERO, (1.0, 0.0, 0.0, 0.0), ZERO, ZERO, ZERO, ZERO, (0.0,) * 4, False)
    return truth._replace(**changes)


def sensor(preset: str, seed: int, rate_hz: float, **overrides: Any) -> Any:
    frames = frames_of(SCENE.model_dump_json()) if overrides.get("sky") is not None else None
    return make_sensor(
        Installation("s", rate_hz=rate_hz, seed=seed, scene=SCENE, step_ns=TICK_NS, frames=frames),
        preset=preset,
        overrides=overrides,
    )


def of_kind(kind: str) -> list[str]:
    return sorted(name for name, preset in PRESETS.items() if preset.kind == kind)


def drifting(pairs: np.ndarray, drift: float, white: float, decay: float) -> None:
    """`pairs` [seed][2]: the error at two instants. Check mean, spread, covariance and spread of the difference."""
    total = math.hypot(drift, white)
    assert pairs[:, 0].std() == pytest.approx(total, rel=REL)
    assert pairs[:, 1].std() == pytest.approx(total, rel=REL)
    assert abs(pairs.mean()) < 4.5 * total / math.sqrt(SEEDS)
    covariance = float(np.mean(pairs[:, 0] * pairs[:, 1]))
    assert covariance == pytest.approx(drift * drift * decay, abs=4.5 * total * total / math.sqrt(SEEDS))
    step = math.sqrt(2 * white * white + 2 * drift * drift * (1 - decay))
    assert np.diff(pairs, axis=1).std() == pytest.approx(step, rel=REL)


@pytest.mark.parametrize("sky", [None, {}], ids=["without a sky", "under an open sky"])
@pytest.mark.parametrize("preset", of_kind("gps"))
def test_gps_position_and_velocity(preset: str, sky: dict[str, Any] | None) -> None:
    p: Any = PRESETS[preset].parameters
    frame = LocalFrame(SCENE.site)
    later = 20  # samples of 0.1 s
    position, velocity, stated = [], [], []
    for seed in range(SEEDS):
        gps = sensor(preset, seed, 10.0, sky=sky)
        samples = [gps.sample(still(), k) for k in (0, later)]
        position.append([frame.enu_from_geodetic(s.latitude_deg, s.longitude_deg, s.altitude_m) for s in samples])
        velocity.append(samples[0].v_W)
        stated.append((samples[0].horizontal_accuracy_m, samples[0].vertical_accuracy_m))
    e = np.array(position)
    decay = math.exp(-0.1 * later / p.drift_time_constant_s)
    for axis in (0, 1):
        drifting(e[:, :, axis], p.horizontal_drift_m, p.horizontal_noise_m, decay)
    drifting(e[:, :, 2], p.vertical_drift_m, p.vertical_noise_m, decay)
    v = np.array(velocity)
    expected = [p.horizontal_speed_noise_mps] * 2 + [p.vertical_speed_noise_mps]
    assert v.std(axis=0) == pytest.approx(expected, rel=REL)
    # The receiver's stated accuracy is its real one.
    assert stated[0][0] == pytest.approx(e[:, 0, :2].std(), rel=REL)
    assert stated[0][1] == pytest.approx(e[:, 0, 2].std(), rel=REL)
    cross = np.corrcoef(np.concatenate([e[:, 0], v], axis=1).T) - np.eye(6)
    assert np.abs(cross).max() < 4.5 / math.sqrt(SEEDS)


@pytest.mark.parametrize("preset", of_kind("barometer"))
def test_barometer(preset: str) -> None:
    p: Any = PRESETS[preset].parameters
    later = 500  # samples of 20 ms
    exact = pressure_pa(geopotential_m(SCENE.site.altitude_m))
    pairs = []
    for seed in range(SEEDS):
        baro = sensor(preset, seed, 50.0)
        pairs.append([baro.sample(still(), k).pressure_pa - exact for k in (0, later)])
    drifting(np.array(pairs), p.drift_pa, p.noise_pa, math.exp(-0.02 * later / p.drift_time_constant_s))


def test_pressure_noise_in_metres_is_that_of_the_barometric_formula() -> None:
    """dh/dp = -R T / (g M p): 1 Pa is about 9 cm here."""
    baro = sensor("ms5611", 1, 50.0, drift_pa=0.0)
    samples = [baro.sample(still(), k) for k in range(4000)]
    pressure = np.array([s.pressure_pa for s in samples])
    altitude = np.array([s.pressure_altitude_m for s in samples])
    temperature = 288.15 - 0.0065 * SCENE.site.altitude_m
    slope = 8.31447 * temperature / (9.80665 * 0.0289644 * pressure.mean())
    assert altitude.std() / pressure.std() == pytest.approx(slope, rel=1e-3)


@pytest.mark.parametrize("preset", of_kind("magnetometer"))
def test_magnetometer(preset: str) -> None:
    p: Any = PRESETS[preset].parameters
    field = np.array(magnetic_field_W_tesla(SCENE.site))
    rows, white = [], []
    for seed in range(SEEDS):
        mag = sensor(preset, seed, 100.0)
        a, b = (np.array(mag.sample(still(), k).field_tesla) for k in (0, 1))
        rows.append(a - field)
        white.append(a - b)
    noise = p.noise_tesla
    assert np.std(white, axis=0) == pytest.approx([math.sqrt(2) * noise] * 3, rel=REL)
    # Each row of the soft-iron matrix has three independent elements: s |B| a component.
    spread = math.sqrt(noise**2 + p.hard_iron_tesla**2 + (p.soft_iron * np.linalg.norm(field)) ** 2)
    assert np.std(rows, axis=0) == pytest.approx([spread] * 3, rel=REL)


@pytest.mark.parametrize("step", [0.5, 1.0, 2.0])
def test_rounding_is_inside_the_stated_noise(step: float) -> None:
    """For steps of half to twice the noise, over true values anywhere within a step."""
    rng = np.random.default_rng(1)
    true = rng.uniform(0.0, 100.0 * step, 200_000)
    drawn = drawn_sigma(1.0, step) * rng.standard_normal(true.size)
    error = [rounded(value, step) - exact for value, exact in zip(true + drawn, true, strict=True)]
    assert np.std(error) == pytest.approx(1.0, rel=0.01)


def test_soft_iron_bends_a_turning_field_into_the_stated_ellipsoid() -> None:
    """Turned about the vertical without noise, the horizontal field traces S B + b, by the matrix drawn."""
    quiet = {"noise_tesla": 0.0, "resolution_tesla": 1e-15, "soft_iron": 0.05, "hard_iron_tesla": 1e-6}
    mag = sensor("rm3100", 3, 100.0, **quiet)
    field = np.array(magnetic_field_W_tesla(SCENE.site))
    matrix, offset = np.array(mag.soft_iron), np.array(mag.hard_iron_tesla)
    assert np.array_equal(matrix, matrix.T)
    for yaw in np.linspace(0, 2 * math.pi, 9):
        c, s = math.cos(yaw), math.sin(yaw)
        in_body = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ field
        q = (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))
        assert mag.sample(still(q_WB=q), 0).field_tesla == pytest.approx(matrix @ in_body + offset, abs=1e-13)


def test_motor_current_bends_the_field_with_the_cube_of_speed() -> None:
    quiet = {"noise_tesla": 0.0, "resolution_tesla": 1e-15, "soft_iron": 0.0, "hard_iron_tesla": 0.0}
    mag = sensor("rm3100", 1, 100.0, **quiet, motor_field_tesla=(1e-6, 0.0, -2e-6), motor_reference_radps=500.0)
    base = np.array(mag.sample(still(), 0).field_tesla)
    for speeds, current in (((500.0,) * 4, 1.0), ((1000.0,) * 4, 8.0), ((1000.0, 0.0, 0.0, 0.0), 2.0)):
        field = np.array(mag.sample(still(rotor_speed_radps=speeds), 0).field_tesla)
        assert field - base == pytest.approx([1e-6 * current, 0.0, -2e-6 * current], abs=1e-14)


QUIET_BARO = {"noise_pa": 0.0, "drift_pa": 0.0, "resolution_pa": 1e-9}


def test_prop_wash_by_thrust_and_height() -> None:
    baro = sensor(
        "ms5611",
        1,
        50.0,
        **QUIET_BARO,
        wash_free_pa=-4.0,
        wash_ground_pa=12.0,
        wash_ground_height_m=0.5,
        wash_reference_radps=500.0,
    )
    for height in (0.0, 0.3, 5.0):
        off = baro.sample(still(p_WB=(0.0, 0.0, height)), 0).pressure_pa
        on = baro.sample(still(p_WB=(0.0, 0.0, height), rotor_speed_radps=(1000.0, 0.0, 0.0, 0.0)), 0).pressure_pa
        assert on - off == pytest.approx(-4.0 + 12.0 * math.exp(-height / 0.5), abs=1e-6)


def test_flow_past_the_static_port() -> None:
    baro = sensor("ms5611", 1, 50.0, **QUIET_BARO, flow_coefficient=(0.1, -0.2))
    base = baro.sample(still(), 0).pressure_pa
    ahead = baro.sample(still(v_WB_W=(10.0, 0.0, 0.0)), 0).pressure_pa - base
    astern = baro.sample(still(v_WB_W=(-10.0, 0.0, 0.0)), 0).pressure_pa - base
    left = baro.sample(still(v_WB_W=(0.0, 10.0, 0.0)), 0).pressure_pa - base
    assert (ahead, astern, left) == pytest.approx((0.1 * 61.25, -0.1 * 61.25, -0.2 * 61.25), abs=1e-6)
    half = math.sqrt(0.5)
    facing_north = still(q_WB=(half, 0.0, 0.0, half), v_WB_W=(0.0, 10.0, 0.0))
    assert baro.sample(facing_north, 0).pressure_pa - base == pytest.approx(ahead, abs=1e-6)


def test_gps_antenna_on_a_lever_arm() -> None:
    arm = (0.1, 0.0, 0.3)
    exact = {
        f"{axis}_{what}": 0.0
        for axis in ("horizontal", "vertical")
        for what in ("noise_m", "drift_m", "speed_noise_mps")
    }
    gps = sensor("m8n", 1, 10.0, **exact, antenna_m=arm)
    half = math.sqrt(0.5)
    sample = gps.sample(still(q_WB=(half, 0.0, 0.0, half), w_WB_B=(0.0, 0.0, 2.0)), 0)
    at = LocalFrame(SCENE.site).enu_from_geodetic(sample.latitude_deg, sample.longitude_deg, sample.altitude_m)
    assert at == pytest.approx((0.0, 0.1, 0.3), abs=1e-8)
    assert sample.v_W == pytest.approx((-0.2, 0.0, 0.0), abs=1e-12)  # facing north, turning left
    arm, w = (0.1, -0.2, 0.3), (0.5, -0.7, 2.0)
    sample = sensor("m8n", 1, 10.0, **exact, antenna_m=arm).sample(still(w_WB_B=w), 0)
    assert sample.v_W == pytest.approx(np.cross(w, arm), abs=1e-12)


def test_gps_loss_keeps_the_receiver_talking() -> None:
    gps = sensor("m8n", 1, 10.0, loss=[{"from_s": 1.0, "until_s": 2.0}])
    samples = [gps.sample(still(t_ns=k * 100_000_000, p_WB=(1.0 * k, 0.0, 0.0)), k) for k in range(30)]
    for k, s in enumerate(samples):
        lost = 10 <= k < 20
        assert (s.fix_type, s.satellites > 0) == ((1, False) if lost else (3, True))
        if lost:
            assert (s.latitude_deg, s.longitude_deg) == (samples[9].latitude_deg, samples[9].longitude_deg)
            assert s.v_W == (0.0, 0.0, 0.0)
            assert s.horizontal_accuracy_m == 1000.0
    unbroken = sensor("m8n", 1, 10.0)
    assert samples[25] == unbroken.sample(still(t_ns=25 * 100_000_000, p_WB=(25.0, 0.0, 0.0)), 25)
    never = sensor("m8n", 1, 10.0, loss=[{"from_s": 0.0, "until_s": 2.0}]).sample(still(), 0)
    assert (never.latitude_deg, never.longitude_deg, never.altitude_m) == (0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="must come after"):
        sensor("m8n", 1, 10.0, loss=[{"from_s": 2.0, "until_s": 2.0}])
