"""Settings of planning and flight. Lengths in m, speeds in m/s, horizontal unless stated otherwise."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from hil_companion.errors import OptionError


@dataclass(frozen=True)
class FlightSettings:
    """Settings of one flight. Raises OptionError."""

    height_m: float = 10.0  # of the flight, in W
    speed_mps: float = 3.0
    slow_mps: float = 0.8  # at the smallest planned distance from obstacles
    accel_mps2: float = 1.5  # of the set-points, also planned for braking
    climb_mps: float = 1.5
    yaw_rate_radps: float = 1.0
    vehicle_radius_m: float = 0.4  # x500: arms of 0.25 m, propellers of 0.13 m, some slack
    clearance_m: float = 0.5  # smallest distance from the vehicle's edge to any obstacle
    slab_m: float = 1.0  # half height of the band about the flight's height in which obstacles count
    reaction_s: float = 0.5  # from the LiDAR's sweep to a change of speed: sensor, frame, autopilot
    goal_radius_m: float = 0.4  # by its own estimate; the judged limit is larger, to allow for the estimate's error
    move_goal_m: float = 0.0  # largest shift of a goal that is too near to an obstacle
    unknown_price: float = 0.4  # a metre through unknown cells costs 1 + this
    lidar_lost_s: float = 2.0  # without a usable sweep
    imu_lost_s: float = 5.0  # without knowing roll and pitch
    no_path_s: float = 4.0  # hovering without a path to the goal
    stuck_s: float = 25.0  # without moving by `progress_m`
    progress_m: float = 1.0
    hover_s: float = 5.0  # hovering after an outcome other than the goal, before it reports `finished`
    unsafe_hover_s: float = 30.0  # the same over an obstacle or unknown ground
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
        """Return the distance from the detection of an obstacle to standstill."""
        return speed_mps * self.reaction_s + speed_mps * speed_mps / (2.0 * self.accel_mps2)

    def speed_that_stops_mps(self, distance_m: float) -> float:
        """Return the speed whose `stopping_m` is this distance."""
        if distance_m <= 0.0:
            return 0.0
        a, t = self.accel_mps2, self.reaction_s
        return a * (math.sqrt(t * t + 2.0 * distance_m / a) - t)


_MAY_BE_ZERO = {"clearance_m", "unknown_price", "move_goal_m", "hover_s", "reaction_s"}
