"""The inventory of connected devices: names, serial ports, and notes about obstacles."""

import json
import sys
from dataclasses import replace

import pytest

from firmware_bridge.devices import gamepads, usb_boards
from firmware_bridge.devices.buses import BackendMissing, HidInterface, SerialPort, UsbDevice
from firmware_bridge.devices.inventory import find_devices
from firmware_bridge.devices.mock_bus import MockDesk
from firmware_bridge.devices.serial_ports import join_ports, natural
from firmware_bridge.devices.usb_boards import PyUsbBus, identify_board, names_bootloader

PIXHAWK_6C = (0x3162, 0x0053)


@pytest.mark.parametrize(
    ("ids", "word"),
    [
        ((0x26AC, 0x0032), "FMUv5"),
        ((0x26AC, 0x7777), "3DR"),
        ((0x2DAE, 0x1016), "CubeOrange"),
        ((0x2DAE, 0x9999), "CubePilot"),
        ((0x3162, 0x9999), "Holybro"),
        ((0x3163, 0x004C), "CUAV"),
        ((0x3185, 0x0039), "ARK"),
        ((0x3185, 0x9999), "Auterion"),
        ((0x1209, 0x5740), "ArduPilot"),
        ((0x1209, 0x5741), "ArduPilot"),
        ((0x0483, 0x5740), "STM32"),
    ],
)
def test_boards_are_named_by_product_and_else_by_vendor(ids, word):
    assert word in identify_board(*ids).name


@pytest.mark.parametrize("ids", [(0x1209, 0x4F54), (0x0483, 0x0001), (0x046D, 0xC216), (0x10C4, 0xEA60)])
def test_other_devices_are_not_taken_for_boards(ids):
    """The vendor ids of pid.codes and ST are shared by many makers: they are matched by product only."""
    assert identify_board(*ids) is None


@pytest.mark.parametrize(
    ("product", "is_one"),
    [
        ("PX4 BL FMU v6X.x", True),
        ("CubeOrange-BL", True),
        ("CubeOrange-Secure-BL-v10", True),
        ("Board_BL_1", True),
        ("mRo Bootloader", True),
        ("PX4 FMU v6X.x", False),
        ("BLHeli thing", False),
        ("CUBLE", False),
        (None, False),
    ],
)
def test_bootloaders_are_known_by_their_product_text(product, is_one):
    assert names_bootloader(product) is is_one


def test_a_board_has_its_ports_in_order_of_interface():
    desk = MockDesk()
    desk.plug_board(0x2DAE, 0x1016, product="CubeOrange", serial_number="A1", ports=["/dev/ttyACM10", "/dev/ttyACM9"])
    (board,) = desk.find().autopilots
    assert [port.device for port in board.ports] == ["/dev/ttyACM10", "/dev/ttyACM9"]
    assert board.port == "/dev/ttyACM10"  # interface 0, although its name sorts last
    assert (board.board, board.product, board.serial_number) == ("CubeOrange", "CubeOrange", "A1")
    assert desk.find().ports == ()


def test_two_boards_of_one_kind_keep_their_own_ports_even_with_equal_serial_numbers():
    """PX4's default serial number is the same on every board: the place on the USB decides."""
    desk = MockDesk()
    for name in ("/dev/ttyACM1", "/dev/ttyACM0"):
        desk.plug_board(*PIXHAWK_6C, serial_number="0", ports=[name])
    assert [(a.location, a.port) for a in desk.find().autopilots] == [("1-1", "/dev/ttyACM1"), ("1-2", "/dev/ttyACM0")]


def test_without_a_common_place_the_serial_number_decides_and_at_last_being_the_only_one():
    a, b = (UsbDevice(*PIXHAWK_6C, serial_number=s, location="20-1") for s in "ab")
    port = SerialPort("COM3", *PIXHAWK_6C, serial_number="b", location="1-7")
    assert join_ports([a, b], [port]) == [[], [port]]
    assert join_ports([a], [port]) == [[]]
    bare, nameless = SerialPort("COM4", *PIXHAWK_6C), UsbDevice(*PIXHAWK_6C)
    assert join_ports([nameless], [bare]) == [[bare]]
    assert join_ports([nameless, nameless], [bare]) == [[], []]
    assert join_ports([nameless], [SerialPort("COM5", 0x26AC, 0x0032)]) == [[]]


