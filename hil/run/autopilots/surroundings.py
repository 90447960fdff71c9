"""Facts about the run that every autopilot link needs, and the start of the vehicle in geodetic coordinates."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_bridge.devices.inventory import find_devices, port_hint
from firmware_bridge.ground_station.projections import GeodeticFromW, Place, ardupilot_sitl_world
from firmware_bridge.links.autopilot_link import AutopilotLink, LinkTimeouts
from firmware_bridge.links.child_process import FirmwareBuild
from firmware_bridge.transports.serial import check_port
from firmware_bridge.transports.transport import Transport
from hil.config import Bench
from signals.errors import PortNotFound
from signals.geodesy import LocalFrame
from signals.rotation import yaw_of
from sim.scene.scene import Site

LOG_NAME = "autopilot.log"
USB = "usb:"  # before the serial number of a USB device, in the place of a serial port
WORK_FOLDER = "autopilot"  # working folder of firmware that the bench starts: parameters, missions, its logs
State = NDArray[np.float64]  # of the vehicle: p_W [m], q_WB (w, x, y, z), then velocities


@dataclass(frozen=True)
class Surroundings:
    """Facts about the run that an autopilot link is part of."""

    out: Path  # folder of the run; processes that the link starts write their logs here
    wrap: Callable[[Transport], Transport]  # wraps the transport, for declared faults
    on_event: Callable[[str, str], None]  # (kind, text), at the present simulated time
    say: Callable[[str, str], None]  # the same, also printed on the console
    # Start of the vehicle: latitude, longitude [deg], altitude above mean sea level [m], heading [deg from north].
    home: tuple[float, float, float, float]


def make_link(bench: Bench, around: Surroundings) -> AutopilotLink:
    """Make the link of this bench's autopilot, not yet open, by the module in this folder named after its kind.

    Raises LinkError if something that the link needs does not exist.
    """
    link: AutopilotLink = import_module(f"hil.run.autopilots.{bench.config.autopilot.kind}").make_link(bench, around)
    return link


def check_ports(bench: Bench) -> None:
    """Check the serial ports of this bench's autopilot without opening one. Raises LinkError."""
    autopilot = bench.config.autopilot
    for port in (autopilot.port, autopilot.mavlink_port):
        if port is not None and not port.startswith(("udp:", "tcp:")) and port != "none":
            check_port(serial_path(port))
    if autopilot.kind == "px4_hitl" and autopilot.port is None:
        only_board()


def firmware_build(bench: Bench, around: Surroundings, log: str = LOG_NAME) -> FirmwareBuild:
    """Return the user's build, `autopilot.binary`, set to run in this run's folder and to write this log."""
    autopilot, out = bench.config.autopilot, around.out
    return FirmwareBuild(
        Path(str(autopilot.binary)), out / WORK_FOLDER, out / log, arguments=autopilot.arguments, env=autopilot.env
    )


def timeouts(bench: Bench) -> LinkTimeouts:
    """Return the timeouts of the bench file."""
    autopilot = bench.config.autopilot
    return LinkTimeouts(autopilot.reply_timeout_s, autopilot.connect_timeout_s, autopilot.reconnect_s)


def free_running_settings(bench: Bench, around: Surroundings) -> dict[str, Any]:
    """Return the settings of links to autopilots that run on wall-clock time and do not wait for the bench."""
    return {
        "period_ns": bench.config.tick_ns,
        "on_event": around.on_event,
        "say": around.say,
        "timeouts": timeouts(bench),
    }


def home_of(site: Site, state: State) -> tuple[float, float, float, float]:
    """Return latitude and longitude [deg], altitude [m MSL], heading [deg from north] of a vehicle in this state."""
    x, y, z, *q_WB = state[:7].tolist()
    yaw_deg = math.degrees(yaw_of(q_WB))
    return *LocalFrame(site).geodetic_from_enu((x, y, z)), (90.0 - yaw_deg) % 360.0


def geodetic_from_W(autopilot_kind: str, site: Site, state: State) -> GeodeticFromW:
    """Return the map from W to the geodetic coordinates that the autopilot uses, for a flight from this state."""
    if autopilot_kind != "ardupilot_sitl":
        return LocalFrame(site).geodetic_from_enu
    x, y, z = state[:3].tolist()
    return ardupilot_sitl_world(Place(*home_of(site, state)[:3]), (x, y, z))


def serial_path(port: str | None) -> str:
    """Return the path of a serial port of the bench: of the device `usb:SERIAL`, or of the only board if it is None.

    Raises PortNotFound.
    """
    if port is None:
        return only_board()
    return usb_device(port.removeprefix(USB)) if port.startswith(USB) else port


def usb_device(serial_number: str) -> str:
    """Return the serial port of the USB device with this serial number. Raises PortNotFound.

    Boards come before other serial ports, such as an adapter's; of a board's ports it is the first.
    """
    devices = find_devices()
    boards = {(a.serial_number, a.port): a.board for a in devices.autopilots if a.port is not None}
    adapters = {(p.serial_number, p.device): port_hint(p) for p in devices.ports if p.vendor_id is not None}
    for found in (boards, adapters):
        paths = [str(path) for number, path in found if number == serial_number]
        if len(paths) == 1:
            return paths[0]
        if paths:
            why = f"{len(paths)} USB devices have this serial number ({', '.join(paths)})"
            raise PortNotFound(f"{USB}{serial_number}", f"{why}: set autopilot.port to a path")
    named = [f"{USB}{number} ({kind}, {path})" for (number, path), kind in (boards | adapters).items() if number]
    there = ", ".join(named) or "none with a serial number"
    why = f"no USB device has this serial number. Here: {there}; see `hil devices`"
    raise PortNotFound(f"{USB}{serial_number}", why)


def only_board() -> str:
    """Return the serial port of the only autopilot on USB. Raises PortNotFound if there is none or more than one."""
    boards = find_devices().autopilots
    ports = [board.port for board in boards if board.port]
    if len(ports) == 1:
        return str(ports[0])
    found = f"{len(ports)} are there ({', '.join(map(str, ports))})" if ports else "none is there"
    raise PortNotFound(
        "autopilot.port", f"names no serial port, and of autopilots on USB {found}; see `hil devices`, then "
        "--set autopilot.port=/dev/ttyACM0"
    )  # fmt: skip
