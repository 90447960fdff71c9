"""Heading of a move: AirSim's YawMode and DrivetrainType."""

from __future__ import annotations

from enum import IntEnum
from math import fmod, sqrt
from typing import NamedTuple

from hil.apps.airsim.flight.move import ACCURACY_M, MoveError, Xy, finite
from signals._kernel import det_atan2
from signals.units import DEG_PER_RAD, RAD_PER_DEG


class Drivetrain(IntEnum):
    """AirSim's DrivetrainType."""

    MAX_DEGREE_OF_FREEDOM = 0  # heading as the yaw mode says
    FORWARD_ONLY = 1  # the nose points along the path, plus the yaw mode's angle


class YawMode(NamedTuple):
    """AirSim's YawMode: an angle from north [deg], or a rate [deg/s], clockwise."""

    is_rate: bool = True
    yaw_or_rate: float = 0.0


class Heading(NamedTuple):
    """Heading values of a command; one of them is None."""

    yaw_rad: float | None
    yaw_rate_radps: float | None


STILL = Heading(None, 0.0)


def heading_of(mode: YawMode, drivetrain: int, course: Xy) -> Heading:
    """Return the heading for a horizontal course; one shorter than ACCURACY_M does not turn the nose along."""
    if mode.is_rate:
        return Heading(None, mode.yaw_or_rate * RAD_PER_DEG)
    yaw_deg = mode.yaw_or_rate
    if drivetrain == Drivetrain.FORWARD_ONLY:
        x, y = course
        if not sqrt(x * x + y * y) > ACCURACY_M:
            return STILL
        yaw_deg += det_atan2(y, x) * DEG_PER_RAD
    return Heading(normalized_deg(yaw_deg) * RAD_PER_DEG, None)


def check_heading(mode: YawMode, drivetrain: int) -> None:
    """Raise MoveError for a yaw that is not finite or a drivetrain that does not exist."""
    finite(yaw_or_rate=mode.yaw_or_rate)
    if drivetrain not in (0, 1):
        raise MoveError(f"drivetrain is {drivetrain}; it is 0 (MaxDegreeOfFreedom) or 1 (ForwardOnly)")


def normalized_deg(angle_deg: float) -> float:
    """Return an angle within -180..180."""
    angle_deg = fmod(angle_deg, 360.0)
    return angle_deg - 360.0 if angle_deg > 180.0 else angle_deg + 360.0 if angle_deg < -180.0 else angle_deg
