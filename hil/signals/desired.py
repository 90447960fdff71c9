"""What a companion computer wants the vehicle to do: one plain value that codecs, pilot and bench share.

World frame W is ENU, body frame B is FLU, SI units. None is "not commanded". What may be combined:

    p_W, v_W, a_W       any of them, with yaw_rad or q_WB (of which the heading counts) and yaw_rate_radps
    q_WB, w_B           either or both, with thrust; then nothing of the line above
    land                alone or with anything: the vehicle lands where it is
    nothing             stay
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import isfinite, sqrt

from hil.signals.samples import Quat, Vec3

_LENGTHS = {"p_W": 3, "v_W": 3, "a_W": 3, "q_WB": 4, "w_B": 3}
_PATH = ("p_W", "v_W", "a_W", "yaw_rad", "yaw_rate_radps")  # does not go with a thrust
_NUMBERS = ("yaw_rad", "yaw_rate_radps", "thrust")
# A quaternion in single precision, or written with a few digits, is still meant as a unit one.
_NORM_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True)
class DesiredState:
    """ValueError where a value is not finite, has the wrong length or range, or does not go with another one."""

    p_W: Vec3 | None = None  # position [m]
    v_W: Vec3 | None = None  # velocity [m/s]
    a_W: Vec3 | None = None  # acceleration [m/s2]
    yaw_rad: float | None = None  # heading, from east, counter-clockwise
    yaw_rate_radps: float | None = None  # counter-clockwise
    q_WB: Quat | None = None  # attitude, w-x-y-z; kept with norm 1
    thrust: float | None = None  # collective, 0 to 1 of what the vehicle has
    w_B: Vec3 | None = None  # angular velocity [rad/s]
    land: bool = False

    def __post_init__(self) -> None:
        for name, length in _LENGTHS.items():
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _finite(name, value, length))
        for name in _NUMBERS:
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _finite(name, (value,), 1)[0])
        if self.q_WB is not None:
            norm = sqrt(sum(c * c for c in self.q_WB))
            if not abs(norm - 1.0) <= _NORM_TOLERANCE:
                raise ValueError(f"q_WB has norm {norm:g}; an attitude has norm 1")
            object.__setattr__(self, "q_WB", tuple(c / norm for c in self.q_WB))
        if not isinstance(self.land, bool):
            raise ValueError(f"land is true or false, not {self.land!r}")
        self._check_combination()

    def _check_combination(self) -> None:
        if self.thrust is None:
            if self.w_B is not None:
                raise ValueError("w_B without thrust: body rates are flown with a thrust")
            return
        if not 0.0 <= self.thrust <= 1.0:
            raise ValueError(f"thrust is {self.thrust:g}; it goes from 0 to 1")
        if self.q_WB is None and self.w_B is None:
            raise ValueError("thrust without q_WB or w_B: a thrust is flown with an attitude or body rates")
        others = [name for name in _PATH if getattr(self, name) is not None]
        if others:
            raise ValueError(f"thrust with {', '.join(others)}: either an attitude is flown, or a path")

    @property
    def moves(self) -> bool:
        """It says where to go, by a path or an attitude; otherwise the vehicle stays where it is."""
        return not (self.p_W is None and self.v_W is None and self.a_W is None and self.thrust is None)


def _finite(name: str, values: Iterable[float], length: int) -> tuple[float, ...]:
    try:
        numbers = tuple(float(value) for value in values)
    except (TypeError, ValueError):
        raise ValueError(f"{name} is {values!r}; it has to be {length} numbers") from None
    if len(numbers) != length:
        raise ValueError(f"{name} has {len(numbers)} numbers; it has to have {length}")
    if not all(isfinite(number) for number in numbers):
        raise ValueError(f"{name} is {numbers}; every number has to be finite")
    return numbers
