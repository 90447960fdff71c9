"""What the planning half can be told. Lengths in m, speeds in m/s, all of them horizontal unless they say otherwise."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

from hil_companion.errors import OptionError


@dataclass(frozen=True)
class FlightSettings:
    """One flight. OptionError for what cannot be flown."""

    height_m: float = 10.0  # of the flight, in the world
    speed_mps: float = 3.0
    slow_mps: float = 0.8  # at the least distance from obstacles that is planned
    accel_mps2: float = 1.5  # of the set-points; braking is planned with it
    climb_mps: float = 1.5
    yaw_rate_radps: float = 1.0
    vehicle_radius_m: float = 0.4  # x500: arms of 0.25 m, propellers of 0.13 m, some slack
    clearance_m: float = 0.5  # from the vehicle's edge to anything, in whatever comes
    slab_m: float = 1.0  # obstacles count that are within so much of the flight's height
    reaction_s: float = 0.5  # from the LiDAR's sweep to a change of speed: sensor, frame, autopilot
    goal_radius_m: float = 0.4  # of its own estimate; the rest up to what is judged is left to the estimate's error
    move_goal_m: float = 0.0  # a goal where it cannot be is moved to the nearest place where it can, this far at most
    unknown_price: float = 0.4  # a metre of unknown counts as 1 + this
    lidar_lost_s: float = 2.0  # without a usable sweep
    imu_lost_s: float = 5.0  # without knowing roll and pitch
    no_path_s: float = 4.0  # without a way to the goal, hovering
    stuck_s: float = 25.0  # without getting `progress_m` away from where it was
    progress_m: float = 1.0
    hover_s: float = 5.0  # with an outcome other than the goal, before it says that it is finished
    unsafe_hover_s: float = 30.0  # the same where what is below is no bare ground, or not known
    time_limit_s: float = 600.0  # of simulated time, from the first frame

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
                raise OptionError(f"explore: {field.name} {value!r}: a number is needed")
            if value < 0.0 or (value == 0.0 and field.name not in _MAY_BE_ZERO):
                raise OptionError(f"explore: {field.name} {value!r}: more than 0 is needed")
        if self.slow_mps > self.speed_mps:
            raise OptionError(f"explore: slow_mps {self.slow_mps:g} is more than speed_mps {self.speed_mps:g}")

    def stopping_m(self, speed_mps: float) -> float:
        """From seeing something to standing still."""
        return speed_mps * self.reaction_s + speed_mps * speed_mps / (2.0 * self.accel_mps2)

    def speed_that_stops_mps(self, distance_m: float) -> float:
        """The speed whose `stopping_m` is this distance."""
        if distance_m <= 0.0:
            return 0.0
        a, t = self.accel_mps2, self.reaction_s
        return a * (math.sqrt(t * t + 2.0 * distance_m / a) - t)


_MAY_BE_ZERO = {"clearance_m", "unknown_price", "move_goal_m", "hover_s", "reaction_s"}


def number(name: str, value: Any) -> float:
    """OptionError unless it is a finite number."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise OptionError(f"explore: {name} {value!r}: a number is needed")
    return float(value)
