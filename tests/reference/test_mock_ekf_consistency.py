"""The estimator's accuracy and the consistency of its covariance (NEES, NIS), in simulated flight.

NEES = e^T P^-1 e averages the number of states if P is right; NIS = r^T S^-1 r the number of measurements
(Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, section 5.4).
"""

from __future__ import annotations

import itertools
import math
import random

import casadi as ca
import numpy as np
import pytest

from firmware_bridge import _native
from tests.reference.ekf_reference import OFF, POSITION, TICK_US, Flight, SensorNoise, parameters, smooth_legs

RUNS = 6
LEGS = [(0.0, 0.0, -5.0), (25.0, 0.0, -8.0), (25.0, 15.0, -5.0), (0.0, 15.0, -5.0)]


def matched(noise: SensorNoise) -> np.ndarray:
    """Return parameters that state exactly the simulated noise."""
    root_dt = math.sqrt(TICK_US * 1e-6)
    return parameters(
        EKF_GYR_NOISE=noise.gyro * root_dt,
        EKF_ACC_NOISE=noise.accel * root_dt,
        EKF_GYR_B_NOISE=1e-6,
        EKF_ACC_B_NOISE=1e-5,
        EKF_GPS_V_NOISE=noise.gps_v,
        EKF_GPS_P_NOISE=0.001,
        EKF_GPS_T_NOISE=0.0,
        EKF_BARO_NOISE=noise.baro,
        EKF_BARO_DRIFT=0.001,
        EKF_HEAD_NOISE=noise.mag / 0.21,
    )


def with_random_biases(seed: int) -> SensorNoise:
    draw = random.Random(1000 + seed)
    return SensorNoise(
        gps_p=0.05,
        gyro_bias=tuple(draw.gauss(0.0, 0.01) for _ in range(3)),
        accel_bias=tuple(draw.gauss(0.0, 0.1) for _ in range(3)),
    )


def error_vector(flight: Flight) -> np.ndarray:
    """Return true minus estimated attitude (body), velocity, position, gyro bias, accelerometer bias."""
    q, offset = flight.get("q_NF"), flight.offset()
    dq = flight._times((q[0], -q[1], -q[2], -q[3]), flight.q)
    sign = 2.0 if dq[0] > 0 else -2.0
    parts = [[sign * d for d in dq[1:]]]
    for true, name in (
        (flight.v, "v_NF_N"),
        ([a + b for a, b in zip(flight.p, offset, strict=True)], "p_NF"),
        (flight.noise.gyro_bias, "gyro_bias"),
        (flight.noise.accel_bias, "accel_bias"),
    ):
        parts.append([t - e for t, e in zip(true, flight.get(name), strict=True)])
    return np.concatenate(parts)


def covariance(flight: Flight) -> np.ndarray:
    return np.array([[flight.core.covariance(i, j) for j in range(16)] for i in range(16)])


@pytest.fixture(scope="module")
def flights() -> list[tuple[np.ndarray, np.ndarray]]:
    """Return NEES (all 15, then each group of 3) and NIS of GPS position and velocity per run, as means of a flight."""
    results = []
    for seed in range(RUNS):
        noise = with_random_biases(seed)
        flight = Flight(seed=seed, params=matched(noise), noise=noise)
        flight.ready()
        flight.take_off()
        nees, nis = [], []
        for i, (p, v) in enumerate(smooth_legs(LEGS, 3.0, 1.5)):
            yaw = 0.7 + 0.5 * math.sin(0.002 * i)
            flight.set(POSITION, x=p[0], y=p[1], z=p[2], vx=v[0], vy=v[1], vz=v[2], yaw=yaw)
            flight.step()
            if i % 25 == 12:
                e, P = error_vector(flight), covariance(flight)
                assert np.array_equal(P, P.T)
                assert np.linalg.eigvalsh(P).min() > 0.0
                groups = [slice(0, 15), *(slice(k, k + 3) for k in range(0, 15, 3))]
                nees.append([e[g] @ np.linalg.solve(P[g, g], e[g]) for g in groups])
                nis.append(flight.get("nis_gps"))
        results.append((np.mean(nees, axis=0), np.mean(nis, axis=0)))
    return results


