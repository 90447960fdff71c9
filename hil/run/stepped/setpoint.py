"""Set-point of a flight controller: the command of one instant.

World W is ENU, body B is FLU, SI units.
"""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

IDLE_COMMAND = 0.05
IDLE_COMMANDS = (IDLE_COMMAND,) * 8
STOPPED_COMMANDS = (0.0,) * 8


class Setpoint(NamedTuple):
    """Command of one instant, in W and B: one horizontal, one vertical and one heading value, or `rotors` alone.

    Horizontal: `p_xy_m`, `v_xy_mps`, `roll_pitch_rad` or `roll_pitch_rate_radps`. Vertical: `z_m`, `vz_mps` or
    `thrust_ratio`. Heading: `yaw_rad` or `yaw_rate_radps`. Roll and pitch are relative to the current heading: positive
    roll to the right, positive pitch nose down (FLU).
    """

    p_xy_m: tuple[float, float] | None = None
    v_xy_mps: tuple[float, float] | None = None
    roll_pitch_rad: tuple[float, float] | None = None
    roll_pitch_rate_radps: tuple[float, float] | None = None  # about x and y of B
    z_m: float | None = None
    vz_mps: float | None = None
    thrust_ratio: float | None = None  # collective thrust over the weight
    yaw_rad: float | None = None  # of x of B, from east, counter-clockwise
    yaw_rate_radps: float | None = None  # about z of B
    speed_limit_mps: float | None = None  # of the way to a position or height
    rotors: tuple[float, ...] | None = None  # commands 0..1 in the vehicle's rotor order; others are ignored


IDLE = Setpoint(rotors=IDLE_COMMANDS)  # armed on the ground
STOPPED = Setpoint(rotors=STOPPED_COMMANDS)


def check(setpoint: Setpoint) -> None:
    """Raise ValueError if a set-point has a wrong combination of values or one that is not finite."""
    if setpoint.rotors is not None:
        groups: tuple[tuple[str, ...], ...] = ()
        if any(value is not None for name, value in zip(setpoint._fields, setpoint, strict=True) if name != "rotors"):
            raise ValueError("a set-point with rotor commands has no other values")
    else:
        groups = (
            ("p_xy_m", "v_xy_mps", "roll_pitch_rad", "roll_pitch_rate_radps"),
            ("z_m", "vz_mps", "thrust_ratio"),
            ("yaw_rad", "yaw_rate_radps"),
        )
    for group in groups:
        given = [name for name in group if getattr(setpoint, name) is not None]
        if len(given) != 1:
            raise ValueError(f"a set-point has exactly one of {', '.join(group)}; this one has {given or 'none'}")
    for name, value in zip(setpoint._fields, setpoint, strict=True):
        numbers = () if value is None else value if isinstance(value, tuple) else (value,)
        if not all(isfinite(number) for number in numbers):
            raise ValueError(f"{name} of a set-point is {value}; every number has to be finite")
    if setpoint.speed_limit_mps is not None and not setpoint.speed_limit_mps > 0.0:
        raise ValueError(f"speed_limit_mps of a set-point is {setpoint.speed_limit_mps:g}; it has to be above 0")
