"""Closed-loop flights of the core round an independent quadrotor model. Limits are those of the bench, plus a margin.

Positions are compared in the estimator's local frame: its origin is a noisy GPS fix (`Flight.offset`).
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.reference.ekf_reference import (
    ATTITUDE,
    IDLE,
    NAN,
    OFF,
    POSITION,
    RATE,
    TICK_US,
    VELOCITY,
    Airframe,
    Flight,
    SensorNoise,
    parameters,
    smooth_legs,
)

ALTITUDE_M = 5.0
RECTANGLE = [(0.0, 0.0, -5.0), (30.0, 0.0, -5.0), (30.0, 20.0, -5.0), (0.0, 20.0, -5.0), (0.0, 0.0, -5.0)]
STANDALONE_GPS = SensorNoise(gps_p=0.5, gps_v=0.15)

IRIS = Airframe(
    mass=1.5,
    inertia=(0.029, 0.029, 0.055),
    rotors=((0.1515, 0.245, 1.0), (-0.1515, -0.1875, 1.0), (0.1515, -0.245, -1.0), (-0.1515, 0.1875, -1.0)),
    thrust_k=1.0288e-5,  # hovers at u = 0.598
    moment_ratio=0.06,
)
IRIS_PARAMETERS = {
    f"CA_ROTOR{i}_{column}": value
    for i, (x, y, spin) in enumerate(IRIS.rotors)
    for column, value in (("PX", x), ("PY", y), ("KM", spin * IRIS.moment_ratio))
}


def in_the_air(**how) -> Flight:
    """Return a flight that hovers over the origin."""
    flight = Flight(**how)
    flight.ready()
    flight.take_off(ALTITUDE_M)
    flight.set(POSITION, x=0.0, y=0.0, z=-ALTITUDE_M, yaw=flight.get("euler")[2])
    flight.run(6.0)
    return flight


def fly_legs(flight: Flight, points: list, speed: float = 3.0, accel: float = 1.5) -> tuple[float, float]:
    """Follow the legs with set-points at 50 Hz; returns the largest cross-track and altitude error."""
    legs = smooth_legs(points, speed, accel)
    offset, yaw = flight.offset(), flight.get("euler")[2]
    dt = TICK_US * 1e-6
    worst = worst_z = 0.0
    for i, (p, v) in enumerate(legs):
        if i % 5 == 0:
            following = legs[min(i + 1, len(legs) - 1)][1]
            a = [min(max((n - o) / dt, -accel), accel) for n, o in zip(following, v, strict=True)]
            flight.set(
                POSITION,
                **dict(zip("xyz", p, strict=True)),
                **dict(zip(("vx", "vy", "vz"), v, strict=True)),
                **dict(zip(("ax", "ay", "az"), a, strict=True)),
                yaw=yaw,
            )
        flight.step()
        error = [flight.p[j] + offset[j] - p[j] for j in range(3)]
        speed_now = math.hypot(v[0], v[1])
        if speed_now > 1e-6:
            worst = max(worst, abs(error[0] * v[1] - error[1] * v[0]) / speed_now)
        worst_z = max(worst_z, abs(error[2]))
    return worst, worst_z


def test_stands_still_with_motors_off_until_commanded():
    flight = Flight()
    flight.ready()
    assert not np.any(np.array(flight.controls))
    assert flight.core.landed
    flight.set(IDLE)
    flight.run(0.5)
    assert np.array(flight.controls)[:4].tolist() == [0.1] * 4
    assert not np.any(np.array(flight.controls)[4:])
    assert flight.core.landed
    flight.set(POSITION, x=0.0, y=0.0, z=0.3, yaw=0.0)  # a set-point below the ground is not a take-off
    flight.run(2.0)
    assert flight.core.landed
    assert max(flight.controls.tolist()) < 0.2


def test_take_off_and_hover():
    flight = Flight()
    flight.ready()
    flight.take_off(ALTITUDE_M)
    assert not flight.core.landed
    assert max(-p[2] for p in flight.log.p) < ALTITUDE_M + 0.3
    assert max(flight.log.tilt) < math.radians(6.0)
    start = len(flight.log.p)
    flight.run(10.0)
    hover = np.array(flight.log.p[start:])
    assert hover.std(axis=0).max() < 0.05
    assert abs(hover[:, 2].mean() + flight.offset()[2] + ALTITUDE_M) < 0.1
    assert flight.get("thrust_sp")[0] == pytest.approx(0.591, abs=0.02)
    assert flight.get("saturation") == (1.0,)


@pytest.mark.parametrize(
    ("how", "cross_track_m", "altitude_m"),
    [
        pytest.param({}, 0.2, 0.1, marks=pytest.mark.slow),
        ({"wind_N": (4.0, 3.0, 0.0)}, 0.2, 0.1),
        pytest.param({"noise": STANDALONE_GPS}, 0.5, 0.3, marks=pytest.mark.slow),
        pytest.param(
            {"airframe": IRIS, "params": parameters(MPC_THR_HOVER=0.358, **IRIS_PARAMETERS)},
            0.2,
            0.1,
            marks=pytest.mark.slow,
        ),
        # PX4's own settings of that airframe: a linear thrust model and a hover thrust that is well off.
        ({"airframe": IRIS, "params": parameters(MPC_THR_HOVER=0.5, THR_MDL_FAC=0.0, **IRIS_PARAMETERS)}, 0.25, 0.1),
    ],
    ids=["rtk", "wind", "standalone", "iris", "iris-px4"],
)
def test_rectangle(how, cross_track_m, altitude_m):
    flight = in_the_air(**how)
    cross_track, altitude = fly_legs(flight, RECTANGLE)
    assert cross_track < cross_track_m
    assert altitude < altitude_m
    assert flight.get("resets") == (0.0,)
    assert flight.get("rejected_setpoints") == (0.0,)


def test_position_step_without_overshoot():
    flight = in_the_air()
    flight.set(POSITION, x=10.0, y=0.0, z=-8.0, yaw=flight.get("euler")[2])
    start = len(flight.log.p)
    flight.run(10.0)
    path = np.array(flight.log.p[start:]) + flight.offset()
    assert path[:, 0].max() < 10.3
    assert (-path[:, 2]).max() < 8.3
    assert np.abs(path[:, 1]).max() < 0.2
    assert path[-1] == pytest.approx([10.0, 0.0, -8.0], abs=0.15)
    assert max(flight.log.tilt) < math.radians(36.0)


def test_level_dash_keeps_altitude():
    """Tilting 30 degrees and back loses no height, with a thrust to weight of 1.7."""
    flight = in_the_air()
    yaw = flight.get("euler")[2]
    start = len(flight.log.p)
    for x in (6.0, 0.0, 6.0):
        flight.set(POSITION, x=x, y=0.0, z=-ALTITUDE_M, yaw=yaw)
        flight.run(2.0)
    height = np.array(flight.log.p[start:])[:, 2] + flight.offset()[2] + ALTITUDE_M
    assert np.abs(height).max() < 0.07


def test_yaw_turns_the_short_way_and_holds_position():
    flight = in_the_air()
    start = flight.get("euler")[2]
    flight.set(POSITION, x=0.0, y=0.0, z=-ALTITUDE_M, yaw=start - 2.5)
    count = len(flight.log.p)
    flight.run(6.0)
    turn = math.remainder(flight.get("euler")[2] - start, 2 * math.pi)
    assert turn == pytest.approx(-2.5, abs=0.05)
    path = np.array(flight.log.p[count:]) + flight.offset()
    assert np.abs(path[:, :2]).max() < 0.2
    flight.set(POSITION, x=0.0, y=0.0, z=-ALTITUDE_M, yawspeed=0.4)
    before = flight.get("euler")[2]
    flight.run(3.0)
    assert math.remainder(flight.get("euler")[2] - before, 2 * math.pi) == pytest.approx(1.2, abs=0.1)


def test_velocity_control_on_some_axes():
    flight = in_the_air()
    flight.set(POSITION, x=NAN, y=0.0, z=NAN, vx=2.0, vy=0.0, vz=-0.5, yaw=0.0)
    flight.run(5.0)
    assert flight.v == pytest.approx((2.0, 0.0, -0.5), abs=0.15)
    assert abs(flight.p[1] + flight.offset()[1]) < 0.2
    flight.set(VELOCITY, vx=0.0, vy=-1.5, vz=0.0, yaw=0.0)
    flight.run(5.0)
    assert flight.v == pytest.approx((0.0, -1.5, 0.0), abs=0.15)


def test_attitude_and_rate_control():
    flight = in_the_air()
    flight.set(ATTITUDE, x=0.2, y=-0.15, z=0.6, yaw=flight.get("euler")[2])
    flight.run(1.0)
    roll, pitch, _ = flight.get("euler")
    assert (roll, pitch) == (pytest.approx(0.2, abs=0.03), pytest.approx(-0.15, abs=0.03))
    flight.set(RATE, x=-0.5, y=0.3, z=0.2, vx=0.6)
    flight.run(0.5)
    assert flight.w == pytest.approx((-0.5, 0.3, 0.2), abs=0.1)


@pytest.mark.parametrize("wind", [(0.0, 0.0, 0.0), (4.0, 3.0, 0.0)], ids=["calm", "wind"])
@pytest.mark.parametrize("speed", [0.3, 0.7, 1.2])
def test_landing(speed, wind):
    flight = in_the_air(wind_N=wind)
    flight.set(POSITION, x=0.0, y=0.0, z=NAN, vz=speed, yaw=flight.get("euler")[2])
    start = len(flight.log.p)
    fell = 0.0
    while not flight.core.landed and len(flight.log.p) - start < 250 * 30:
        flight.step()
        assert flight.p[2] > -0.05 or not flight.core.landed
        if flight.p[2] < -0.3:
            assert flight.get("ground_contact") == (0.0,)
        fell = max(fell, flight.v[2])
    assert flight.core.landed
    assert fell < speed + 0.25
    touch = next(i for i in range(start, len(flight.log.p)) if flight.log.p[i][2] > -0.01)
    assert len(flight.log.p) - touch < 250 * 3  # reported within 3 s of touching down
    assert max(flight.log.tilt[start:]) < math.radians(15.0)
    flight.set(OFF)
    flight.run(0.5)
    assert not np.any(np.array(flight.controls))
    # And up again.
    flight.take_off(3.0, 6.0)
    assert not flight.core.landed
    assert flight.p[2] + flight.offset()[2] == pytest.approx(-3.0, abs=0.25)


def test_a_descent_in_the_air_is_no_landing():
    """Told to stay and to sink in turn, high up: contact is never declared for good and the vehicle does not drop."""
    flight = in_the_air()
    for _ in range(4):
        flight.set(VELOCITY, vx=0.0, vy=0.0, vz=0.3, yaw=0.0)
        flight.run(1.0)
        assert not flight.core.landed
        flight.set(VELOCITY, vx=0.0, vy=0.0, vz=-0.3, yaw=0.0)
        flight.run(1.0)
        assert abs(flight.v[2]) < 0.6


def test_without_gps_it_keeps_attitude_and_altitude():
    flight = in_the_air()
    flight.gps_on = False
    flight.run(4.0)
    assert flight.get("position_ok") == (1.0,)
    flight.run(4.0)
    assert flight.get("position_ok") == (0.0,)
    assert flight.get("velocity_ok") == (0.0,)
    assert flight.get("attitude_ok") == (1.0,)
    flight.run(5.0)
    assert abs(flight.p[2] + ALTITUDE_M) < 1.0
    assert flight.log.tilt[-1] < math.radians(10.0)
    flight.gps_on = True
    flight.run(10.0)
    assert flight.get("position_ok") == (1.0,)
    true_local = [a + b for a, b in zip(flight.p, flight.offset(), strict=True)]
    assert flight.get("p_NF") == pytest.approx(true_local, abs=0.15)


def test_without_compass_yaw_follows_the_gyro():
    flight = in_the_air()
    flight.mag_on = False
    cross_track, _ = fly_legs(flight, RECTANGLE)
    assert cross_track < 0.3
