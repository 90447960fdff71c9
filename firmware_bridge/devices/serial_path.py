"""Serial ports of a bench: a path, or a USB device found by its serial number, or the only board on USB."""

from __future__ import annotations

from firmware_bridge.devices.inventory import find_devices, port_hint
from signals.errors import PortNotFound

USB = "usb:"  # before the serial number of a USB device, in the place of a serial port


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
