"""The automatic modes of a plane besides missions and take-off: hold, return, land. As `flight_modes`."""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt

from firmware_bridge.mock_pixhawk import elementary as el
from firmware_bridge.mock_pixhawk.flight.trajectory import Point
from firmware_bridge.mock_pixhawk.modes import Mode
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.plane.engine_watch import EngineWatch
from firmware_bridge.mock_pixhawk.plane.landing import PlaneLanding
from firmware_bridge.mock_pixhawk.plane.path import Circle, line_between
from firmware_bridge.mock_pixhawk.plane.pilot import PlanePilot
from firmware_bridge.mock_pixhawk.vehicle import Vehicle
from signals.time import US_PER_S
from signals.units import RAD_PER_DEG


class PlaneHold:
    """AUTO.LOITER and DO_REPOSITION: circle with NAV_LOITER_RAD; on the ground, idle."""

    def __init__(self, pilot: PlanePilot, vehicle: Vehicle, params: ParamTable) -> None:
        self._pilot, self._vehicle, self._params = pilot, vehicle, params
        self._d = 0.0

    def start(self, now_us: int) -> None:  # noqa: ARG002
        self._pilot.circle_here()
        self._d = self._vehicle.pos_d

    def go_to(self, point: Point, speed_mps: float | None, yaw: float | None) -> None:  # noqa: ARG002 (a plane has no choice)
        """Fly to `point` and circle about it."""
        radius = self._params["NAV_LOITER_RAD"]
        self._pilot.path = Circle(point[0], point[1], abs(radius), radius >= 0.0)
        self._pilot.airspeed_mps = speed_mps
        self._d = point[2]

    def step(self, now_us: int) -> Mode | None:  # noqa: ARG002
        if self._vehicle.landed:
            self._pilot.idle()
        else:
            self._pilot.fly(d_m=self._d)
        return None


class PlaneLand:
    """AUTO.LAND: straight on, down the slope of FW_LND_ANG, flare. Without engine: a glide at the best speed."""

    def __init__(
        self, pilot: PlanePilot, vehicle: Vehicle, params: ParamTable, landing: PlaneLanding, engine: EngineWatch
    ) -> None:
        self._pilot, self._vehicle, self._params = pilot, vehicle, params
        self._landing, self._engine = landing, engine

    def start(self, now_us: int) -> None:  # noqa: ARG002
        pilot, home = self._pilot, self._vehicle.home
        here, course = pilot.here(), pilot.course_rad
        ground_d = home.d_m if home is not None else 0.0
        angle = self._params["FW_LND_ANG"] * RAD_PER_DEG
        length = max((ground_d - here[2]) * el.cos(angle) / el.sin(angle), 1.0)
        point = (here[0] + length * el.cos(course), here[1] + length * el.sin(course), ground_d)
        self._landing.start(here, point, engine=not self._engine.failed)

    def step(self, now_us: int) -> Mode | None:
        self._landing.step(now_us)
        return None


class PlaneReturn:
    """AUTO.RTL: climb to RTL_RETURN_ALT on the way home, circle there down to RTL_DESCEND_ALT, then stay or land.

    With RTL_TYPE 1 and a mission that has a landing, that landing is flown (the mode changes to MISSION). Else
    RTL_LAND_DELAY: seconds on the circle, after which the plane lands at home against the wind; -1: it stays.
    """

    def __init__(
        self,
        pilot: PlanePilot,
        vehicle: Vehicle,
        params: ParamTable,
        landing: PlaneLanding,
        mission_landing: Callable[[], bool],
    ) -> None:
        """`mission_landing()` makes the landing of the mission its current item; False: it has none."""
        self._pilot, self._vehicle, self._params, self._landing = pilot, vehicle, params, landing
        self._mission_landing = mission_landing
        self._d = 0.0
        self._wait_until_us: int | None = None
        self._entry: Point | None = None  # start of the approach
        self._landing_now = False

    def start(self, now_us: int) -> None:  # noqa: ARG002
        pilot, home, p = self._pilot, self._vehicle.home, self._params
        self._wait_until_us, self._entry, self._landing_now = None, None, False
        n, e, d = pilot.here()
        home_n, home_e, home_d = (n, e, d) if home is None else (home.n_m, home.e_m, home.d_m)
        # PX4's cone: near home no climb is needed.
        distance = sqrt((home_n - n) * (home_n - n) + (home_e - e) * (home_e - e))
        top = p["RTL_RETURN_ALT"]
        if distance <= p["RTL_LOITER_RAD"] and home_d - d < top:
            top = max(home_d - d, min(top, p["RTL_DESCEND_ALT"]))
        self._d = min(home_d - top, d)
        pilot.path = Circle(home_n, home_e, p["RTL_LOITER_RAD"], clockwise=True)

    def step(self, now_us: int) -> Mode | None:
        pilot, vehicle, p = self._pilot, self._vehicle, self._params
        if vehicle.landed and not self._landing_now:
            pilot.idle()
            return None
        if self._landing_now:
            self._landing.step(now_us)
            return None
        home = vehicle.home
        if home is None:
            pilot.fly(d_m=self._d)
            return None
        if self._entry is not None:
            return self._to_entry(self._entry, now_us)
        n, e, _ = pilot.here()
        radius = sqrt((n - home.n_m) * (n - home.n_m) + (e - home.e_m) * (e - home.e_m))
        circling = radius < 1.3 * p["RTL_LOITER_RAD"]
        if circling:
            self._d = max(self._d, home.d_m - p["RTL_DESCEND_ALT"])
        pilot.fly(d_m=self._d)
        down = circling and abs(vehicle.pos_d - self._d) < p["NAV_FW_ALT_RAD"]
        if not down:
            return None
        if p["RTL_TYPE"] == 1 and self._mission_landing():
            return Mode.MISSION
        if p["RTL_LAND_DELAY"] < 0.0:
            return None
        if self._wait_until_us is None:
            self._wait_until_us = now_us + int(p["RTL_LAND_DELAY"] * US_PER_S)
        if now_us >= self._wait_until_us:
            self._entry = self._approach_entry()
        return None

    def _approach_entry(self) -> Point:
        """Return a place down-wind of home from which the slope leads there; without wind, down the present course."""
        home, p, pilot = self._vehicle.home, self._params, self._pilot
        assert home is not None
        w_n, w_e = pilot.air.wind_mps
        wind = sqrt(w_n * w_n + w_e * w_e)
        t_n, t_e = (w_n / wind, w_e / wind) if wind > 1.0 else (-el.cos(pilot.course_rad), -el.sin(pilot.course_rad))
        angle = p["FW_LND_ANG"] * RAD_PER_DEG
        height = home.d_m - self._d
        away = height * el.cos(angle) / el.sin(angle) + 1.5 * pilot.turn_distance_m()
        return (home.n_m + away * t_n, home.e_m + away * t_e, self._d)

    def _to_entry(self, entry: Point, now_us: int) -> Mode | None:
        pilot, home = self._pilot, self._vehicle.home
        assert home is not None
        n, e, _ = pilot.here()
        pilot.path = line_between(n, e, entry[0], entry[1], otherwise_rad=pilot.course_rad)
        if (n - entry[0]) * (n - entry[0]) + (e - entry[1]) * (e - entry[1]) < pilot.turn_distance_m() ** 2:
            self._landing.start(entry, (home.n_m, home.e_m, home.d_m))
            self._landing_now = True
            self._landing.step(now_us)
            return None
        pilot.fly(d_m=self._d)
        return None