def test_equal_serial_numbers_without_a_place_are_not_assigned():
    twins = [UsbDevice(*PIXHAWK_6C, serial_number="0")] * 2
    assert join_ports(twins, [SerialPort("COM3", *PIXHAWK_6C, serial_number="0")]) == [[], []]


def test_twins_whose_ports_cannot_be_told_apart_are_still_two_boards():
    desk = MockDesk()
    boards = [desk.plug_board(*PIXHAWK_6C, serial_number="0") for _ in range(2)]
    desk.ports.plugged = [replace(board.ports[0], location=f"20-{i}") for i, board in enumerate(boards)]
    assert sorted(a.port for a in desk.find().autopilots) == ["/dev/ttyACM0", "/dev/ttyACM1"]


def test_another_place_and_no_serial_number_is_another_board():
    usb = UsbDevice(*PIXHAWK_6C, location="1-1")
    assert join_ports([usb], [SerialPort("p", *PIXHAWK_6C, location="1-2:1.0")]) == [[]]


def test_texts_come_from_the_serial_driver_where_the_usb_device_may_not_be_opened():
    desk = MockDesk()
    desk.plug_board(0x1209, 0x5741, product="MatekH743-BL", serial_number="77", usb_texts=False)
    (board,) = desk.find().autopilots
    assert (board.product, board.serial_number, board.bootloader) == ("MatekH743-BL", "77", True)
    assert board.port is None
    assert any("unplug and replug" in note for note in board.notes)


def test_without_libusb_boards_are_found_by_their_serial_ports():
    desk = MockDesk()
    desk.plug_board(*PIXHAWK_6C, product="PX4 Pixhawk6C", ports=2)
    with_usb = desk.find()
    desk.usb.without_backend("install libusb")
    without = desk.find()
    assert without.autopilots == with_usb.autopilots
    assert any("install libusb" in note for note in without.notes)
    assert without.failed == frozenset()


@pytest.mark.parametrize("bus", ["usb", "ports", "hid"])
@pytest.mark.parametrize("error", [OSError("busy"), ValueError("odd"), RuntimeError("hm")])
def test_a_bus_that_fails_is_a_note_and_the_others_are_read(bus, error):
    desk = MockDesk()
    desk.plug_board(*PIXHAWK_6C)
    desk.plug_pad(0x054C, 0x05C4)
    getattr(desk, bus).error = error
    found = desk.find()
    assert len(found.notes) == 1
    assert str(error) in found.notes[0]
    assert len(found.failed) == 1
    assert len(found.gamepads) == (bus != "hid")
    assert len(found.autopilots) == 1


def test_missing_permissions_come_with_advice():
    desk = MockDesk()
    desk.plug_board(*PIXHAWK_6C, accessible=False)
    desk.plug_pad(0x054C, 0x05C4, accessible=False)
    found = desk.find()
    assert any("dialout" in note and "/dev/ttyACM0" in note for note in found.autopilots[0].notes)
    (note,) = found.gamepads[0].notes
    assert ("054c" in note and "udev" in note) if sys.platform == "linux" else note


def test_a_board_without_port_and_a_generic_id_are_noted():
    desk = MockDesk()
    desk.plug_board(*PIXHAWK_6C, ports=0)
    desk.plug_board(0x0483, 0x5740)
    desk.plug_board(0x0483, 0xDF11, ports=0)
    without, generic, dfu = desk.find().autopilots
    assert any("no serial port" in note for note in without.notes)
    assert any("not only autopilots" in note for note in generic.notes)
    assert dfu.bootloader
    assert not any("no serial port" in note for note in dfu.notes)


def test_plain_ports_are_listed_in_natural_order_with_a_hint():
    desk = MockDesk()
    desk.plug_board(0x10C4, 0xEA60, ports=["/dev/ttyUSB10"])
    desk.plug_port("/dev/ttyUSB2")
    found = desk.find()
    assert [port.device for port in found.ports] == ["/dev/ttyUSB2", "/dev/ttyUSB10"]
    assert "telemetry" in found.as_json()["ports"][1]["hint"]
    assert found.autopilots == ()
    assert natural("COM2") < natural("COM10")


