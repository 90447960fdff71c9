"""The inventory of plugged-in devices at one moment.

A board is found on USB or, where libusb is missing or lists nothing, by its serial ports; both lists are joined. A bus
that cannot be listed becomes a note for the user, not an error: a bench without libusb still flies.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, TypeVar

from firmware_bridge.devices.buses import (
    BackendMissing,
    HidBus,
    HidInterface,
    SerialPort,
    SerialPorts,
    UsbBus,
    UsbDevice,
)
from firmware_bridge.devices.gamepads import HidApi, identify_gamepad
from firmware_bridge.devices.serial_ports import (
    ADAPTERS,
    PySerialPorts,
    join_ports,
    natural,
    port_order,
    usb_location,
)
from firmware_bridge.devices.usb_boards import BoardId, PyUsbBus, identify_board, names_bootloader

NO_PORT_ACCESS = (
    "no permission to open {device}: `sudo usermod -aG dialout $USER` (on Arch and Fedora the group may be `uucp` or "
    "`plugdev`), then log out and in"
)
NO_HID_ACCESS = (
    'no permission to read it: put `KERNEL=="hidraw*", ATTRS{{idVendor}}=="{vendor:04x}", MODE="0660", '
    'TAG+="uaccess"` into /etc/udev/rules.d/70-gamepad.rules, then `sudo udevadm control --reload` and plug it in again'
)
BOOTLOADER_NOTE = "bootloader: unplug and replug; if it stays, the board has no firmware"
GENERIC_NOTE = "not only autopilots have these ids"
NO_PORT_NOTE = "no serial port: USB charge-only cable, missing driver, or still starting"

_T = TypeVar("_T")


@dataclass(frozen=True)
class Autopilot:
    """An autopilot board. `ports` in the order of interfaces; the first is the most likely one."""

    board: str
    vendor_id: int
    product_id: int
    manufacturer: str | None
    product: str | None
    serial_number: str | None
    location: str | None
    firmwares: tuple[str, ...]
    bootloader: bool
    generic: bool
    ports: tuple[SerialPort, ...]
    notes: tuple[str, ...]

    @property
    def port(self) -> str | None:
        """The serial device to try first; None if there is none, or in a bootloader."""
        return self.ports[0].device if self.ports and not self.bootloader else None


@dataclass(frozen=True)
class Gamepad:
    """A device with sticks. `kind`: gamepad, joystick or RC transmitter."""

    name: str
    kind: str
    vendor_id: int
    product_id: int
    serial_number: str | None
    path: bytes
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Devices:
    """The inventory. `ports` belong to no autopilot; `failed` names the buses that could not be listed."""

    autopilots: tuple[Autopilot, ...] = ()
    ports: tuple[SerialPort, ...] = ()
    gamepads: tuple[Gamepad, ...] = ()
    notes: tuple[str, ...] = ()
    failed: frozenset[str] = frozenset()  # of usb, serial, hid; without those whose library is missing

    def as_json(self) -> dict[str, Any]:
        """Return plain data. Ids are text such as '26ac:0032'."""
        return {
            "schema": 1,
            "autopilots": [
                {**_plain(a), "port": a.port, "ports": [_plain(port) for port in a.ports]} for a in self.autopilots
            ],
            "ports": [{**_plain(port), "hint": port_hint(port)} for port in self.ports],
            "gamepads": [{**_plain(pad), "path": pad.path.decode("utf-8", "replace")} for pad in self.gamepads],
            "notes": list(self.notes),
        }


def usb_ids(item: Autopilot | SerialPort | Gamepad) -> str | None:
    """Return ids such as '26ac:0032', or None for a device that is not on USB."""
    if item.vendor_id is None or item.product_id is None:
        return None
    return f"{item.vendor_id:04x}:{item.product_id:04x}"


def port_hint(port: SerialPort) -> str | None:
    """Return the probable kind of a serial port that is not a board, or None."""
    if port.vendor_id is None or port.product_id is None:
        return None
    return ADAPTERS.get((port.vendor_id, port.product_id)) or port.product


def find_devices(usb: UsbBus | None = None, ports: SerialPorts | None = None, hid: HidBus | None = None) -> Devices:
    """List all devices once. None means the real bus. Missing libraries and permissions become notes."""
    notes: list[str] = []
    failed: set[str] = set()
    on_usb = _list("usb", (usb or PyUsbBus()).devices, notes, failed)
    serial = _list("serial", (ports or PySerialPorts()).ports, notes, failed)
    interfaces = _list("hid", (hid or HidApi()).interfaces, notes, failed)
    autopilots, rest = _autopilots(on_usb, serial)
    return Devices(
        autopilots=tuple(autopilots),
        ports=tuple(sorted(rest, key=lambda port: natural(port.device))),
        gamepads=tuple(_gamepads(interfaces)),
        notes=tuple(notes),
        failed=frozenset(failed),
    )


_NAMES = {"usb": "USB boards", "serial": "serial ports", "hid": "gamepads"}


def _list(kind: str, lister: Callable[[], Sequence[_T]], notes: list[str], failed: set[str]) -> Sequence[_T]:
    try:
        return lister()
    except BackendMissing as error:
        notes.append(f"{_NAMES[kind]} were not listed: {error}")
    except (OSError, ValueError, RuntimeError) as error:
        failed.add(kind)
        notes.append(f"{_NAMES[kind]} could not be listed this time: {type(error).__name__}: {error}")
    return ()


def _autopilots(on_usb: Sequence[UsbDevice], serial: Sequence[SerialPort]) -> tuple[list[Autopilot], list[SerialPort]]:
    """Return the boards, and the ports that belong to none."""
    found: list[Autopilot] = []
    unassigned = list(serial)
    boards = [(device, row) for device in on_usb if (row := identify_board(device.vendor_id, device.product_id))]
    joined = join_ports([device for device, _ in boards], serial)
    for (device, row), board_ports in zip(boards, joined, strict=True):
        unassigned = [port for port in unassigned if port not in board_ports]
        found.append(_autopilot(row, device, board_ports))
    groups: dict[tuple[object, ...], list[SerialPort]] = {}
    for port in unassigned:
        if port.vendor_id is not None and port.product_id is not None:
            key = (port.vendor_id, port.product_id, port.serial_number, usb_location(port))
            groups.setdefault(key, []).append(port)
    for group in groups.values():
        first = group[0]
        assert first.vendor_id is not None
        assert first.product_id is not None
        by_ids = identify_board(first.vendor_id, first.product_id)
        if by_ids is None:
            continue
        unassigned = [port for port in unassigned if port not in group]
        # A USB board without ports and with the same ids is this board, listed by libusb.
        twin = next((a for a in found if not a.ports and usb_ids(a) == usb_ids(first)), None)
        if twin is not None:
            found.remove(twin)
        device = UsbDevice(first.vendor_id, first.product_id, location=usb_location(first))
        found.append(_autopilot(by_ids, device, sorted(group, key=port_order)))
    return found, unassigned


def _autopilot(row: BoardId, device: UsbDevice, ports: list[SerialPort]) -> Autopilot:
    # Without permission to open the USB device its texts are missing; the serial driver has read them.
    texts = replace(
        device,
        manufacturer=device.manufacturer or next((p.manufacturer for p in ports if p.manufacturer), None),
        product=device.product or next((p.product for p in ports if p.product), None),
        serial_number=device.serial_number or next((p.serial_number for p in ports if p.serial_number), None),
    )
    bootloader = row.bootloader or names_bootloader(texts.product)
    notes: list[str] = []
    if bootloader:
        notes.append(BOOTLOADER_NOTE)
    elif not ports:
        notes.append(NO_PORT_NOTE)
    if row.generic and not bootloader:
        notes.append(GENERIC_NOTE)
    no_access = ", ".join(port.device for port in ports if not port.accessible)
    if no_access:
        notes.append(NO_PORT_ACCESS.format(device=no_access))
    return Autopilot(
        board=row.name,
        vendor_id=row.vendor_id,
        product_id=device.product_id,
        manufacturer=texts.manufacturer,
        product=texts.product,
        serial_number=texts.serial_number,
        location=device.location,
        firmwares=row.firmwares,
        bootloader=bootloader,
        generic=row.generic,
        ports=tuple(ports),
        notes=tuple(notes),
    )


def _gamepads(interfaces: Sequence[HidInterface]) -> list[Gamepad]:
    """Return one gamepad per path: hidapi lists a device once for each of its usages."""
    found: dict[bytes, Gamepad] = {}
    for interface in interfaces:
        named = identify_gamepad(interface)
        if named is None or interface.path in found:
            continue
        name, kind = named
        notes: tuple[str, ...] = ()
        if not interface.accessible:
            notes = (NO_HID_ACCESS.format(vendor=interface.vendor_id),) if sys.platform == "linux" else ("no access",)
        found[interface.path] = Gamepad(
            name, kind, interface.vendor_id, interface.product_id, interface.serial_number, interface.path, notes
        )
    return list(found.values())


def _plain(item: Autopilot | SerialPort | Gamepad) -> dict[str, Any]:
    data = asdict(item)
    del data["vendor_id"], data["product_id"]
    return {"usb_ids": usb_ids(item), **{k: list(v) if isinstance(v, tuple) else v for k, v in data.items()}}
