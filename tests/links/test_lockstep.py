"""The lockstep link against a scripted autopilot: in memory and over a pty."""

import dataclasses
import random
import sys

import pytest
from pymavlink.dialects.v20 import common

from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.mavlink_frame import MAX_FRAME_LENGTH, FrameParser
from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.links.autopilot_link import InvalidControls, LinkCaps, TickSamples
from firmware_bridge.links.child_process import ChildProcess
from firmware_bridge.links.px4 import lockstep
from firmware_bridge.links.px4.lockstep import LockstepLink
from firmware_bridge.transports.loopback import LoopbackTransport
from firmware_bridge.transports.pty import PtyTransport
from signals.errors import HandshakeError, LockstepLost
from signals.samples import DifferentialPressureSample
from tests.worlds import scripted_autopilot as fake
from tests.worlds.patience import PATIENCE_S, PATIENT, SILENCE_S, expect_silence, let_arrive
from tests.worlds.resting_vehicle import BARO, GPS, IMU, MAG

TICK_NS = 4_000_000
BOOT = 3
CAPS = LinkCaps("fake", lockstep=True, deterministic=True, boot_sensors=BOOT)
ACTUATORS = MSGID["HIL_ACTUATOR_CONTROLS"]


def in_memory(**script):
    return LockstepLink(LoopbackTransport(fake.FakeAutopilot(boot_sensors=BOOT, **script)), CAPS, timeouts=PATIENT)


def over_pty(*arguments):
    transport = PtyTransport()

    def start():
        argv = [sys.executable, fake.__file__, "--port", transport.far_path, "--boot-sensors", str(BOOT), *arguments]
        return ChildProcess(argv)

    return LockstepLink(transport, CAPS, start_process=start, timeouts=PATIENT)


@pytest.fixture(params=["memory", "pty"])
def scripted(request):
    """Yield a function that opens a link to an autopilot with the given fault; close it at the end."""
    links = []

    def make(fault="", at=5):
        if request.param == "memory":
            link = in_memory(fault=fault, at=at)
        else:
            link = over_pty("--fault", fault, "--at", str(at))
        links.append(link)
        link.open()
        return link

    yield make
    for link in links:
        link.close()


def fly(link, ticks, first=0, extra=b""):
    """Drive `ticks` ticks; return (bytes sent, answers, frames) per tick."""
    log = []
    for tick in range(first, first + ticks):
        t_ns = tick * TICK_NS
        sent = link.send(tick, t_ns, TickSamples(IMU, MAG, BARO, GPS if tick % 25 == 0 else None), extra)
        answer = link.wait(tick, t_ns)
        log.append((sent, answer, link.take_frames()))
    return log


def test_one_answer_to_each_sensor_after_boot(scripted):
    log = fly(link := scripted(), 50)
    assert [answer is None for _, answer, _ in log] == [True] * BOOT + [False] * (50 - BOOT)
    for tick, (_, answer, frames) in enumerate(log[BOOT:], BOOT):
        assert (answer.tick, answer.t_ns) == (tick, tick * TICK_NS)
        assert answer.controls[0] == pytest.approx((tick - BOOT + 1) / 1000, abs=1e-6)
        assert answer.armed
        assert frames[-1].msgid == ACTUATORS
    stats = link.stats
    assert (stats.steps, stats.late, stats.bad_crc, stats.garbage_bytes, stats.lost_frames) == (50, 0, 0, 0, 0)
    assert stats.rtt.count == 50 - BOOT
    assert stats.tx_bytes == sum(len(sent) for sent, _, _ in log)


def test_bytes_received_at_boot_are_kept_for_the_first_tick(scripted):
    log = fly(scripted(), 1)
    assert [frame.msgid for frame in log[0][2]] == [MSGID["COMMAND_LONG"], MSGID["HEARTBEAT"]]


def test_one_write_holds_extra_then_gps_then_sensor(scripted):
    link = scripted()
    sent = link.send(0, 0, TickSamples(IMU, MAG, BARO, GPS), b"extra")
    assert sent.startswith(b"extra\xfd")
    assert [f.msgid for f in FrameParser().feed(sent)] == [MSGID["HIL_GPS"], MSGID["HIL_SENSOR"]]


