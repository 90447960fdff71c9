"""Finds its way to a goal through a place that it has no map of, with LiDAR, GPS, IMU and barometer.

The goal is the last of the bench's waypoints, or `goal`: x, y [m] and, if there is a third number, the height of the
flight. `start`: x, y, z [m] and yaw of the vehicle before take-off, which nothing measures. How it ends goes to the
bench with every answer (`report`), pictures to `pictures`, or to where the bench has room for them.
"""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any, Mapping, Sequence

import numpy as np

from hil_companion.desired import Desired
from hil_companion.errors import OptionError
from hil_companion.explore.explorer import Explorer
from hil_companion.explore.pictures import Pictures
from hil_companion.explore.settings import FlightSettings, number
from hil_companion.explore.slam import Slam
from hil_companion.explore.slam_settings import SlamSettings, lidar_settings
from hil_companion.explore.true_pose import TruePose
from hil_companion.frame import Frame
from hil_companion.protocol import Welcome
from hil_companion.view import FREE, NEAR, OCCUPIED, UNKNOWN, Grid, View

GOAL_W = (70.0, 60.0, 10.0)
OUT_VARIABLE = "HIL_COMPANION_OUT"  # a folder for whatever a started client wants to leave; the bench sets it
LOCALISERS = ("slam", "truth")
# Half the side of the map, and room in it for ways round behind the goal. A goal beyond the most is told as no_path.
_LEAST_HALF_M, _MOST_HALF_M, _BEYOND_GOAL_M = 128.0, 300.0, 48.0


class Explore:
    """`flight`: any of `FlightSettings`; `slam`: any of the SLAM's settings. `camera`: a topic, for the pictures."""

    control = True

    def __init__(
        self,
        *,
        goal: Sequence[float] | None = None,
        start: Sequence[float] = (0.0, 0.0, 0.23, 0.0),
        localiser: str = "slam",
        seed: int = 1,
        flight: Mapping[str, Any] | None = None,
        slam: Mapping[str, Any] | None = None,
        lidar: str = "lidar",
        camera: str | None = None,
        pictures: str | None = None,
        picture_every_s: float = 1.0,
    ) -> None:
        if localiser not in LOCALISERS:
            raise OptionError(f"explore: localiser {localiser!r}: one of {', '.join(LOCALISERS)} is needed")
        self._goal = None if goal is None else _numbers("goal", goal, (2, 3))
        self._start = _numbers("start", start, (4,))
        self._localiser, self._seed = localiser, int(number("seed", seed))
        self._flight, self._slam = _mapping("flight", flight), _mapping("slam", slam)
        _made(FlightSettings, "flight", self._flight)
        self._lidar, self._camera = lidar, camera
        self._picture_every_s = number("picture_every_s", picture_every_s)
        folder = pictures if pictures is not None else os.environ.get(OUT_VARIABLE, "")
        self._folder = Path(folder) if folder else None
        self._explorer: Explorer | None = None
        self._pictures: Pictures | None = None
        self._landing = False  # the rest is the bench's, and no news
        self.topics = tuple(
            topic for topic in ("imu", "gps", "baro", lidar, camera, "truth" if localiser == "truth" else None) if topic
        )

    @property
    def finished(self) -> bool:
        return self._explorer is not None and self._explorer.finished

    @property
    def report(self) -> Mapping[str, Any]:
        """What the bench is told."""
        return {} if self._explorer is None else self._explorer.report.as_map()

    def start(self, welcome: Welcome) -> None:
        goal = self._goal or (welcome.waypoints_W[-1] if welcome.waypoints_W else GOAL_W)
        flight = dict(self._flight)
        if len(goal) == 3:
            flight.setdefault("height_m", goal[2])
        settings = _made(FlightSettings, "flight", flight)
        fields = welcome.topics.get(self._lidar, {}).get("fields", {})
        if fields and "points_L" not in fields:
            raise OptionError(f"explore: lidar {self._lidar!r}: the topic of a LiDAR is needed; it has no points_L")
        calibration = welcome.sensors.get(self._lidar, {})
        x, y, _, _ = self._start
        half_m = max(abs(goal[0] - x), abs(goal[1] - y)) + _BEYOND_GOAL_M
        half_m = min(max(half_m, _LEAST_HALF_M), _MOST_HALF_M)
        made = self._make_localiser(settings, calibration, 2.0 * half_m)
        goal_W, mapped_W = (float(goal[0]), float(goal[1])), (x - half_m, y - half_m, x + half_m, y + half_m)
        self._explorer = Explorer(settings, made, goal_W, calibration, mapped_W=mapped_W, lidar=self._lidar)
        if self._folder is not None:
            self._pictures = Pictures(self._folder, every_s=self._picture_every_s, camera=self._camera)

    def _make_localiser(self, settings: FlightSettings, calibration: Mapping[str, Any], area_m: float) -> Slam:
        told: dict[str, Any] = {"area_m": area_m, "lidar_topic": self._lidar, **lidar_settings(calibration)}
        told.update(flight_height_m=settings.height_m, band_half_m=settings.slab_m)
        told.update(self._slam)
        x, y, z, yaw = self._start
        kind, alone = (TruePose, {"particles": 1}) if self._localiser == "truth" else (Slam, {})
        return kind(_made(SlamSettings, "slam", {**told, **alone}), start_W=(x, y, z, yaw), seed=self._seed)

    def __call__(self, frame: Frame) -> Desired | None:
        assert self._explorer is not None
        desired = self._explorer.step(frame)
        if self._pictures is not None and not self._landing:
            self._pictures.look(self._explorer, frame)
        self._landing = self._explorer.finished
        return desired

    def view(self) -> View | None:
        """For people who look on."""
        return None if self._explorer is None else overview(self._explorer)

    def stop(self) -> None:
        if self._pictures is not None:
            self._pictures.close()


