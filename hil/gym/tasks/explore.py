"""Explore: fly to a goal between obstacles that only a LiDAR or a depth picture shows.

    reward       metres that the distance to the goal became shorter in the step, -0.02 for the step, 10 for the goal,
                 -10 for a collision
    terminated   the goal reached (`reach_m`), contact, farther than `range_m` from the goal, higher than `ceiling_m`
                 above the start of the bench, upside down, or beyond the limits of the model
    truncated    after `episode_s`
    is_success   in `info`: the goal was reached

Observation with a LiDAR: the features of the state, then the shortest range of each of `sectors` sectors of the azimuth
in L, over `see_m`; the first is ahead, the others follow to the left; 1: nothing. Only points within `band_m` of the
LiDAR's own height count. With a depth picture: "state", and "depth", the picture with 255 for `see_m` and more.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from gymnasium.spaces import Box, Dict
from numpy.typing import NDArray
from pydantic import Field, model_validator

from hil.config import Bench
from hil.gym.flight import Flight
from hil.gym.options import ActionKind, FlightOptions
from hil.gym.target_task import TargetTask, hover_speeds, random_attitude
from hil.gym.task import Ends, Rewards, Step, seed_of
from hil.run.sensors.frame_stages import available_ports
from signals.errors import ConfigError, HilError
from signals.rotation import minus, norm
from signals.samples import PointCloudSample, Vec3
from sim.scene.solids import solid_tree
from sim.world_loader import load_world

_TRIES = 2000
_PICTURES = ("/depth", "/range")
_Metres = Annotated[float, Field(gt=0.0, le=10_000.0)]


class ExploreOptions(FlightOptions):
    """Sensor, start and goal."""

    action: ActionKind = "velocity"
    step_s: Annotated[float, Field(gt=0.0, le=60.0)] = 0.1
    episode_s: Annotated[float, Field(gt=0.0, le=86_400.0)] = 40.0
    port: str = "lidar"  # a LiDAR, or the depth or range of a camera, such as front/depth
    sectors: Annotated[int, Field(ge=4, le=720)] = 36
    band_m: _Metres = 1.0
    see_m: _Metres = 20.0
    area_m: _Metres = 60.0  # start and goal lie within +-area_m of the bench's start, east and north
    height_m: _Metres = 3.0  # of start and goal above the bench's start
    goal_m: tuple[_Metres, _Metres] = (15.0, 35.0)  # least and greatest distance from start to goal
    clearance_m: _Metres = 2.5  # of start and goal
    reach_m: _Metres = 1.0
    ceiling_m: _Metres = 6.0
    range_m: _Metres = 50.0

    @model_validator(mode="after")
    def _episodes_can_succeed(self) -> ExploreOptions:
        least, most = self.goal_m
        if not self.reach_m < least <= most <= self.range_m:
            raise ValueError("reach_m, goal_m[0], goal_m[1] and range_m must follow each other in size")
        if self.height_m >= self.ceiling_m:
            raise ValueError(f"height_m {self.height_m:g} must be below ceiling_m {self.ceiling_m:g}")
        return self


class ExploreTask(TargetTask):
    """Explore of a batch."""

    Options = ExploreOptions
    bench = "gym_explore"

    @classmethod
    def ports(cls, bench: Bench, options: ExploreOptions) -> tuple[str, ...]:
        port = available_ports(bench.config).get(options.port)
        if port is not None and port.type is not PointCloudSample and not options.port.endswith(_PICTURES):
            hint = "take a LiDAR, or the channel depth or range of a camera"
            raise ConfigError.at("port", f"{options.port!r} shows no obstacles", hint)
        return (options.port,)

    def __init__(self, flights: Sequence[Flight], options: ExploreOptions, name: str) -> None:
        self._o, self._port = options, options.port
        self._depth = options.port.endswith(_PICTURES)
        super().__init__(flights, name, targets=1, range_m=options.range_m, more=0 if self._depth else options.sectors)
        if self._depth:
            picture = Box(0, 255, self._value(0).shape, np.uint8)
            self.observation_space = Dict({"depth": picture, "state": self.observation_space})
        self._solids: dict[int, Any] = {}  # by row, of the flight's map
        self._left_m = np.zeros(len(flights))
        self._floor_z = np.zeros(len(flights))
        # The borders of sectors are amid the columns of the default LiDAR, away from the last bit of arctan2.
        self._per_rad = options.sectors / (2.0 * np.pi)

    def enter(self, row: int, flight: Flight, seed: int) -> None:
        if row not in self._solids or self.flights[row] is not flight:
            self._solids[row] = solid_tree(load_world(flight.bench.scene))
        super().enter(row, flight, seed)

    def begin(self, row: int, flight: Flight, random: np.random.Generator) -> None:
        self.enter(row, flight, seed_of(random))
        x, y, z = flight.truth.p_WB
        start, goal = self._ends(row, (x, y, z + self._o.height_m), random)
        flight.vehicle.place(start, random_attitude(random, 0.0), rotor_speed_radps=hover_speeds(flight))
        self.target_W[row, 0] = goal
        self._floor_z[row] = z
        self._left_m[row] = norm(minus(goal, start))
        flight.begin(seed_of(random), start)

    def _ends(self, row: int, centre: Vec3, random: np.random.Generator) -> tuple[Vec3, Vec3]:
        """Return random start and goal. Raises HilError if the map has no room."""
        o, solids = self._o, self._solids[row]
        least, most = o.goal_m
        for _ in range(_TRIES):
            ax, ay, bx, by = random.uniform(-o.area_m, o.area_m, 4).tolist()
            a, b = (centre[0] + ax, centre[1] + ay, centre[2]), (centre[0] + bx, centre[1] + by, centre[2])
            if least <= norm(minus(b, a)) <= most and min(solids.distance(a), solids.distance(b)) >= o.clearance_m:
                return a, b
        raise HilError(
            f"{self.name}: no start and goal with {o.clearance_m:g} m around them and {least:g} to {most:g} m apart "
            f"were found {o.height_m:g} m above the start; change area_m, height_m, goal_m, clearance_m or the map"
        )

    def observe(self) -> Any:
        features = super().observe()
        if not self._depth:
            for row in range(len(self.flights)):
                features[row, self.width :] = self._sectors(self._value(row))
            return features
        pictures = [self._scaled(self._value(row)) for row in range(len(self.flights))]
        return {"depth": np.stack(pictures), "state": features}

    def _value(self, row: int) -> NDArray[Any]:
        ports = self.flights[row].ports
        assert ports is not None
        return ports.value(self._port)

    def _scaled(self, depth_m: NDArray[np.float32]) -> NDArray[np.uint8]:
        return np.minimum(depth_m * np.float32(255.0 / self._o.see_m), np.float32(255.0)).astype(np.uint8)

    def _sectors(self, cloud: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the nearest range of each sector over `see_m`."""
        points = cloud[:, :3].astype(np.float64)
        x, y, z = points.T
        range_m = np.sqrt((x * x + y * y) + z * z)
        counts = (range_m > 0.0) & (np.abs(z) <= self._o.band_m)
        sector = np.rint(np.arctan2(y[counts], x[counts]) * self._per_rad).astype(np.int64) % self._o.sectors
        nearest = np.full(self._o.sectors, self._o.see_m)
        np.minimum.at(nearest, sector, range_m[counts])
        return nearest / self._o.see_m

    def judge(self, step: Step) -> tuple[Rewards, Ends]:
        o, d, crashed = self._o, self.distance_m, step.crashed
        reached = d < o.reach_m
        reward = (self._left_m - d) - 0.02 + 10.0 * reached - 10.0 * crashed
        self._left_m[:] = d
        heights_m = np.array([flight.height_m for flight in self.flights]) - self._floor_z
        return reward, reached | crashed | (d > o.range_m) | (heights_m > o.ceiling_m) | (self.cos_tilt < 0.0)

    def info(self) -> dict[str, NDArray[Any]]:
        return {"is_success": self.distance_m < self._o.reach_m, "distance_m": self.distance_m}
