"""HID gamepads: opened, read, pulled out, and fed garbage."""

from dataclasses import replace

import pytest

from firmware_bridge.devices.mock_bus import MockDesk
from firmware_bridge.manual.axes import Axis, StickMapping
from firmware_bridge.manual.hid_gamepad import open_gamepad
from firmware_bridge.manual.sticks import NEUTRAL, ManualControlError, StickLost
from tests.worlds import hid_descriptors as hid

DEAD_MAN = 5


def opened(**options):
    desk = MockDesk()
    pad = desk.plug_pad(0x1234, 0x0001, product="Pad", descriptor=hid.SIMPLE)
    return desk, pad, open_gamepad(hid=desk.hid, **options)


def test_nothing_is_known_before_the_first_report():
    assert opened()[2].poll() is None


def test_the_newest_report_counts_and_stays_while_nothing_moves():
    _, pad, gamepad = opened()
    pad.report(hid.simple_report(y=0))
    pad.report(hid.simple_report(128, 128, 255, 128, DEAD_MAN))
    state = gamepad.poll()
    assert state.sticks == NEUTRAL._replace(roll=1.0)
    assert state.held
    assert gamepad.poll() == state


def test_a_button_tapped_between_two_polls_is_not_missed_but_does_not_hold_the_switch():
    _, pad, gamepad = opened()
    pad.report(hid.simple_report(128, 128, 128, 128, 1, DEAD_MAN))
    pad.report(hid.simple_report())
    state = gamepad.poll()
    assert state.pressed == {1, DEAD_MAN}
    assert not state.held
    assert gamepad.poll().pressed == frozenset()


def test_unplugging_is_a_loss():
    desk, pad, gamepad = opened()
    pad.report(hid.simple_report())
    gamepad.poll()
    desk.unplug(pad)
    with pytest.raises(StickLost, match="Pad: unplugged"):
        gamepad.poll()


@pytest.mark.parametrize("garbage", [b"\x01", hid.simple_report()[:5], bytes(range(64))])
def test_single_garbage_reports_are_dropped_and_counted(garbage):
    _, pad, gamepad = opened()
    pad.report(hid.simple_report(x=255))
    pad.report(garbage)
    assert gamepad.poll().sticks.yaw == 1.0
    assert gamepad.bad_reports == 1


def test_nothing_but_garbage_is_a_loss():
    _, pad, gamepad = opened()
    pad.report(hid.simple_report(128, 128, 255, 128, DEAD_MAN))
    for _ in range(24):
        pad.report(b"\xff" * 3)
    assert gamepad.poll().held
    pad.report(b"\xff" * 3)
    with pytest.raises(StickLost, match="25 reports in a row"):
        gamepad.poll()


def test_a_valid_report_resets_the_count_of_bad_ones():
    _, pad, gamepad = opened()
    for _ in range(10):
        for _ in range(20):
            pad.report(b"")  # an empty read is not a report: nothing more is read in this poll
            pad.report(b"\xff")
        pad.report(hid.simple_report())
    for _ in range(300):
        gamepad.poll()
    assert gamepad.bad_reports == 200


def test_a_device_that_floods_reports_does_not_stop_the_bench():
    _, pad, gamepad = opened()
    for _ in range(1000):
        pad.report(hid.simple_report(x=255))
    assert gamepad.poll().sticks.yaw == 1.0
    assert pad.read(64)  # some are left for the next poll


@pytest.mark.parametrize(("descriptor", "says"), [(None, "Strange.*no report descriptor"), (b"\xb4", "cannot be used")])
def test_a_device_without_a_description_or_with_a_damaged_one_is_refused_and_closed(descriptor, says):
    desk = MockDesk()
    pad = desk.plug_pad(0x1234, 1, product="Strange", descriptor=descriptor)
    with pytest.raises(ManualControlError, match=says):
        open_gamepad(hid=desk.hid)
    assert pad.opened == 0


def test_missing_device_permissions_and_hidapi_are_named():
    desk = MockDesk()
    with pytest.raises(StickLost, match="no gamepad"):
        open_gamepad(hid=desk.hid)
    desk.plug_pad(0x1234, 1, descriptor=hid.SIMPLE, accessible=False)
    with pytest.raises(StickLost, match=r"no permission|no access"):
        open_gamepad(hid=desk.hid)
    desk.hid.without_backend("pip install hidapi")
    with pytest.raises(StickLost, match="pip install hidapi"):
        open_gamepad(hid=desk.hid)


def test_no_dead_man_switch_must_be_said_explicitly():
    mapping = StickMapping(pitch=Axis("y"), roll=Axis("x"), throttle=Axis("z"), yaw=Axis("rz"))
    with pytest.raises(ManualControlError, match="no dead-man button"):
        opened(mapping=mapping)
    for options in ({"mapping": mapping}, {}):
        _, pad, gamepad = opened(needs_dead_man=False, **options)
        pad.report(hid.simple_report())
        assert gamepad.poll().held


def test_a_mapping_that_does_not_fit_is_refused_and_the_device_closed():
    desk = MockDesk()
    pad = desk.plug_pad(0x1234, 1, product="Pad", descriptor=hid.SIMPLE)
    mapping = StickMapping(pitch=Axis("y"), roll=Axis("x"), throttle=Axis("wheel"), yaw=Axis("rz"), dead_man=1)
    with pytest.raises(ManualControlError, match="Pad: the device has no axis 'wheel'"):
        open_gamepad(hid=desk.hid, mapping=mapping)
    assert pad.opened == 0
    gamepad = open_gamepad(hid=desk.hid, mapping=replace(mapping, throttle=Axis("z")))
    assert pad.opened == 1
    gamepad.close()
    assert pad.opened == 0
