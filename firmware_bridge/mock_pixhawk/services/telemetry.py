"""The telemetry messages: one function per message, from the autopilot's state to MAVLink's units.

Default rates are low; a ground station raises them with SET_MESSAGE_INTERVAL.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from math import nan, sqrt
from typing import Any

from firmware_bridge.codecs.messages import message_class
from firmware_bridge.mock_pixhawk.estimate.sensors import ACCEL, BARO, GPS, GYRO, MAG, UNKNOWN_ACCURACY
from firmware_bridge.mock_pixhawk.estimate.vibration import VibrationMetrics
from firmware_bridge.mock_pixhawk.flight.firmware_parts import FirmwareParts
from firmware_bridge.mock_pixhawk.ids import (
    AUTOPILOT_PX4,
    BaseMode,
    Capability,
    LandedState,
    Sensor,
    SystemState,
)
from firmware_bridge.mock_pixhawk.modes import Mode
from signals.units import DEG_PER_RAD

#: message -> default period [us]; 0 = only on request
DEFAULT_PERIOD_US = {
    "HEARTBEAT": 1_000_000,
    "SYS_STATUS": 500_000,
    "SYSTEM_TIME": 1_000_000,
    "GPS_RAW_INT": 500_000,
    "ATTITUDE": 100_000,
    "ATTITUDE_QUATERNION": 0,
    "LOCAL_POSITION_NED": 100_000,
    "GLOBAL_POSITION_INT": 200_000,
    "SERVO_OUTPUT_RAW": 1_000_000,
    "MISSION_CURRENT": 1_000_000,
    "VFR_HUD": 500_000,
    "ALTITUDE": 500_000,
    "BATTERY_STATUS": 1_000_000,
    "ESTIMATOR_STATUS": 1_000_000,
    "HOME_POSITION": 2_000_000,
    "GPS_GLOBAL_ORIGIN": 0,
    "EXTENDED_SYS_STATE": 500_000,
    "VIBRATION": 0,
}
_HITL_PERIOD_US = {"TIMESYNC": 100_000}  # a board with its own clock asks for the time of the other side

_CONTROLS = (
    Sensor.SENSOR_MOTOR_OUTPUTS
    | Sensor.SENSOR_ANGULAR_RATE_CONTROL
    | Sensor.SENSOR_ATTITUDE_STABILIZATION
    | Sensor.SENSOR_YAW_POSITION
    | Sensor.SENSOR_Z_ALTITUDE_CONTROL
    | Sensor.SENSOR_XY_POSITION_CONTROL
)
_SENSOR_BITS = (
    (ACCEL, Sensor.SENSOR_3D_ACCEL),
    (GYRO, Sensor.SENSOR_3D_GYRO),
    (MAG, Sensor.SENSOR_3D_MAG),
    (BARO, Sensor.SENSOR_ABSOLUTE_PRESSURE),
    (GPS, Sensor.SENSOR_GPS),
)
_PRESENT = sum(bit for _, bit in _SENSOR_BITS) | Sensor.AHRS | Sensor.SENSOR_BATTERY | Sensor.PREARM_CHECK | _CONTROLS
_ESTIMATOR_ALL = 0x1 | 0x2 | 0x4 | 0x8 | 0x10 | 0x20 | 0x100 | 0x200
_ESTIMATOR_ATTITUDE = 0x1 | 0x20
_CELL_FULL_MV, _CELL_EMPTY_MV, _CELLS = 4050, 3600, 4
_UNKNOWN_U16 = 65535
_BATTERY_OK, _BATTERY_LOW, _BATTERY_CRITICAL = 1, 2, 3
_I16 = (-32768, 32767)


def _clamped(value: float, limits: tuple[int, int]) -> int:
    """Round `value` and clamp it to `limits`. Return 0 for NaN."""
    if value != value:
        return 0
    return round(min(max(value, limits[0]), limits[1]))


def _i32(value: float) -> int:
    return _clamped(value, (-(2**31), 2**31 - 1))


class Telemetry:
    """Builder of the telemetry messages. `mission()` returns (seq, total, state).

    Every maker takes the clock in us and returns a message, or None while its data are missing.
    """

    def __init__(
        self, parts: FirmwareParts, mission: Callable[[], tuple[int, int, int]], *, system_type: int, hil: bool = False
    ) -> None:
        _, self._v, self._estimate, self._sensors, _, _ = parts
        self._mission, self._type = mission, system_type
        self._base_mode = BaseMode.CUSTOM_MODE_ENABLED | (BaseMode.HIL_ENABLED if hil else 0)
        self.makers: dict[int, Callable[[int], Any]] = {}
        self.periods_us: dict[int, int] = {}  # by message id
        for name, period_us in (DEFAULT_PERIOD_US | (_HITL_PERIOD_US if hil else {})).items():
            cls = message_class(name)
            self.periods_us[cls.MSGID] = period_us
            self.makers[cls.MSGID] = partial(getattr(self, f"_{name.lower()}"), cls)
        self.controls: Sequence[float] = (0.0,) * 16

    def _heartbeat(self, cls: Any, now_us: int) -> Any:  # noqa: ARG002
        v = self._v
        base = self._base_mode | v.mode.value.base_mode
        if v.armed:
            base |= BaseMode.SAFETY_ARMED
        if v.terminated:
            state = SystemState.FLIGHT_TERMINATION
        elif v.failsafe:
            state = SystemState.CRITICAL
        elif v.armed:
            state = SystemState.ACTIVE
        else:
            state = SystemState.STANDBY
        return cls(
            type=self._type,
            autopilot=AUTOPILOT_PX4,
            base_mode=base,
            custom_mode=v.mode.custom_mode,
            system_status=state,
            mavlink_version=3,
        )

    def _sys_status(self, cls: Any, now_us: int) -> Any:
        v, sensors = self._v, self._sensors
        healthy = 0
        for sensor, bit in _SENSOR_BITS:
            if sensors.healthy(sensor, now_us):
                healthy |= bit
        if self._estimate.attitude_ok:
            healthy |= Sensor.AHRS
        if v.battery_remaining > 0.07:
            healthy |= Sensor.SENSOR_BATTERY
        healthy |= _CONTROLS
        if v.ready or v.armed:
            healthy |= Sensor.PREARM_CHECK
        return cls(
            onboard_control_sensors_present=_PRESENT,
            onboard_control_sensors_enabled=_PRESENT,
            onboard_control_sensors_health=healthy,
            load=300,
            voltage_battery=_CELLS * self._cell_mv(),
            current_battery=1500 if v.armed else 100,
            battery_remaining=_clamped(100.0 * v.battery_remaining, (0, 100)),
            drop_rate_comm=0,
            errors_comm=0,
            errors_count1=0,
            errors_count2=0,
            errors_count3=0,
            errors_count4=0,
        )

    def _cell_mv(self) -> int:
        return _CELL_EMPTY_MV + round((_CELL_FULL_MV - _CELL_EMPTY_MV) * self._v.battery_remaining)

    def _timesync(self, cls: Any, now_us: int) -> Any:
        return cls(0, now_us * 1000)  # tc1 = 0: a request

    def _system_time(self, cls: Any, now_us: int) -> Any:
        return cls(time_unix_usec=0, time_boot_ms=now_us // 1000 & 0xFFFFFFFF)

    def _gps_raw_int(self, cls: Any, now_us: int) -> Any:  # noqa: ARG002
        fix = self._sensors.gps
        if fix is None:
            return None
        known_eph, known_epv = fix.eph != UNKNOWN_ACCURACY, fix.epv != UNKNOWN_ACCURACY
        return cls(
            time_usec=fix.t_us,
            fix_type=fix.fix_type,
            lat=fix.lat,
            lon=fix.lon,
            alt=fix.alt_mm,
            eph=80,  # dilution of precision times 100: HIL_GPS does not carry it
            epv=120,
            vel=fix.vel,
            cog=fix.cog,
            satellites_visible=fix.satellites,
            alt_ellipsoid=fix.alt_mm,
            h_acc=fix.eph * 10 if known_eph else 0,
            v_acc=fix.epv * 10 if known_epv else 0,
            vel_acc=100,
        )

    def _attitude(self, cls: Any, now_us: int) -> Any:
        e = self._estimate
        return cls(now_us // 1000 & 0xFFFFFFFF, *e.euler, *e.w_NF_F)

    def _attitude_quaternion(self, cls: Any, now_us: int) -> Any:
        e = self._estimate
        return cls(now_us // 1000 & 0xFFFFFFFF, *e.q_NF, *e.w_NF_F)

    def _local_position_ned(self, cls: Any, now_us: int) -> Any:
        e = self._estimate
        if not e.position_ok:
            return None
        return cls(now_us // 1000 & 0xFFFFFFFF, *e.p_NF, *e.v_NF_N)

    def _global_position_int(self, cls: Any, now_us: int) -> Any:
        e, v = self._estimate, self._v
        if not e.position_ok:
            return None
        lat, lon, alt = e.geodetic(*e.p_NF)
        vn, ve, vd = e.v_NF_N
        relative = v.home.d_m - e.p_NF[2] if v.home is not None else 0.0
        yaw = e.euler[2] * DEG_PER_RAD
        return cls(
            now_us // 1000 & 0xFFFFFFFF,
            _i32(lat * 1e7),
            _i32(lon * 1e7),
            _i32(alt * 1e3),
            _i32(relative * 1e3),
            _clamped(vn * 100.0, _I16),
            _clamped(ve * 100.0, _I16),
            _clamped(vd * 100.0, _I16),
            round((yaw + 360.0 if yaw < 0.0 else yaw) * 100.0) % 36000,
        )

    def _servo_output_raw(self, cls: Any, now_us: int) -> Any:
        pulses = [round(1000.0 + 1000.0 * u) if self._v.armed else 900 for u in self.controls[:8]]
        return cls(now_us & 0xFFFFFFFF, 0, *pulses)

    def _mission_current(self, cls: Any, now_us: int) -> Any:  # noqa: ARG002
        seq, total, state = self._mission()
        return cls(seq, total if total else _UNKNOWN_U16, state, 1 if self._v.mode is Mode.MISSION else 2)

    def _vfr_hud(self, cls: Any, now_us: int) -> Any:  # noqa: ARG002
        e = self._estimate
        vn, ve, vd = e.v_NF_N
        speed = sqrt(vn * vn + ve * ve)
        heading = round(e.euler[2] * DEG_PER_RAD) % 360
        u = self.controls
        throttle = 25.0 * (u[0] + u[1] + u[2] + u[3])
        return cls(speed, speed, heading, _clamped(throttle, (0, 100)), self._altitude_amsl(), -vd)

    def _altitude_amsl(self) -> float:
        e = self._estimate
        return e.origin_alt_m - e.p_NF[2] if e.has_origin else 0.0

    def _altitude(self, cls: Any, now_us: int) -> Any:
        e, v = self._estimate, self._v
        amsl = self._altitude_amsl()
        relative = v.home.d_m - e.p_NF[2] if v.home is not None else -e.p_NF[2]
        return cls(now_us, amsl, amsl, -e.p_NF[2], relative, nan, nan)

    def _battery_status(self, cls: Any, now_us: int) -> Any:  # noqa: ARG002
        v = self._v
        cells = (self._cell_mv(),) * _CELLS + (_UNKNOWN_U16,) * (10 - _CELLS)
        left = v.battery_remaining
        state = _BATTERY_OK if left > 0.15 else (_BATTERY_LOW if left > 0.07 else _BATTERY_CRITICAL)
        return cls(
            id=0,
            battery_function=1,
            type=1,
            temperature=32767,
            voltages=cells,
            current_battery=1500 if v.armed else 100,
            current_consumed=round(5000.0 * (1.0 - left)),
            energy_consumed=-1,
            battery_remaining=_clamped(100.0 * left, (0, 100)),
            time_remaining=0,
            charge_state=state,
        )

    def _vibration(self, cls: Any, now_us: int) -> Any:
        """Return the metrics in the fields that PX4 uses; all 0 at the first request, from which they are measured."""
        metrics = self._sensors.vibration
        if metrics is None:
            metrics = self._sensors.vibration = VibrationMetrics()
        return cls(now_us, metrics.coning_rad2, metrics.gyro_radps, metrics.accel_mps2, metrics.clipped, 0, 0)

    def _estimator_status(self, cls: Any, now_us: int) -> Any:
        e = self._estimate
        flags = _ESTIMATOR_ALL if e.position_ok else (_ESTIMATOR_ATTITUDE if e.attitude_ok else 0)
        pos, vel, baro, mag = e.test_ratios
        horizontal, vertical = e.accuracy_m
        return cls(
            time_usec=now_us,
            flags=flags,
            vel_ratio=vel,
            pos_horiz_ratio=pos,
            pos_vert_ratio=baro,
            mag_ratio=mag,
            hagl_ratio=0.0,
            tas_ratio=0.0,
            pos_horiz_accuracy=horizontal,
            pos_vert_accuracy=vertical,
        )

    def _home_position(self, cls: Any, now_us: int) -> Any:
        home = self._v.home
        if home is None:
            return None
        return cls(
            latitude=_i32(home.lat_deg * 1e7),
            longitude=_i32(home.lon_deg * 1e7),
            altitude=_i32(home.alt_m * 1e3),
            x=home.n_m,
            y=home.e_m,
            z=home.d_m,
            q=(1.0, 0.0, 0.0, 0.0),
            approach_x=0.0,
            approach_y=0.0,
            approach_z=0.0,
            time_usec=now_us,
        )

    def _gps_global_origin(self, cls: Any, now_us: int) -> Any:
        """Return the origin at each period of a stream; PX4 sends it only when it changes."""
        e = self._estimate
        if not e.has_origin:
            return None
        lat, lon, alt = e.geodetic(0.0, 0.0, 0.0)
        return cls(_i32(lat * 1e7), _i32(lon * 1e7), _i32(alt * 1e3), now_us)

    def _extended_sys_state(self, cls: Any, now_us: int) -> Any:  # noqa: ARG002
        v = self._v
        if v.landed:
            state = LandedState.ON_GROUND
        elif v.mode is Mode.TAKEOFF:
            state = LandedState.TAKEOFF
        elif v.mode is Mode.LAND:
            state = LandedState.LANDING
        else:
            state = LandedState.IN_AIR
        return cls(0, state)


_Version = message_class("AUTOPILOT_VERSION")

_RELEASE = 255  # FIRMWARE_VERSION_TYPE_OFFICIAL
_SOFTWARE = 1 << 24 | 15 << 16 | 0 << 8 | _RELEASE  # behaves as PX4 1.15.0
_VENDOR, _PRODUCT = 0x26AC, 0x0011  # 3D Robotics, Pixhawk: what QGroundControl shows as PX4 FMU


# Without FTP, so that clients do not request files.
_CAPABILITIES = sum(
    getattr(Capability, name)
    for name in (
        "PARAM_FLOAT",
        "MISSION_INT",
        "COMMAND_INT",
        "PARAM_ENCODE_BYTEWISE",
        "SET_ATTITUDE_TARGET",
        "SET_POSITION_TARGET_LOCAL_NED",
        "SET_POSITION_TARGET_GLOBAL_INT",
        "FLIGHT_TERMINATION",
        "MAVLINK2",
    )
)


def autopilot_version(sysid: int) -> Any:
    """Return AUTOPILOT_VERSION. The unique id is the system id: the mock has no serial number."""
    return _Version(
        capabilities=_CAPABILITIES,
        uid=sysid,
        flight_sw_version=_SOFTWARE,
        middleware_sw_version=_SOFTWARE,
        os_sw_version=0,
        board_version=0,
        flight_custom_version=(0,) * 8,
        middleware_custom_version=(0,) * 8,
        os_custom_version=(0,) * 8,
        vendor_id=_VENDOR,
        product_id=_PRODUCT,
    )
