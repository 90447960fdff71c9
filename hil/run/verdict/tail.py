"""Attitude of a tailsitter, from ground truth: its rotors lift it in hover and pull it ahead in flight.

ahead           the nose is less than 35 degrees over the horizon: autopilots climb at 30 at most, tilt by 45 in hover
on the wings    the same, once the airspeed has reached that at which a controller should fly, 1.2 times the stall
"""

from __future__ import annotations

import math
from collections.abc import Callable

from hil.run.verdict.air_data import air_data
from signals.rotation import cos_nose_up_of
from signals.samples import Quat, TruthState, Vec3

_LOWERED = math.sin(math.radians(35.0))


class Tail:
    """Tells tick by tick what carries a tailsitter."""

    looks_back_s = 3.0  # the nose sinks before it is ahead, and the vehicle slows down before it is not

    def __init__(self, least_mps: float, wind_at: Callable[[], Vec3]) -> None:
        """`least_mps`: slowest airspeed on the wings. `wind_at` returns the wind at the vehicle in W."""
        self._least_mps, self._wind_at = least_mps, wind_at
        self._carried = False

    def on_wings(self, truth: TruthState) -> bool:
        """Return True while the wings carry it; call it at every measured tick, in order."""
        if not self.ahead(truth):
            self._carried = False
        elif not self._carried:
            self._carried = air_data(truth, self._wind_at()).airspeed_mps >= self._least_mps
        return self._carried

    def ahead(self, truth: TruthState) -> bool:
        """Return True if the nose is lowered for flight."""
        return nose_is_lowered(truth)

    def cos_tilt(self, q_WB: Quat) -> float:
        """Return the cosine of the angle between the nose and the vertical."""
        return cos_nose_up_of(q_WB)


def nose_is_lowered(truth: TruthState) -> bool:
    """Return True if the nose is less than 35 degrees over the horizon."""
    return cos_nose_up_of(truth.q_WB) < _LOWERED
