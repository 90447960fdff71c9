"""PyFlyt: `PyFlyt/QuadX-Hover-v4` on PyBullet, a Crazyflie at the environment's default of 40 decisions a second.

Bullet takes semi-implicit Euler steps of 1/240 s; forces are computed in Python, by functions that numba compiles.
"""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import gymnasium
import numpy as np
import PyFlyt.gym_envs  # noqa: F401 (registers the environments)
from PyFlyt.core import Aviary

from lab.gym.simulators.manoeuvre import Float64, decisions, greatest_error_m, thrusts_n

_RATE_HZ, _CONTROL_HZ, _PHYSICS_HZ = 40, 120, 240
_FINER = 64  # of the reference's steps
_START_M = 100.0
_make: Any = gymnasium.make


class Simulator:
    """One world. `model` has no choice."""

    decision_s = 1.0 / _RATE_HZ

    def __init__(self, worlds: int, model: str) -> None:
        if worlds != 1:
            raise ValueError("PyFlyt has no batched worlds")
        self.versions = {"PyFlyt": version("PyFlyt"), "pybullet": version("pybullet"), "model": model}
        self._env: Any = _make("PyFlyt/QuadX-Hover-v4", flight_mode=-1, agent_hz=_RATE_HZ)
        self._env.reset(seed=1)
        motors = self._env.unwrapped.env.drones[0].motors
        self._action = np.full(4, np.sqrt(0.027 * 9.81 / (4.0 * motors.thrust_coef[0, 0])) / motors.max_rpm[0])

    def step(self) -> bool:
        """Take one step and return True if the episode has ended."""
        _, _, terminated, truncated, _ = self._env.step(self._action)
        return bool(terminated or truncated)

    def reset(self) -> None:
        self._env.reset()

    def error(self) -> dict[str, Any]:
        """Fly the manoeuvre without motor noise, compared with the same model in steps 64 times finer.

        The steps are of first order: the reference is extrapolated from steps 32 and 64 times finer (Richardson).
        """
        flown, rate_radps = _fly(1)
        half, full = _fly(_FINER // 2)[0], _fly(_FINER)[0]
        exact = 2.0 * full - half
        return {
            "error_m": greatest_error_m(flown, exact),
            "rate_radps": rate_radps,
            "reference": f"own steps 1/{_FINER}, extrapolated",
            "reference_error_m": greatest_error_m(full, exact) / _FINER,
        }


def _fly(finer: int) -> tuple[Float64, float]:
    """Return the positions after each decision, and the greatest body rate. `finer`: steps in one ordinary step."""
    aviary = Aviary(
        start_pos=np.array([[0.0, 0.0, _START_M]]),
        start_orn=np.zeros((1, 3)),
        drone_type="quadx",
        physics_hz=_PHYSICS_HZ * finer,
        drone_options={"control_hz": _CONTROL_HZ},
    )
    aviary.setTimeStep(1.0 / (_PHYSICS_HZ * finer))
    drone, p = aviary.drones[0], aviary
    aviary.set_mode(-1)
    motors = drone.motors
    motors.noise_ratio = np.zeros(4)
    mass, _, inertia = p.getDynamicsInfo(drone.Id, -1)[:3]
    mass += sum(p.getDynamicsInfo(drone.Id, link)[0] for link in range(p.getNumJoints(drone.Id)))
    base_m = np.array(p.getBasePositionAndOrientation(drone.Id)[0])
    arms_m = np.array([state[0] for state in p.getLinkStates(drone.Id, motors.motor_ids)]) - base_m
    yaw_m = motors.torque_coef[:, 0] / motors.thrust_coef[:, 0]
    effectiveness = np.vstack([np.ones(4), arms_m[:, 1], -arms_m[:, 0], yaw_m])

    def throttle(thrust_n: Float64) -> Float64:
        return np.sqrt(thrust_n / motors.thrust_coef[:, 0]) / motors.max_rpm

    motors.throttle = throttle(np.full(4, 0.25 * 9.81 * mass))
    positions, rates = [], []
    for t in decisions(1.0 / _RATE_HZ):
        thrust_n = thrusts_n(t, weight_n=9.81 * mass, inertia_kgm2=np.array(inertia), effectiveness=effectiveness)
        aviary.set_setpoint(0, throttle(thrust_n))
        for _ in range(_CONTROL_HZ // _RATE_HZ):
            aviary.step()
        position, _ = p.getBasePositionAndOrientation(drone.Id)
        positions.append(position)
        rates.append(float(np.linalg.norm(aviary.state(0)[0])))
    aviary.disconnect()
    return np.array(positions), max(rates)
