"""The automatic modes besides missions: take-off, hold, return, land.

Each mode is an object with `start(now_us)`, called when the mode is entered (or the vehicle armed in it), and
`step(now_us)`, called at guidance rate while armed; `step` returns the mode to change to, or None.
"""

from __future__ import annotations

from math import sqrt
from typing import Protocol

from firmware_bridge.mock_pixhawk import elementary as el
from firmware_bridge.mock_pixhawk.flight.guidance import Guidance
from firmware_bridge.mock_pixhawk.flight.trajectory import Point
from firmware_bridge.mock_pixhawk.modes import Mode
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.vehicle import Vehicle
from signals.time import US_PER_S
from signals.units import RAD_PER_DEG


class FlightMode(Protocol):
    """Interface of a flight mode."""

    def start(self, now_us: int) -> None: ...

    def step(self, now_us: int) -> Mode | None: ...


class Landing:
    """Vertical landing at a point, slower near the ground (PX4's MPC_LAND_* altitudes above home)."""

    def __init__(self, guidance: Guidance, vehicle: Vehicle, params: ParamTable) -> None:
        self._guidance, self._vehicle, self._params = guidance, vehicle, params
        self._point: Point | None = None

    def start(self, point: Point | None) -> None:
        """Begin over `point`; None: at the position where the vehicle stops."""
        self._point = point
        if point is None:
            self._guidance.brake()
        else:
            self._guidance.start_descent()

    def _speed(self) -> float:
        p, v = self._params, self._vehicle
        ground_d = v.home.d_m if v.home is not None else 0.0
        height = ground_d - v.pos_d
        slow, fast = p["MPC_LAND_SPEED"], self._guidance.limits.speed_down_mps
        low, high = p["MPC_LAND_ALT2"], p["MPC_LAND_ALT1"]
        if height <= p["MPC_LAND_ALT3"]:
            return min(p["MPC_LAND_CRWL"], slow)
        if height <= low or high <= low:
            return slow
        if height >= high:
            return fast
        return slow + (fast - slow) * (height - low) / (high - low)

    def step(self) -> bool:
        """Run one guidance step. Return True once the vehicle is on the ground."""
        guidance = self._guidance
        if self._vehicle.landed:
            guidance.idle()
            return True
        if self._point is None:
            guidance.follow()
            if guidance.trajectory is None or guidance.trajectory.done:
                self._point = guidance.setpoint_position()
                guidance.start_descent()
            return False
        guidance.descend(self._point, self._speed())
        return False


class TakeoffClimb:
    """Take-off: spool-up on the ground, then a vertical climb to an altitude."""

    def __init__(self, guidance: Guidance, vehicle: Vehicle, params: ParamTable) -> None:
        self._guidance, self._vehicle, self._params = guidance, vehicle, params
        self._target: Point | None = None
        self._climbing = False

    def start(self, target_d_m: float) -> None:
        """Climb to `target_d_m` (local down) over the present position; never down."""
        n, e, d = self._guidance.here()
        self._target = (n, e, min(target_d_m, d))
        self._climbing = False

    def step(self, now_us: int) -> bool:
        """Run one guidance step. Return True when the altitude is reached."""
        guidance, vehicle = self._guidance, self._vehicle
        assert self._target is not None
        if not self._climbing:
            spool_us = int(self._params["COM_SPOOLUP_TIME"] * US_PER_S)
            if vehicle.landed and now_us - vehicle.armed_at_us < spool_us:
                guidance.idle()
                return False
            self._climbing = True
            n, e, d = guidance.here()
            self._target = (n, e, self._target[2])
            limits = guidance.limits
            climb = min(limits.speed_up_mps, self._params["MPC_TKO_SPEED"])
            guidance.limits = limits._replace(speed_up_mps=climb)
            guidance.fly([(n, e, d), self._target])
            guidance.limits = limits
            guidance.course_yaw = False
        guidance.follow()
        trajectory = guidance.trajectory
        _, vertical = guidance.distance_to(self._target)
        if (trajectory is None or trajectory.done) and vertical < self._params["NAV_MC_ALT_RAD"]:
            guidance.hold(self._target)
            return True
        return False


class Hold:
    """AUTO.LOITER and DO_REPOSITION: stop and hold position; on the ground, idle."""

    def __init__(self, guidance: Guidance, vehicle: Vehicle) -> None:
        self._guidance, self._vehicle = guidance, vehicle

    def start(self, now_us: int) -> None:  # noqa: ARG002
        self._guidance.brake()

    def go_to(self, point: Point, speed_mps: float | None, yaw: float | None) -> None:
        """Fly straight to `point` and stay there."""
        guidance = self._guidance
        guidance.fly([guidance.here(), point], None if speed_mps is None else [speed_mps])
        guidance.yaw_target = yaw

    def step(self, now_us: int) -> Mode | None:  # noqa: ARG002
        if self._vehicle.landed:
            self._guidance.idle()
        else:
            self._guidance.follow()
        return None


