"""Autopilot boards by their USB ids.

Sources: PX4's board configurations, ArduPilot's board definitions and QGroundControl's table. Some vendors use one id
for several boards, and several vendors share one, so an entry is only probable. The board's own product text, where it
can be read, is the better name.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from firmware_bridge.devices.buses import BackendMissing, UsbDevice

PX4, ARDUPILOT = "PX4", "ArduPilot"
_BOTH = (PX4, ARDUPILOT)


@dataclass(frozen=True)
class BoardId:
    """One row of the table. `product_id` None: any product of the vendor."""

    name: str
    vendor_id: int
    product_id: int | None
    firmwares: tuple[str, ...] = _BOTH
    bootloader: bool = False
    generic: bool = False  # devices other than autopilots have this id, too


BOARDS = (
    # 3D Robotics' vendor id, used by many boards of the Pixhawk family.
    BoardId("Omnibus F4 SD or other FMUv4-class board", 0x26AC, 0x0001),
    BoardId("PX4 FMUv1", 0x26AC, 0x0010),
    BoardId("Pixhawk 1 (FMUv2/v3)", 0x26AC, 0x0011),
    BoardId("Pixracer (FMUv4)", 0x26AC, 0x0012),
    BoardId("Pixhawk 3 Pro (FMUv4 Pro)", 0x26AC, 0x0013),
    BoardId("Crazyflie 2, or the bootloader of an early Pixhawk", 0x26AC, 0x0016),
    BoardId("AUAV X2.1", 0x26AC, 0x0021),
    BoardId("MindPX v2", 0x26AC, 0x0030),
    BoardId("Pixhawk 4 (FMUv5)", 0x26AC, 0x0032),
    BoardId("Holybro Kakute F7", 0x26AC, 0x0050),
    BoardId("mRo Control Zero F7", 0x26AC, 0x008D),
    BoardId("AeroCore", 0x26AC, 0x1001, (PX4,)),
    BoardId("mRo Pixracer Pro", 0x26AC, 0x1017),
    BoardId("mRo Control Zero Classic", 0x26AC, 0x1022),
    BoardId("mRo Control Zero H7", 0x26AC, 0x1023),
    BoardId("mRo Control Zero H7 OEM", 0x26AC, 0x1024),
    BoardId("3DR Control Zero H7 OEM revG", 0x26AC, 0x1124),
    BoardId("3DR or mRo board", 0x26AC, None),
    # CubePilot; the older bootloaders have ids of their own.
    BoardId("CubeBlack bootloader", 0x2DAE, 0x1001, bootloader=True),
    BoardId("CubeYellow bootloader", 0x2DAE, 0x1002, bootloader=True),
    BoardId("CubePurple bootloader", 0x2DAE, 0x1005, bootloader=True),
    BoardId("CubeBlack", 0x2DAE, 0x1011),
    BoardId("CubeYellow", 0x2DAE, 0x1012),
    BoardId("CubePurple", 0x2DAE, 0x1015, (ARDUPILOT,)),
    BoardId("CubeOrange", 0x2DAE, 0x1016),
    BoardId("CubeOrange+", 0x2DAE, 0x1058),
    BoardId("CubeRed", 0x2DAE, 0x1059, (ARDUPILOT,)),
    BoardId("CubeBlack+", 0x2DAE, 0x1101, (ARDUPILOT,)),
    BoardId("CubePilot board", 0x2DAE, None),
    # Holybro
    BoardId("Holybro Durandal", 0x3162, 0x004B),
    BoardId("Holybro Pix32 v5", 0x3162, 0x004E),
    BoardId("Holybro Kakute H7", 0x3162, 0x0050),
    BoardId("Holybro Pixhawk 5X or Kakute H7 Wing", 0x3162, 0x0051),
    BoardId("Holybro Pixhawk 6C", 0x3162, 0x0053),
    BoardId("Holybro board", 0x3162, None),
    # CUAV gives all its boards one product id.
    BoardId("CUAV board (V5+, Nora, X7, 7-Nano, X25)", 0x3163, 0x004C),
    BoardId("CUAV board", 0x3163, None),
    # Auterion's vendor id: the Pixhawk standard's reference boards, and ARK's.
    BoardId("Pixhawk 5X (FMUv5X)", 0x3185, 0x0033),
    BoardId("Pixhawk 6X (FMUv6X)", 0x3185, 0x0035),
    BoardId("Pixhawk 6C (FMUv6C)", 0x3185, 0x0038),
    BoardId("ARK FMUv6X", 0x3185, 0x0039),
    BoardId("ARK Pi6X", 0x3185, 0x003A),
    BoardId("ARK FPV", 0x3185, 0x003B),
    BoardId("Auterion or ARK board", 0x3185, None),
    BoardId("Pixhawk 6X-RT (FMUv6X-RT)", 0x3643, 0x001D, (PX4,)),
    BoardId("ZeroOne X6", 0x3643, 0x15E0),
    BoardId("H743-class board (Matek, MicoAir, CORVON, NxtPX4) or FMUv6U", 0x1B8C, 0x0036),
    BoardId("NXP FMUK66", 0x1FC9, 0x001C, (PX4,)),
    BoardId("UVify Core", 0x1008, 0x0001, (PX4,)),
    BoardId("ThePeach FCC-K1", 0x35A7, 0x0001),
    BoardId("ThePeach FCC-R1", 0x35A7, 0x0002),
    BoardId("VR Brain or F4BY", 0x27AC, None, (ARDUPILOT,)),
    BoardId("JFB-110", 0x0A8E, 0x006E),
    BoardId("Accton Godwit GA1", 0x083A, 0x1BD0, (PX4,)),
    # ArduPilot's own allocation: every board without ids of its own, so the product text is the board's name.
    BoardId("ArduPilot board with two USB ports", 0x1209, 0x5740, (ARDUPILOT,)),
    BoardId("ArduPilot board", 0x1209, 0x5741, (ARDUPILOT,)),
    BoardId("Matek H743-SLIM", 0x1209, 0x1013, (PX4,)),
    # STMicroelectronics' own ids
    BoardId("ModalAI Flight Core v1", 0x0483, 0xA32F, (PX4,)),
    BoardId("ModalAI Flight Core v2", 0x0483, 0xA330, (PX4,)),
    BoardId("SmartAP AirLink", 0x0483, 0x0037, (PX4,)),
    BoardId("STM32 in its ROM bootloader (DFU)", 0x0483, 0xDF11, (), bootloader=True, generic=True),
    BoardId("STM32 with a USB serial port (perhaps an older ArduPilot)", 0x0483, 0x5740, (ARDUPILOT,), generic=True),
)

_EXACT = {(b.vendor_id, b.product_id): b for b in BOARDS}
# "PX4 BL FMU v6X.x", "CubeOrange-BL", "CubeOrange-Secure-BL-v10", "... Bootloader"
_BOOTLOADER = re.compile(r"(^|[\s_-])BL([\s_-]|$)|bootloader", re.IGNORECASE)


def identify_board(vendor_id: int, product_id: int) -> BoardId | None:
    """Return the row for these ids: the exact one, else the vendor's, else None."""
    return _EXACT.get((vendor_id, product_id)) or _EXACT.get((vendor_id, None))


