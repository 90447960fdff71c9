"""Commanded manoeuvre of `hil bench gym`, the same for every simulator: climbs, rolls, pitches and yaws at about 1 Hz.

Each simulator gets motor commands that would give its own vehicle these accelerations if its motors had no lag. They
lead to body rates of about 10 rad/s. The commands are held for one decision, as an agent's actions are.

This module and its neighbours run in the environments of other simulators: they import numpy and, in functions, scipy,
the simulator, and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
SECONDS = 3.0
AXES_RADPS2 = (35.0, 30.0, 2.0)  # greatest angular acceleration
_TOLERANCE = 1e-12


def decisions(decision_s: float) -> Float64:
    """Return the times of the decisions [s]."""
    return np.asarray(decision_s * np.arange(round(SECONDS / decision_s)), np.float64)


def wanted(t_s: float) -> tuple[float, Float64]:
    """Return the collective thrust over the weight, and the angular acceleration [rad/s^2] about x, y, z of B (FLU)."""
    turn = 2.0 * np.pi * t_s
    axes = np.sin([1.1 * turn, 1.3 * turn + 1.0, 0.4 * turn])
    return 1.0 + 0.12 * float(np.sin(0.9 * turn)), axes * AXES_RADPS2


def thrusts_n(t_s: float, *, weight_n: float, inertia_kgm2: Float64, effectiveness: Float64) -> Float64:
    """Return the thrust of each rotor. `effectiveness`: (4, rotors), force up and torque in B per newton of thrust."""
    factor, acceleration = wanted(t_s)
    wrench = np.concatenate([[factor * weight_n], inertia_kgm2 * acceleration])
    return np.linalg.lstsq(effectiveness, wrench, rcond=None)[0]


def solve(rate: Callable[[Float64, Any], Float64], start: Float64, commands: Any, decision_s: float) -> Float64:
    """Return the positions (first three of the state) after each decision, by DOP853 at a tolerance of 1e-12.

    `rate(state, command)`: the derivative; commands are held for a decision, where the solver starts afresh.
    """
    from scipy.integrate import solve_ivp

    state, positions = start, []
    for command in commands:
        solved = solve_ivp(
            lambda _t, s, held=command: rate(s, held),
            (0.0, decision_s),
            state,
            method="DOP853",
            rtol=_TOLERANCE,
            atol=_TOLERANCE,
        )
        state = solved.y[:, -1]
        positions.append(state[:3])
    return np.array(positions)


def greatest_error_m(flown: Float64, exact: Float64) -> float:
    """Return the greatest distance between two flights, (n, 3) each; infinite if one is not finite."""
    error_m = float(np.max(np.linalg.norm(flown - exact, axis=1)))
    return error_m if np.isfinite(error_m) else float("inf")
