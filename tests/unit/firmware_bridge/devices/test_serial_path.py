"""A board found by its USB serial number (`autopilot.port: usb:SERIAL`)."""

from __future__ import annotations

import pytest

from firmware_bridge.devices import serial_path as module
from firmware_bridge.devices.mock_bus import MockDesk
from firmware_bridge.devices.serial_path import serial_path
from signals.errors import PortNotFound

PIXHAWK, ADAPTER = (0x3162, 0x0053), (0x0403, 0x6001)


@pytest.fixture
def desk(monkeypatch) -> MockDesk:
    desk = MockDesk()
    monkeypatch.setattr(module, "find_devices", desk.find)
    return desk


def test_two_equal_boards_keep_their_vehicles_in_any_order(desk):
    first = desk.plug_board(*PIXHAWK, serial_number="1A", ports=["/dev/ttyACM0", "/dev/ttyACM1"])
    desk.plug_board(*PIXHAWK, serial_number="2B", ports=["/dev/ttyACM2"])
    assert [serial_path(port) for port in ("usb:1A", "usb:2B")] == ["/dev/ttyACM0", "/dev/ttyACM2"]
    desk.unplug(first)
    desk.plug_board(*PIXHAWK, serial_number="1A", ports=["/dev/ttyACM7"])
    assert [serial_path(port) for port in ("usb:1A", "usb:2B")] == ["/dev/ttyACM7", "/dev/ttyACM2"]


def test_an_adapter_has_a_serial_number_too_and_a_path_stays(desk):
    desk.plug_board(*ADAPTER, serial_number="FT9", ports=["/dev/ttyUSB0"])
    assert serial_path("usb:FT9") == "/dev/ttyUSB0"
    assert serial_path("/dev/ttyS3") == "/dev/ttyS3"


def test_an_unknown_number_is_named_with_those_that_are_there(desk):
    with pytest.raises(PortNotFound, match=r"usb:9: no USB device has this serial number\. Here: none with a serial"):
        serial_path("usb:9")
    desk.plug_board(*PIXHAWK, serial_number="1A")
    desk.plug_board(*ADAPTER, serial_number="FT9")
    with pytest.raises(PortNotFound, match=r"usb:1A \(.*Pixhawk 6C, /dev/ttyACM0\), usb:FT9 \(FTDI .*hil devices"):
        serial_path("usb:9")


def test_twin_serial_numbers_need_a_path(desk):
    for _ in range(2):
        desk.plug_board(*PIXHAWK, serial_number="0")
    with pytest.raises(PortNotFound, match=r"2 USB devices have this serial number \(/dev/ttyACM0, /dev/ttyACM1\)"):
        serial_path("usb:0")