def _numbers(name: str, values: Sequence[float], sizes: Sequence[int]) -> tuple[float, ...]:
    if isinstance(values, (str, bytes)) or not hasattr(values, "__len__") or len(values) not in sizes:
        wanted = " or ".join(str(size) for size in sizes)
        raise OptionError(f"explore: {name} {values!r}: {wanted} numbers are needed")
    return tuple(number(f"{name}[{i}]", value) for i, value in enumerate(values))


def _mapping(name: str, values: Mapping[str, Any] | None) -> dict[str, Any]:
    if values is None:
        return {}
    if not isinstance(values, Mapping):
        raise OptionError(f"explore: {name} {values!r}: a mapping of settings is needed")
    return dict(values)


def _made(kind: Any, name: str, values: Mapping[str, Any]) -> Any:
    """Settings of that kind. OptionError for names that it does not have."""
    strange = sorted(set(values) - set(kind.__dataclass_fields__))
    if strange:
        known = ", ".join(kind.__dataclass_fields__)
        raise OptionError(f"explore: {name} has no setting {', '.join(map(str, strange))}; it has {known}")
    return kind(**values)


def overview(explorer: Explorer) -> View | None:
    """Of the moment; None before there is a position to show."""
    estimate = explorer.estimate
    if estimate is None or not all(math.isfinite(float(v)) for v in (*estimate.p_W, estimate.yaw_rad)):
        return None
    particles = estimate.particles_xy
    return View(
        p_W=[float(v) for v in estimate.p_W],
        yaw_rad=float(estimate.yaw_rad),
        goal_W=explorer.goal_W,
        plan_W=np.asarray(explorer.route.points_W, float).reshape(-1, 2) if explorer.route.found else None,
        particles_W=particles[np.isfinite(particles).all(axis=1)],
        grid=_grid(explorer),
    )


def _grid(explorer: Explorer) -> Grid | None:
    around = explorer.map
    if around is None:
        return None
    settings = explorer.settings
    cells = np.full(around.distance_m.shape, FREE, np.uint8)
    cells[around.distance_m < settings.vehicle_radius_m + settings.clearance_m] = NEAR
    cells[around.unknown] = UNKNOWN
    cells[around.distance_m <= 0.0] = OCCUPIED
    return Grid(cells, around.origin_W, around.cell_m)
