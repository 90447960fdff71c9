"""Manual modes of a plane with MANUAL_CONTROL. Same interface as `flight_modes`."""

from __future__ import annotations

from firmware_bridge.mock_pixhawk import elementary as el
from firmware_bridge.mock_pixhawk.modes import Mode
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.plane.path import Line
from firmware_bridge.mock_pixhawk.plane.pilot import PlanePilot
from firmware_bridge.mock_pixhawk.vehicle import ManualControl, Vehicle
from signals.units import RAD_PER_DEG

_CENTRE = ManualControl(0, 0.0, 0.0, 0.5, 0.0)
_DEAD_ZONE = 0.06


class PlaneDirect:
    """MANUAL: sticks are torque demands and throttle."""

    def __init__(self, pilot: PlanePilot, vehicle: Vehicle) -> None:
        self._pilot, self._vehicle = pilot, vehicle

    def start(self, now_us: int) -> None: ...

    def step(self, now_us: int) -> Mode | None:  # noqa: ARG002
        sticks = self._vehicle.manual or _CENTRE
        # Stick forward (positive) is nose down.
        self._pilot.direct(sticks.roll, -sticks.pitch, sticks.yaw, sticks.throttle)
        return None


class PlaneStabilized:
    """STABILIZED: sticks are bank, pitch and throttle."""

    def __init__(self, pilot: PlanePilot, vehicle: Vehicle, params: ParamTable) -> None:
        self._pilot, self._vehicle, self._params = pilot, vehicle, params

    def start(self, now_us: int) -> None: ...

    def step(self, now_us: int) -> Mode | None:  # noqa: ARG002
        sticks, p = self._vehicle.manual or _CENTRE, self._params
        self._pilot.attitude(
            sticks.roll * p["FW_MAN_R_MAX"] * RAD_PER_DEG,
            -sticks.pitch * p["FW_MAN_P_MAX"] * RAD_PER_DEG + p["FW_PSP_OFF"] * RAD_PER_DEG,
            sticks.throttle,
        )
        return None


class PlaneAltitude:
    """ALTCTL and POSCTL: pitch stick is climb rate, throttle airspeed, roll stick bank.

    POSCTL holds the course with the roll stick centred.
    """

    def __init__(self, pilot: PlanePilot, vehicle: Vehicle, params: ParamTable, *, holds_course: bool) -> None:
        self._pilot, self._vehicle, self._params, self._holds_course = pilot, vehicle, params, holds_course
        self._d: float | None = None
        self._line: Line | None = None

    def start(self, now_us: int) -> None:  # noqa: ARG002
        self._d = self._line = None

    def step(self, now_us: int) -> Mode | None:  # noqa: ARG002
        sticks, p, v, pilot = self._vehicle.manual or _CENTRE, self._params, self._vehicle, self._pilot
        if v.landed and sticks.throttle < 0.1:
            pilot.idle()
            return None
        low, trim, high = p["FW_AIRSPD_MIN"], p["FW_AIRSPD_TRIM"], p["FW_AIRSPD_MAX"]
        t = 2.0 * sticks.throttle - 1.0
        airspeed = trim + t * (high - trim) if t > 0.0 else trim + t * (trim - low)
        climb = -sticks.pitch * (p["FW_T_CLMB_MAX"] if sticks.pitch < 0.0 else p["FW_T_SINK_MAX"])
        if abs(sticks.pitch) > _DEAD_ZONE:
            self._d = None
        elif self._d is None:
            self._d = v.pos_d
        if self._holds_course and abs(sticks.roll) <= _DEAD_ZONE:
            if self._line is None:
                course = pilot.course_rad
                self._line = Line(v.pos_n, v.pos_e, el.cos(course), el.sin(course))
            pilot.path = self._line
        else:
            self._line = pilot.path = None
        if self._d is not None:
            pilot.fly(d_m=self._d, airspeed_mps=airspeed)
        else:
            pilot.fly(climb_mps=climb, airspeed_mps=airspeed)
        if pilot.path is None:
            pilot.roll_sp = sticks.roll * min(p["FW_MAN_R_MAX"], p["FW_R_LIM"]) * RAD_PER_DEG
        return None
