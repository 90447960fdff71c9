"""Starts a user's own ArduCopter SITL with the bench's External AHRS instead of its simulated sensors.

SITL still simulates a vehicle of its own (`--model quad`), but its IMU, barometer, compass, GPS and motors are switched
off, and its pose is not used. Only its battery is used.

Its two serial ports are pseudo-terminals of the bench. SITL serves its ports once in each round of its main loop (and
every 10 ms), where a board's UART interrupts at each byte: packets reach the autopilot in pairs, up to a round late,
and its outputs leave as late. At 200 Hz that is a round trip of 2.6 ms in the median and 4.8 ms at the 99th percentile
(TIMESYNC). A port holds 512 bytes: if the main loop stalls for 13 ms at 400 packets a second, some are lost.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from firmware_bridge.links.ardupilot.sitl import (
    DEFAULTS_PATH,
    OWN_RC,
    arducopter_command,
    loop_parameters,
    program_at,
    write_defaults,
)
from firmware_bridge.links.child_process import ChildProcess, FirmwareBuild
from firmware_bridge.transports.pty import PtyTransport

BAUD = 921_600
SENSOR_SERIAL = 4  # SERIAL4 of SITL has the bench's VectorNav, SERIAL0 MAVLink
_EKF_EXTERNAL = 11  # AHRS_EKF_TYPE: attitude, velocity and position are the device's; 3 is EKF3 on its measurements

_DEVICE_TYPE_IMU = 0x320000  # of an accelerometer behind an External AHRS
_BUS_SERIAL = 6
_NO_SIMULATED_COMPASS = 1 << 13
_ALL_MOTORS = 0xFF


class HeldPty(PtyTransport):
    """A pseudo-terminal whose far end the bench keeps open: firmware that closes it to reboot does not end the link.

    The end of the firmware is detected by its process.
    """

    def read(self, timeout_s: float) -> bytes:
        return self._opened().read(timeout_s)


def board_parameters(*, serial: int, rate_hz: int) -> dict[str, float]:
    """Return the parameters of a board whose only source of measurements is the External AHRS at SERIAL`serial`.

    The device ids make accelerometer and compass count as calibrated (with offsets that are not zero).
    """
    where = serial * 8 + _BUS_SERIAL
    return {
        "EAHRS_TYPE": 1,
        "EAHRS_RATE": rate_hz,
        "EAHRS_SENSORS": 15,
        "EAHRS_OPTIONS": 0,
        f"SERIAL{serial}_PROTOCOL": 36,
        f"SERIAL{serial}_BAUD": BAUD,
        "AHRS_EKF_TYPE": _EKF_EXTERNAL,
        "GPS1_TYPE": 21,
        "GPS2_TYPE": 0,
        "COMPASS_USE2": 0,
        "COMPASS_USE3": 0,
        "COMPASS_DEV_ID": where,
        "COMPASS_PRIO1_ID": where,
        "COMPASS_PRIO2_ID": 0,
        "COMPASS_PRIO3_ID": 0,
        "COMPASS_OFS_X": 1,
        "COMPASS_OFS_Y": 1,
        "COMPASS_OFS_Z": 1,
        "INS_GYR_CAL": 0,
        "INS_ACC_ID": _DEVICE_TYPE_IMU + 0x200 + where,
        "INS_ACCSCAL_X": 1.0,
        "INS_ACCSCAL_Y": 1.0,
        "INS_ACCSCAL_Z": 1.0,
        # Arming compares variances that an External AHRS does not set (4.7-dev): uninitialised memory.
        "FS_EKF_THRESH": 0,
        **{f"INS_ACC2OFFS_{axis}": 0 for axis in "XYZ"},
        **{f"INS_ACC2SCAL_{axis}": 1 for axis in "XYZ"},
    }


def sitl_parameters(
    vehicle: Mapping[str, float], *, tick_hz: float, more: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Return the parameters of a SITL whose only sensor is the bench's device: `vehicle`'s, and `more`, which override.

    EAHRS_RATE is the tick's rate and SCHED_LOOP_RATE half of it at most: the loop waits for packets.
    """
    loop = loop_parameters(tick_hz)
    del loop["SIM_RATE_HZ"]  # of its own simulation, which is not used
    simulated = {
        "SIM_IMU_COUNT": 0,
        "SIM_BARO_COUNT": 0,
        "SIM_GPS1_ENABLE": 0,
        "SIM_GPS2_ENABLE": 0,
        "SERIAL3_PROTOCOL": -1,
        "COMPASS_DISBLMSK": _NO_SIMULATED_COMPASS,
        "SIM_ENGINE_FAIL": _ALL_MOTORS,
        "SIM_ENGINE_MUL": 0,
    }
    board = board_parameters(serial=SENSOR_SERIAL, rate_hz=round(tick_hz))
    return dict(vehicle) | loop | board | simulated | dict(more or {})


def arducopter_on_ptys(
    build: FirmwareBuild,
    sensor: PtyTransport,
    mavlink: PtyTransport,
    *,
    home: tuple[float, float, float, float],
    parameters: Mapping[str, float],
    base: Path = DEFAULTS_PATH,
    instance: int = 0,
) -> Callable[[], ChildProcess]:
    """Return a function that starts the build; call it once the two pseudo-terminals are open.

    PortNotFound if the binary does not exist.
    """
    program, where = program_at(build.binary), build.folder.resolve()

    def start() -> ChildProcess:
        ports = {0: mavlink.far_path, SENSOR_SERIAL: sensor.far_path}
        command = arducopter_command(
            program,
            model="quad",
            instance=instance,
            speedup=1,
            home=home,
            defaults=write_defaults(where / "bench.parm", parameters, base),
            serials=dict.fromkeys(range(9), "none") | {n: f"uart:{path}:{BAUD}" for n, path in ports.items()},
            arguments=[*OWN_RC, *build.arguments],
        )
        return ChildProcess(command, stderr_path=build.log.resolve(), cwd=where, env=build.env, log_output=True)

    return start
