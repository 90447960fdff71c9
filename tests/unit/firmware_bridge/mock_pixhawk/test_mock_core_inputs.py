"""The flight core and bad input: refused or counted, never passed on."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from firmware_bridge import _native
from tests.reference.ekf_reference import ATTITUDE, POSITION, RATE, Flight, SensorNoise, parameters

NAN, INF = math.nan, math.inf
PARAM_LIMIT = 16  # MAVLink: char param_id[16]


@pytest.fixture
def hovering() -> Flight:
    flight = Flight()
    flight.ready()
    flight.take_off(3.0, 5.0)
    return flight


def test_parameter_table_is_usable():
    names = _native.PARAM_NAMES
    assert len(set(names)) == len(names)
    assert all(len(name) <= PARAM_LIMIT for name in names)
    columns = (_native.PARAM_MIN, _native.PARAM_DEFAULTS, _native.PARAM_MAX)
    for low, value, high in zip(*columns, strict=True):
        assert low <= value <= high
    core = _native.FlightCore(parameters())
    for index, values in enumerate(zip(*columns, strict=True)):
        if not names[index].startswith("CA_"):
            for value in values:
                core.set_param(index, float(np.float32(value)))


def test_state_fields_tile_the_state():
    spans = sorted(_native.STATE_FIELDS.values())
    assert spans[0][0] == 0
    for (offset, size), (following, _) in itertools.pairwise(spans):
        assert offset + size == following
    assert sum(spans[-1]) == 64


def test_views_are_stable_and_read_only():
    core = _native.FlightCore(parameters())
    state, controls = core.state, core.controls
    assert state.shape == (64,)
    assert controls.shape == (16,)
    with pytest.raises(ValueError, match="read-only"):
        state[0] = 1.0
    core.step(4000, 0, 0, 0, 0, 0, -9.81)
    core.step(8000, 0, 0, 0, 0, 0, -9.81)
    assert state[0] == 8000.0
    assert np.shares_memory(state, core.state)
    del core
    assert np.all(np.isfinite(state[:23]))  # the views keep the core alive


def test_parameter_array_of_another_layout_is_refused():
    with pytest.raises(ValueError, match="PARAM_NAMES"):
        _native.FlightCore(parameters()[:-1].copy())
    with pytest.raises(TypeError):
        _native.FlightCore(parameters().astype(np.float32))
    with pytest.raises(IndexError):
        _native.FlightCore(parameters()).set_param(len(_native.PARAM_NAMES), 1.0)


def test_bad_samples_are_counted_and_change_nothing(hovering):
    core = hovering.core
    before = np.array(core.state)
    t = int(before[0])
    for bad in (NAN, INF, -INF, 1e30):
        core.update_gps(t + 1, bad, 8.5, 488.0, 0, 0, 0, 0.02, 0.02)
        core.update_gps(t + 1, 47.4, 8.5, 488.0, bad, 0, 0, 0.02, 0.02)
        core.update_gps(t + 1, 47.4, 8.5, 488.0, 0, 0, 0, bad, 0.02)
        core.update_baro(t + 1, bad)
        core.update_mag(t + 1, bad, 0.0, 0.4)
    core.update_mag(t + 1, 0.0, 0.0, 0.0)  # no field
    core.update_gps(t + 1, 47.4, 8.5, 488.0, 0, 0, 0, 0.0, 0.02)  # claims to be exact
    after = np.array(core.state)
    rejected = slice(*[_native.STATE_FIELDS["rejected"][0] + d for d in (0, 5)])
    assert (after - before)[rejected].tolist() == [0.0, 13.0, 4.0, 5.0, 0.0]
    after[rejected] = before[rejected]
    assert after.tobytes() == before.tobytes()


def test_repeated_and_reversed_time_is_rejected(hovering):
    core = hovering.core
    before = hovering.get("p_NF")
    t = int(core.state[0])
    core.step(t, 0, 0, 0, 0, 0, -9.81)
    core.step(t - 4000, 0, 0, 0, 0, 0, -9.81)
    assert hovering.get("rejected")[0] == 2.0
    assert hovering.get("p_NF") == before


@pytest.mark.parametrize("bad", [NAN, INF, 1e12])
def test_imu_faults_in_flight_are_bridged(hovering, bad):
    core = hovering.core
    for _ in range(5):
        hovering.run(0.2)
        t_us = int(core.state[0]) + 2000
        core.step(t_us, bad, 0.0, 0.0, 0.0, bad, 0.0)
    assert hovering.get("rejected")[0] == 5.0
    hovering.run(1.0)
    assert np.all(np.isfinite(np.array(core.state)))
    assert np.all(np.isfinite(np.array(core.controls)))
    assert abs(hovering.p[2] + 3.0) < 0.3
    assert hovering.get("attitude_ok") == (1.0,)


def test_lasting_imu_failure_is_reported(hovering):
    core = hovering.core
    t = int(core.state[0])
    for k in range(1, 61):
        core.step(t + 4000 * k, NAN, NAN, NAN, NAN, NAN, NAN)
    assert hovering.get("attitude_ok") == (0.0,)
    assert np.all(np.isfinite(np.array(core.controls)))


def test_invalid_setpoints_are_refused(hovering):
    core = hovering.core
    bad = [
        {"kind": POSITION, "x": INF},
        {"kind": POSITION, "z": 1e9},
        {"kind": POSITION, "vx": -INF},
        {"kind": POSITION, "yaw": INF},
        {"kind": RATE, "x": 0.0, "y": 0.0, "z": 0.0},  # no thrust
        {"kind": ATTITUDE, "x": 0.0, "y": 0.0},  # no thrust
        {"kind": ATTITUDE, "x": 0.0, "y": 2.0, "z": 0.5},
        {"kind": 6},
        {"kind": -1},
    ]
    for setpoint in bad:
        assert core.set_setpoint(**setpoint) is False, setpoint
    hovering.run(0.5)
    assert hovering.get("rejected_setpoints") == (float(len(bad)),)
    assert abs(hovering.p[2] + 3.0) < 0.2


def test_gps_outlier_is_gated_and_a_lasting_jump_is_followed():
    flight = Flight(noise=SensorNoise(gps_p=0.05))
    flight.ready()
    flight.set(0)
    flight.run(2.0)
    estimate = flight.get("p_NF")
    true_plane = flight.plane

    class Shifted:
        def geodetic(self, n: float, e: float, d: float) -> tuple[float, float, float]:
            return true_plane.geodetic(n + 40.0, e, d)

    flight.plane = Shifted()
    flight.run(0.3)
    assert flight.get("test_ratios")[0] > 1.0
    assert math.dist(flight.get("p_NF"), estimate) < 0.2
    flight.run(6.0)  # past EKF_REJECT_T
    assert flight.get("resets") == (1.0,)
    assert flight.get("p_NF")[0] - estimate[0] == pytest.approx(40.0, abs=0.3)


def test_geodesy_against_pymap3d():
    pymap3d = pytest.importorskip("pymap3d")
    flight = Flight()
    flight.ready()
    origin = flight.get("origin")
    for n, e, d in ((0.0, 0.0, 0.0), (123.0, -456.0, -50.0), (-5000.0, 7000.0, -300.0)):
        lat, lon, alt = flight.core.ned_to_geodetic(n, e, d)
        north, east, _ = pymap3d.geodetic2ned(lat, lon, alt, *origin)
        assert (north, east) == (pytest.approx(n, abs=1e-6), pytest.approx(e, abs=1e-6))
        assert alt == pytest.approx(origin[2] - d, abs=1e-9)
        assert flight.core.geodetic_to_ned(lat, lon, alt) == pytest.approx((n, e, d), abs=1e-6)


def in_fifo_steps(x: float, step: float) -> float:
    return round(min(max(x, -32767.0 * step), 32767.0 * step) * (1.0 / step)) * step


def test_fifo_samples_have_steps_of_int16_and_nan_is_no_sample():
    rng = np.random.default_rng(5)
    by_fifo, by_hand = _native.FlightCore(parameters()), _native.FlightCore(parameters())
    force_step, rate_step = 9.80665 / 2048.0, 2000.0 / 32768.0 * (math.pi / 180.0)
    for k in range(1, 300):
        rates = rng.normal(0.0, 20.0 if k % 7 == 0 else 0.1, 3)
        forces = rng.normal((0, 0, -9.8), 60.0 if k % 5 == 0 else 0.2)
        if k % 50 == 0:
            rates, forces = (INF, -INF, -1e-9), (-0.0, -1e-9, 2.5 * force_step)
        assert by_fifo.step_fifo(4000 * k, *rates, *forces)
        words = (*(in_fifo_steps(x, rate_step) for x in rates), *(in_fifo_steps(x, force_step) for x in forces))
        by_hand.step(4000 * k, *words)
        assert by_fifo.state.tobytes() == by_hand.state.tobytes()
    before = by_fifo.state.tobytes()
    for place in range(6):
        assert not by_fifo.step_fifo(10**9, *(NAN if i == place else 0.0 for i in range(6)))
    assert by_fifo.state.tobytes() == before


def test_motor_commands_come_in_steps_of_a_thousandth(hovering: Flight):
    controls = hovering.core.controls.tolist()
    assert hovering.core.motor_commands(4) == [round(u * 1000.0) / 1000.0 for u in controls[:4]] + [0.0] * 12
    assert hovering.core.motor_commands(2)[:3] == [*hovering.core.motor_commands(4)[:2], 0.0]
    assert all(0.0 < u < 1.0 for u in hovering.core.motor_commands(4)[:4])
