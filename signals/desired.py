"""Desired state of the vehicle: the command of a companion computer, shared by codecs, pilot and bench.

World frame W is ENU, body frame B is FLU, SI units. None means "not commanded". Allowed combinations:

    p_W, v_W, a_W       any of them, with yaw_rad or q_WB (only its heading counts) and yaw_rate_radps
    q_WB, w_B           either or both, with thrust, and without the values of the line above
    land                alone or with any other value: the vehicle lands where it is
    no value            the vehicle stays where it is

A desired state is for one instant. `extrapolated` continues it for a short time, unless `hold` is set. A position with
a velocity may be followed by `ahead`, the path from there on, so that a slow client can keep the vehicle on its path.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import isfinite, sqrt
from typing import NamedTuple

from signals.samples import Quat, Vec3

_LENGTHS = {"p_W": 3, "v_W": 3, "a_W": 3, "q_WB": 4, "w_B": 3}
_PATH = ("p_W", "v_W", "a_W", "yaw_rad", "yaw_rate_radps")  # not allowed with a thrust
_NUMBERS = ("yaw_rad", "yaw_rate_radps", "thrust")
# Accepts unit quaternions in single precision or with a few digits.
_NORM_TOLERANCE = 1e-3


MAX_KNOTS = 32
MAX_AHEAD_S = 5.0
MIN_STEP_S = 1e-3  # from knot to knot; the equations divide by its square
MAX_EXTRAPOLATION_S = 0.5  # without a path ahead; older rates mean nothing


class Knot(NamedTuple):
    """Position and velocity on the path, `dt_s` later."""

    dt_s: float
    p_W: Vec3
    v_W: Vec3


@dataclass(frozen=True, slots=True)
class DesiredState:
    """Command for one instant.

    Raises ValueError if a value is not finite, has the wrong length or range, or excludes another value.
    """

    p_W: Vec3 | None = None  # position [m]
    v_W: Vec3 | None = None  # velocity [m/s]
    a_W: Vec3 | None = None  # acceleration [m/s2]
    yaw_rad: float | None = None  # heading, from east, counter-clockwise
    yaw_rate_radps: float | None = None  # counter-clockwise
    q_WB: Quat | None = None  # attitude, w-x-y-z; normalised
    thrust: float | None = None  # collective thrust as a share of the vehicle's maximum, 0 to 1
    w_B: Vec3 | None = None  # angular velocity [rad/s]
    land: bool = False
    hold: bool = False  # no extrapolation: valid unchanged until the next desired state
    ahead: tuple[Knot, ...] = ()  # the path after p_W and v_W, in order of time

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
        self._check_ahead()
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

    def _check_ahead(self) -> None:
        if not self.ahead:
            return
        if self.p_W is None or self.v_W is None:
            raise ValueError("ahead without p_W and v_W: a path begins somewhere")
        if len(self.ahead) > MAX_KNOTS:
            raise ValueError(f"ahead has {len(self.ahead)} knots; {MAX_KNOTS} are the most")
        knots, previous_s = [], 0.0
        for dt_s, p_W, v_W in self.ahead:
            (dt_s,) = _finite("ahead", (dt_s,), 1)
            if not previous_s + MIN_STEP_S <= dt_s <= MAX_AHEAD_S:
                raise ValueError(
                    f"ahead: {dt_s:g} s; times rise from 0 to {MAX_AHEAD_S:g} s at most, by {MIN_STEP_S:g} s at least"
                )
            previous_s = dt_s
            knots.append(Knot(dt_s, _finite("ahead", p_W, 3), _finite("ahead", v_W, 3)))  # type: ignore[arg-type]
        object.__setattr__(self, "ahead", tuple(knots))

    @property
    def moves(self) -> bool:
        """True if a path or an attitude is commanded; otherwise the vehicle stays where it is."""
        return not (self.p_W is None and self.v_W is None and self.a_W is None and self.thrust is None)

    @property
    def changes(self) -> bool:
        """True if rates of change are commanded, so that `extrapolated` returns another state."""
        moving = self.v_W is not None and (self.p_W is not None or self.a_W is not None)
        return moving or (self.yaw_rad is not None and self.yaw_rate_radps is not None)


def extrapolated(desired: DesiredState, dt_s: float) -> DesiredState:
    """Return the desired state `dt_s` later, but no later than half a second or the last knot of `ahead`:

        p + v dt + a dt^2 / 2      v + a dt      a      yaw + yaw_rate dt

    A position without a velocity does not move. Without an acceleration the path is straight. With `ahead`, position,
    velocity and acceleration are those of the path: between two knots the cubic through their positions and velocities
    (Hermite), after the last knot a straight line.
    """
    p_W, v_W, a_W, yaw_rad = desired.p_W, desired.v_W, desired.a_W, desired.yaw_rad
    last_s = desired.ahead[-1].dt_s if desired.ahead else 0.0
    dt_s = min(dt_s, max(last_s, MAX_EXTRAPOLATION_S))
    if desired.ahead and p_W is not None and v_W is not None:
        p_W, v_W, a_W = _on_path(Knot(0.0, p_W, v_W), desired.ahead, dt_s)
    elif v_W is not None:
        a = (0.0, 0.0, 0.0) if a_W is None else a_W
        if p_W is not None:
            half = _along(v_W, a, 0.5 * dt_s)
            p_W = _along(p_W, half, dt_s)
        v_W = _along(v_W, a, dt_s)
    if yaw_rad is not None and desired.yaw_rate_radps is not None:
        yaw_rad = yaw_rad + desired.yaw_rate_radps * dt_s
    return replace(desired, p_W=p_W, v_W=v_W, a_W=a_W, yaw_rad=yaw_rad, ahead=())


def _on_path(begin: Knot, ahead: Sequence[Knot], dt_s: float) -> tuple[Vec3, Vec3, Vec3]:
    """Return position, velocity, acceleration. With h the time between two knots and s the elapsed share of h:

    p = p0 + h v0 s + (3 d - 2 h v0 - h v1) s^2 + (h v0 + h v1 - 2 d) s^3      d = p1 - p0
    """
    end = begin
    for knot in ahead:
        begin, end = end, knot
        if dt_s <= knot.dt_s:
            break
    else:
        return _along(end.p_W, end.v_W, dt_s - end.dt_s), end.v_W, (0.0, 0.0, 0.0)
    h_s = end.dt_s - begin.dt_s
    s = (dt_s - begin.dt_s) / h_s
    rows = []
    for p0, v0, p1, v1 in zip(begin.p_W, begin.v_W, end.p_W, end.v_W, strict=True):
        d, b0, b1 = p1 - p0, h_s * v0, h_s * v1
        c2, c3 = 3.0 * d - 2.0 * b0 - b1, b0 + b1 - 2.0 * d
        p = p0 + (b0 + (c2 + c3 * s) * s) * s
        rows.append((p, (b0 + (2.0 * c2 + 3.0 * c3 * s) * s) / h_s, (2.0 * c2 + 6.0 * c3 * s) / (h_s * h_s)))
    (px, vx, ax), (py, vy, ay), (pz, vz, az) = rows
    return (px, py, pz), (vx, vy, vz), (ax, ay, az)


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
