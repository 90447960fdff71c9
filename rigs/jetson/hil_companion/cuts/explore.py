"""Flies to a goal through an unmapped area, with LiDAR, GPS, IMU and barometer.

The goal is the setting `goal`, or else the last of the bench's waypoints, or else `GOAL_W`. The flight's state goes to
the bench with every answer (`report`); pictures go to the folder `pictures`, or else to the folder that the bench
assigns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Mapping, Sequence

import numpy as np

from hil_companion.cuts.settings import number, output_folder
from hil_companion.desired import Desired
from hil_companion.errors import OptionError
from hil_companion.explore.explorer import Explorer
from hil_companion.explore.mapping.slam import Slam
from hil_companion.explore.mapping.slam_settings import SlamSettings, lidar_settings
from hil_companion.explore.mapping.true_pose import TruePose
from hil_companion.explore.pictures import Pictures
from hil_companion.explore.planning.flight_settings import FlightSettings
from hil_companion.frame import Frame
from hil_companion.link.protocol import Welcome
from hil_companion.view import FREE, NEAR, OCCUPIED, UNKNOWN, Grid, View

GOAL_W = (70.0, 60.0, 10.0)
LOCALISERS = ("slam", "truth")
# Half the side of the map, and its margin behind the goal for detours. With a goal beyond the largest map, the flight
# ends as no_path.
_MIN_HALF_M, _MAX_HALF_M, _BEYOND_GOAL_M = 128.0, 300.0, 48.0


@dataclass(frozen=True)
class ExploreSettings:
    """Settings of `explore`. Raises OptionError."""

    goal: Sequence[float] | None = (
        None  # x, y [m] and optionally the flight's height; None: the last waypoint, or `GOAL_W`
    )
    start: Sequence[float] = (0.0, 0.0, 0.23, 0.0)  # x, y, z [m] and yaw [rad] before take-off
    localiser: str = "slam"
    seed: int = 1
    flight: Mapping[str, Any] | None = None  # fields of `FlightSettings`
    slam: Mapping[str, Any] | None = None  # fields of `SlamSettings`
    lidar: str = "lidar"  # topic
    camera: str | None = None  # topic of a camera to show in the pictures
    pictures: str | None = None  # folder; None: the folder that the bench assigns
    picture_every_s: float = 1.0

    def __post_init__(self) -> None:
        if self.localiser not in LOCALISERS:
            raise OptionError(f"explore: localiser {self.localiser!r}: one of {', '.join(LOCALISERS)} is needed")
        if self.goal is not None:
            _numbers("goal", self.goal, (2, 3))
        _numbers("start", self.start, (4,))
        number("explore", "seed", self.seed)
        for name in ("flight", "slam"):
            values = getattr(self, name)
            if values is not None and not isinstance(values, Mapping):
                raise OptionError(f"explore: {name} {values!r}: a mapping of settings is needed")
        _checked(FlightSettings, "flight", self.flight or {})
        number("explore", "picture_every_s", self.picture_every_s)

    @property
    def topics(self) -> tuple[str, ...]:
        truth = "truth" if self.localiser == "truth" else None
        return tuple(topic for topic in ("imu", "gps", "baro", self.lidar, self.camera, truth) if topic)


class Explore:
    """The CUT `explore`. Keyword arguments: the fields of `ExploreSettings`."""

    control = True
    settings_type = ExploreSettings

    def __init__(self, **settings: Any) -> None:
        s = self._settings = ExploreSettings(**settings)
        self._goal = None if s.goal is None else _numbers("goal", s.goal, (2, 3))
        self._start = _numbers("start", s.start, (4,))
        self._folder = output_folder(s.pictures)
        self._explorer: Explorer | None = None
        self._pictures: Pictures | None = None
        self._landing = False  # True once the bench lands the vehicle: no more pictures
        self.topics = s.topics

    @property
    def finished(self) -> bool:
        return self._explorer is not None and self._explorer.finished

    @property
    def report(self) -> Mapping[str, Any]:
        """Return the entries for run.json."""
        return {} if self._explorer is None else self._explorer.report.as_map()

    def start(self, welcome: Welcome) -> None:
        """Begin a session: take goal and LiDAR calibration from the welcome. Raises OptionError, CutError."""
        s = self._settings
        goal = self._goal or (welcome.waypoints_W[-1] if welcome.waypoints_W else GOAL_W)
        flight = dict(s.flight or {})
        if len(goal) == 3:
            flight.setdefault("height_m", goal[2])
        flight_settings = _checked(FlightSettings, "flight", flight)
        fields = welcome.topics.get(s.lidar, {}).get("fields", {})
        if fields and "points_L" not in fields:
            raise OptionError(f"explore: lidar {s.lidar!r}: the topic of a LiDAR is needed; it has no points_L")
        calibration = welcome.sensors.get(s.lidar, {})
        x, y, _, _ = self._start
        half_m = max(abs(goal[0] - x), abs(goal[1] - y)) + _BEYOND_GOAL_M
        half_m = min(max(half_m, _MIN_HALF_M), _MAX_HALF_M)
        localiser = self._make_localiser(flight_settings, calibration, 2.0 * half_m)
        goal_W, mapped_W = (float(goal[0]), float(goal[1])), (x - half_m, y - half_m, x + half_m, y + half_m)
        self._explorer = Explorer(flight_settings, localiser, goal_W, calibration, mapped_W=mapped_W, lidar=s.lidar)
        if self._folder is not None:
            self._pictures = Pictures(self._folder, every_s=float(s.picture_every_s), camera=s.camera)

    def _make_localiser(self, settings: FlightSettings, calibration: Mapping[str, Any], area_m: float) -> Slam:
        s = self._settings
        slam: dict[str, Any] = {"area_m": area_m, "lidar_topic": s.lidar, **lidar_settings(calibration)}
        # `slab_m` and `band_half_m` are half heights of the band of obstacles, for the planner and for SLAM.
        slam.update(flight_height_m=settings.height_m, band_half_m=settings.slab_m)
        slam.update(s.slam or {})
        kind = Slam
        if s.localiser == "truth":
            kind, slam["particles"] = TruePose, 1
        x, y, z, yaw = self._start
        return kind(_checked(SlamSettings, "slam", slam), start_W=(x, y, z, yaw), seed=int(s.seed))

    def __call__(self, frame: Frame) -> Desired | None:
        assert self._explorer is not None
        desired = self._explorer.step(frame)
        if self._pictures is not None and not self._landing:
            self._pictures.add(self._explorer, frame)
        self._landing = self._explorer.finished
        return desired

    def view(self) -> View | None:
        """Return the explorer's map, plan and particles for display."""
        return None if self._explorer is None else overview(self._explorer)

    def stop(self) -> None:
        if self._pictures is not None:
            self._pictures.close()


