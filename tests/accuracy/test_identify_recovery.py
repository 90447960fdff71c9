"""The fit finds hidden parameters in logs of the physics: noise, delays, biases and light wind are on."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hil.apps.identify.fit import parameters as at
from hil.apps.identify.fit.estimate import fit_windows
from sim.physics.vehicle import Vehicle
from tests.worlds.excited_flight import Sensing, excited_log, hidden_vehicle, nominal_vehicle

IMU_DELAY_S, POSE_DELAY_S = 0.007, 0.016
GYRO_BIAS, ACCEL_BIAS = (0.01, -0.02, 0.005), (0.1, -0.05, 0.1)


def hover_radps(vehicle: Vehicle) -> float:
    c = vehicle.rotor_constants
    return math.sqrt(vehicle.mass_kg * 9.80665 / (len(vehicle.rotors) * c.thrust_coefficient_n_per_radps2))


def errors(seed: int, duration_s: float) -> tuple[dict[str, float], dict[str, float], list[float]]:
    """Return relative errors, errors of delays [s], and errors over their sigma."""
    nominal = nominal_vehicle()
    truth = hidden_vehicle(nominal, seed)
    log = excited_log(
        truth,
        seed=seed,
        duration_s=duration_s,
        sensing=Sensing(
            imu_delay_s=IMU_DELAY_S,
            pose_delay_s=POSE_DELAY_S,
            gyro_bias_radps=GYRO_BIAS,
            accel_bias_mps2=ACCEL_BIAS,
        ),
    )
    _, unknowns, solution = fit_windows(
        [log], nominal, fixed={}, parts=lambda share: True, progress=lambda share, what: None
    )
    found = at.values(unknowns, solution.s)
    sigma = np.sqrt(np.diag(solution.covariance)) * [abs(u.slope(x)) for u, x in zip(unknowns, solution.s, strict=True)]
    true = [u.start for u in at.vehicle_unknowns(truth)]
    relative = {
        unknowns[i].key: found[i] / true[i] - 1.0
        for i in (at.THRUST, at.INERTIA, at.INERTIA + 1, at.INERTIA + 2, at.TAU_UP, at.TAU_DOWN)
    }
    # Drag of the rotors and of the body brake alike at one rotor speed: what a flight shows is their sum.
    rotors = len(truth.rotors) * hover_radps(truth)
    for axis in (0, 1):
        total = [
            p[at.ROTOR_DRAG] * rotors + p[at.LINEAR_DRAG + axis] + p[at.QUADRATIC_DRAG + axis] * 2.0 * 3.0
            for p in (found, true)
        ]  # its slope at 3 m/s
        relative[f"drag {'xy'[axis]}"] = total[0] / total[1] - 1.0
    first = at.VEHICLE_COUNT
    delays = {
        "motors": found[first + at.MOTOR_DELAY] + IMU_DELAY_S,
        "pose": found[first + at.POSE_DELAY] - (POSE_DELAY_S - IMU_DELAY_S),
    }
    judged = [*range(at.THRUST, at.AIR_MOMENT), *range(at.LINEAR_DRAG, at.CENTRE + 2), at.TAU_UP, at.TAU_DOWN, at.SHAPE]
    normal = [(found[i] - true[i]) / sigma[i] for i in judged]
    log_truth = {at.MOTOR_DELAY: -IMU_DELAY_S, at.POSE_DELAY: POSE_DELAY_S - IMU_DELAY_S}
    log_truth |= {at.GYRO_BIAS + i: GYRO_BIAS[i] for i in range(3)} | {
        at.ACCEL_BIAS + i: ACCEL_BIAS[i] for i in range(3)
    }
    normal += [(found[first + i] - value) / sigma[first + i] for i, value in log_truth.items()]
    return relative, delays, [float(x) for x in normal]


def check(seeds: range, duration_s: float) -> None:
    normal: list[float] = []
    for seed in seeds:
        relative, delays, each = errors(seed, duration_s)
        assert {key: x for key, x in relative.items() if not abs(x) <= 0.03} == {}, f"vehicle {seed}"
        assert {key: x for key, x in delays.items() if not abs(x) <= 0.002} == {}, f"vehicle {seed}"
        normal += each
    assert np.mean(np.abs(normal) <= 3.0) >= 0.95, [round(x, 1) for x in normal if abs(x) > 3.0]


def test_hidden_parameters_of_two_vehicles_are_found() -> None:
    check(range(1, 3), 30.0)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_hidden_parameters_of_twenty_vehicles_are_found() -> None:
    check(range(1, 21), 60.0)
