"""Output of `hil devices`."""

import io
import json

import pytest
from rich.console import Console

from firmware_bridge.devices.mock_bus import MockDesk
from hil.apps.devices.command import print_devices


def printed(desk, *, width=40, **options):
    out = io.StringIO()
    print_devices(Console(file=out, width=width, highlight=False), find=desk.find, **options)
    return out.getvalue()


def test_an_empty_machine_gets_advice():
    text = printed(MockDesk())
    assert text.count("none found") == 3
    assert "data cable" in text


def test_a_narrow_terminal_cuts_nothing():
    desk = MockDesk()
    desk.plug_board(0x3162, 0x0053, product="PX4 [Pixhawk6C]", serial_number="3A0039001151333", ports=2)
    desk.plug_board(0x2DAE, 0x1001, accessible=False)
    desk.plug_board(0x10C4, 0xEA60, ports=["/dev/ttyUSB0"], accessible=False)
    desk.plug_pad(0x1209, 0x4F54)
    desk.usb.plugged.reverse()
    text = printed(desk)
    for piece in (
        "PX4 [Pixhawk6C] (Holybro Pixhawk 6C)",
        "3162:0053",
        "3A0039001151333",
        "/dev/ttyACM0 (try first)",
        "/dev/ttyACM1",
        "bootloader: unplug and replug",
        "dialout",
        "EdgeTX",
        "RC transmitter",
        "--rig px4_hitl --set autopilot.port=/dev/ttyACM0",
    ):
        assert piece in text, piece
    assert "…" not in text


def test_ardupilot_boards_are_sent_to_their_own_rig_and_closed_ports_are_not_proposed():
    desk = MockDesk()
    desk.plug_board(0x1209, 0x5741, accessible=False)
    assert "to fly with it" not in printed(desk)
    desk.plug_board(0x1209, 0x5741)
    assert "--rig ardupilot_eahrs --set autopilot.mavlink_port=/dev/ttyACM1" in printed(desk)


def test_missing_libraries_are_notes():
    desk = MockDesk()
    desk.hid.without_backend("pip install something")
    assert "note: gamepads were not listed: pip install something" in printed(desk)


def test_json_is_one_object():
    desk = MockDesk()
    desk.plug_board(0x3162, 0x0053)
    assert json.loads(printed(desk, as_json=True)) == desk.find().as_json()


@pytest.mark.parametrize("as_json", [False, True])
def test_watch_prints_changes_until_ctrl_c(as_json):
    desk = MockDesk()
    polls = 0

    def wait(_seconds):
        nonlocal polls
        polls += 1
        if polls == 1:
            desk.plug_board(0x3162, 0x0053, product="PX4 Pixhawk6C")
        elif polls == 3:
            raise KeyboardInterrupt

    text = printed(desk, as_json=as_json, watch=True, wait=wait)
    if as_json:
        first, event = (json.loads(line) for line in text.splitlines())
        assert first["autopilots"] == []
        assert (event["event"], event["kind"], event["device"]["port"]) == ("plugged", "autopilot", "/dev/ttyACM0")
    else:
        assert text.count("plugged in: PX4 Pixhawk6C at /dev/ttyACM0") == 1
