"""The state that a CUT commands. Fields that are None are not commanded.

World W is ENU (east, north, up), body B is FLU (forward, left, up), SI units; quaternions w-x-y-z, rotating B into W.
"""

from __future__ import annotations

import math
import numbers
from dataclasses import dataclass
from typing import Any, Sequence

from hil_companion.errors import CutError

UNIT_NORM_TOLERANCE = 1e-3
FLAGS = ("land", "hold")
MAX_KNOTS, MAX_AHEAD_S, MIN_STEP_S = 32, 5.0, 1e-3
LARGEST = 1e9  # limit of the bench for any number, in its SI unit


@dataclass(frozen=True)
class Desired:
    """A desired state at the time of the frame that it answers. Raises CutError for invalid values.

    The bench extrapolates it until the next one, for half a second at most: p_W along v_W and a_W, v_W along a_W,
    yaw_rad along yaw_rate_radps. With `hold` it does not extrapolate. `ahead` gives more of the path from p_W and v_W
    on: knots (seconds later, position, velocity) in the order of time.
    """

    p_W: Sequence[float] | None = None  # [m]
    v_W: Sequence[float] | None = None  # [m/s]
    a_W: Sequence[float] | None = None  # [m/s2]
    yaw_rad: float | None = None  # from east, counter-clockwise
    yaw_rate_radps: float | None = None
    q_WB: Sequence[float] | None = None
    thrust: float | None = None  # 0..1, share of the full thrust
    w_B: Sequence[float] | None = None  # [rad/s]
    land: bool = False
    hold: bool = False
    ahead: Sequence[tuple[float, Sequence[float], Sequence[float]]] = ()

    def __post_init__(self) -> None:
        for name in ("p_W", "v_W", "a_W", "w_B"):
            self._keep(name, _vector(name, getattr(self, name), 3))
        self._keep("q_WB", _vector("q_WB", self.q_WB, 4))
        for name in ("yaw_rad", "yaw_rate_radps", "thrust"):
            self._keep(name, _number(name, getattr(self, name)))
        if self.q_WB is not None and abs(math.sqrt(sum(c * c for c in self.q_WB)) - 1.0) > UNIT_NORM_TOLERANCE:
            raise CutError(f"desired q_WB {list(self.q_WB)}: a quaternion of unit norm is needed")
        if self.thrust is not None and not 0.0 <= self.thrust <= 1.0:
            raise CutError(f"desired thrust {self.thrust}: 0 to 1 is needed")
        self._keep("ahead", self._knots())
        self._check_combination()
        for name in FLAGS:
            if not isinstance(getattr(self, name), bool):
                raise CutError(f"desired {name} {getattr(self, name)!r}: True or False is needed")

    def _knots(self) -> list[list[Any]]:
        knots: list[list[Any]] = []
        try:
            given = [(dt_s, p_W, v_W) for dt_s, p_W, v_W in self.ahead]
        except (TypeError, ValueError):
            raise CutError("desired ahead: for each knot a time, a position and a velocity are needed") from None
        if given and (self.p_W is None or self.v_W is None):
            raise CutError("desired ahead without p_W and v_W: both are needed as its first point")
        if len(given) > MAX_KNOTS:
            raise CutError(f"desired ahead: {len(given)} knots; at most {MAX_KNOTS} are allowed")
        before_s = 0.0
        for at_s, p_W, v_W in given:
            dt_s = _number("ahead", at_s)
            if dt_s is None or not before_s + MIN_STEP_S <= dt_s <= MAX_AHEAD_S:
                raise CutError(
                    f"desired ahead: {at_s} s; times rise from 0 to {MAX_AHEAD_S:g} s at most, "
                    f"by {MIN_STEP_S:g} s at least"
                )
            if p_W is None or v_W is None:
                raise CutError("desired ahead: for each knot a time, a position and a velocity are needed")
            knots.append([dt_s, _vector("ahead", p_W, 3), _vector("ahead", v_W, 3)])
            before_s = dt_s
        return knots

    def _check_combination(self) -> None:
        """Raise CutError for fields that cannot be combined; the bench would refuse them."""
        if self.thrust is None:
            if self.w_B is not None:
                raise CutError("desired w_B without thrust: body rates are flown with a thrust")
            return
        if self.q_WB is None and self.w_B is None:
            raise CutError("desired thrust without q_WB or w_B: a thrust is flown with an attitude or body rates")
        path_fields = ("p_W", "v_W", "a_W", "yaw_rad", "yaw_rate_radps")
        conflicts = [name for name in path_fields if getattr(self, name) is not None]
        if conflicts:
            raise CutError(f"desired thrust with {', '.join(conflicts)}: either an attitude is flown, or a path")

    def _keep(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)  # as plain floats and lists, whatever types the CUT passed

    def as_map(self) -> dict[str, Any]:
        """Return the commanded fields as plain floats and lists, for the message."""
        entries = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return {
            name: value for name, value in entries.items() if value is not None and value is not False and value != []
        }


def _number(name: str, value: Any) -> float | None:
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, numbers.Real) or not abs(float(value)) <= LARGEST:
        raise CutError(f"desired {name} {value!r}: a finite number of sensible size is needed")
    return float(value)


def _vector(name: str, values: Any, size: int) -> list[float] | None:
    if values is None:
        return None
    try:
        items = list(values)
    except TypeError:
        items = []
    if len(items) != size:
        raise CutError(f"desired {name} {values!r}: {size} numbers are needed")
    return [float(_number(name, item) or 0.0) for item in items]