@pytest.mark.parametrize("taken", [True, False])
def test_the_temperature_of_a_pitot_is_kept_for_an_autopilot_that_takes_it_for_the_airs(taken):
    """PX4 makes true airspeed of it; the pitot's samples and the barometer's come in different ticks."""
    caps = dataclasses.replace(CAPS, air_temperature=taken)
    link = LockstepLink(LoopbackTransport(fake.FakeAutopilot(boot_sensors=BOOT)), caps)
    link.open()
    pitots = [[], [DifferentialPressureSample(0, 0, 0, 200.0, 11.5)], [], [], []]
    degc = []
    for tick, others in enumerate(pitots):
        sent = link.send(tick, tick * TICK_NS, TickSamples(IMU, MAG, BARO, None, others), b"")
        link.wait(tick, tick * TICK_NS)
        (sensor,) = FrameParser().feed(sent)
        degc.append(common.MAVLink(None).decode(bytearray(sensor.raw)).temperature)
    link.close()
    own = BARO.temperature_degc
    assert degc == pytest.approx([own] + 4 * [11.5] if taken else 5 * [own])


def test_memory_and_pty_carry_the_same_bytes():
    logs = []
    for link in (in_memory(), over_pty()):
        link.open()
        try:
            logs.append([(sent, answer, [f.raw for f in frames]) for sent, answer, frames in fly(link, 60)])
        finally:
            link.close()
    assert logs[0] == logs[1]


@pytest.mark.parametrize("fault", ["garbage_between", "trailing", "damaged_length"])
def test_bytes_that_are_no_answer_do_not_end_a_run(scripted, fault):
    link = scripted(fault)
    log = fly(link, 30)
    assert all(answer is not None for _, answer, _ in log[BOOT:])
    if fault == "trailing":
        # After the answer: belongs to the next tick.
        assert [f.msgid for f in log[BOOT + 4][2]][-1] == ACTUATORS
        assert log[BOOT + 5][2][0].msgid == MSGID["HEARTBEAT"]
    else:
        assert link.stats.garbage_bytes > 0


@pytest.mark.parametrize(
    ("fault", "error", "says"),
    [
        ("wrong_time", LockstepLost, "time_usec 28000, its answer 32000"),
        ("old_time", LockstepLost, "28000, its answer 24000"),
        ("silent", LockstepLost, "no bytes came"),
        ("telemetry_only", LockstepLost, "telemetry came .1 messages. but no HIL_ACTUATOR_CONTROLS"),
        ("garbage_only", LockstepLost, "damaged"),
        ("damaged", LockstepLost, "no answer to time_usec 28000"),
        ("nan", InvalidControls, "nan"),
        ("range", InvalidControls, "1.5"),
    ],
)
def test_errors_that_end_a_run_name_the_cause(scripted, fault, error, says):
    link = scripted(fault)
    fly(link, BOOT + 4)
    tick = BOOT + 4
    link.send(tick, tick * TICK_NS, TickSamples(IMU, MAG, BARO), b"")
    if fault != "silent":
        let_arrive(link)
    expect_silence(link)
    with pytest.raises(error, match=says):
        link.wait(tick, tick * TICK_NS)


def test_a_second_answer_ends_the_next_tick(scripted):
    link = scripted("twice")
    fly(link, BOOT + 5)
    with pytest.raises(LockstepLost, match="late, or twice"):
        fly(link, 1, first=BOOT + 5)


@pytest.fixture
def hold_after_s(monkeypatch):
    """Return a function that sets how long a link waits before it holds a command; at first it does not hold any."""

    def hold(limit_s):
        monkeypatch.setattr(lockstep, "_HOLD_S", limit_s)

    hold(PATIENCE_S)
    return hold


@pytest.fixture
def uneven(hold_after_s):
    """Yield a function that opens a link to one that may answer a tick twice or not at all, as PX4's VTOLs do."""
    links = []

    def make(fault):
        transport = PtyTransport()

        def start():
            options = ["--boot-sensors", str(BOOT), "--fault", fault]
            return ChildProcess([sys.executable, fake.__file__, "--port", transport.far_path, *options])

        caps = dataclasses.replace(CAPS, uneven_answers=True)
        links.append(LockstepLink(transport, caps, start_process=start, timeouts=PATIENT))
        links[0].open()
        return links[0]

    yield make
    links[0].close()


