"""Hover: hold a position, from a start beside it with a random attitude and velocity.

reward       1 / (1 + 4 d^2) - 0.05 min(1, |w| / 10 rad/s) of each step, d the distance to the target [m]
terminated   contact, d > `range_m`, upside down, or beyond the limits of the model
truncated    after `episode_s`
is_success   in `info`: within 0.25 m of the target for the last 2 s
"""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from hil.gym.flight import Flight
from hil.gym.options import FlightOptions
from hil.gym.target_task import TargetTask, hover_speeds, random_attitude, random_vector
from hil.gym.task import Ends, Rewards, Step, seed_of
from signals.samples import Vec3
from signals.units import RAD_PER_DEG

NEAR_M, NEAR_S = 0.25, 2.0


class HoverOptions(FlightOptions):
    """Start of the episode, around the target."""

    height_m: Annotated[float, Field(ge=1.0, le=500.0)] = 3.0  # of the target above the start of the bench
    start_offset_m: Annotated[float, Field(ge=0.0, le=100.0)] = 1.0  # greatest, on each axis
    start_speed_mps: Annotated[float, Field(ge=0.0, le=20.0)] = 0.5  # greatest, on each axis
    start_rate_radps: Annotated[float, Field(ge=0.0, le=20.0)] = 0.5  # greatest, on each axis
    start_tilt_deg: Annotated[float, Field(ge=0.0, le=180.0)] = 15.0
    range_m: Annotated[float, Field(gt=0.0, le=1000.0)] = 5.0

    @property
    def offset_m(self) -> Vec3:
        """Greatest distance from the target at the start, on each axis; not below the ground."""
        return self.start_offset_m, self.start_offset_m, min(self.start_offset_m, 0.5 * self.height_m)

    @model_validator(mode="after")
    def _begins_in_range(self) -> HoverOptions:
        if (far_m := hypot(*self.offset_m)) > self.range_m:
            raise ValueError(f"start_offset_m begins up to {far_m:.3g} m away, beyond range_m {self.range_m:g}")
        return self


class HoverTask(TargetTask):
    """Hover of a batch."""

    Options = HoverOptions
    bench = "gym_hover"

    def __init__(self, flights: Sequence[Flight], options: HoverOptions, name: str) -> None:
        super().__init__(flights, name, targets=1, range_m=options.range_m)
        self._o = options
        self._near = np.zeros(len(flights), np.int64)  # steps in succession near the target
        self._near_steps = max(1, round(NEAR_S / options.step_s))

    def begin(self, row: int, flight: Flight, random: np.random.Generator) -> None:
        self.enter(row, flight, seed_of(random))
        o = self._o
        x, y, z = flight.truth.p_WB
        target = x, y, z + o.height_m
        dx, dy, dz = random_vector(random, o.offset_m)
        flight.vehicle.place(
            (target[0] + dx, target[1] + dy, target[2] + dz),
            random_attitude(random, o.start_tilt_deg * RAD_PER_DEG),
            random_vector(random, (o.start_speed_mps,) * 3),
            random_vector(random, (o.start_rate_radps,) * 3),
            hover_speeds(flight),
        )
        self.target_W[row, 0] = target
        self._near[row] = 0
        flight.begin(seed_of(random), target)

    def judge(self, step: Step) -> tuple[Rewards, Ends]:
        near, flies = self._near, step.flies
        d, _, rate_radps, cos_tilt = self.measures.T
        near[flies] = np.where(d[flies] < NEAR_M, near[flies] + 1, 0)
        rewards = 1.0 / (1.0 + 4.0 * (d * d)) - 0.05 * np.minimum(1.0, 0.1 * rate_radps)
        return rewards, (d > self._o.range_m) | (cos_tilt < 0.0) | step.crashed

    def judge_alone(self, step: Step) -> tuple[float, bool]:
        ((d, _, rate_radps, cos_tilt),) = self.measures.tolist()
        self._near[0] = self._near[0] + 1 if d < NEAR_M else 0
        reward = 1.0 / (1.0 + 4.0 * (d * d)) - 0.05 * min(1.0, 0.1 * rate_radps)
        return reward, d > self._o.range_m or cos_tilt < 0.0 or bool(step.crashed[0])

    def info(self) -> dict[str, Any]:
        return {"is_success": self._near >= self._near_steps, "distance_m": self.distance_m}

    def info_of(self, row: int) -> dict[str, Any]:
        return {"is_success": bool(self._near[row] >= self._near_steps), "distance_m": float(self.distance_m[row])}