def names_bootloader(product: str | None) -> bool:
    """Return True if the product text names a bootloader. Most bootloaders share their ids with the firmware."""
    return product is not None and _BOOTLOADER.search(product) is not None


class PyUsbBus:
    """USB devices, listed by libusb through pyusb."""

    def devices(self) -> Sequence[UsbDevice]:
        try:
            import usb.core
        except ImportError as error:
            raise BackendMissing("pyusb is not installed: `pip install pyusb`") from error
        try:
            found = list(usb.core.find(find_all=True))
        except usb.core.NoBackendError as error:
            raise BackendMissing(
                "libusb is not installed: `apt install libusb-1.0-0` (Debian, Ubuntu), `brew install libusb` (macOS), "
                "`pip install libusb-package` (Windows)"
            ) from error
        return [_describe(device) for device in found]


def _describe(device: object) -> UsbDevice:
    """Return the readable facts of a pyusb device."""
    ports = getattr(device, "port_numbers", None)
    bus = getattr(device, "bus", None)
    return UsbDevice(
        vendor_id=int(device.idVendor),  # type: ignore[attr-defined]
        product_id=int(device.idProduct),  # type: ignore[attr-defined]
        manufacturer=_text(device, "manufacturer"),
        product=_text(device, "product"),
        serial_number=_text(device, "serial_number"),
        location=f"{bus}-{'.'.join(str(p) for p in ports)}" if bus is not None and ports else None,
    )


def _text(device: object, name: str) -> str | None:
    """Return a string descriptor; None without permission, or if it is missing or damaged."""
    try:
        return getattr(device, name) or None
    except (OSError, ValueError, NotImplementedError):
        return None
