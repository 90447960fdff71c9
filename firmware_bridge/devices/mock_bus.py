"""Mocks of USB, serial ports and HID with devices plugged in by program, for this project's tests and a user's CI.

desk = MockDesk()
board = desk.plug_board(0x3162, 0x0053, product="PX4 Pixhawk6C")
pad = desk.plug_pad(0x054C, 0x05C4)
desk.find().autopilots[0].port     # '/dev/ttyACM0'
desk.unplug(board)
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

from firmware_bridge.devices.buses import BackendMissing, HidDevice, HidInterface, SerialPort, UsbDevice
from firmware_bridge.devices.inventory import Devices, find_devices


class _Fallible:
    """A bus that can fail: `error` is raised by each listing until it is None again."""

    def __init__(self) -> None:
        self.error: Exception | None = None

    def without_backend(self, advice: str = "install the mock's library") -> None:
        """Behave as if the library were not installed."""
        self.error = BackendMissing(advice)

    def _check(self) -> None:
        if self.error is not None:
            raise self.error


class MockUsbBus(_Fallible):
    """A mocked USB."""

    def __init__(self) -> None:
        super().__init__()
        self.plugged: list[UsbDevice] = []

    def devices(self) -> Sequence[UsbDevice]:
        self._check()
        return list(self.plugged)


class MockSerialPorts(_Fallible):
    """Mocked serial ports."""

    def __init__(self) -> None:
        super().__init__()
        self.plugged: list[SerialPort] = []

    def ports(self) -> Sequence[SerialPort]:
        self._check()
        return list(self.plugged)


class MockPad:
    """A HID device: its readers get the bytes given to `report`. `present` is False while it is unplugged."""

    def __init__(self, interface: HidInterface, descriptor: bytes | None) -> None:
        self.interface = interface
        self.descriptor = descriptor
        self.present = True
        self.opened = 0
        self._reports: deque[bytes] = deque()

    def report(self, data: bytes) -> None:
        """Queue one input report."""
        self._reports.append(data)

    def read(self, max_length: int) -> bytes:
        self._check()
        return self._reports.popleft()[:max_length] if self._reports else b""

    def report_descriptor(self) -> bytes:
        self._check()
        if self.descriptor is None:
            raise OSError("get report descriptor error")
        return self.descriptor

    def close(self) -> None:
        self.opened -= 1

    def _check(self) -> None:
        if not self.present:
            raise OSError("read error")


class MockHid(_Fallible):
    """A mocked HID bus."""

    def __init__(self) -> None:
        super().__init__()
        self.plugged: list[MockPad] = []

    def interfaces(self) -> Sequence[HidInterface]:
        self._check()
        return [pad.interface for pad in self.plugged]

    def open(self, path: bytes) -> HidDevice:
        self._check()
        for pad in self.plugged:
            if pad.interface.path == path:
                if not pad.interface.accessible:
                    raise OSError("open failed")
                pad.opened += 1
                return pad
        raise OSError("open failed")


@dataclass(frozen=True)
class MockBoard:
    """A board that is or was plugged in."""

    usb: UsbDevice
    ports: tuple[SerialPort, ...] = ()


@dataclass
class MockDesk:
    """A machine's three buses, with methods to plug and unplug devices."""

    usb: MockUsbBus = field(default_factory=MockUsbBus)
    ports: MockSerialPorts = field(default_factory=MockSerialPorts)
    hid: MockHid = field(default_factory=MockHid)
    _plugged_count: int = 0  # for locations and paths
    _ttys: int = 0  # serial devices so far

    def find(self) -> Devices:
        """Return the inventory of these buses."""
        return find_devices(self.usb, self.ports, self.hid)

    def plug_board(
        self,
        vendor_id: int,
        product_id: int,
        *,
        product: str | None = None,
        serial_number: str | None = None,
        ports: Sequence[str] | int = 1,
        accessible: bool = True,
        usb_texts: bool = True,
    ) -> MockBoard:
        """Plug a board in. `ports`: its serial devices, or their number.

        `usb_texts` False: product and serial number cannot be read over USB.
        """
        self._plugged_count += 1
        location = f"1-{self._plugged_count}"
        if isinstance(ports, int):
            names = [f"/dev/ttyACM{self._ttys + i}" for i in range(ports)]
            self._ttys += ports
        else:
            names = list(ports)
        usb = UsbDevice(
            vendor_id,
            product_id,
            product=product if usb_texts else None,
            serial_number=serial_number if usb_texts else None,
            location=location,
        )
        # A CDC port has two interfaces, so a board's second port is interface 2.
        serial = tuple(
            SerialPort(
                name,
                vendor_id,
                product_id,
                product=product,
                serial_number=serial_number,
                location=f"{location}:1.{2 * i}",
                accessible=accessible,
            )
            for i, name in enumerate(names)
        )
        board = MockBoard(usb, serial)
        self.replug(board)
        return board

    def plug_port(self, device: str, *, accessible: bool = True) -> MockBoard:
        """Add a serial port that is not on USB. It is returned as a board without USB device, for `unplug`."""
        port = SerialPort(device, accessible=accessible)
        self.ports.plugged.append(port)
        return MockBoard(UsbDevice(0, 0), (port,))

    def plug_pad(
        self,
        vendor_id: int,
        product_id: int,
        *,
        product: str | None = None,
        usage: int = 0x05,
        usage_page: int = 0x01,
        descriptor: bytes | None = None,
        accessible: bool = True,
    ) -> MockPad:
        """Plug a gamepad in. Without `descriptor`, reading its report descriptor fails."""
        self._plugged_count += 1
        interface = HidInterface(
            f"/dev/hidraw{self._plugged_count}".encode(),
            vendor_id,
            product_id,
            product=product,
            usage_page=usage_page,
            usage=usage,
            accessible=accessible,
        )
        pad = MockPad(interface, descriptor)
        self.hid.plugged.append(pad)
        return pad

    def replug(self, device: MockBoard | MockPad) -> None:
        """Plug in again what was unplugged."""
        if isinstance(device, MockPad):
            device.present = True
            self.hid.plugged.append(device)
            return
        if device.usb.vendor_id:
            self.usb.plugged.append(device.usb)
        self.ports.plugged.extend(device.ports)

    def unplug(self, device: MockBoard | MockPad) -> None:
        """Unplug: the device is no longer listed, and reading it fails."""
        if isinstance(device, MockPad):
            device.present = False
            self.hid.plugged.remove(device)
            return
        if device.usb.vendor_id:
            self.usb.plugged.remove(device.usb)
        for port in device.ports:
            self.ports.plugged.remove(port)