@pytest.mark.parametrize(
    ("ids", "usage_page", "usage", "kind"),
    [
        ((0x1111, 1), 1, 5, "gamepad"),
        ((0x1111, 1), 1, 4, "joystick"),
        ((0x1111, 1), 1, 6, None),  # keyboard
        ((0x1111, 1), 0x0C, 5, None),  # consumer page
        ((0x1111, 1), 0, 0, None),  # the system gives no usage, and the ids are unknown
        ((0x1209, 0x4F54), 0, 0, "RC transmitter"),
        ((0x054C, 0x05C4), 0, 0, "gamepad"),
        ((0x054C, 0x05C4), 0xFF00, 1, None),  # the pad's other interface
    ],
)
def test_gamepads_are_known_by_usage_and_by_ids(ids, usage_page, usage, kind):
    named = gamepads.identify_gamepad(HidInterface(b"p", *ids, usage_page=usage_page, usage=usage))
    assert (named and named[1]) == kind


def test_a_pad_that_is_listed_once_for_each_usage_counts_once():
    desk = MockDesk()
    pad = desk.plug_pad(0x1234, 1, product="Pad")
    desk.hid.plugged.append(pad)
    assert [p.name for p in desk.find().gamepads] == ["Pad"]


def test_json_is_plain_data():
    desk = MockDesk()
    desk.plug_board(*PIXHAWK_6C, ports=2)
    desk.plug_pad(0x054C, 0x05C4)
    data = json.loads(json.dumps(desk.find().as_json()))
    assert data["schema"] == 1
    assert data["autopilots"][0]["usb_ids"] == "3162:0053"
    assert data["autopilots"][0]["port"] == data["autopilots"][0]["ports"][0]["device"] == "/dev/ttyACM0"
    assert data["gamepads"][0]["path"].startswith("/dev/hidraw")


# -- the real libraries ---------------------------------------------------------------------------------------------


def test_the_inventory_of_this_machine_raises_nothing():
    find_devices()


def test_a_missing_libusb_becomes_advice(monkeypatch):
    import usb.core

    def no_backend(**_):
        raise usb.core.NoBackendError("No backend available")

    monkeypatch.setattr(usb.core, "find", no_backend)
    with pytest.raises(BackendMissing, match="apt install libusb"):
        PyUsbBus().devices()


def test_pyusb_devices_are_read_as_far_as_they_may_be(monkeypatch):
    import usb.core

    class Device:
        idVendor, idProduct, bus, port_numbers = 0x26AC, 0x0032, 3, (1, 4)
        manufacturer = "3D Robotics"

        @property
        def product(self):
            raise usb.core.USBError("Access denied", 13)

        @property
        def serial_number(self):
            raise ValueError("The device has no langid")

    class Root(Device):
        port_numbers = None

    monkeypatch.setattr(usb.core, "find", lambda **_: iter([Device(), Root()]))
    first, root = PyUsbBus().devices()
    assert first == UsbDevice(0x26AC, 0x0032, "3D Robotics", None, None, "3-1.4")
    assert root.location is None


@pytest.mark.parametrize("library", ["usb", "usb.core"])
def test_a_missing_pyusb_gives_advice(monkeypatch, library):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(BackendMissing, match="pip install pyusb"):
        usb_boards.PyUsbBus().devices()


def test_a_missing_or_wrong_hidapi_gives_advice(monkeypatch):
    monkeypatch.setitem(sys.modules, "hidraw", None)
    monkeypatch.setitem(sys.modules, "hid", json)  # a module without `device`
    with pytest.raises(BackendMissing, match="pip install hidapi"):
        gamepads.HidApi().interfaces()


def test_hidapi_entries_are_copied(monkeypatch):
    class Fake:
        device = object

        @staticmethod
        def enumerate():
            return [
                {"path": b"1-2:1.0", "vendor_id": 1, "product_id": 2, "product_string": "", "usage_page": 1, "usage": 5}
            ]

    monkeypatch.setattr(gamepads, "_hidapi", lambda: Fake)
    assert gamepads.HidApi().interfaces() == [HidInterface(b"1-2:1.0", 1, 2, usage_page=1, usage=5)]
