"""Sticks to MANUAL_CONTROL: the rate, the dead-man switch, and every loss of the pilot's input."""

import pytest

from firmware_bridge.autopilots.ardupilot.firmware import ARDUPILOT
from firmware_bridge.autopilots.px4.firmware import PX4
from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import message_class, pack, unpack
from firmware_bridge.devices.mock_bus import MockDesk
from firmware_bridge.manual.axes import Axis, StickMapping
from firmware_bridge.manual.hid_gamepad import open_gamepad
from firmware_bridge.manual.manual_control import (
    Buttons,
    Control,
    ManualControlSource,
    buttons_of,
)
from firmware_bridge.manual.sticks import ManualControlError, StickLost, Sticks, StickState
from firmware_bridge.mock_pixhawk.modes import Mode
from tests.worlds import hid_descriptors as hid
from tests.worlds.mock_pixhawk_world import World, texts

TICK_NS = 4_000_000
FORWARD = Sticks(0.5, 0.0, 0.0, 0.0)


class Pilot:
    """A manual-control device driven by the test."""

    name = "pilot"

    def __init__(self):
        self.state = StickState(FORWARD, True, frozenset())
        self.lost = False
        self.polls = 0
        self.closed = 0

    def poll(self):
        self.polls += 1
        if self.lost:
            raise StickLost("pilot: unplugged")
        return self.state

    def close(self):
        self.closed += 1

    def hold(self, held=True, *pressed):
        self.state = StickState(FORWARD, held, frozenset(pressed))


class Bench:
    """Runs a source tick by tick and keeps what it sent."""

    def __init__(self, source, tick_ns=TICK_NS):
        self.source, self.tick_ns, self.tick = source, tick_ns, 0
        self.parser = FrameParser()
        self.autopilot = FrameEncoder(1, 1)
        self.inbox = []

    def answer(self, command, result, target=(255, 25)):
        ack = message_class("COMMAND_ACK")(command, result, 0, 0, *target)
        self.inbox += FrameParser().feed(self.autopilot.frame(ack.MSGID, pack(ack)))

    def run(self, seconds):
        """Return [(t_ns, message)] sent in `seconds`."""
        sent = []
        for _ in range(round(seconds * 1e9 / self.tick_ns)):
            frames, self.inbox = self.inbox, []
            t_ns = self.tick * self.tick_ns
            sent += [(t_ns, unpack(f)) for f in self.parser.feed(self.source.step(t_ns, frames))]
            self.tick += 1
        assert self.parser.lost == self.parser.garbage_bytes == 0
        return sent


def kinds(source):
    return [event.kind.removeprefix("manual_") for event in source.take_events()]


def sticks_sent(sent):
    return [(m.x, m.y, m.z, m.r) for _, m in sent if type(m).__name__ == "MANUAL_CONTROL"]


def commands_sent(sent):
    return [m for _, m in sent if type(m).__name__ == "COMMAND_LONG"]


