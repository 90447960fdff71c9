"""The mock Pixhawk as a process on a serial port.

    python -m firmware_bridge.mock_pixhawk --port /dev/pts/7 [--hitl] [--airframe x500] [--param NAME=VALUE ...]

Exit status: 0 when the port hangs up, the parent process ends or on SIGTERM; 2 for wrong arguments; 3 when the port
cannot be opened; 70 for the injected fault `die`.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Callable, Sequence

import serial

from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from firmware_bridge.mock_pixhawk.faults import EXIT_STATUS_DIED, Died, parse_fault
from firmware_bridge.mock_pixhawk.hitl import DEFAULT_BAUD, Board, BoardClock
from firmware_bridge.mock_pixhawk.line import serve
from firmware_bridge.mock_pixhawk.parameters.params import airframes
from signals.errors import ConfigError

_MAX_DRIFT_PPM = 10_000.0


def _whole_number(least: int, most: int) -> Callable[[str], int]:
    """Return an argument type for whole numbers from `least` to `most`."""

    def parse(text: str) -> int:
        if not text.isdecimal() or not least <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from {least} to {most}")
        return int(text)

    return parse


def _ppm(text: str) -> float:
    """Parse the drift of a clock."""
    try:
        value = float(text)
    except ValueError:
        value = _MAX_DRIFT_PPM + 1.0
    if not abs(value) <= _MAX_DRIFT_PPM:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from -{_MAX_DRIFT_PPM:g} to {_MAX_DRIFT_PPM:g}")
    return value


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m firmware_bridge.mock_pixhawk", description="Mock Pixhawk.")
    parser.add_argument("--port", required=True, help="serial device, such as /dev/pts/7")
    parser.add_argument(
        "--baud",
        type=_whole_number(1200, 12_000_000),
        default=DEFAULT_BAUD,
        help=f"baud rate of a real serial line (default {DEFAULT_BAUD}); as on PX4, --hitl ignores HIL on a slow line",
    )
    parser.add_argument("--airframe", default="x500", help=f"one of {', '.join(airframes())} (default x500)")
    parser.add_argument(
        "--boot-sensors", type=_whole_number(0, 100_000), default=20, help="HIL_SENSORs before the first reply"
    )
    parser.add_argument("--sysid", type=_whole_number(1, 250), help="MAVLink system id (default: MAV_SYS_ID, 1)")
    parser.add_argument(
        "--param", action="append", default=[], metavar="NAME=VALUE", help="set a parameter; repeatable"
    )
    parser.add_argument(
        "--fault", action="append", default=[], metavar="KIND@S", help="inject a fault from that second on"
    )
    parser.add_argument(
        "--answer-offboard",
        action="store_true",
        help="go on answering when OFFBOARD is selected while disarmed without set-points; PX4 falls silent",
    )
    parser.add_argument(
        "--hitl",
        action="store_true",
        help="run by its own clock, as a real board with SYS_HITL=1 (default: in lockstep, as PX4 SITL)",
    )
    parser.add_argument(
        "--clock-offset-us", type=_whole_number(0, 1 << 50), default=0, help="HITL: reading of the clock at power-on"
    )
    parser.add_argument("--clock-drift-ppm", type=_ppm, default=0.0, help="HITL: how much too fast the clock runs")
    return parser.parse_args(argv)


def _end(signum: int, frame: object) -> None:  # noqa: ARG001
    sys.exit(0)


def main(argv: Sequence[str] | None = None) -> int:
    """Run until the line hangs up. Return the exit status."""
    signal.signal(signal.SIGTERM, _end)
    arguments = _arguments(argv)
    clock = BoardClock(offset_us=arguments.clock_offset_us, drift_ppm=arguments.clock_drift_ppm)
    try:
        autopilot = MockPixhawk(
            airframe=arguments.airframe,
            boot_sensors=arguments.boot_sensors,
            sysid=arguments.sysid,
            params=arguments.param,
            faults=[parse_fault(text) for text in arguments.fault],
            offboard_silence=not arguments.answer_offboard,
            board=Board(clock, arguments.baud) if arguments.hitl else None,
        )
    except ConfigError as error:
        print(f"mock_pixhawk: {error}", file=sys.stderr)  # noqa: T201
        return 2
    try:
        line = serial.Serial(arguments.port, arguments.baud, exclusive=None)
    except (serial.SerialException, ValueError) as error:
        print(f"mock_pixhawk: cannot open {arguments.port}: {error}", file=sys.stderr)  # noqa: T201
        return 3
    try:
        serve(autopilot, line.fileno())
    except Died as death:
        print(f"mock_pixhawk: {death}", file=sys.stderr, flush=True)  # noqa: T201
        os._exit(EXIT_STATUS_DIED)  # no clean-up: a crash has none
    return 0


if __name__ == "__main__":
    sys.exit(main())
