"""Detects plugging and unplugging by comparing inventories.

It polls, because no hot-plug interface works on all systems and without privileges; an inventory takes milliseconds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from firmware_bridge.devices.buses import SerialPort
from firmware_bridge.devices.inventory import Autopilot, Devices, Gamepad, find_devices

Item: TypeAlias = Autopilot | SerialPort | Gamepad
_Key: TypeAlias = tuple[object, ...]

# The buses that must have been listed before a missing device counts as unplugged.
_LISTED_BY = {
    "autopilot": frozenset({"usb", "serial"}),
    "serial port": frozenset({"serial"}),
    "gamepad": frozenset({"hid"}),
}


@dataclass(frozen=True)
class Change:
    """Plugging or unplugging of a device. If it was `unplugged`, `item` is its last known state."""

    kind: str  # autopilot, serial port or gamepad
    item: Item
    unplugged: bool

    def __str__(self) -> str:
        return f"{'unplugged' if self.unplugged else 'plugged in'}: {describe(self.item)}"


class DeviceWatch:
    """Reports the changes between two calls of `poll`. Devices present at the first call are not changes."""

    def __init__(self, find: Callable[[], Devices] = find_devices) -> None:
        self._find = find
        self._known: dict[_Key, tuple[str, Item]] | None = None
        self._settling: set[_Key] = set()
        self.devices = Devices()  # of the last poll

    def poll(self) -> list[Change]:
        """List all devices and compare. Return the changes."""
        self.devices = devices = self._find()
        current = _items(devices)
        if self._known is None:
            self._known = current
            return []
        known = self._known
        for key, (kind, item) in known.items():
            # If its bus could not be listed, the device may still be present.
            if key not in current and devices.failed & _LISTED_BY[kind]:
                current[key] = (kind, item)
        events: list[Change] = [Change(*known[key], unplugged=True) for key in known if key not in current]
        waiting: set[_Key] = set()
        for key in [key for key in current if key not in known]:
            kind, item = current[key]
            # A board is on USB a moment before its serial port exists: wait for the next poll.
            if isinstance(item, Autopilot) and not item.ports and not item.bootloader and key not in self._settling:
                waiting.add(key)
                del current[key]
                continue
            events.append(Change(kind, item, unplugged=False))
        self._settling = waiting
        self._known = current
        return events


def describe(item: Item) -> str:
    """Describe a device in one line."""
    if isinstance(item, Autopilot):
        parts = [item.product or item.board]
        parts += [f"at {item.port}"] if item.port else []
        parts += [f"({note})" for note in item.notes]
        return " ".join(parts)
    if isinstance(item, Gamepad):
        return f"{item.kind} {item.name}"
    return item.device + (f" ({item.product})" if item.product else "")


def _items(devices: Devices) -> dict[_Key, tuple[str, Item]]:
    found: dict[_Key, tuple[str, Item]] = {}
    for a in devices.autopilots:
        # A board that changes to its bootloader counts as another device.
        key = ("autopilot", a.vendor_id, a.product_id, a.location or a.serial_number, a.bootloader)
        found[key] = ("autopilot", a)
    for port in devices.ports:
        found[("serial port", port.device, port.vendor_id, port.product_id, port.serial_number)] = ("serial port", port)
    for pad in devices.gamepads:
        found[("gamepad", pad.path, pad.vendor_id, pad.product_id, pad.serial_number)] = ("gamepad", pad)
    return found
