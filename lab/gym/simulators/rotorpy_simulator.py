"""RotorPy: `rotorpy.learning.quadrotor_environments.QuadrotorEnv`, a Crazyflie at its default rate of 100 Hz.

The environment is a vector environment of stable-baselines3 on torch, in steps of the classical Runge-Kutta method.
"""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

import numpy as np
import torch
from rotorpy.learning.quadrotor_environments import QuadrotorEnv
from rotorpy.vehicles.crazyflie_params import quad_params
from rotorpy.vehicles.multirotor import BatchedMultirotor, BatchedMultirotorParams, Multirotor

from lab.gym.simulators.manoeuvre import decisions, greatest_error_m, solve, thrusts_n

_RATE_HZ = 100
_CPU = torch.device("cpu")


def _states(count: int, p_m: tuple[float, float, float], hover_radps: float) -> dict[str, torch.Tensor]:
    zeros = torch.zeros(count, 3, dtype=torch.float64)
    return {
        "x": torch.tensor(p_m, dtype=torch.float64).repeat(count, 1),
        "v": zeros.clone(),
        "q": torch.tensor([0.0, 0.0, 0.0, 1.0], dtype=torch.float64).repeat(count, 1),
        "w": zeros.clone(),
        "wind": zeros.clone(),
        "rotor_speeds": torch.full((count, 4), hover_radps, dtype=torch.float64),
    }


class Simulator:
    """Worlds of one vehicle each. `model` has no choice."""

    decision_s = 1.0 / _RATE_HZ

    def __init__(self, worlds: int, model: str) -> None:
        torch.set_num_threads(1)
        self.versions = {"rotorpy": version("rotorpy"), "torch": torch.__version__, "model": model}
        self._hover_radps = float(np.sqrt(quad_params["mass"] * 9.81 / (4.0 * quad_params["k_eta"])))
        env = self._env = QuadrotorEnv(
            worlds,
            _states(worlds, (0.0, 0.0, 1.0), self._hover_radps),
            control_mode="cmd_motor_speeds",
            sim_rate=_RATE_HZ,
        )
        low, high = quad_params["rotor_speed_min"], quad_params["rotor_speed_max"]
        action = 2.0 * (self._hover_radps - low) / (high - low) - 1.0
        self._action = np.full((worlds, 4), action)
        self._step = env.step
        env.reset()

    def step(self) -> bool:
        """Take one step. The environment resets single worlds itself."""
        self._step(self._action)
        return False

    def reset(self) -> None:
        self._env.reset()

    def error(self) -> dict[str, Any]:
        """Fly the manoeuvre with the environment's model and integrator, compared with RotorPy's own equations.

        The equations are those of `Multirotor`, RotorPy's model without torch.
        """
        p_m = (0.0, 0.0, 100.0)
        batch = BatchedMultirotor(
            BatchedMultirotorParams([quad_params], 1, _CPU),
            1,
            _states(1, p_m, self._hover_radps),
            _CPU,
            integrator="rk4",
        )
        plain = Multirotor(quad_params)
        inertia = np.diag(plain.inertia)
        effectiveness = np.asarray(plain.f_to_TM)
        commands = [
            np.sqrt(
                thrusts_n(t, weight_n=plain.mass * 9.81, inertia_kgm2=inertia, effectiveness=effectiveness)
                / quad_params["k_eta"]
            )
            for t in decisions(self.decision_s)
        ]
        state, flown, rates = _states(1, p_m, self._hover_radps), [], []
        for command in commands:
            state = batch.step(state, {"cmd_motor_speeds": torch.tensor(command)[None]}, self.decision_s)
            flown.append(state["x"][0].numpy().copy())
            rates.append(float(torch.linalg.norm(state["w"][0])))
        start = np.concatenate([p_m, np.zeros(3), [0, 0, 0, 1], np.zeros(6), np.full(4, self._hover_radps)])
        exact = solve(lambda s, command: plain._s_dot_fn(0.0, s, command), start, commands, self.decision_s)
        return {"error_m": greatest_error_m(np.array(flown), exact), "rate_radps": max(rates), "reference": "DOP853"}
