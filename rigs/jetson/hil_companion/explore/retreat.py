"""The retreat rule: within the orange band of an obstacle move straight away from it until out of the band.

    red      nearer than the clearance leaves: stop, then back off
    orange   away from the obstacle, perpendicular to its surface at the nearest point, until the band is left
    clear    the plan is flown

The band is left with some way to spare, so that the rule does not switch on and off at its edge. Where another obstacle
leaves no room to give way, the vehicle stays between the two and the plan is flown slowly: a passage that was planned
is wide enough.
"""

from __future__ import annotations

from dataclasses import dataclass

from hil_companion.explore.inflation import Berth

_SPARE_M = 0.15
_RETREAT_MPS = 0.6
_STOPPED_MPS = 0.4  # slower than this it may back off: braking comes first


@dataclass(frozen=True)
class Retreat:
    """What the rule wants: a velocity, or None where the plan may be flown."""

    band: str  # "clear", "orange", "red"
    v_W: tuple[float, float] | None


class RetreatRule:
    """Remembers whether it is retreating."""

    def __init__(self) -> None:
        self._retreating = False

    def apply(
        self,
        berth: Berth,
        nearest_m: float,
        towards: tuple[float, float],
        v_W: tuple[float, float],
        room_behind_m: float,
    ) -> Retreat:
        """`towards`: unit vector to the nearest obstacle; `room_behind_m`: free distance on the side away from it."""
        limit_m = berth.orange_m + (_SPARE_M if self._retreating else 0.0)
        if not nearest_m < limit_m:
            self._retreating = False
            return Retreat("clear", None)
        band = "red" if nearest_m < berth.red_m else "orange"
        self._retreating = True
        closing_mps = v_W[0] * towards[0] + v_W[1] * towards[1]
        if band == "red" and closing_mps > _STOPPED_MPS:
            return Retreat(band, (0.0, 0.0))
        if room_behind_m < nearest_m + 0.1:  # as near on the other side: it is in the middle already
            return Retreat(band, None)
        speed_mps = _RETREAT_MPS if band == "red" else _RETREAT_MPS * min(1.0, max(0.4, (limit_m - nearest_m) / 0.3))
        return Retreat(band, (-speed_mps * towards[0], -speed_mps * towards[1]))
