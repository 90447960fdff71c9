"""Take-off of a plane: from a runway, from a hand or a catapult, or at once, then the climb.

RWTO_TKOFF 1        throttle rises to RWTO_MAX_THR in RWTO_RAMP_TIME, the plane rolls along its heading at the pitch
                    RWTO_PSP, steered by wheel and rudder; at RWTO_ROT_AIRSPD (at most FW_TKO_AIRSPD; default: 0.9 times
                    that) the nose rises: the limits of the pitch open from RWTO_PSP to those of the climb within
                    RWTO_ROT_TIME. As PX4's RunwayTakeoff. Below 1 m the wings stay level and rudder and wheel steer
FW_LAUN_DETCN_ON 1  engine idle until the specific force forward was above FW_LAUN_AC_THLD for FW_LAUN_AC_T;
                    FW_LAUN_MOT_DEL later the engine starts
neither             the engine starts at once
climb               full throttle, pitch at least FW_TKO_PITCH_MIN while the airspeed allows it, along the line
                    from the place of the start in its heading, or to the take-off point
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum, auto

from firmware_bridge.mock_pixhawk import elementary as el
from firmware_bridge.mock_pixhawk.modes import Mode
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.plane.path import Line, line_between
from firmware_bridge.mock_pixhawk.plane.pilot import PERIOD_S, PlanePilot
from firmware_bridge.mock_pixhawk.vehicle import Vehicle
from signals.time import US_PER_S
from signals.units import RAD_PER_DEG

_ROTATION = 0.9  # over the airspeed of the take-off, as PX4's default
_CLIMB_ROLL_RAD = 15.0 * RAD_PER_DEG
_OFF_GROUND_M = 1.0  # height from which the wings may bank after a roll
_TURNS_FROM_M = 15.0  # height from which the climb turns to the take-off point


class _Phase(Enum):
    WAITING = auto()
    LAUNCHED = auto()
    ROLLING = auto()
    CLIMBING = auto()


class PlaneTakeoff:
    """AUTO.TAKEOFF, and the take-off item of a mission. `altitude_d_m`: commanded altitude, used once."""

    def __init__(self, pilot: PlanePilot, vehicle: Vehicle, params: ParamTable, say: Callable[[str], None]) -> None:
        self._pilot, self._vehicle, self._params, self._say = pilot, vehicle, params, say
        self.altitude_d_m: float | None = None
        self.launched = False  # the land detector may find the vehicle in the air
        self._phase = _Phase.CLIMBING
        self._line = Line(0.0, 0.0, 1.0, 0.0)
        self._to: tuple[float, float] | None = None
        self._target_d = 0.0
        self._since_us = 0
        self._above_s = 0.0
        self._rotated_us: int | None = None  # when the nose rose off the runway

    @property
    def rolling(self) -> bool:
        """True while the plane rolls towards its rotation speed."""
        return self._phase is _Phase.ROLLING

    def start(self, now_us: int) -> None:
        """Begin the mode."""
        vehicle = self._vehicle
        target = self.altitude_d_m
        self.altitude_d_m = None
        if target is None:
            ground_d = vehicle.home.d_m if vehicle.home is not None else vehicle.pos_d
            target = ground_d - self._params["MIS_TAKEOFF_ALT"]
        self.begin(now_us, target, None)

    def begin(self, now_us: int, target_d_m: float, to: tuple[float, float] | None) -> None:
        """Begin a take-off to an altitude, towards a place (north, east) if there is one."""
        p, vehicle, pilot = self._params, self._vehicle, self._pilot
        n, e, d = pilot.here()
        self._target_d = min(target_d_m, d)
        self._line = Line(n, e, el.cos(vehicle.yaw), el.sin(vehicle.yaw))
        self._to = to
        self._since_us = now_us
        self._above_s = 0.0
        self._rotated_us = None
        if not vehicle.landed:
            self._phase = _Phase.CLIMBING
        elif p["RWTO_TKOFF"]:
            self._phase = _Phase.ROLLING
            self._say("Takeoff on runway")
        elif p["FW_LAUN_DETCN_ON"]:
            self._phase = _Phase.WAITING
            self._say("Waiting for launch")
        else:
            self._phase = _Phase.CLIMBING
        self.launched = self._phase is not _Phase.WAITING
        pilot.path = self._line

    def step(self, now_us: int) -> Mode | None:
        """Run one guidance step of the mode."""
        return Mode.LOITER if self.climb(now_us) else None

    def climb(self, now_us: int) -> bool:
        """Run one guidance step. Return True when the altitude is reached."""
        if self._phase is _Phase.WAITING:
            self._wait(now_us)
        elif self._phase is _Phase.LAUNCHED:
            self._launched(now_us)
        elif self._phase is _Phase.ROLLING:
            self._roll(now_us)
        else:
            return self._climb(now_us)
        return False

    def _wait(self, now_us: int) -> None:
        p, pilot = self._params, self._pilot
        pilot.idle()
        self._above_s = self._above_s + PERIOD_S if pilot.forward_force_mps2 > p["FW_LAUN_AC_THLD"] else 0.0
        if self._above_s >= p["FW_LAUN_AC_T"] and self._above_s > 0.0:
            self._phase = _Phase.LAUNCHED
            self._since_us = now_us
            self.launched = True
            self._say("Launch detected")

    def _launched(self, now_us: int) -> None:
        """Fly without engine until it may start: a propeller near a hand or a catapult stands still."""
        p = self._params
        if now_us - self._since_us >= int(p["FW_LAUN_MOT_DEL"] * US_PER_S):
            self._phase = _Phase.CLIMBING
            self._climb(now_us)
            return
        self._pilot.attitude(0.0, p["FW_TKO_PITCH_MIN"] * RAD_PER_DEG, p["FW_THR_IDLE"])

    def _roll(self, now_us: int) -> None:
        p, pilot = self._params, self._pilot
        ramp = 1e-6 * (now_us - self._since_us) / p["RWTO_RAMP_TIME"]
        throttle = p["RWTO_MAX_THR"] * min(ramp, 1.0)
        takeoff = self._takeoff_airspeed_mps()
        rotation = min(p["RWTO_ROT_AIRSPD"], takeoff) if p["RWTO_ROT_AIRSPD"] > 0.0 else _ROTATION * takeoff
        pilot.roll_on_ground(self._line, pitch_rad=p["RWTO_PSP"] * RAD_PER_DEG, throttle=throttle)
        if pilot.air.airspeed_mps >= rotation:
            self._phase = _Phase.CLIMBING
            self._rotated_us = now_us
            pilot.take_over()
            pilot.path = self._line

    def _takeoff_airspeed_mps(self) -> float:
        p = self._params
        return p["FW_TKO_AIRSPD"] if p["FW_TKO_AIRSPD"] > 0.0 else p["FW_AIRSPD_MIN"]

    def _climb(self, now_us: int) -> bool:
        p, pilot = self._params, self._pilot
        low = p["FW_AIRSPD_STALL"]
        room = max(p["FW_AIRSPD_MIN"] - low, 0.1)
        share = min(max((pilot.air.airspeed_mps - low) / room, 0.0), 1.0)
        if self._to is not None and pilot.height_m() > _TURNS_FROM_M:
            n, e, _ = pilot.here()
            pilot.path = line_between(n, e, *self._to, otherwise_rad=pilot.course_rad)
            self._to = None
        low_deg, high_deg = share * p["FW_TKO_PITCH_MIN"], p["FW_P_LIM_MAX"]
        runway = None
        if self._rotated_us is not None:
            risen = min(1e-6 * (now_us - self._rotated_us) / p["RWTO_ROT_TIME"], 1.0)
            low_deg += (p["RWTO_PSP"] - low_deg) * (1.0 - risen)
            high_deg += (p["RWTO_PSP"] - high_deg) * (1.0 - risen)
            runway = self._line if pilot.height_m() < _OFF_GROUND_M else None
        pilot.fly(
            d_m=self._target_d,
            pitch_min_rad=low_deg * RAD_PER_DEG,
            pitch_max_rad=high_deg * RAD_PER_DEG,
            runway=runway,
            roll_limit_rad=_CLIMB_ROLL_RAD if pilot.height_m() < 2.0 * _TURNS_FROM_M else None,
        )
        return self._vehicle.pos_d <= self._target_d + min(p["NAV_FW_ALT_RAD"], 0.5 * pilot.height_m())
