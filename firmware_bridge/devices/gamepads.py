"""Gamepads, joysticks and radio-control transmitters among the HID interfaces."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from types import ModuleType
from typing import Any

from firmware_bridge.devices.buses import BackendMissing, HidDevice, HidInterface
from firmware_bridge.devices.serial_ports import may_open

GENERIC_DESKTOP = 0x01
KINDS = {0x04: "joystick", 0x05: "gamepad"}
TRANSMITTER = "RC transmitter"

# (vendor, product): (name, kind). Recognised also where the operating system does not report the usage.
KNOWN = {
    (0x1209, 0x4F54): ("EdgeTX/OpenTX radio (RadioMaster, Jumper, FrSky, ...)", TRANSMITTER),
    (0x0483, 0x5710): ("FrSky radio with OpenTX", TRANSMITTER),
    (0x054C, 0x05C4): ("DualShock 4", "gamepad"),
    (0x054C, 0x09CC): ("DualShock 4", "gamepad"),
    (0x054C, 0x0CE6): ("DualSense", "gamepad"),
    (0x045E, 0x02E0): ("Xbox controller (Bluetooth)", "gamepad"),
    (0x045E, 0x02FD): ("Xbox controller (Bluetooth)", "gamepad"),
    (0x045E, 0x0B13): ("Xbox controller (Bluetooth)", "gamepad"),
    (0x046D, 0xC216): ("Logitech F310 (switch on D)", "gamepad"),
    (0x046D, 0xC218): ("Logitech F510 (switch on D)", "gamepad"),
    (0x046D, 0xC219): ("Logitech F710 (switch on D)", "gamepad"),
    (0x046D, 0xC215): ("Logitech Extreme 3D Pro", "joystick"),
}


def identify_gamepad(interface: HidInterface) -> tuple[str, str] | None:
    """Return (name, kind) of a device with sticks, None for any other."""
    known = KNOWN.get((interface.vendor_id, interface.product_id))
    reported = interface.usage_page != 0
    kind = KINDS.get(interface.usage) if interface.usage_page == GENERIC_DESKTOP else None
    if reported and kind is None:
        return None  # another interface of the same device: a headset, a touch pad
    if known is not None:
        return known
    if kind is None:
        return None
    return interface.product or f"{kind} {interface.vendor_id:04x}:{interface.product_id:04x}", kind


class HidApi:
    """HID interfaces, listed by hidapi."""

    def interfaces(self) -> Sequence[HidInterface]:
        return [
            HidInterface(
                path=entry["path"],
                vendor_id=entry["vendor_id"],
                product_id=entry["product_id"],
                manufacturer=entry.get("manufacturer_string") or None,
                product=entry.get("product_string") or None,
                serial_number=entry.get("serial_number") or None,
                usage_page=entry.get("usage_page") or 0,
                usage=entry.get("usage") or 0,
                accessible=may_open(entry["path"]),
            )
            for entry in _hidapi().enumerate()
        ]

    def open(self, path: bytes) -> HidDevice:
        device = _hidapi().device()
        device.open_path(path)
        device.set_nonblocking(1)
        return _OpenHid(device)


class _OpenHid:
    """An open hidapi device."""

    def __init__(self, device: Any) -> None:
        self._device = device

    def read(self, max_length: int) -> bytes:
        try:
            return bytes(self._device.read(max_length))
        except ValueError as error:  # "not open"
            raise OSError(str(error)) from error

    def report_descriptor(self) -> bytes:
        try:
            return bytes(self._device.get_report_descriptor())
        except ValueError as error:
            raise OSError(str(error)) from error

    def close(self) -> None:
        self._device.close()


def _hidapi() -> ModuleType:
    """Return hidapi's module. On Linux prefer its hidraw build: the libusb build detaches the kernel's driver."""
    for name in ("hidraw", "hid") if sys.platform == "linux" else ("hid",):
        try:
            module = __import__(name)
        except ImportError:
            continue
        if hasattr(module, "device") and hasattr(module, "enumerate"):
            return module
    raise BackendMissing(
        "hidapi is not installed: `pip install hidapi` (the package `hid` is another one; remove it if it is installed)"
    )
