"""This project: `hil/Hover-v0` on the x500.

`model`: the time of a decision [ms], which is that of the simulator it is compared with, and the kind of action:
`motors`, or `rates` for body rates and thrust.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

import hil.gym  # noqa: F401 (registers the environments)
from hil.apps.bench_suite.physics import multirotor_reference as reference
from lab.gym.simulators.manoeuvre import decisions, greatest_error_m, thrusts_n
from sim.physics import multirotor

_TASK = "hil/Hover-v0"
_make: Any = gymnasium.make
_TICK_HZ = 200  # of which decisions at 100 Hz and at 40 Hz are whole numbers
_AT_REST: dict[str, Any] = dict.fromkeys(
    ("start_offset_m", "start_speed_mps", "start_rate_radps", "start_tilt_deg"), 0.0
)


class Simulator:
    """Worlds of one vehicle each: the environment for one, and the vector environment in this process for more."""

    def __init__(self, worlds: int, model: str) -> None:
        decision_ms, action_kind, *tolerance_m = model.split(" ")
        self.decision_s = 1e-3 * float(decision_ms)
        self.versions = {"gymnasium": gymnasium.__version__}
        self._options: dict[str, Any] = {
            "action": action_kind,
            "step_s": self.decision_s,
            "settings": [f"tick_hz={_TICK_HZ}", "vehicle_settings.rotor_model=quadratic"],  # as the peers' models
            **({"tolerance_m": float(tolerance_m[0])} if tolerance_m else {}),
        }
        if worlds == 1:
            self._env: Any = _make(_TASK, **self._options, **_AT_REST)
            hover = multirotor.hover_control(self._env.unwrapped.bench.vehicle)
        else:
            make_vec: Any = gymnasium.make_vec
            options = self._options | _AT_REST
            self._env = make_vec(_TASK, num_envs=worlds, vectorization_mode="vector_entry_point", **options)
            hover = multirotor.hover_control(self._env.unwrapped.batch.flights[0].bench.vehicle)
        action = np.full(4, 2.0 * hover - 1.0 if action_kind == "motors" else 0.0, np.float32)
        self._action = action if worlds == 1 else np.tile(action, (worlds, 1))
        self._single = worlds == 1
        self._env.reset(seed=1)

    def step(self) -> bool:
        """Take one step and return True if the episode has ended; the vector environment resets by itself."""
        _, _, terminated, truncated, _ = self._env.step(self._action)
        return self._single and bool(terminated or truncated)

    def reset(self) -> None:
        self._env.reset()

    def error(self) -> dict[str, Any]:
        """Fly the manoeuvre by motor commands, compared with the CasADi model of multirotor_reference.py at 1e-14."""
        options = self._options | _AT_REST | {"action": "motors", "height_m": 100.0, "range_m": 1000.0}
        env: Any = _make(_TASK, **options).unwrapped
        env.reset(seed=1)
        bench = env.bench
        vehicle = bench.vehicle
        c, f = vehicle.rotor_constants, vehicle.rotor_constants.thrust_model_factor
        most_n = c.thrust_coefficient_n_per_radps2 * c.max_speed_radps**2
        actions = []
        for t in decisions(self.decision_s):
            share = (
                thrusts_n(
                    t,
                    weight_n=vehicle.mass_kg * bench.scene.gravity_mps2,
                    inertia_kgm2=np.array(vehicle.inertia_kgm2),
                    effectiveness=multirotor.effectiveness(vehicle)[2:],
                )
                / most_n
            )
            command = share if f == 0.0 else (np.sqrt((1.0 - f) ** 2 + 4.0 * f * share) - (1.0 - f)) / (2.0 * f)
            actions.append(2.0 * command - 1.0)
        truth = env.truth
        start = np.concatenate([truth.p_WB, truth.q_WB, truth.v_WB_W, truth.w_WB_B, truth.rotor_speed_radps])
        flown, rates = [], []
        for action in actions:
            # Not `step`: it goes on beyond the end of the episode, where the vehicle is upside down.
            env.batch.step_alone(np.clip(action, -1.0, 1.0).tolist())
            flown.append(env.truth.p_WB)
            rates.append(float(np.linalg.norm(env.truth.w_WB_B)))
        ticks = round(self.decision_s * _TICK_HZ)
        commands = np.repeat(0.5 * (np.array(actions) + 1.0), ticks, axis=0)
        effects = bench.config.physics.effects.model_dump()
        exact = reference.fly(
            vehicle,
            start,
            reference.Inputs(commands, effects=effects),
            tick_s=1.0 / _TICK_HZ,
            gravity_mps2=bench.scene.gravity_mps2,
        )[ticks::ticks, :3]
        return {"error_m": greatest_error_m(np.array(flown), exact), "rate_radps": max(rates), "reference": "CVODES"}
