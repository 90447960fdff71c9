"""Pitot tube and vanes against closed forms: impact pressure, mount, wind, blockage, friction and lag."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from signals.samples import GpsSample, TruthState, Vec3
from sim.scene.atmosphere import density_kgpm3, geopotential_m, pressure_pa
from sim.scene.scene import Scene, load_scene
from sim.sensors.catalog import make_sensor
from sim.sensors.faults import FAULT_LIST, FaultySensor, fault_problems
from sim.sensors.sensor import Installation
from tests.worlds.rotation_matrices import rotation

TICK_NS = 4_000_000
FIELD = load_scene("airfield")
ZERO = (0.0, 0.0, 0.0)
EXACT: dict[str, Any] = {"range_pa": 1e5, "resolution_pa": 1e-9, "noise_pa": 0.0}
EXACT_VANE: dict[str, Any] = {"noise_deg": 0.0, "resolution_deg": 1e-9}


def made(
    kind: str,
    values: dict[str, Any],
    *,
    wind_W: Vec3 = ZERO,
    scene: Scene = FIELD,
    seed: int = 1,
    rate_hz: float = 50.0,
) -> Any:
    installation = Installation("a", rate_hz=rate_hz, seed=seed, scene=scene, step_ns=TICK_NS, wind_at=lambda: wind_W)
    return make_sensor(installation, kind=kind, overrides=values)


def flying(v_W: Vec3 = ZERO, *, height_m: float = 0.0, t_s: float = 0.0, **changes: Any) -> TruthState:
    t_ns = round(t_s * 1e9)
    truth = TruthState(
        t_ns // TICK_NS, t_ns, (0.0, 0.0, height_m), (1.0, 0.0, 0.0, 0.0), v_W, ZERO, ZERO, ZERO, (0.0,) * 4, False
    )
    return truth._replace(**changes)


def read(sensor: Any, truth: TruthState, seq: int = 0) -> float:
    value: float = sensor.sample(truth, seq).differential_pressure_pa
    return value


def impact(speed_mps: float, height_m: float = 0.0, *, warmer_k: float = 0.0) -> float:
    """Isentropic stagnation pressure over the static one."""
    altitude = FIELD.site.altitude_m + height_m
    p = pressure_pa(geopotential_m(altitude))
    mach2 = density_kgpm3(altitude, warmer_k) * speed_mps**2 / (1.4 * p)
    return p * math.expm1(3.5 * math.log1p(0.2 * mach2))


@pytest.mark.parametrize("speed_mps", [0.0, 1.0, 15.0, 60.0, 250.0])
def test_the_tube_reads_the_impact_pressure_of_the_air_at_its_height(speed_mps: float) -> None:
    for height_m in (0.0, 1500.0):
        expected = impact(speed_mps, height_m)
        got = read(made("pitot", EXACT), flying((speed_mps, 0.0, 0.0), height_m=height_m))
        assert got == pytest.approx(expected, rel=1e-9, abs=1e-9)
        if speed_mps <= 60.0:
            density = density_kgpm3(FIELD.site.altitude_m + height_m)
            assert got == pytest.approx(0.5 * density * speed_mps**2, rel=0.009)


def test_warm_air_is_thinner_and_shows_less() -> None:
    hot = FIELD.model_copy(update={"site": FIELD.site.model_copy(update={"temperature_degc": 40.0})})
    got = read(made("pitot", EXACT, scene=hot), flying((20.0, 0.0, 0.0)))
    assert got == pytest.approx(impact(20.0, warmer_k=hot.site.warmer_k), rel=1e-9)
    assert got < 0.93 * impact(20.0)


def test_wind_and_turning_move_the_tube_through_the_air() -> None:
    q = np.array([0.9, 0.1, -0.2, 0.3]) / np.linalg.norm([0.9, 0.1, -0.2, 0.3])
    v, wind, w, r = (np.array(x) for x in ((12.0, 3.0, 1.0), (-2.0, 4.0, 0.5), (0.5, -1.0, 2.0), (0.4, -0.8, 0.1)))
    u = rotation(q).T @ (v - wind) + np.cross(w, r)
    truth = flying(tuple(v), q_WB=tuple(q), w_WB_B=tuple(w))
    got = read(made("pitot", EXACT | {"mount_m": tuple(r)}, wind_W=tuple(wind)), truth)
    assert got == pytest.approx(math.copysign(impact(u[0]), u[0]), rel=1e-9)
    yaw = math.radians(30.0)
    got = read(made("pitot", EXACT | {"mount_m": tuple(r), "mount_rpy_deg": (0, 0, 30)}, wind_W=tuple(wind)), truth)
    along = math.cos(yaw) * u[0] + math.sin(yaw) * u[1]
    assert got == pytest.approx(math.copysign(impact(along), along), rel=1e-9)


def test_the_insensitive_range_takes_the_whole_speed_and_ends_without_a_step() -> None:
    sensor = made("pitot", EXACT | {"insensitive_deg": 20.0})
    for angle, speed in (
        (0.0, 20.0),
        (19.9, 20.0),
        (20.1, 20.0 * math.cos(math.radians(20.1)) / math.cos(math.radians(20))),
    ):
        a = math.radians(angle)
        got = read(sensor, flying((20.0 * math.cos(a), 20.0 * math.sin(a), 0.0)))
        assert got == pytest.approx(impact(speed), rel=1e-9)


def test_position_error_grows_with_the_squares_of_the_angles() -> None:
    sensor = made("pitot", EXACT | {"static_error": 0.02, "static_error_per_rad2": (0.5, 1.5)})
    alpha, beta = 0.2, -0.1
    u = 20.0 * np.array([1.0, -math.tan(beta), -math.tan(alpha)])
    expected = impact(20.0) * (1.0 - 0.02 - 0.5 * alpha**2 - 1.5 * beta**2)
    assert read(sensor, flying(tuple(u))) == pytest.approx(expected, rel=1e-9)


def test_output_is_rounded_saturated_and_has_the_stated_noise() -> None:
    values = EXACT | {
        "range_pa": 100.0,
        "resolution_pa": 0.5,
        "noise_pa": 2.0,
        "zero_error_pa": 5.0,
        "scale_error": 0.05,
    }
    sensor = made("pitot", values)
    samples = np.array([read(sensor, flying((10.0, 0.0, 0.0)), k) for k in range(4000)])
    assert np.all(samples / 0.5 == np.round(samples / 0.5))
    assert samples.std() == pytest.approx(2.0, rel=0.05)
    means = []
    for seed in range(300):
        other = made("pitot", values | {"noise_pa": 0.0}, seed=seed)
        means.append(read(other, flying((10.0, 0.0, 0.0))) - impact(10.0))
    assert np.std(means) == pytest.approx(math.hypot(5.0, 0.05 * impact(10.0)), rel=0.15)
    assert read(sensor, flying((60.0, 0.0, 0.0))) == 99.5
    assert read(sensor, flying((-60.0, 0.0, 0.0))) == -100.0


def blocked(**fault: Any) -> FaultySensor:
    entry = {"kind": "blocked", "sensor": "a", "at_s": 1.0, **fault}
    return FaultySensor(made("pitot", EXACT), FAULT_LIST.validate_python([entry]))


def course(sensor: Any, states: list[TruthState]) -> list[float]:
    return [read(sensor, truth, k) for k, truth in enumerate(states)]


def states(until_s: float, speed: Any, height: Any) -> list[TruthState]:
    times = np.arange(0.0, until_s + 1e-9, 0.02)
    return [flying((speed(t), 0.0, 0.0), height_m=height(t), t_s=t) for t in times]


def test_a_closed_total_port_is_an_altimeter() -> None:
    """The trapped total pressure stays, the static one falls in the climb: the airspeed read rises with height."""
    flight = states(3.0, lambda t: 20.0 - 5.0 * max(t - 1.0, 0.0), lambda t: 50.0 * max(t - 1.0, 0.0))
    got = course(blocked(port="total"), flight)
    p0 = pressure_pa(geopotential_m(FIELD.site.altitude_m))
    for truth, value in zip(flight, got, strict=True):
        height = truth.p_WB[2]
        if truth.t_ns < 1_000_000_000:
            assert value == pytest.approx(impact(20.0), rel=1e-9)
        else:
            static = pressure_pa(geopotential_m(FIELD.site.altitude_m + height))
            assert value == pytest.approx(p0 + impact(20.0) - static, abs=1e-6)
    assert got[-1] > 5.0 * got[0]


def test_a_closed_static_port_keeps_the_static_pressure() -> None:
    flight = states(3.0, lambda t: 20.0, lambda t: 15.0 * max(t - 1.0, 0.0))
    got = course(blocked(port="static"), flight)
    p0 = pressure_pa(geopotential_m(FIELD.site.altitude_m))
    static = pressure_pa(geopotential_m(FIELD.site.altitude_m + 30.0))
    assert got[-1] == pytest.approx(static + impact(20.0, 30.0) - p0, abs=1e-6)
    assert got[-1] < 0.0 < got[0]


def test_both_ports_closed_freeze_the_reading_and_open_ports_recover() -> None:
    flight = states(3.0, lambda t: 20.0 + 5.0 * t, lambda t: 30.0 * t)
    got = course(blocked(port="both", until_s=2.0), flight)
    assert got[50:100] == pytest.approx([got[49]] * 50, abs=1e-9)
    assert got[101:] == pytest.approx([impact(20.0 + 0.1 * k, 0.6 * k) for k in range(101, 151)], rel=1e-9)


def test_a_drain_empties_the_blocked_total_line_exponentially() -> None:
    flight = states(3.0, lambda t: 20.0, lambda t: 0.0)
    got = course(blocked(port="total", leak=0.25, response_s=0.1), flight)
    for k in (50, 60, 80, 150):
        since = 0.02 * k - 0.98  # the sample before the fault was the last with an open port
        assert got[k] == pytest.approx(impact(20.0) * math.exp(-since * 0.25 / 0.1), rel=1e-9)


def test_ice_closes_the_port_slowly_against_its_drain() -> None:
    """While it closes, a line that settles at once divides the pressure as its two conductances do."""
    flight = states(11.0, lambda t: 20.0, lambda t: 0.0)
    got = course(blocked(port="total", closing_s=10.0, leak=0.2, response_s=1e-4), flight)
    for k in (75, 300, 500):
        opened = 1.0 - (0.02 * k - 1.0) / 10.0
        assert got[k] == pytest.approx(impact(20.0) * opened / (opened + 0.2), rel=1e-6)
    assert got[-1] == pytest.approx(0.0, abs=1e-6)


def test_only_a_pitot_tube_has_ports() -> None:
    fault = FAULT_LIST.validate_python([{"kind": "blocked", "sensor": "gps", "at_s": 1.0}])
    ((index, key, text),) = fault_problems(fault, {"gps": GpsSample})
    assert (index, key) == (0, "kind")
    assert "only a pitot tube has ports" in text


def angles(sensor: Any, truth: TruthState, seq: int = 0) -> tuple[float, float]:
    sample = sensor.sample(truth, seq)
    return sample.angle_of_attack_rad, sample.sideslip_rad


def test_vanes_stand_in_the_flow_at_their_place() -> None:
    q = np.array([0.9, 0.1, -0.2, 0.3]) / np.linalg.norm([0.9, 0.1, -0.2, 0.3])
    v, wind, w, r = (np.array(x) for x in ((12.0, 3.0, 1.0), (-2.0, 4.0, 0.5), (0.5, -1.0, 2.0), (0.4, -0.8, 0.1)))
    u = rotation(q).T @ (v - wind) + np.cross(w, r)
    sensor = made("vane", EXACT_VANE | {"mount_m": tuple(r)}, wind_W=tuple(wind))
    got = angles(sensor, flying(tuple(v), q_WB=tuple(q), w_WB_B=tuple(w)))
    assert got == pytest.approx((math.atan2(-u[2], u[0]), math.atan2(-u[1], u[0])), abs=1e-9)
    # Sinking, and drifting to the right: the air comes from below and from the right.
    alpha, beta = angles(made("vane", EXACT_VANE), flying((15.0, -2.0, -1.0)))
    assert alpha == pytest.approx(math.atan2(1.0, 15.0), abs=1e-9)
    assert beta == pytest.approx(math.atan2(2.0, 15.0), abs=1e-9)


@pytest.mark.parametrize("speed_mps", [7.5, 15.0, 30.0])
def test_a_vane_follows_a_step_as_a_lag_that_shortens_with_speed(speed_mps: float) -> None:
    sensor = made("vane", EXACT_VANE | {"time_constant_s": 0.08, "reference_airspeed_mps": 15.0})
    angles(sensor, flying((speed_mps, 0.0, 0.0)))
    step = flying((speed_mps * math.cos(0.3), 0.0, -speed_mps * math.sin(0.3)))
    for k in range(1, 20):
        got = angles(sensor, step._replace(t_ns=k * 20_000_000), k)[0]
        expected = 0.3 * (1.0 - math.exp(-0.02 * k * speed_mps / 15.0 / 0.08))
        assert got == pytest.approx(expected, abs=1e-8)


def test_friction_stops_a_vane_short_of_the_flow_and_less_so_in_fast_air() -> None:
    values = EXACT_VANE | {"friction_deg": 2.0, "reference_airspeed_mps": 15.0}
    for speed, stays in ((15.0, 2.0), (30.0, 0.5)):
        sensor = made("vane", values)
        angles(sensor, flying((speed, 0.0, 0.0)))
        a = math.radians(5.0)
        up = angles(sensor, flying((speed * math.cos(a), 0.0, -speed * math.sin(a)), t_s=0.1), 1)[0]
        assert math.degrees(up) == pytest.approx(5.0 - stays, abs=1e-6)
        b = math.radians(5.0 - 1.9 * stays)  # within the friction on the other side: it stays
        down = angles(sensor, flying((speed * math.cos(b), 0.0, -speed * math.sin(b)), t_s=0.2), 2)[0]
        assert down == up


def test_a_vane_hangs_still_in_still_air() -> None:
    sensor = made("vane", EXACT_VANE | {"min_airspeed_mps": 2.0})
    assert angles(sensor, flying()) == (0.0, 0.0)
    angles(sensor, flying((15.0, 0.0, -3.0), t_s=0.1), 1)
    stood = angles(sensor, flying((0.5, 1.0, 1.0), t_s=0.2), 2)
    assert stood == pytest.approx((math.atan2(3.0, 15.0), 0.0), abs=1e-9)


def test_the_last_wind_is_the_one_that_counts() -> None:
    """A gust is in the sample of its tick: the sensor asks for the wind each time."""
    wind = [(0.0, 0.0, 0.0)]
    installation = Installation("a", 50.0, 1, FIELD, TICK_NS, wind_at=lambda: wind[0])
    sensor = make_sensor(installation, kind="pitot", overrides=EXACT)
    assert read(sensor, flying((20.0, 0.0, 0.0))) == pytest.approx(impact(20.0), rel=1e-9)
    wind[0] = (-5.0, 0.0, 0.0)
    assert read(sensor, flying((20.0, 0.0, 0.0)), 1) == pytest.approx(impact(25.0), rel=1e-9)