def test_a_second_answer_is_left_out_where_the_autopilot_may_give_one(uneven):
    log = fly(link := uneven("twice"), 30)
    assert all(answer is not None for _, answer, _ in log[BOOT:])
    assert (link.stats.repeated, link.stats.unanswered) == (1, 0)


@pytest.mark.parametrize("fault", ["damaged", "silent"])
def test_a_tick_without_an_answer_holds_the_command_where_the_autopilot_may_leave_one_out(uneven, hold_after_s, fault):
    link = uneven(fault)
    log = fly(link, BOOT + 4)
    hold_after_s(SILENCE_S)
    log += fly(link, 1, first=BOOT + 4)
    hold_after_s(PATIENCE_S)
    log += fly(link, 25 - BOOT, first=BOOT + 5)
    answers = [answer for _, answer, _ in log[BOOT:]]
    assert answers[4].controls == answers[3].controls
    assert answers[4].tick == answers[3].tick + 1
    assert (link.stats.repeated, link.stats.unanswered) == (0, 1)


def test_an_autopilot_that_leaves_out_more_than_single_ticks_is_lost(uneven, hold_after_s):
    link = uneven("hang")
    fly(link, BOOT + 4)
    hold_after_s(SILENCE_S)
    expect_silence(link, 2 * SILENCE_S)
    with pytest.raises(LockstepLost, match="no bytes came"):
        fly(link, 30, first=BOOT + 4)
    assert link.stats.unanswered == 3


def test_a_wrong_boot_length_in_the_rig_is_named():
    early = LockstepLink(LoopbackTransport(fake.FakeAutopilot(boot_sensors=1)), CAPS, timeouts=PATIENT)
    early.open()
    with pytest.raises(LockstepLost, match="boot_sensors"):
        fly(early, 10)
    late = LockstepLink(LoopbackTransport(fake.FakeAutopilot(boot_sensors=9)), CAPS, timeouts=PATIENT)
    late.open()
    with pytest.raises(LockstepLost, match="boot_sensors"):
        fly(late, 10)


def test_a_sample_of_nan_is_never_sent(scripted):
    link = scripted()
    with pytest.raises(CodecError, match="accel"):
        link.send(0, 0, TickSamples(IMU._replace(accel_mps2=(float("nan"), 0.0, 0.0)), MAG, BARO), b"")
    assert link.stats.steps == 0


def test_an_open_link_can_be_closed_and_opened_again():
    link = over_pty()
    for _ in range(2):
        link.open()
        assert fly(link, 10)[-1][1] is not None
        process = link._process
        link.close()
        link.close()
        assert not process.running()


def test_a_missing_heartbeat_in_memory_is_named():
    link = in_memory(greet=False)
    with pytest.raises(HandshakeError, match="no bytes came at all"):
        link.open()


def test_fifty_thousand_invalid_packets_between_answers():
    """Noise, damaged copies and false headers around every answer are counted, not fatal, and not kept."""
    rng = random.Random(11)

    class Noisy(fake.FakeAutopilot):
        def sensor(self, time_us):
            answer = super().sensor(time_us)
            return b"".join(map(self.rubbish, range(5))) + answer + b"".join(map(self.rubbish, range(5)))

        def rubbish(self, _):
            damaged = bytearray(self.frame(fake.Attitude(1, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0)))
            damaged[rng.randrange(1, len(damaged))] ^= 1 << rng.randrange(8)
            return rng.choice(
                [rng.randbytes(rng.randrange(40)), bytes(damaged), b"\xfd\xff\x00\x00\x07\x01\x01\x1e\0\0"]
            )

    link = LockstepLink(LoopbackTransport(Noisy(boot_sensors=BOOT)), CAPS, timeouts=PATIENT)
    link.open()
    ticks = 5_000
    for tick in range(ticks):
        link.send(tick, tick * TICK_NS, TickSamples(IMU), b"")
        answer = link.wait(tick, tick * TICK_NS)
        assert (answer is None) == (tick < BOOT)
        link.take_frames()
    stats = link.stats
    assert stats.rtt.count == ticks - BOOT
    assert stats.garbage_bytes > 50_000
    assert link._parser.pending < MAX_FRAME_LENGTH
    assert link._held == []
    link.close()
