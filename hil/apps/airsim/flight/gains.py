"""Controller gains of AirSim's clients as factors of the ideal controller's gains.

A proportional gain counts relative to AirSim's default: a `kp` of twice the default doubles the gain of the ideal
controller's loop. `ki` and `kd` have no counterpart: the controller has no steady error and no noise to fight, so they
are checked and otherwise ignored.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

from hil.apps.airsim.flight.move import MoveError
from hil.run.stepped.ideal_controller import Gains

DEFAULT_KP = {
    "rate": (0.25, 0.25, 0.25),  # setAngleRateControllerGains: roll, pitch, yaw
    "attitude": (2.5, 2.5, 2.5),  # setAngleLevelControllerGains: roll, pitch, yaw
    "velocity": (0.2, 0.2, 2.0),  # setVelocityControllerGains: x, y, z of NED
    "position": (0.25, 0.25, 0.25),  # setPositionControllerGains: x, y, z of NED
}
MOST_FACTOR = 20.0


def with_gains(
    gains: Gains, loop: str, kp: Sequence[float], ki: Sequence[float], kd: Sequence[float]
) -> tuple[Gains, bool]:
    """Return the gains with those of one loop replaced, and True if `ki` or `kd` ask for what is ignored.

    Raises MoveError for gains that are not three finite numbers, or a `kp` beyond 0..20 times the default.
    """
    for name, values in (("kp", kp), ("ki", ki), ("kd", kd)):
        if len(values) != 3 or not all(map(isfinite, values)):
            raise MoveError(f"{name} is {list(values)}; it has to be three finite numbers")
    defaults = DEFAULT_KP[loop]
    for value, default in zip(kp, defaults, strict=True):
        if not 0.0 <= value <= MOST_FACTOR * default:
            raise MoveError(f"kp is {value:g}; the {loop} controller takes 0 to {MOST_FACTOR * default:g}")
    x, y, z = (value / default for value, default in zip(kp, defaults, strict=True))
    factors = (y, x, z) if loop in ("velocity", "position") else (x, y, z)  # W is east, north, up
    usual_ki = (0.0, 0.0, 2.0) if loop == "velocity" else (0.0, 0.0, 0.0)
    return gains._replace(**{loop: factors}), tuple(ki) != usual_ki or any(kd)
