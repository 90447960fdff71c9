"""What the inventory needs of USB, serial ports and HID: three small interfaces, and what they list.

The real ones are `PyUsbBus`, `PySerialPorts` and `HidApi`; `mock_bus` has ones to plug and unplug by program.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from hil.signals.errors import HilError


class BackendMissing(HilError):
    """The library that would list these devices is not installed. `str` says what to install."""


@dataclass(frozen=True)
class UsbDevice:
    """One device on the USB. Texts are None where reading them was not allowed; `location` is 'BUS-PORT[.PORT]'."""

    vendor_id: int
    product_id: int
    manufacturer: str | None = None
    product: str | None = None
    serial_number: str | None = None
    location: str | None = None


@dataclass(frozen=True)
class SerialPort:
    """One serial device. The USB fields are None for ports that are not on the USB."""

    device: str
    vendor_id: int | None = None
    product_id: int | None = None
    manufacturer: str | None = None
    product: str | None = None
    serial_number: str | None = None
    location: str | None = None  # 'BUS-PORT[.PORT][:CONFIGURATION.INTERFACE]'
    accessible: bool = True  # may this user open it?


@dataclass(frozen=True)
class HidInterface:
    """One HID interface. `usage_page` and `usage` are 0 where the operating system does not tell."""

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
        """All of them. BackendMissing without a library for it; OSError if looking failed this time."""
        ...


class SerialPorts(Protocol):
    """Lists serial ports."""

    def ports(self) -> Sequence[SerialPort]:
        """All of them. BackendMissing, OSError as in `UsbBus`."""
        ...


class HidDevice(Protocol):
    """One opened HID interface."""

    def read(self, max_length: int) -> bytes:
        """The oldest report not yet read, or b"" at once if there is none. OSError when the device is gone."""
        ...

    def report_descriptor(self) -> bytes:
        """The device's own description of its reports. OSError where it cannot be had."""
        ...

    def close(self) -> None: ...


class HidBus(Protocol):
    """Lists and opens HID interfaces."""

    def interfaces(self) -> Sequence[HidInterface]:
        """All of them. BackendMissing, OSError as in `UsbBus`."""
        ...

    def open(self, path: bytes) -> HidDevice:
        """OSError if it is gone or this user may not open it."""
        ...
