"""Serial ports, and their assignment to USB boards."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence

from firmware_bridge.devices.buses import BackendMissing, SerialPort, UsbDevice

# Adapters that an autopilot may be connected to.
ADAPTERS = {
    (0x0403, 0x6001): "FTDI adapter or SiK telemetry radio",
    (0x0403, 0x6015): "FTDI adapter or SiK telemetry radio",
    (0x10C4, 0xEA60): "CP210x adapter or SiK telemetry radio",
    (0x1A86, 0x7523): "CH340 adapter",
    (0x067B, 0x2303): "Prolific adapter",
    (0x1546, 0x01A8): "u-blox GPS",
    (0x1546, 0x01A9): "u-blox GPS",
}


class PySerialPorts:
    """Serial ports, listed by pyserial."""

    def ports(self) -> Sequence[SerialPort]:
        try:
            from serial.tools import list_ports
        except ImportError as error:
            raise BackendMissing("pyserial is not installed: `pip install pyserial`") from error
        return [
            SerialPort(
                device=port.device,
                vendor_id=port.vid,
                product_id=port.pid,
                manufacturer=port.manufacturer or None,
                product=port.product or None,
                serial_number=port.serial_number or None,
                location=port.location or None,
                accessible=may_open(port.device),
            )
            for port in list_ports.comports()
        ]


def may_open(path: str | bytes) -> bool:
    """Return True if this user may read and write the device file, or if devices are not files (Windows)."""
    return not os.path.exists(path) or os.access(path, os.R_OK | os.W_OK)


def usb_location(port: SerialPort) -> str | None:
    """Return the USB location of the port's device, without the interface."""
    return None if port.location is None else port.location.split(":")[0]


def port_order(port: SerialPort) -> tuple[object, ...]:
    """Return a sort key: interface first, then name with numbers as numbers."""
    interface = port.location.partition(":")[2] if port.location else ""
    return (natural(interface), natural(port.device))


def natural(text: str) -> tuple[tuple[int, str], ...]:
    """Return a sort key that puts 'ttyACM10' after 'ttyACM2'."""
    return tuple((int(digits), "") if digits else (-1, other) for digits, other in re.findall(r"(\d+)|(\D+)", text))


def join_ports(devices: Sequence[UsbDevice], ports: Iterable[SerialPort]) -> list[list[SerialPort]]:
    """Return the ports of each of `devices`, in the order of interfaces.

    The USB location decides where both lists have it in the same form (Linux). The other ports are assigned by serial
    number, and then by ids, each only if a single device is possible: a wrong guess would fly the wrong vehicle.
    """
    joined: list[list[SerialPort]] = [[] for _ in devices]
    unassigned = list(ports)

    def take(i: int, fits: Callable[[SerialPort], bool]) -> None:
        ids = (devices[i].vendor_id, devices[i].product_id)
        matching = [port for port in unassigned if (port.vendor_id, port.product_id) == ids and fits(port)]
        joined[i] += matching
        unassigned[:] = [port for port in unassigned if port not in matching]

    for i, device in enumerate(devices):
        if device.location is not None:
            take(i, lambda port, place=device.location: usb_location(port) == place)  # type: ignore[misc]
    portless = [i for i in range(len(devices)) if not joined[i]]
    same_serial = Counter((devices[i].vendor_id, devices[i].product_id, devices[i].serial_number) for i in portless)
    for i in portless:
        d = devices[i]
        if d.serial_number is not None and same_serial[d.vendor_id, d.product_id, d.serial_number] == 1:
            take(i, lambda port, number=d.serial_number: port.serial_number == number)  # type: ignore[misc]
    same_ids = Counter((device.vendor_id, device.product_id) for device in devices)
    for i in portless:
        d = devices[i]
        if not joined[i] and same_ids[d.vendor_id, d.product_id] == 1:
            take(i, lambda port, d=d: _is_possible(d, port))  # type: ignore[misc]
    return [sorted(device_ports, key=port_order) for device_ports in joined]


def _is_possible(device: UsbDevice, port: SerialPort) -> bool:
    """Return True if the serial numbers are equal, or if one is unknown and one location is, too."""
    both_serials = device.serial_number is not None and port.serial_number is not None
    both_locations = device.location is not None and port.location is not None
    return device.serial_number == port.serial_number if both_serials else not both_locations
