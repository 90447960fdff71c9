"""Waypoints: fly through a course, in order; the next `next_count` waypoints are in the observation.

    reward       metres that the distance to the waypoint became shorter in the step, and 1 for each waypoint reached
    terminated   the last waypoint reached, contact, farther than `range_m` from the waypoint, upside down, or beyond
                 the limits of the model
    truncated    after `episode_s`
    is_success   in `info`: the last waypoint was reached

A waypoint is reached within `reach_m`. Beyond the last waypoint the observation repeats it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import dist, hypot
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from hil.gym.flight import Flight
from hil.gym.options import FlightOptions
from hil.gym.target_task import TargetTask, hover_speeds, random_attitude, random_vector
from hil.gym.task import Ends, Rewards, Step, seed_of
from signals.samples import Vec3

_Offset = Annotated[float, Field(ge=-1000.0, le=1000.0)]
_Step = Annotated[float, Field(ge=0.0, le=100.0)]


class WaypointsOptions(FlightOptions):
    """The course."""

    episode_s: Annotated[float, Field(gt=0.0, le=86_400.0)] = 30.0
    # Waypoints from the start of the bench, in W [m]; None: random for each episode.
    course_m: Annotated[tuple[tuple[_Offset, _Offset, _Offset], ...], Field(min_length=1, max_length=1000)] | None = (
        None
    )
    count: Annotated[int, Field(ge=1, le=1000)] = 5  # of a random course
    step_m: tuple[_Step, _Step, _Step] = (5.0, 5.0, 1.5)  # greatest, on each axis, from waypoint to waypoint
    height_m: Annotated[float, Field(ge=1.0, le=500.0)] = 5.0  # of the start above the start of the bench
    next_count: Annotated[int, Field(ge=1, le=16)] = 2
    reach_m: Annotated[float, Field(gt=0.0, le=100.0)] = 0.5
    range_m: Annotated[float, Field(gt=0.0, le=10_000.0)] = 15.0

    @model_validator(mode="after")
    def _waypoints_are_in_range(self) -> WaypointsOptions:
        way_m = hypot(*self.step_m)
        if self.course_m is not None:
            way_m = max(dist(*ends) for ends in pairwise(((0.0, 0.0, self.height_m), *self.course_m)))
        if way_m > self.range_m:
            text = f"a waypoint may be {way_m:.3g} m from the one before (the first from the start at height_m)"
            raise ValueError(f"{text}, beyond range_m {self.range_m:g}")
        return self


class WaypointsTask(TargetTask):
    """Waypoints of a batch."""

    Options = WaypointsOptions
    bench = "gym_hover"

    def __init__(self, flights: Sequence[Flight], options: WaypointsOptions, name: str) -> None:
        super().__init__(flights, name, targets=options.next_count, range_m=options.range_m)
        self._o = options
        self._course: list[list[Vec3]] = [[] for _ in flights]
        self._reached = np.zeros(len(flights), np.int64)
        self._left_m = np.zeros(len(flights))

    def begin(self, row: int, flight: Flight, random: np.random.Generator) -> None:
        self.enter(row, flight, seed_of(random))
        o = self._o
        x, y, z = flight.truth.p_WB
        start = x, y, z + o.height_m
        if o.course_m is not None:
            self._course[row] = [(x + dx, y + dy, z + dz) for dx, dy, dz in o.course_m]
        else:
            self._course[row] = self._random_course(start, z + 1.0, random)
        flight.vehicle.place(start, random_attitude(random, 0.0), rotor_speed_radps=hover_speeds(flight))
        self._reached[row] = 0
        self._aim(row)
        dx, dy, dz = (target - here for target, here in zip(self._course[row][0], start, strict=True))
        self._left_m[row] = (dx * dx + dy * dy + dz * dz) ** 0.5
        flight.begin(seed_of(random), start)

    def _random_course(self, start: Vec3, least_z: float, random: np.random.Generator) -> list[Vec3]:
        course, (x, y, z) = [], start
        for _ in range(self._o.count):
            dx, dy, dz = random_vector(random, self._o.step_m)
            x, y, z = x + dx, y + dy, max(z + dz, least_z)
            course.append((x, y, z))
        return course

    def _aim(self, row: int) -> None:
        course, at = self._course[row], int(self._reached[row])
        for k in range(self._o.next_count):
            self.target_W[row, k] = course[min(at + k, len(course) - 1)]

    def judge(self, step: Step) -> tuple[Rewards, Ends]:
        reward = self._left_m - self.distance_m
        ends = (self.distance_m > self._o.range_m) | (self.cos_tilt < 0.0) | step.crashed
        reached = np.flatnonzero((self.distance_m < self._o.reach_m) & step.flies).tolist()
        for row in reached:
            if self._reached[row] < len(self._course[row]):
                self._reached[row] += 1
                reward[row] += 1.0
            ends[row] |= self._reached[row] == len(self._course[row])
            self._aim(row)
        if reached:
            self.write_features(step.observations)
        self._left_m[:] = self.distance_m
        return reward, ends

    def info(self) -> dict[str, NDArray[Any]]:
        counts = np.array([len(course) for course in self._course], np.int64)
        return {
            "is_success": self._reached == counts,
            "reached": self._reached,
            "waypoints": counts,
            "distance_m": self.distance_m,
        }