def _numbers(name: str, values: Sequence[float], sizes: Sequence[int]) -> tuple[float, ...]:
    if isinstance(values, (str, bytes)) or not hasattr(values, "__len__") or len(values) not in sizes:
        wanted = " or ".join(str(size) for size in sizes)
        raise OptionError(f"explore: {name} {values!r}: {wanted} numbers are needed")
    return tuple(number("explore", f"{name}[{i}]", value) for i, value in enumerate(values))


def _checked(kind: Any, name: str, values: Mapping[str, Any]) -> Any:
    """Make settings of that dataclass. Raises OptionError for fields that it does not have."""
    unknown = sorted(set(values) - set(kind.__dataclass_fields__))
    if unknown:
        known = ", ".join(kind.__dataclass_fields__)
        raise OptionError(f"explore: {name} has no setting {', '.join(map(str, unknown))}; it has {known}")
    return kind(**values)


def overview(explorer: Explorer) -> View | None:
    """Return the explorer's present state for display; None before a position is known."""
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
    plan_map = explorer.map
    if plan_map is None:
        return None
    settings = explorer.settings
    cells = np.full(plan_map.distance_m.shape, FREE, np.uint8)
    cells[plan_map.distance_m < settings.vehicle_radius_m + settings.clearance_m] = NEAR
    cells[plan_map.unknown] = UNKNOWN
    cells[plan_map.distance_m <= 0.0] = OCCUPIED
    return Grid(cells, plan_map.origin_W, plan_map.cell_m)