class Takeoff:
    """AUTO.TAKEOFF: climb to MIS_TAKEOFF_ALT above home, or to the altitude commanded; then hold."""

    def __init__(self, guidance: Guidance, vehicle: Vehicle, params: ParamTable) -> None:
        self._guidance, self._vehicle, self._params = guidance, vehicle, params
        self._climb = TakeoffClimb(guidance, vehicle, params)
        self.altitude_d_m: float | None = None  # commanded altitude, used once

    def start(self, now_us: int) -> None:  # noqa: ARG002
        vehicle = self._vehicle
        target_d = self.altitude_d_m
        self.altitude_d_m = None
        if target_d is None:
            ground_d = vehicle.home.d_m if vehicle.home is not None else vehicle.pos_d
            target_d = ground_d - self._params["MIS_TAKEOFF_ALT"]
        self._climb.start(target_d)

    def step(self, now_us: int) -> Mode | None:
        return Mode.LOITER if self._climb.step(now_us) else None


class Land:
    """AUTO.LAND: stop, go straight down."""

    def __init__(self, guidance: Guidance, vehicle: Vehicle, params: ParamTable) -> None:
        self._landing = Landing(guidance, vehicle, params)

    def start(self, now_us: int) -> None:  # noqa: ARG002
        self._landing.start(None)

    def step(self, now_us: int) -> Mode | None:  # noqa: ARG002
        self._landing.step()
        return None


class Return:
    """AUTO.RTL: climb to the return altitude, fly home, descend, land.

    PX4's cone: within RTL_MIN_DIST of home the altitude is at most RTL_DESCEND_ALT; further away it is that of a cone
    of half-angle RTL_CONE_ANG over home, at most RTL_RETURN_ALT. The vehicle never descends on the way.
    """

    def __init__(self, guidance: Guidance, vehicle: Vehicle, params: ParamTable) -> None:
        self._guidance, self._vehicle, self._params = guidance, vehicle, params
        self._landing = Landing(guidance, vehicle, params)
        self._legs: list[Point] = []
        self._landing_at: Point | None = None
        self._wait_until_us: int | None = None

    def _return_height(self, distance_m: float, height_m: float) -> float:
        p = self._params
        top = p["RTL_RETURN_ALT"]
        if distance_m <= p["RTL_MIN_DIST"]:
            wanted = min(top, p["RTL_DESCEND_ALT"], height_m)
        elif p["RTL_CONE_ANG"] > 0.0:
            angle = p["RTL_CONE_ANG"] * RAD_PER_DEG
            cone = distance_m * el.cos(angle) / el.sin(angle)
            wanted = min(top, max(cone, p["RTL_DESCEND_ALT"]))
        else:
            wanted = top
        return max(wanted, height_m)

    def start(self, now_us: int) -> None:  # noqa: ARG002
        guidance, home = self._guidance, self._vehicle.home
        self._wait_until_us = None
        n, e, d = guidance.here()
        if home is None:
            self._legs, self._landing_at = [], (n, e, d)
            self._landing.start(None)
            return
        self._landing_at = None
        dn, de = home.n_m - n, home.e_m - e
        height = self._return_height(sqrt(dn * dn + de * de), home.d_m - d)
        cruise_d = home.d_m - height
        loiter_d = max(cruise_d, home.d_m - self._params["RTL_DESCEND_ALT"])
        self._legs = [(n, e, cruise_d), (home.n_m, home.e_m, cruise_d), (home.n_m, home.e_m, loiter_d)]
        guidance.brake()

    def step(self, now_us: int) -> Mode | None:
        guidance = self._guidance
        if self._vehicle.landed and self._landing_at is None:
            guidance.idle()
            return None
        if self._landing_at is not None:
            self._landing.step()
            return None
        guidance.follow()
        if guidance.trajectory is not None and not guidance.trajectory.done:
            return None
        if self._legs:
            guidance.fly([guidance.setpoint_position(), self._legs.pop(0)])
            return None
        point = guidance.setpoint_position()
        delay = self._params["RTL_LAND_DELAY"]
        if delay < 0.0:
            return None  # stay over home
        if self._wait_until_us is None:
            self._wait_until_us = now_us + int(delay * US_PER_S)
        if now_us >= self._wait_until_us:
            self._landing_at = point
            self._landing.start(point)
        return None
