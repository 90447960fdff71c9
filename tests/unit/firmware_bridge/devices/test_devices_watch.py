"""Hot-plugging: every change is exactly one event."""

from firmware_bridge.devices.mock_bus import MockDesk
from firmware_bridge.devices.watch import DeviceWatch

PIXHAWK_6C = (0x3162, 0x0053)


def watched():
    desk = MockDesk()
    return desk, DeviceWatch(desk.find)


def names(events):
    return [("Unplugged" if event.unplugged else "Plugged", event.kind) for event in events]


def test_devices_present_at_the_start_are_no_events():
    desk, watch = watched()
    desk.plug_board(*PIXHAWK_6C)
    assert [watch.poll() for _ in range(3)] == [[], [], []]
    assert len(watch.devices.autopilots) == 1


def test_plugging_and_unplugging_are_one_event_each():
    desk, watch = watched()
    watch.poll()
    board = desk.plug_board(*PIXHAWK_6C, product="PX4 Pixhawk6C")
    pad = desk.plug_pad(0x054C, 0x05C4)
    port = desk.plug_port("/dev/ttyS9")
    events = watch.poll()
    assert sorted(names(events)) == [("Plugged", k) for k in ("autopilot", "gamepad", "serial port")]
    assert any("PX4 Pixhawk6C at /dev/ttyACM0" in str(event) for event in events)
    assert watch.poll() == []
    for thing in (board, pad, port):
        desk.unplug(thing)
    events = watch.poll()
    assert sorted(names(events)) == [("Unplugged", k) for k in ("autopilot", "gamepad", "serial port")]
    assert any(e.unplugged and "PX4 Pixhawk6C" in str(e) for e in events)
    assert watch.poll() == []
    desk.replug(board)
    assert names(watch.poll()) == [("Plugged", "autopilot")]


def test_a_board_with_a_delayed_port_is_one_event_with_its_port():
    desk, watch = watched()
    watch.poll()
    board = desk.plug_board(*PIXHAWK_6C)
    desk.ports.plugged.clear()
    assert watch.poll() == []
    desk.ports.plugged.extend(board.ports)
    (event,) = watch.poll()
    assert not event.unplugged
    assert event.item.port == "/dev/ttyACM0"
    assert watch.poll() == []


def test_a_board_without_a_port_is_an_event_at_the_second_scan():
    desk, watch = watched()
    watch.poll()
    board = desk.plug_board(*PIXHAWK_6C, ports=0)
    assert watch.poll() == []
    assert names(watch.poll()) == [("Plugged", "autopilot")]
    assert watch.poll() == []
    desk.unplug(board)
    assert names(watch.poll()) == [("Unplugged", "autopilot")]


def test_a_board_that_comes_and_goes_between_scans_is_no_event():
    desk, watch = watched()
    watch.poll()
    board = desk.plug_board(*PIXHAWK_6C, ports=0)
    watch.poll()
    desk.unplug(board)
    assert watch.poll() == []


def test_rebooting_into_the_bootloader_is_a_change():
    desk, watch = watched()
    board = desk.plug_board(*PIXHAWK_6C, product="PX4 Pixhawk6C")
    watch.poll()
    desk.unplug(board)
    desk.plug_board(*PIXHAWK_6C, product="PX4 BL Pixhawk6C")
    assert names(watch.poll()) == [("Unplugged", "autopilot"), ("Plugged", "autopilot")]


def test_a_failed_scan_unplugs_nothing():
    desk, watch = watched()
    desk.plug_board(*PIXHAWK_6C)
    pad = desk.plug_pad(0x054C, 0x05C4)
    watch.poll()
    for bus in (desk.usb, desk.ports, desk.hid):
        bus.error = OSError("busy")
    assert watch.poll() == []
    for bus in (desk.usb, desk.ports, desk.hid):
        bus.error = None
    assert watch.poll() == []
    desk.unplug(pad)
    assert names(watch.poll()) == [("Unplugged", "gamepad")]
