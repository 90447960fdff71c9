"""The mock Pixhawk as a process on a serial port.

    python -m firmware_bridge.mock_pixhawk --port /dev/pts/7 [--airframe x500] [--param NAME=VALUE ...]

Exit status: 0 when the port hangs up, the parent process ends or on SIGTERM; 2 for wrong arguments; 3 when the port
cannot be opened; 70 for the injected fault `die`.
"""

from __future__ import annotations

import argparse
import os
import select
import signal
import sys
from collections.abc import Callable, Sequence

import serial

from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from firmware_bridge.mock_pixhawk.faults import EXIT_STATUS_DIED, Died, parse_fault
from firmware_bridge.mock_pixhawk.params import airframes
from hil.signals.errors import ConfigError

_READ_SIZE = 65536
_PARENT_CHECK_MS = 1000  # how often a silent line is taken as a reason to look for the parent process
_HANG_UP = select.POLLHUP | select.POLLERR | select.POLLNVAL


def _whole_number(least: int, most: int) -> Callable[[str], int]:
    """Type of an argument from `least` to `most`."""

    def parse(text: str) -> int:
        if not text.isdecimal() or not least <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from {least} to {most}")
        return int(text)

    return parse


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m firmware_bridge.mock_pixhawk", description="Mock Pixhawk.")
    parser.add_argument("--port", required=True, help="serial device to talk on, such as /dev/pts/7")
    parser.add_argument(
        "--baud", type=_whole_number(1200, 12_000_000), default=921600, help="of a real serial line (default 921600)"
    )
    parser.add_argument("--airframe", default="x500", help=f"one of {', '.join(airframes())} (default x500)")
    parser.add_argument(
        "--boot-sensors", type=_whole_number(0, 100_000), default=20, help="HIL_SENSORs before the first answer"
    )
    parser.add_argument("--sysid", type=_whole_number(1, 250), default=1, help="MAVLink system id (default 1)")
    parser.add_argument(
        "--param", action="append", default=[], metavar="NAME=VALUE", help="set a parameter; repeatable"
    )
    parser.add_argument("--fault", action="append", default=[], metavar="KIND@S", help="misbehave from that second on")
    parser.add_argument(
        "--answer-offboard",
        action="store_true",
        help="do not fall silent, as PX4 does, when OFFBOARD is selected while disarmed without set-points",
    )
    return parser.parse_args(argv)


def _serve(autopilot: MockPixhawk, fd: int) -> None:
    """Answer what arrives on `fd` until the other side hangs up or the parent is gone."""
    parent = os.getppid()
    poll = select.poll()
    poll.register(fd, select.POLLIN)
    wait, read, feed = poll.poll, os.read, autopilot.feed
    try:
        _write(fd, autopilot.boot())
        while True:
            events = wait(_PARENT_CHECK_MS)
            if not events:
                if os.getppid() != parent:
                    return
                continue
            if events[0][1] & _HANG_UP:
                return
            data = read(fd, _READ_SIZE)
            if not data:
                return
            out = feed(data)
            if out:
                _write(fd, out)
    except OSError:
        # EIO: the other end of the line was closed. There is nobody left to tell.
        return


def _write(fd: int, data: bytes) -> None:
    written = os.write(fd, data)
    while written < len(data):
        written += os.write(fd, data[written:])


def _end(signum: int, frame: object) -> None:  # noqa: ARG001
    sys.exit(0)


def main(argv: Sequence[str] | None = None) -> int:
    """Run until the line hangs up. Returns the exit status."""
    signal.signal(signal.SIGTERM, _end)
    arguments = _arguments(argv)
    try:
        autopilot = MockPixhawk(
            airframe=arguments.airframe,
            boot_sensors=arguments.boot_sensors,
            sysid=arguments.sysid,
            params=arguments.param,
            faults=[parse_fault(text) for text in arguments.fault],
            offboard_silence=not arguments.answer_offboard,
        )
    except ConfigError as error:
        print(f"mock_pixhawk: {error}", file=sys.stderr)  # noqa: T201
        return 2
    try:
        line = serial.Serial(arguments.port, arguments.baud, exclusive=None)
    except (serial.SerialException, ValueError) as error:
        print(f"mock_pixhawk: cannot open {arguments.port}: {error}", file=sys.stderr)  # noqa: T201
        return 3
    os.set_blocking(line.fileno(), True)
    try:
        _serve(autopilot, line.fileno())
    except Died as death:
        print(f"mock_pixhawk: {death}", file=sys.stderr, flush=True)  # noqa: T201
        os._exit(EXIT_STATUS_DIED)  # no clean-up: a crash has none
    return 0


if __name__ == "__main__":
    sys.exit(main())
