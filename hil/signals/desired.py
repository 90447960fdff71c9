"""What a companion computer wants the vehicle to do: one plain value that codecs, pilot and bench share.

World frame W is ENU, body frame B is FLU, SI units. None is "not commanded". What may be combined:

    p_W, v_W, a_W       any of them, with yaw_rad or q_WB (of which the heading counts) and yaw_rate_radps
    q_WB, w_B           either or both, with thrust; then nothing of the line above
    land                alone or with anything: the vehicle lands where it is
    nothing             stay

It is said of one instant. `carried_on` says what it amounts to a little later; `hold` asks not to.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
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
    hold: bool = False  # as it stands, until the next one: not carried on

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
        for name in ("land", "hold"):
            if not isinstance(getattr(self, name), bool):
                raise ValueError(f"{name} is true or false, not {getattr(self, name)!r}")
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

    @property
    def changes(self) -> bool:
        """It says how what it wants goes on: `carried_on` makes another of it."""
        moving = self.v_W is not None and (self.p_W is not None or self.a_W is not None)
        return moving or (self.yaw_rad is not None and self.yaw_rate_radps is not None)


def carried_on(desired: DesiredState, dt_s: float) -> DesiredState:
    """What is wanted `dt_s` later, as far as it is said:

        p + v dt + a dt^2 / 2      v + a dt      a      yaw + yaw_rate dt

    A position without a velocity stays where it is, whatever else is said; so does one whose acceleration is not
    given go on straight.
    """
    p_W, v_W, a_W, yaw_rad = desired.p_W, desired.v_W, desired.a_W, desired.yaw_rad
    if v_W is not None:
        a = (0.0, 0.0, 0.0) if a_W is None else a_W
        if p_W is not None:
            half = _along(v_W, a, 0.5 * dt_s)
            p_W = _along(p_W, half, dt_s)
        v_W = _along(v_W, a, dt_s)
    if yaw_rad is not None and desired.yaw_rate_radps is not None:
        yaw_rad = yaw_rad + desired.yaw_rate_radps * dt_s
    return replace(desired, p_W=p_W, v_W=v_W, yaw_rad=yaw_rad)


def _along(x: Vec3, rate: Vec3, dt_s: float) -> Vec3:
    return x[0] + rate[0] * dt_s, x[1] + rate[1] * dt_s, x[2] + rate[2] * dt_s


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
