"""Protocols by which the device inventory (inventory.py) lists USB, serial and HID devices, and their records.

Implementations: `PyUsbBus`, `PySerialPorts` and `HidApi`; `mock_bus` has mocks to plug and unplug by program.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from signals.errors import HilError


class BackendMissing(HilError):
    """The library that lists these devices is not installed. The text names the package to install."""


@dataclass(frozen=True)
class UsbDevice:
    """One USB device. Texts are None without permission to read them; `location` is 'BUS-PORT[.PORT]'."""

    vendor_id: int
    product_id: int
    manufacturer: str | None = None
    product: str | None = None
    serial_number: str | None = None
    location: str | None = None


@dataclass(frozen=True)
class SerialPort:
    """One serial device. The USB fields are None for other ports."""

    device: str
    vendor_id: int | None = None
    product_id: int | None = None
    manufacturer: str | None = None
    product: str | None = None
    serial_number: str | None = None
    location: str | None = None  # 'BUS-PORT[.PORT][:CONFIGURATION.INTERFACE]'
    accessible: bool = True  # this user has the permission to open it


@dataclass(frozen=True)
class HidInterface:
    """One HID interface. `usage_page` and `usage` are 0 if the operating system does not report them."""

    path: bytes
    vendor_id: int
    product_id: int
    manufacturer: str | None = None
    product: str | None = None
    serial_number: str | None = None
    usage_page: int = 0
    usage: int = 0
    accessible: bool = True


class UsbBus(Protocol):
    """Lists USB devices."""

    def devices(self) -> Sequence[UsbDevice]:
        """Return all devices. BackendMissing without the library; OSError if listing failed this time."""
        ...


class SerialPorts(Protocol):
    """Lists serial ports."""

    def ports(self) -> Sequence[SerialPort]:
        """Return all ports. BackendMissing, OSError as in `UsbBus`."""
        ...


class HidDevice(Protocol):
    """One opened HID interface."""

    def read(self, max_length: int) -> bytes:
        """Return the oldest unread report, or b"" at once if there is none. OSError if the device is unplugged."""
        ...

    def report_descriptor(self) -> bytes:
        """Return the device's description of its reports. OSError if it cannot be read."""
        ...

    def close(self) -> None: ...


class HidBus(Protocol):
    """Lists and opens HID interfaces."""

    def interfaces(self) -> Sequence[HidInterface]:
        """Return all interfaces. BackendMissing, OSError as in `UsbBus`."""
        ...

    def open(self, path: bytes) -> HidDevice:
        """Open an interface. OSError if it is unplugged or this user may not open it."""
        ...