def test_errors_match_the_covariance(flights):
    # Errors are correlated over a whole flight, so each run is close to one draw: chi-square with 15 x 6 = 90 degrees
    # of freedom is within [61, 129] at 99.5 % two-sided; over 6 runs of 15 that is 10.2 .. 21.5.
    nees = np.mean([n for n, _ in flights], axis=0)
    assert 10.2 < nees[0] < 21.5, nees
    assert np.all(nees[1:] < 7.0), nees  # 3 expected; 6 draws of 3: below 6.2 at 99.9 %, and linearisation
    assert np.all(nees[1:] > 0.8), nees


def test_innovations_match_their_covariance(flights):
    # Some 180 independent triples per run, 6 runs: mean 3, deviation sqrt(6 / 1000) = 0.08.
    nis = np.mean([n for _, n in flights], axis=0)
    assert nis == pytest.approx([3.0, 3.0], abs=0.3)


def test_alignment_at_rest():
    for seed in range(4):
        noise = SensorNoise(accel_bias=(0.02, -0.015, 0.03))
        flight = Flight(seed=seed, noise=noise, yaw_rad=-2.0 + seed)
        flight.set(OFF)
        flight.run(0.9)
        assert flight.get("tilt_aligned") == (0.0,)
        flight.run(1.1)
        assert flight.get("tilt_aligned") == flight.get("yaw_aligned") == (1.0,)
        roll, pitch, yaw = flight.get("euler")
        assert max(abs(roll), abs(pitch)) < math.radians(0.5)
        assert abs(math.remainder(yaw - (-2.0 + seed), 2 * math.pi)) < math.radians(2.0)
        assert flight.get("gyro_bias") == pytest.approx(noise.gyro_bias, abs=5e-4)


def test_biases_are_found_in_flight():
    noise = SensorNoise(gyro_bias=(0.02, -0.03, 0.01), accel_bias=(0.15, -0.1, 0.2))
    flight = Flight(noise=noise)
    flight.ready()
    flight.take_off()
    for k in range(12):  # rotation separates a tilt error from an accelerometer bias
        flight.set(POSITION, x=5.0 * (k % 2), y=0.0, z=-5.0, yaw=0.7 + 1.5 * k)
        flight.run(4.0)
    assert flight.get("gyro_bias") == pytest.approx(noise.gyro_bias, abs=1e-3)
    assert flight.get("accel_bias") == pytest.approx(noise.accel_bias, abs=0.05)


def test_dipping_field_does_not_bias_tilt():
    """At rest tilt and accelerometer bias cannot be told apart, and the compass must not seem to do it.

    A heading row linearised at the noisy sample seems to: within 10 s the bias estimate drifts by six of its
    own standard deviations.
    """
    walk = []
    for seed in range(4):
        noise = with_random_biases(seed)
        flight = Flight(seed=seed, params=matched(noise), noise=noise)
        flight.set(OFF)
        flight.run(1.5)
        before, sigma = error_vector(flight), np.sqrt(np.diag(covariance(flight)))[:15]
        flight.run(10.0)
        walk.append((error_vector(flight) - before)[[0, 1, 12, 13]] / sigma[[0, 1, 12, 13]])
    assert np.abs(walk).max() < 1.0


