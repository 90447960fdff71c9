"""Free flight against an exact reference: the size of the error, and its order.

The reference is written independently of the kernel, from the same physics in another form: total angular momentum
in the world frame, L_W = R (I w + h e_z) with dL_W/dt = R tau, attitude as a 3x3 matrix, forces by cross products,
rotor speeds integrated, not in closed form. scipy's DOP853 solves it with tolerances of 1e-13.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
import scipy.integrate
from numpy.typing import NDArray

from sim._kernels import RigidBody
from sim.physics.vehicle import Vehicle, load_vehicle, vehicle_names

Float64 = NDArray[np.float64]
G = 9.80665
WIND = np.array([2.0, -1.5, 0.5])
TICK_S = 0.004


def reference(vehicle: Vehicle, state: Float64, controls: Float64, duration_s: float) -> Float64:
    """State (p, q, v, w, rotor speeds) after `duration_s` of constant controls."""
    c = vehicle.rotor_constants
    inertia = np.diag(vehicle.inertia_kgm2)
    sites = np.array([r.position_m for r in vehicle.rotors])
    spins = np.array([1.0 if r.spin.value == "ccw" else -1.0 for r in vehicle.rotors])
    up = np.array([0.0, 0.0, 1.0])
    command = np.clip(controls, 0.0, 1.0) * c.max_speed_radps
    lag = np.where(command > state[13:], c.time_constant_up_s, c.time_constant_down_s)

    def slope(_t: float, s: Float64) -> Float64:
        R, v, L, speed = s[3:12].reshape(3, 3), s[12:15], s[15:18], s[18:]
        w = np.linalg.solve(inertia, R.T @ L - c.inertia_kgm2 * (spins @ speed) * up)
        air = R.T @ (v - WIND)
        force = -(
            np.array(vehicle.body_drag_linear_n_per_mps) * air
            + np.array(vehicle.body_drag_quadratic_n_per_m2ps2) * np.abs(air) * air
        )
        torque = np.zeros(3)
        for site, spin, speed_i in zip(sites, spins, speed, strict=True):
            thrust = c.thrust_coefficient_n_per_radps2 * speed_i**2
            hub = air + np.cross(w, site)
            rotor_force = thrust * up - c.drag_kg_per_rad * speed_i * (hub - (hub @ up) * up)
            force = force + rotor_force
            torque = torque + np.cross(site, rotor_force) - spin * c.moment_ratio_m * thrust * up
        wx, wy, wz = w
        skew = np.array([[0, -wz, wy], [wz, 0, -wx], [-wy, wx, 0]])
        return np.concatenate(
            [v, (R @ skew).ravel(), R @ force / vehicle.mass_kg - G * up, R @ torque, (command - speed) / lag]
        )

    R0 = _matrix(state[3:7])
    L0 = R0 @ (inertia @ state[10:13] + c.inertia_kgm2 * (spins @ state[13:]) * up)
    start = np.concatenate([state[:3], R0.ravel(), state[7:10], L0, state[13:]])
    solution = scipy.integrate.solve_ivp(slope, (0.0, duration_s), start, method="DOP853", rtol=1e-13, atol=1e-14)
    assert solution.success
    end = solution.y[:, -1]
    R, L = end[3:12].reshape(3, 3), end[15:18]
    w = np.linalg.solve(inertia, R.T @ L - c.inertia_kgm2 * (spins @ end[18:]) * up)
    return np.concatenate([end[:3], _quaternion(R, state[3:7]), end[12:15], w, end[18:]])


def _matrix(q: Float64) -> Float64:
    w, x, y, z = q
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * skew + 2 * skew @ skew


def _quaternion(R: Float64, like: Float64) -> Float64:
    """Eigenvector of Bar-Itzhack's matrix, sign nearest to `like`."""
    K = np.array(
        [
            [R[0, 0] + R[1, 1] + R[2, 2], R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], R[0, 0] - R[1, 1] - R[2, 2], R[1, 0] + R[0, 1], R[2, 0] + R[0, 2]],
            [R[0, 2] - R[2, 0], R[1, 0] + R[0, 1], R[1, 1] - R[0, 0] - R[2, 2], R[2, 1] + R[1, 2]],
            [R[1, 0] - R[0, 1], R[2, 0] + R[0, 2], R[2, 1] + R[1, 2], R[2, 2] - R[0, 0] - R[1, 1]],
        ]
    )
    q = np.linalg.eigh(K)[1][:, -1]
    return q if q @ like > 0 else -q


