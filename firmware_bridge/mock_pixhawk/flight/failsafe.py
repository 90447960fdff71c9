"""Failsafes in flight and their actions, by PX4's failsafe parameters."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum, auto

from firmware_bridge.mock_pixhawk import elementary as el
from firmware_bridge.mock_pixhawk.estimate.sensors import ACCEL, BARO, GPS, GYRO, LABELS, MAG
from firmware_bridge.mock_pixhawk.flight.firmware_parts import FirmwareParts
from firmware_bridge.mock_pixhawk.flight.offboard import Offboard
from firmware_bridge.mock_pixhawk.ids import Severity
from firmware_bridge.mock_pixhawk.modes import Mode
from signals.time import US_PER_S
from signals.units import RAD_PER_DEG

_TERMINATION_BREAKER = 121212
_HITL_IMU_TIMEOUT_US = 2_000_000


class Action(Enum):
    """Action of a failsafe."""

    HOLD = auto()
    RETURN = auto()
    LAND = auto()
    TERMINATE = auto()
    DISARM = auto()


# Parameter values -> action; other values only warn.
_DATA_LINK = {1: Action.HOLD, 2: Action.RETURN, 3: Action.LAND, 5: Action.TERMINATE, 6: Action.DISARM}
_MANUAL_LOSS = {1: Action.HOLD, 2: Action.RETURN, 3: Action.LAND, 5: Action.TERMINATE, 6: Action.DISARM}
# COM_OBL_RC_ACT: 0..2 are manual modes; without manual control input they become Hold.
_OFFBOARD_LOSS = {
    0: Action.HOLD,
    1: Action.HOLD,
    2: Action.HOLD,
    3: Action.RETURN,
    4: Action.LAND,
    5: Action.HOLD,
    6: Action.TERMINATE,
    7: Action.DISARM,
}
_LOW_BATTERY = {2: Action.LAND, 3: Action.RETURN}


class Failsafe:
    """Failsafes of one armed vehicle. `say(severity, text)` sends a STATUSTEXT."""

    def __init__(
        self, parts: FirmwareParts, offboard: Offboard, say: Callable[[int, str], None], *, hitl: bool = False
    ) -> None:
        _, self._vehicle, self._estimate, self._sensors, self._params, _ = parts
        self._offboard, self._say = offboard, say
        # The bench may pause for a moment: in HITL a lost IMU is only reported until this time has passed.
        self._imu_timeout_us = _HITL_IMU_TIMEOUT_US if hitl else 0
        self.last_gcs_us: int | None = None
        self.descending_blind = False
        self._raised: dict[str, bool] = {}
        self._tilted_since_us: int | None = None
        self._attitude_reported = False

    def armed(self, now_us: int) -> None:  # noqa: ARG002
        """Reset all failsafes for a new flight."""
        self.descending_blind = False
        self._raised = {}
        self._tilted_since_us = None
        self._attitude_reported = False

    def operator_took_over(self) -> None:
        """Clear the failsafe after an operator chose a mode that can run."""
        self.descending_blind = False
        self._vehicle.failsafe = False

    def manual_control_ok(self, now_us: int) -> bool:
        """Return True if MANUAL_CONTROL arrived within COM_RC_LOSS_T."""
        manual = self._vehicle.manual
        return manual is not None and now_us - manual.t_us <= int(self._params["COM_RC_LOSS_T"] * US_PER_S)

    def _edge(self, name: str, present: bool) -> bool:
        """Return True if condition `name` has just become true."""
        was = self._raised.get(name, False)
        self._raised[name] = present
        return present and not was

    def check(self, now_us: int) -> Action | None:
        """Run the checks in order. Return the first action demanded, or None."""
        for check in (
            self._attitude,
            self._imu,
            self._other_sensors,
            self._position,
            self._offboard_link,
            self._sticks,
            self._data_link,
            self._battery,
        ):
            action = check(now_us)
            if action is not None:
                return action
        return None

    def _attitude(self, now_us: int) -> Action | None:
        p = self._params
        limit = min(p["FD_FAIL_R"], p["FD_FAIL_P"])
        if limit <= 0.0 or self._vehicle.tilt_cos >= el.cos(limit * RAD_PER_DEG):
            self._tilted_since_us = None
            return None
        if self._tilted_since_us is None:
            self._tilted_since_us = now_us
        if now_us - self._tilted_since_us < int(min(p["FD_FAIL_R_TTRI"], p["FD_FAIL_P_TTRI"]) * US_PER_S):
            return None
        if not self._attitude_reported:
            self._attitude_reported = True
            self._say(Severity.EMERGENCY, "Attitude failure (roll or pitch)")
        return Action.TERMINATE if p["CBRK_FLIGHTTERM"] != _TERMINATION_BREAKER else None

    def _imu(self, now_us: int) -> Action | None:
        sensors = self._sensors
        lost = sensors.lost(ACCEL, now_us) or sensors.lost(GYRO, now_us)
        if lost and self._imu_timeout_us:
            for sensor in (ACCEL, GYRO):
                if self._edge(LABELS[sensor], sensors.lost(sensor, now_us)):
                    self._say(Severity.EMERGENCY, f"{LABELS[sensor]} #0 failed: TIMEOUT!")
            silent_us = max(sensors.lost_since_us(ACCEL, now_us), sensors.lost_since_us(GYRO, now_us))
            lost = silent_us > self._imu_timeout_us
        elif self._imu_timeout_us:
            self._raised[LABELS[ACCEL]] = self._raised[LABELS[GYRO]] = False
        if self._edge("imu", lost):
            self._say(Severity.EMERGENCY, "Failsafe activated: IMU timeout")
            return Action.TERMINATE
        return None

    def _other_sensors(self, now_us: int) -> Action | None:
        for sensor, name, text in (
            (MAG, "mag", "Compass timeout"),
            (BARO, "baro", "Barometer timeout"),
            (GPS, "gps", "GPS lost"),
        ):
            if self._edge(name, not self._sensors.healthy(sensor, now_us)):
                self._say(Severity.CRITICAL, text)
        return None

    def _position(self, now_us: int) -> Action | None:  # noqa: ARG002
        needs = self._vehicle.mode.value.needs_position
        invalid = needs and not self._estimate.position_ok
        if self._edge("position", invalid):
            self.descending_blind = True
            self._vehicle.failsafe = True
            self._say(Severity.CRITICAL, "Failsafe activated: no valid position, descending")
        elif not invalid and self.descending_blind:
            self.descending_blind = False
            self._say(Severity.WARNING, "Position valid again")
            return Action.HOLD
        return None

    def _offboard_link(self, now_us: int) -> Action | None:
        lost = self._vehicle.mode is Mode.OFFBOARD and not self._offboard.fresh(
            now_us, int(self._params["COM_OF_LOSS_T"] * US_PER_S)
        )
        if self._edge("offboard", lost):
            self._say(Severity.CRITICAL, "Failsafe activated: no offboard signal")
            return _OFFBOARD_LOSS.get(int(self._params["COM_OBL_RC_ACT"]))
        return None

    def _sticks(self, now_us: int) -> Action | None:
        lost = self._vehicle.mode.value.needs_manual_control and not self.manual_control_ok(now_us)
        if self._edge("sticks", lost):
            self._say(Severity.CRITICAL, "Failsafe activated: manual control lost")
            return _MANUAL_LOSS.get(int(self._params["NAV_RCL_ACT"]))
        return None

    def _data_link(self, now_us: int) -> Action | None:
        action = _DATA_LINK.get(int(self._params["NAV_DLL_ACT"]))
        limit = int(self._params["COM_DL_LOSS_T"] * US_PER_S)
        lost = self.last_gcs_us is not None and now_us - self.last_gcs_us > limit
        if self._edge("gcs", lost):
            self._say(Severity.WARNING, "Connection to ground station lost")
            return action
        return None

    def _battery(self, now_us: int) -> Action | None:
        v, p = self._vehicle, self._params
        # Linear in armed time down to SIM_BAT_MIN_PCT, as PX4's battery simulator.
        drained = (now_us - v.armed_at_us) / (p["SIM_BAT_DRAIN"] * US_PER_S)
        v.battery_remaining = max(1.0 - drained, p["SIM_BAT_MIN_PCT"] / 100.0)
        if self._edge("battery_low", v.battery_remaining <= p["BAT_LOW_THR"]):
            self._say(Severity.WARNING, "Low battery level")
        if self._edge("battery_critical", v.battery_remaining <= p["BAT_CRIT_THR"]):
            self._say(Severity.EMERGENCY, "Critical battery level")
            return _LOW_BATTERY.get(int(p["COM_LOW_BAT_ACT"]))
        return None