@pytest.mark.parametrize("told_ms", [0.0, 100.0, 200.0])
def test_gps_delay_is_compensated(told_ms):
    """At 4 m/s a fix is 0.4 m behind; with the right delay set, the estimate is not."""
    noise = SensorNoise()
    flight = Flight(noise=noise, params=parameters(EKF_GPS_DELAY=told_ms))
    flight.ready()
    flight.take_off()
    offset = flight.offset()
    along = []
    for i, (p, v) in enumerate(smooth_legs([(0.0, 0.0, -5.0), (40.0, 0.0, -5.0)], 4.0, 2.0)):
        flight.set(POSITION, x=p[0], y=p[1], z=p[2], vx=v[0], vy=v[1], vz=v[2], yaw=0.7)
        flight.step()
        if v[0] == 4.0 and i % 10 == 0:
            along.append(flight.get("p_NF")[0] - flight.p[0] - offset[0])
    error = float(np.mean(along))
    assert error == pytest.approx(4.0 * (told_ms - 100.0) * 1e-3, abs=0.06 + 0.15 * (told_ms != 100.0))
    if told_ms == 100.0:
        assert abs(error) < 0.03


def after_an_outage() -> tuple[Flight, tuple[float, ...]]:
    """Return a hover after 15 s without GPS, position and velocity uncertain, and the fix (200 ms late) to end it."""
    flight = Flight()
    flight.ready()
    flight.take_off()
    flight.gps_on = False
    flight.run(15.0)
    assert flight.get("std_v")[0] > 0.1
    lat, lon, alt = flight.plane.geodetic(*flight.p)
    return flight, (lat, lon, alt, *flight.v, 0.05, 0.05)


def test_delayed_fusion_is_the_textbook_update():
    """Six scalar updates in sequence equal the batch update P - K S K^T with the rows carried back by tau."""
    flight, fix = after_an_outage()
    core, tau = flight.core, 0.1
    before = covariance(flight)
    q = flight.get("q_NF")
    # Hovering: the mean specific force of the last 100 ms is gravity's, within a per cent.
    delayed = ca.external("ekf_delayed", _native.__file__)
    blocks = delayed.call([ca.DM(q), ca.DM([0.0, 0.0, -9.81]), ca.DM([tau])])
    v_theta, v_ba, p_theta, p_ba = (np.reshape(b, (3, 3)) for b in blocks)
    H = np.zeros((6, 16))
    H[:3, 0:3], H[:3, 3:6], H[:3, 12:15] = v_theta, np.eye(3), v_ba
    H[3:, 0:3], H[3:, 3:6], H[3:, 6:9], H[3:, 12:15] = p_theta, -tau * np.eye(3), np.eye(3), p_ba
    R = np.diag([0.1**2] * 3 + [0.05**2] * 3)
    S = H @ before @ H.T + R
    expected = before - before @ H.T @ np.linalg.solve(S, H @ before)
    core.set_param(_native.PARAM_NAMES.index("EKF_GPS_T_NOISE"), 0.0)
    core.update_gps(int(flight.state[0]), *fix)
    scale = np.sqrt(np.outer(np.diag(before), np.diag(before)))
    assert np.abs((covariance(flight) - expected) / scale).max() < 2e-3
    assert flight.get("rejected")[1] == 0.0


def test_the_past_is_corrected_with_the_present():
    """The same fix again corrects nothing but noise: the stored past states were corrected with the present."""
    flight, fix = after_an_outage()
    positions = [flight.get("p_NF")]
    for repeat in range(2):
        flight.core.update_gps(int(flight.state[0]) + repeat, *fix)
        positions.append(flight.get("p_NF"))
    first, second = (math.dist(a, b) for a, b in itertools.pairwise(positions))
    assert first > 0.2
    assert second < 0.05 * first
    assert flight.get("rejected")[1] == 0.0


def test_fix_older_than_the_ring_is_rejected():
    flight = Flight()
    flight.ready()
    flight.run(1.0)
    rejected = flight.get("rejected")[1]
    lat, lon, alt = flight.plane.geodetic(0.0, 0.0, 0.0)
    t = int(flight.state[0])
    flight.core.set_param(0, 200.0)
    for _ in range(20):  # silence, then a long-delayed packet
        t += 4000
        flight.core.step(t, 0, 0, 0, 0, 0, -9.81)
    flight.core.update_gps(t - 60_000, lat, lon, alt, 0, 0, 0, 0.02, 0.02)
    assert flight.get("rejected")[1] == rejected + 1
