"""Crazyflow: its vector environment `DroneReachPos-v0` on the processor (JAX), with decisions at 100 Hz.

`model`: `so_rpy`, the environment's default, a fitted response to attitude commands without rotors; or
`first_principles`, rigid body and rotors, below an attitude controller. Both take explicit Euler steps of 2 ms in
single precision, which are Crazyflow's defaults.
"""

from __future__ import annotations

from importlib.metadata import version
from typing import Any

# Sets a variable that has to be set before scipy is imported.
import crazyflow  # isort: skip
import jax
import jax.numpy as jnp
import numpy as np
from crazyflow.control import Control
from crazyflow.control.transform import motor_force2rotor_vel
from crazyflow.drones import Drone
from crazyflow.dynamics import Dynamics, first_principles, so_rpy
from crazyflow.envs import ReachPosEnv
from crazyflow.sim import Sim

from lab.gym.simulators.manoeuvre import (
    AXES_RADPS2,
    Float64,
    decisions,
    greatest_error_m,
    solve,
    thrusts_n,
    wanted,
)

_RATE_HZ = 100
_DRONE = Drone.cf2x_L250
_START_M = 50.0


class Simulator:
    """Worlds of one vehicle each."""

    decision_s = 1.0 / _RATE_HZ

    def __init__(self, worlds: int, model: str) -> None:
        self.versions = {"crazyflow": crazyflow_version(), "jax": jax.__version__, "model": model}
        self._model = Dynamics(model)
        env = self._env = ReachPosEnv(num_envs=worlds, dynamics=self._model, freq=_RATE_HZ)
        mass = float(np.ravel(np.asarray(env.sim.data.params.mass))[0])
        self._action = np.tile(np.array([0.0, 0.0, 0.0, 9.81 * mass], np.float32), (worlds, 1))
        env.reset(seed=1)

    def step(self) -> bool:
        """Take one step and wait for its results. The environment resets single worlds itself."""
        jax.block_until_ready(self._env.step(self._action)[:4])
        return False

    def reset(self) -> None:
        jax.block_until_ready(self._env.reset()[0])

    def error(self) -> dict[str, Any]:
        """Fly the manoeuvre with the same model, integrator and steps, compared with the same equations in double.

        `first_principles` gets motor commands. `so_rpy` gets roll and pitch commands of 0.8 rad at about 1 Hz.
        """
        rotors = self._model == Dynamics.first_principles
        sim = Sim(
            dynamics=self._model,
            drone=_DRONE,
            control=Control.rotor_vel if rotors else Control.attitude,
            freq=500,
        )
        params = {key: np.asarray(value, np.float64) for key, value in vars(sim.data.params).items()}
        params = {key: value.reshape(value.shape[-_NDIM.get(key, 1) :]) for key, value in params.items()}
        commands, hover = (_motor_commands if rotors else _attitude_commands)(params)
        states = sim.data.states
        states = states.replace(
            pos=states.pos.at[..., 2].set(_START_M), rotor_vel=jnp.full_like(states.rotor_vel, hover)
        )
        sim.data = sim.data.replace(states=states)
        send = sim.rotor_vel_control if rotors else sim.attitude_control
        flown, rates = [], []
        for command in commands:
            send(jnp.asarray(command, jnp.float32)[None, None])
            sim.step(sim.freq // _RATE_HZ)
            flown.append(np.asarray(sim.data.states.pos[0, 0], np.float64))
            rates.append(float(jnp.linalg.norm(sim.data.states.ang_vel)))
        held = [np.asarray(np.asarray(command, np.float32), np.float64) for command in commands]
        start = np.concatenate([[0, 0, _START_M], [0, 0, 0, 1], np.zeros(6), np.full(4, np.float32(hover))])
        exact = solve(lambda s, command: self._rate(s, command, params), start, held, self.decision_s)
        return {"error_m": greatest_error_m(np.array(flown), exact), "rate_radps": max(rates), "reference": "DOP853"}

    def _rate(self, s: Float64, command: Float64, params: dict[str, Any]) -> Float64:
        state = {"pos": s[:3], "quat": s[3:7] / np.linalg.norm(s[3:7]), "vel": s[7:10], "ang_vel": s[10:13]}
        if self._model == Dynamics.first_principles:
            rates = first_principles.dynamics(**state, cmd=command, rotor_vel=s[13:], **params)
        else:
            rates = (*so_rpy.dynamics(**state, cmd=command, **params), np.zeros(4))
        return np.concatenate(rates)


_NDIM = {"J": 2, "J_inv": 2, "mixing_matrix": 2, "drag_matrix": 2, "rpm2thrust": 2, "rpm2torque": 2}
_NDIM |= {"rotor_dyn_coef": 2}


def crazyflow_version() -> str:
    """Return the version of the package."""
    return version(crazyflow.__name__)


def _motor_commands(params: dict[str, Any]) -> tuple[list[Float64], float]:
    """Return the commanded rotor speeds [rpm] of each decision, and those at hover."""
    mix, arm = params["mixing_matrix"], params["L"]
    per_newton = params["rpm2torque"][0, 2] / params["rpm2thrust"][0, 2]
    effectiveness = np.vstack([np.ones(4), mix[0] * arm, mix[1] * arm, mix[2] * per_newton])
    weight_n = 9.81 * float(np.ravel(params["mass"])[0])
    vehicle: dict[str, Any] = {
        "weight_n": weight_n,
        "inertia_kgm2": np.diag(params["J"]),
        "effectiveness": effectiveness,
    }

    def rpm(thrust_n: Float64) -> Float64:
        return np.asarray(motor_force2rotor_vel(thrust_n, params["rpm2thrust"]), np.float64)

    commands = [rpm(thrusts_n(t, **vehicle)) for t in decisions(1.0 / _RATE_HZ)]
    return commands, float(rpm(np.full(4, 0.25 * weight_n))[0])


def _attitude_commands(params: dict[str, Any]) -> tuple[list[Float64], float]:
    """Return roll, pitch, yaw [rad] and thrust [N] of each decision; there are no rotors."""
    weight_n = 9.81 * float(np.ravel(params["mass"])[0])
    commands = []
    for t in decisions(1.0 / _RATE_HZ):
        factor, acceleration = wanted(t)
        commands.append(np.array([*(0.8 * acceleration / AXES_RADPS2), factor * weight_n]))
    return commands, 0.0
