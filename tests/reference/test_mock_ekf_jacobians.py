"""The estimator compiled from the C++ that CasADi generates: it equals the model, and its derivatives are right."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from firmware_bridge import _native
from firmware_bridge.mock_pixhawk.estimate import ekf_model

FUNCTIONS = {f.name(): f for f in ekf_model.functions()}
COMPILED = {name: ca.external(name, _native.__file__) for name in FUNCTIONS}


def compiled(name: str, *inputs: np.ndarray) -> list[np.ndarray]:
    """Return the outputs of one compiled function, flat."""
    return [np.array(out).ravel() for out in COMPILED[name].call([ca.DM(i) for i in inputs])]


def random_inputs(name: str, rng: np.random.Generator) -> list[np.ndarray]:
    q = rng.normal(size=4)
    q /= np.linalg.norm(q)
    if name in ("ekf_predict", "ekf_transition"):
        x = np.concatenate([q, 5.0 * rng.normal(size=6), 0.02 * rng.normal(size=3), 0.1 * rng.normal(size=3)])
        imu = np.concatenate([3.0 * rng.normal(size=3), 10.0 * rng.normal(size=3)])
        return [x, imu, np.array([0.004]), np.array([9.81])][: FUNCTIONS[name].n_in()]
    if name == "ekf_heading":
        return [q, rng.normal(size=3)]
    return [q, 10.0 * rng.normal(size=3), np.array([0.1])]


def test_a_model_that_calls_more_than_sqrt_is_refused(tmp_path, monkeypatch):
    x = ca.SX.sym("x")
    monkeypatch.setattr(ekf_model, "functions", lambda: [ca.Function("f", [x], [1 + 2 * ca.atan2(x, ca.sqrt(x))])])
    with pytest.raises(SystemExit, match="atan2"):
        ekf_model.write(tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", FUNCTIONS)
def test_compiled_code_equals_the_model(name):
    rng = np.random.default_rng(7)
    for _ in range(20):
        inputs = random_inputs(name, rng)
        expected = FUNCTIONS[name].call([ca.DM(i) for i in inputs])
        for c, e in zip(compiled(name, *inputs), expected, strict=True):
            np.testing.assert_array_equal(c, np.array(e).ravel())


def exact_exp(phi: np.ndarray) -> np.ndarray:
    angle = np.linalg.norm(phi)
    return np.concatenate([[np.cos(angle / 2)], np.sinc(angle / (2 * np.pi)) / 2 * phi])


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.array(ekf_model.quaternion_product(ca.DM(a), ca.DM(b))).ravel()


def matrix(q: np.ndarray) -> np.ndarray:
    return np.array(ekf_model.rotation_matrix(ca.DM(q)))


def propagate_exactly(x: np.ndarray, imu: np.ndarray, dt: float, gravity: float) -> np.ndarray:
    """Return the documented transition with exact sin and cos."""
    phi = (imu[:3] - x[10:13]) * dt
    a = matrix(product(x[:4], exact_exp(phi / 2))) @ (imu[3:] - x[13:]) + [0, 0, gravity]
    q = product(x[:4], exact_exp(phi))
    return np.concatenate([q, x[4:7] + a * dt, x[7:10] + x[4:7] * dt + a * dt * dt / 2, x[10:]])


def perturbed(x: np.ndarray, e: np.ndarray) -> np.ndarray:
    return np.concatenate([product(x[:4], exact_exp(e[:3])), x[4:] + e[3:]])


def error_between(x: np.ndarray, x_true: np.ndarray) -> np.ndarray:
    dq = product(x[:4] * [1, -1, -1, -1], x_true[:4])
    return np.concatenate([2 * dq[1:] / dq[0], x_true[4:] - x[4:]])


def test_prediction_against_exact_rotation():
    rng = np.random.default_rng(3)
    worst = 0.0
    for _ in range(50):
        x, imu, dt, g = random_inputs("ekf_predict", rng)
        imu[:3] *= 10.0 / np.linalg.norm(imu[:3])
        x_next, _ = compiled("ekf_predict", x, imu, dt, g)
        worst = max(worst, np.abs(x_next - propagate_exactly(x, imu, dt[0], g[0])).max())
    assert worst < 1e-12


def test_transition_matrix_against_finite_differences():
    rng = np.random.default_rng(5)
    theta, vel, pos, bg, ba = ekf_model.THETA, ekf_model.VEL, ekf_model.POS, ekf_model.GYRO_BIAS, ekf_model.ACCEL_BIAS
    places = [(theta, theta), (theta, bg), (vel, theta), (vel, bg), (vel, ba), (pos, theta), (pos, bg), (pos, ba)]
    for _ in range(10):
        x, imu, dt, g = random_inputs("ekf_predict", rng)
        blocks = compiled("ekf_transition", x, imu, dt)
        F = np.eye(15)
        F[theta, theta] = 0.0
        F[pos, vel] = dt[0] * np.eye(3)
        for (rows, columns), block in zip(places, blocks, strict=True):
            F[rows, columns] = np.reshape(block, (3, 3))
        h = 1e-5
        numeric = np.empty((15, 15))
        nominal = propagate_exactly(x, imu, dt[0], g[0])
        for j in range(15):
            step = np.zeros(15)
            step[j] = h
            plus = error_between(nominal, propagate_exactly(perturbed(x, step), imu, dt[0], g[0]))
            minus = error_between(nominal, propagate_exactly(perturbed(x, -step), imu, dt[0], g[0]))
            numeric[:, j] = (plus - minus) / (2 * h)
        np.testing.assert_allclose(F, numeric, atol=2e-9)


def test_measurement_rows_against_finite_differences():
    rng = np.random.default_rng(9)
    for _ in range(10):
        q, field = random_inputs("ekf_heading", rng)
        row = compiled("ekf_heading", q, field)[0]
        force, tau = 10.0 * rng.normal(size=3), 0.1
        rows = [np.reshape(b, (3, 3)) for b in compiled("ekf_delayed", q, force, np.array([tau]))]
        body_force = matrix(q).T @ force

        def acceleration(e: np.ndarray, q=q, body_force=body_force) -> np.ndarray:
            return matrix(product(q, exact_exp(e[:3]))) @ (body_force - e[3:])

        h = 1e-6
        for j in range(6):
            step = np.zeros(6)
            step[j] = h
            da = (acceleration(step) - acceleration(-step)) / (2 * h)
            kind, column = divmod(j, 3)
            np.testing.assert_allclose(rows[kind][:, column], -tau * da, atol=1e-7)
            np.testing.assert_allclose(rows[2 + kind][:, column], tau * tau / 2 * da, atol=1e-8)
            if kind == 0:
                heading = [
                    np.arctan2(*(matrix(product(q, exact_exp(s * step[:3]))) @ field)[1::-1]) for s in (1.0, -1.0)
                ]
                turn = (heading[0] - heading[1] + np.pi) % (2 * np.pi) - np.pi
                assert row[j] == pytest.approx(turn / (2 * h), abs=1e-4 * max(1.0, abs(row[j])))