def kernel(vehicle: Vehicle, truth: Float64, tick_s: float, substeps: int) -> RigidBody:
    c = vehicle.rotor_constants
    return RigidBody(
        truth=truth,
        mass_kg=vehicle.mass_kg,
        inertia_kgm2=vehicle.inertia_kgm2,
        rotor_position_m=[r.position_m for r in vehicle.rotors],
        rotor_spin=[r.spin.sign for r in vehicle.rotors],
        thrust_coefficient_n_per_radps2=c.thrust_coefficient_n_per_radps2,
        moment_ratio_m=c.moment_ratio_m,
        max_speed_radps=c.max_speed_radps,
        time_constant_up_s=c.time_constant_up_s,
        time_constant_down_s=c.time_constant_down_s,
        rotor_inertia_kgm2=c.inertia_kgm2,
        rotor_drag_kg_per_rad=c.drag_kg_per_rad,
        body_drag_linear_n_per_mps=(0.1, 0.12, 0.15),
        body_drag_quadratic_n_per_m2ps2=vehicle.body_drag_quadratic_n_per_m2ps2,
        gravity_mps2=G,
        wind_W_mps=tuple(WIND.tolist()),
        tick_s=tick_s,
        substeps=substeps,
        contact_substeps=1,
    )


def start_state(vehicle: Vehicle) -> Float64:
    """Fast, tilted, turning: every term of the equations is at work, no drag component crosses zero."""
    q = np.array([0.9, 0.3, -0.25, 0.2])
    speed = vehicle.hover_control * vehicle.rotor_constants.max_speed_radps
    return np.concatenate(
        [
            [1.0, 2.0, 300.0],
            q / np.linalg.norm(q),
            [9.0, 4.0, -3.0],
            [2.5, -1.5, 1.0],
            speed * np.array([1, 0.9, 1.1, 1]),
        ]
    )


@pytest.fixture(params=vehicle_names())
def vehicle(request: pytest.FixtureRequest) -> Vehicle:
    return load_vehicle(request.param).model_copy(update={"body_drag_linear_n_per_mps": (0.1, 0.12, 0.15)})


def split_error(got: Float64, exact: Float64) -> dict[str, float]:
    parts: dict[str, Callable[[Float64], Float64]] = {
        "p_m": lambda s: s[:3],
        "q": lambda s: s[3:7],
        "v_mps": lambda s: s[7:10],
        "w_radps": lambda s: s[10:13],
    }
    return {name: float(np.linalg.norm(part(got) - part(exact))) for name, part in parts.items()}


def test_order_of_convergence_is_four(vehicle: Vehicle) -> None:
    start = start_state(vehicle)
    controls = vehicle.hover_control * np.array([1.02, 0.95, 1.05, 0.98])
    exact = reference(vehicle, start, controls, 0.096)
    errors = []
    for substeps in (12, 24, 48):  # 8, 4, 2 ms
        truth = np.concatenate([start, np.zeros(6)])
        body = kernel(vehicle, truth, 0.096, substeps)
        assert body.command(controls.tolist()) == -1
        body.fly()
        errors.append(split_error(truth[: start.size], exact))
    for part in errors[0]:
        for coarse, fine in itertools.pairwise(errors):
            assert math.log2(coarse[part] / fine[part]) == pytest.approx(4.0, abs=0.4), part


def test_error_of_a_flown_second_is_tiny(vehicle: Vehicle) -> None:
    """250 ticks of 4 ms with the commands changing every 20 ms, two RK4 steps a tick, as the bench runs it."""
    state = start_state(vehicle)
    truth = np.concatenate([state, np.zeros(6)])
    body = kernel(vehicle, truth, TICK_S, 2)
    random = np.random.default_rng(5)
    for _ in range(50):
        controls = vehicle.hover_control * (1.0 + 0.05 * random.standard_normal(4))
        state = reference(vehicle, state, controls, 5 * TICK_S)
        body.command(controls.tolist())
        for _ in range(5):
            body.fly()
            body.finish()
    errors = split_error(truth[: state.size], state)
    assert errors["p_m"] < 1e-7
    assert errors["q"] < 1e-7
    assert errors["v_mps"] < 1e-6
    assert errors["w_radps"] < 1e-6
    assert truth[13:17] == pytest.approx(state[13:], rel=1e-11)