@pytest.mark.parametrize("tick_hz", [25, 100, 250, 333, 1000])
@pytest.mark.parametrize("rate_hz", [5.0, 25.0, 50.0, 12.5])
def test_the_rate_is_exact_in_simulated_time_whatever_the_tick(rate_hz, tick_hz):
    pilot = Pilot()
    sent = Bench(ManualControlSource(pilot, rate_hz=rate_hz), tick_ns=10**9 // tick_hz).run(20.0)
    assert len(sticks_sent(sent)) == pytest.approx(20 * min(rate_hz, tick_hz), abs=1)
    assert pilot.polls == len(sticks_sent(sent))


def test_sticks_go_out_while_the_switch_is_held():
    source = ManualControlSource(Pilot(), target_sysid=7)
    sent = Bench(source).run(1.0)
    assert set(sticks_sent(sent)) == {(500, 0, 500, 0)}
    assert sent[0][1].target == 7
    assert (source.control, source.sent) == (Control.FLYING, 25)
    assert kinds(source) == ["flying"]
    assert source.take_events() == []


@pytest.mark.parametrize("state", [StickState(FORWARD, False, frozenset()), None])
def test_without_the_switch_or_before_the_device_has_said_anything_nothing_is_sent(state):
    pilot = Pilot()
    pilot.state = state
    source = ManualControlSource(pilot)
    assert Bench(source).run(3.0) == []
    assert kinds(source) == []


@pytest.mark.parametrize("neutral_s", [0.0, 0.5, 1.0])
def test_letting_go_centres_the_sticks_for_a_while_and_then_is_silent(neutral_s):
    pilot = Pilot()
    source = ManualControlSource(pilot, neutral_s=neutral_s)
    bench = Bench(source)
    bench.run(1.0)
    pilot.hold(False)
    sent = bench.run(3.0)
    assert set(sticks_sent(sent)) <= {(0, 0, 500, 0)}
    assert len(sent) == round(25 * neutral_s + 0.01)  # at 25 Hz; 12.5 is 13: the first goes out at once
    assert source.control is Control.SILENT
    assert kinds(source) == ["flying", "released", "silent"]


def test_pressing_again_flies_again_from_both_states():
    pilot = Pilot()
    source = ManualControlSource(pilot)
    bench = Bench(source)
    for pause in (0.2, 2.0):
        bench.run(0.4)
        pilot.hold(False)
        bench.run(pause)
        pilot.hold()
        assert set(sticks_sent(bench.run(0.4))) == {(500, 0, 500, 0)}
    assert kinds(source) == ["flying", "released", "flying", "released", "silent", "flying"]


def test_losing_the_device_centres_the_sticks_then_is_silent_and_closes_it():
    pilot = Pilot()
    source = ManualControlSource(pilot)
    bench = Bench(source)
    bench.run(1.0)
    pilot.lost = True
    sent = bench.run(3.0)
    assert set(sticks_sent(sent)) == {(0, 0, 500, 0)}
    assert len(sent) == 13
    assert pilot.closed == 1
    assert kinds(source) == ["flying", "lost", "silent"]
    source.close()
    assert pilot.closed == 1


def test_losing_an_idle_device_sends_nothing():
    pilot = Pilot()
    pilot.hold(False)
    source = ManualControlSource(pilot)
    bench = Bench(source)
    bench.run(0.2)
    pilot.lost = True
    assert bench.run(2.0) == []
    assert kinds(source) == ["lost"]


def test_a_device_that_comes_back_with_the_switch_held_flies_only_after_letting_go():
    pilot, second = Pilot(), Pilot()
    asked = []

    def reopen():
        asked.append(1)
        if len(asked) < 3:
            raise StickLost("not yet")
        return second

    source = ManualControlSource(pilot, reopen=reopen, retry_s=1.0)
    bench = Bench(source)
    bench.run(0.2)
    pilot.lost = True
    bench.run(5.0)
    assert len(asked) == 3  # once a simulated second, and no more once it is there
    assert source.control is Control.SILENT
    assert kinds(source) == ["flying", "lost", "silent", "found"]
    second.hold(False)
    bench.run(0.1)
    second.hold()
    assert sticks_sent(bench.run(0.2))
    assert kinds(source) == ["flying"]


def test_an_unusable_device_is_reported_once_and_may_be_replaced():
    pilot = Pilot()
    offered = [ManualControlError("no sticks"), ManualControlError("no sticks"), pilot]

    def reopen():
        thing = offered.pop(0)
        if isinstance(thing, Exception):
            raise thing
        return thing

    source = ManualControlSource(None, reopen=reopen)
    assert sticks_sent(Bench(source).run(3.0))
    assert kinds(source) == ["unusable", "found", "flying"]


def test_a_device_may_come_later():
    pilot = Pilot()
    there = []
    source = ManualControlSource(None, reopen=lambda: there[0] if there else None)
    bench = Bench(source)
    assert bench.run(2.0) == []
    there.append(pilot)
    assert sticks_sent(bench.run(2.0))
    assert kinds(source) == ["found", "flying"]
    assert Bench(ManualControlSource(None)).run(1.0) == []


# -- buttons ------------------------------------------------------------------------------------------------------

BUTTONS = Buttons(arm=1, disarm=2, modes={3: "position", 4: "return"})


def with_buttons(**options):
    pilot = Pilot()
    source = ManualControlSource(pilot, buttons=BUTTONS, **{"modes": PX4.manual_modes, **options})
    bench = Bench(source)
    bench.run(0.2)
    source.take_events()
    return pilot, source, bench


@pytest.mark.parametrize(
    ("button", "command", "params"),
    [(1, 400, (1, 0, 0)), (2, 400, (0, 0, 0)), (3, 176, (1, 3, 0)), (4, 176, (1, 4, 5))],
)
def test_a_button_is_one_command_however_long_it_is_held(button, command, params):
    pilot, source, bench = with_buttons()
    pilot.hold(True, button)
    (sent,) = commands_sent(bench.run(0.5))
    assert (sent.command, sent.param1, sent.param2, sent.param3) == (command, *params)
    assert (sent.target_system, sent.target_component, sent.confirmation) == (1, 1, 0)
    bench.answer(command, 0)
    assert commands_sent(bench.run(5.0)) == []
    assert kinds(source) == ["button", "done"]


@pytest.mark.parametrize(("button", "sticks_before"), [(3, 8), (4, 0), (1, 0), (2, 0)])
def test_a_mode_flown_by_sticks_is_requested_once_they_have_come_and_all_else_at_once(button, sticks_before):
    pilot = Pilot()
    source = ManualControlSource(pilot, buttons=BUTTONS, modes=PX4.manual_modes, rate_hz=25.0)
    pilot.hold(False)
    bench = Bench(source)
    bench.run(0.2)
    pilot.hold(True, button)
    names = [type(m).__name__ for _, m in bench.run(0.5)]
    assert names.count("COMMAND_LONG") == 1
    assert names.index("COMMAND_LONG") == sticks_before


def test_a_waiting_button_is_forgotten_when_the_switch_is_released():
    pilot = Pilot()
    source = ManualControlSource(pilot, buttons=BUTTONS, modes=PX4.manual_modes)
    bench = Bench(source)
    pilot.hold(True, 3)
    assert commands_sent(bench.run(0.1)) == []
    pilot.hold(False)
    bench.run(0.1)
    pilot.hold(True)
    assert commands_sent(bench.run(2.0)) == []


def test_ardupilot_modes_are_numbers_of_their_own():
    pilot, _, bench = with_buttons(modes=ARDUPILOT.manual_modes)
    pilot.hold(True, 4)
    (sent,) = commands_sent(bench.run(0.5))
    assert (sent.param1, sent.param2, sent.param3) == (1, 6, 0)


def test_px4_modes_are_px4s_own_numbers():
    assert PX4.manual_modes["position"] == (Mode.POSCTL.value.main, Mode.POSCTL.value.sub)
    assert PX4.manual_modes["altitude"] == (Mode.ALTCTL.value.main, Mode.ALTCTL.value.sub)
    assert PX4.manual_modes["hold"] == (Mode.LOITER.value.main, Mode.LOITER.value.sub)
    assert PX4.manual_modes["takeoff"] == (Mode.TAKEOFF.value.main, Mode.TAKEOFF.value.sub)


def test_buttons_do_nothing_while_the_switch_is_not_held_nor_by_being_held_when_it_is_pressed():
    pilot, source, bench = with_buttons()
    pilot.hold(False)
    bench.run(0.1)
    pilot.hold(False, 1)
    assert commands_sent(bench.run(0.5)) == []
    pilot.hold(True, 1)
    assert commands_sent(bench.run(0.5)) == []
    pilot.hold(True)
    bench.run(0.1)
    pilot.hold(True, 1)
    assert len(commands_sent(bench.run(0.5))) == 1
    assert source.control is Control.FLYING


def test_disarming_wins_when_several_are_pressed_at_once():
    pilot, _, bench = with_buttons()
    pilot.hold(True, 1, 2, 3)
    assert [(m.command, m.param1) for m in commands_sent(bench.run(0.5))] == [(400, 0)]


def test_an_answer_that_does_not_come_is_waited_for_three_times():
    pilot, source, bench = with_buttons()
    pilot.hold(True, 1)
    assert [m.confirmation for m in commands_sent(bench.run(6.0))] == [0, 1, 2]
    assert kinds(source) == ["button", "refused"]


def test_refusals_are_reported_and_answers_to_others_are_ignored():
    pilot, source, bench = with_buttons()
    pilot.hold(True, 1)
    bench.run(0.1)
    bench.answer(400, 0, target=(255, 190))  # the ground station's
    bench.answer(176, 0)
    bench.answer(400, 5)  # in progress
    bench.run(2.0)
    assert kinds(source) == ["button"]
    bench.answer(400, 1)
    bench.run(0.1)
    (event,) = source.take_events()
    assert (event.kind, "TEMPORARILY_REJECTED" in event.text) == ("manual_refused", True)


def test_letting_go_cancels_a_waiting_command():
    pilot, _, bench = with_buttons()
    pilot.hold(True, 1)
    bench.run(0.1)
    pilot.hold(False)
    assert commands_sent(bench.run(5.0)) == []


@pytest.mark.parametrize(
    "options",
    [
        {"rate_hz": 0.0},
        {"rate_hz": 1000.0},
        {"rate_hz": float("nan")},
        {"neutral_s": -1.0},
        {"retry_s": 0.0},
        {"buttons": Buttons(modes={1: "sideways"})},
    ],
)
def test_invalid_settings_are_refused(options):
    with pytest.raises(ManualControlError):
        ManualControlSource(Pilot(), **options)


# -- flown --------------------------------------------------------------------------------------------------------

DEAD_MAN, ARM, POSITION = 5, 10, 9


def test_a_mock_gamepad_flies_the_mock_autopilot_and_is_pulled_out_in_flight():
    """Arm, climb, fly north and yaw by hand; then unplug: sticks centre, then silence, then the failsafe."""
    desk = MockDesk()
    pad = desk.plug_pad(0x1234, 1, product="Pad", descriptor=hid.SIMPLE)
    mapping = StickMapping(
        throttle=Axis("y", inverted=True),
        yaw=Axis("x"),
        pitch=Axis("rz", inverted=True),
        roll=Axis("z"),
        dead_man=DEAD_MAN,
        arm=ARM,
        modes={POSITION: "position"},
    )
    pad_in_hand = open_gamepad(hid=desk.hid, mapping=mapping)
    source = ManualControlSource(pad_in_hand, buttons=buttons_of(mapping), modes=PX4.manual_modes)
    world = World(params=["NAV_RCL_ACT=3"])  # lost sticks: land
    world.extra = source.step
    world.run(5.0)
    assert source.sent == 0

    pad.report(hid.simple_report(128, 128, 128, 128, DEAD_MAN, POSITION))
    world.run(0.5)
    pad.report(hid.simple_report(128, 128, 128, 128, DEAD_MAN, ARM))
    frames = world.run(0.5)
    assert world.autopilot.vehicle.mode is Mode.POSCTL
    assert world.autopilot.vehicle.armed, texts(frames)

    pad.report(hid.simple_report(128, 0, 128, 128, DEAD_MAN))  # full climb
    world.run(4.0)
    pad.report(hid.simple_report(128, 128, 128, 128, DEAD_MAN))
    world.run(2.0)
    east, north, up = world.truth.p_WB
    assert up > 3.0
    pad.report(hid.simple_report(128, 128, 128, 64, DEAD_MAN))  # right stick half forward
    world.run(3.0)
    gone_east, gone_north = world.truth.p_WB[0] - east, world.truth.p_WB[1] - north
    w, x, y, z = world.truth.q_WB
    nose_east, nose_north = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z)
    forward = gone_east * nose_east + gone_north * nose_north
    assert forward > 3.0
    assert abs(gone_east * nose_north - gone_north * nose_east) < 0.1 * forward

    events = source.take_events()
    assert [e.kind for e in events if e.kind != "manual_button"] == ["manual_flying", "manual_done", "manual_done"]
    desk.unplug(pad)
    sent = source.sent
    frames = world.run(3.0)
    assert 12 <= source.sent - sent <= 14
    assert [e.kind for e in source.take_events()] == ["manual_lost", "manual_silent"]
    assert any("manual control lost" in text for text in texts(frames))
    assert world.autopilot.vehicle.mode is Mode.LAND
    world.run_until(lambda w: not w.autopilot.vehicle.armed, 40.0)
