"""Pre-flight checks: the reasons that forbid arming."""

from __future__ import annotations

from firmware_bridge.mock_pixhawk.estimate.sensors import ACCEL, BARO, GPS, GYRO, LABELS, MAG, SensorIntake
from firmware_bridge.mock_pixhawk.estimate.state import Estimate
from firmware_bridge.mock_pixhawk.modes import Mode
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.vehicle import Vehicle

# Measured on PX4 SITL: the checks pass 4.3 s after a start at time_usec near 0, and after 18 to 27 s where the first
# time_usec is larger.
_READY_US, _READY_LATE_US, _NEAR_ZERO_US = 4_300_000, 18_000_000, 1_000_000
_CRITICAL_BATTERY = 0.07
BIAS = "High Accelerometer Bias"  # PX4's text when samples arrive unevenly


class Preflight:
    """The checks of one vehicle. `start_us` is the first HIL_SENSOR.time_usec."""

    def __init__(self, vehicle: Vehicle, estimate: Estimate, sensors: SensorIntake, params: ParamTable) -> None:
        self._vehicle, self._estimate, self._sensors, self._params = vehicle, estimate, sensors, params
        self._earliest_us = 0

    def begin(self, start_us: int, *, hitl: bool = False) -> None:
        """Set the time of the first pass from the first time of the clock, in HITL the board's own."""
        if hitl:
            self._earliest_us = start_us + _READY_US
            return
        late = start_us > _NEAR_ZERO_US
        self._earliest_us = start_us + (_READY_LATE_US if late else _READY_US - start_us)

    @property
    def arrivals_bad(self) -> bool:
        """True if IMU samples arrive too unevenly."""
        return self._sensors.arrivals.bad

    def sensor_failures(self, now_us: int) -> list[str]:
        """Return the failures of sensors, in PX4's words."""
        failures = []
        for sensor in (ACCEL, GYRO, MAG, BARO):
            if sensor == MAG and not self._params["SYS_HAS_MAG"]:
                continue
            if self._sensors.stale(sensor):
                failures.append(f"{LABELS[sensor]} #0 failed: STALE")
            elif self._sensors.lost(sensor, now_us):
                failures.append(f"{LABELS[sensor]} #0 failed: TIMEOUT")
        return failures

    def failures(self, now_us: int, mode: Mode) -> list[str]:
        """Return the reasons that forbid arming in `mode`; empty if there are none."""
        failures = self.sensor_failures(now_us)
        estimate = self._estimate
        if not estimate.attitude_ok:
            failures.append("Attitude estimate not ready")
        elif now_us < self._earliest_us:
            failures.append("system still starting")
        if self.arrivals_bad:
            failures.append(BIAS)
        if mode.value.needs_position or not self._params["COM_ARM_WO_GPS"]:
            gps = self._sensors.gps
            if self._sensors.lost(GPS, now_us) or gps is None:
                failures.append("no GPS")
            elif not gps.usable:
                failures.append(
                    f"GPS quality: fix {gps.fix_type}, {gps.satellites} satellites, eph {gps.eph} cm, epv {gps.epv} cm"
                )
            elif not estimate.position_ok:
                failures.append("No valid position estimate")
            elif self._vehicle.home is None:
                failures.append("home position not set")
        if self._vehicle.battery_remaining <= _CRITICAL_BATTERY:
            failures.append("low battery")
        return failures
