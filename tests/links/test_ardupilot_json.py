"""The ArduPilot JSON link against a scripted SITL over real sockets.

Most tests take turns in one thread: the link sends, the fake steps, the link waits. Where the link has to act while it
waits, the fake runs in a thread of its own.
"""

import math
import re
import socket
import threading
import time

import pytest

from firmware_bridge.codecs.ardupilot_json import ServoPacket, hover_throttle
from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, message_class, pack
from firmware_bridge.links.ardupilot_json import ArduPilotJsonLink, RestartRequested
from firmware_bridge.links.ardupilot_mavlink import MavlinkSide
from firmware_bridge.links.ardupilot_sitl import (
    DEFAULTS_PATH,
    SPIN_MAX,
    SPIN_MIN,
    ardupilot_sitl,
    copter_parameters,
    write_defaults,
)
from firmware_bridge.transports.tcp import TcpClient
from firmware_bridge.transports.udp import UdpInbox, UdpTransport
from hil.signals.errors import HandshakeError, LinkClosed, LinkError, LockstepLost, PortNotFound
from hil.signals.samples import RangeSample
from tests.links.ardupilot_packets import encode_servos
from tests.links.drive import IMU, Process, truth_at

TICK_NS = 2_500_000
LOOPBACK = "127.0.0.1"
OFF = (1000,) * 16
HOVER = (1600, 1601, 1602, 1603) + (0,) * 12
Heartbeat = message_class("HEARTBEAT")
StatusText = message_class("STATUSTEXT")
Command = message_class("COMMAND_LONG")


def truth(tick, **changes):
    return truth_at(tick * TICK_NS, tick, **({"p_WB": (10.0, 20.0, 0.25 + tick)} | changes))


def beat(base_mode):
    return Heartbeat(type=2, autopilot=3, base_mode=base_mode, custom_mode=0, system_status=3, mavlink_version=3)


class Sitl:
    """SITL's end: asks, takes one datagram an answer, asks again."""

    def __init__(self, *, frame_rate=1200, first=0):
        self.servo = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.servo.bind((LOOPBACK, 0))
        self.servo.settimeout(10.0)
        self.mavlink = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.mavlink.bind((LOOPBACK, 0))
        self.mavlink.setblocking(False)
        self.encoder = FrameEncoder(1, 1)
        self.to = self.mavlink_to = None
        self.count, self.rate, self.pwm = first, frame_rate, OFF
        self.taken = []

    def attach(self, inbox, side):
        """What starts it, once the link's sockets are open."""

        def start():
            self.to = (LOOPBACK, inbox.port)
            self.mavlink_to = None if side is None or side.udp_port is None else (LOOPBACK, side.udp_port)
            return Process(lambda: self.ask())

        return start

    def ask(self, **changes):
        packet = ServoPacket(self.rate, self.count, self.pwm)._replace(**changes)
        self.servo.sendto(encode_servos(packet), self.to)

    def take(self):
        """The oldest answer, as text, and the step it allows."""
        self.taken.append(self.servo.recv(65536).decode())
        self.count += 1
        return self.taken[-1]

    def step(self):
        self.take()
        self.ask()

    def unread(self):
        """Answers that were not asked for."""
        self.servo.setblocking(False)
        found = []
        try:
            while True:
                found.append(self.servo.recv(65536))
        except BlockingIOError:
            return found
        finally:
            self.servo.settimeout(10.0)

    def reboot(self):
        """A new instance on a new port, numbers from 0."""
        other = Sitl(frame_rate=self.rate)
        other.to, other.mavlink_to = self.to, self.mavlink_to
        return other

    def say(self, message):
        self.mavlink.sendto(self.encoder.frame(message.MSGID, pack(message)), self.mavlink_to)

    def heard(self):
        """MAVLink frames that came so far."""
        data = b""
        try:
            while True:
                data += self.mavlink.recv(65536)
        except BlockingIOError:
            return FrameParser().feed(data)

    def close(self):
        self.servo.close()
        self.mavlink.close()


@pytest.fixture
def sitl():
    made = Sitl()
    yield made
    made.close()


@pytest.fixture
def make(sitl):
    """Makes links to `sitl`, opened, and closes them."""
    links = []

    def build(*, far=sitl, mavlink=True, **settings):
        settings = {"reply_limit_s": 5.0, "boot_limit_s": 5.0} | settings
        side = MavlinkSide(UdpTransport(0)) if mavlink else None
        inbox, events = UdpInbox(0), []
        link = ArduPilotJsonLink(
            inbox,
            side,
            start_process=far.attach(inbox, side),
            on_event=lambda kind, text: events.append((kind, text)),
            **settings,
        )
        link.events = events
        links.append(link)
        link.open()
        return link

    yield build
    for link in links:
        link.close()


def send(link, tick, imu=IMU, extra=b"", **changes):
    link.observe(truth(tick, **changes))
    return link.send(tick, tick * TICK_NS, imu, None, None, None, extra)


def fly(link, sitl, ticks, start=0):
    for tick in range(start, start + ticks):
        send(link, tick)
        sitl.step()
        frame = link.wait(tick, tick * TICK_NS)
        assert (frame.tick, frame.t_ns) == (tick, tick * TICK_NS)
    return frame


def value(text, key):
    return [float(x) for x in re.search(rf'"{key}":\[?([-+.\de,]+)', text)[1].strip(",").split(",")]


def command(number):
    return FrameEncoder(255, 190).frame(
        MSGID["COMMAND_LONG"], pack(Command(1, 1, number, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    )


def test_one_packet_one_answer(make, sitl):
    link = make()
    sitl.pwm = HOVER
    frame = fly(link, sitl, 50)
    assert sitl.unread() == []
    assert frame.controls == (0.6, 0.601, 0.602, 0.603) + (0.0,) * 12
    stats = link.stats
    assert (stats.steps, stats.rtt.count) == (50, 50)
    assert (stats.repeats, stats.answered_again, stats.unasked_steps, stats.stale, stats.junk) == (0,) * 5
    assert stats.rx_bytes == 51 * 40
    assert (stats.frame_rate_hz, stats.channels) == (1200, 16)
    assert link.caps.lockstep
    assert link.caps.takes_truth
    assert link.caps.boot_sensors == 0


def test_answer_is_truth_from_home_with_the_imus_values(make, sitl):
    link = make()
    fly(link, sitl, 1)
    data = send(link, 1, p_WB=(13.0, 24.0, 5.25), v_WB_W=(1.0, 2.0, 3.0))
    sitl.step()
    assert sitl.taken[-1].encode() == data
    text = sitl.taken[-1]
    assert value(text, "position") == [4.0, 3.0, -5.0]
    assert value(text, "velocity") == [2.0, 1.0, -3.0]
    assert value(text, "accel_body") == [0.5, -0.25, -9.75]
    assert value(text, "gyro") == [0.125, -0.25, -0.5]
    assert value(text, "timestamp")[0] == pytest.approx(0.0025, rel=1e-6)
    assert "rng_1" not in text
    assert "airspeed" not in text


def test_an_imu_slower_than_the_tick_is_held_and_before_its_first_sample_truth_stands_in(make, sitl):
    link = make(mavlink=False)
    samples = [None, IMU, None, IMU._replace(accel_mps2=(0.0, 0.0, 9.5))]
    for tick, imu in enumerate(samples):
        send(link, tick, imu=imu)
        sitl.step()
        link.wait(tick, tick * TICK_NS)
    assert [value(text, "accel_body")[2] for text in sitl.taken] == [-9.80665, -9.75, -9.75, -9.5]


def test_range_finder_is_sent_from_its_first_sample_on(make, sitl):
    link = make()
    sample = RangeSample(0, 0, 0, 1.25, 0.1, 12.0, 0.01, 100)
    for tick, ranging in enumerate([(), (sample,), ()]):
        link.observe(truth(tick))
        link.send(tick, tick * TICK_NS, IMU, None, None, None, b"", ranging)
        sitl.step()
        link.wait(tick, tick * TICK_NS)
    assert ["rng_1" in text for text in sitl.taken] == [False, True, True]
    assert value(sitl.taken[2], "rng_1") == [1.25]


def test_the_wind_is_told_only_where_asked_for(make, sitl):
    link = make(tells_wind=True)
    link.observe(truth(0, v_WB_W=(5.0, 0.0, 0.0)), (1.0, 2.0, 0.0))
    link.send(0, 0, IMU, None, None, None, b"")
    text = sitl.take()
    assert "windvane" in text
    assert "airspeed" not in text
    assert value(text, "velocity") == [0.0, 5.0, 0.0]


def test_truth_of_another_tick_is_refused(make):
    link = make()
    with pytest.raises(LockstepLost, match="observe"):
        link.send(0, 0, IMU, None, None, None, b"")
    link.observe(truth(3))
    with pytest.raises(LockstepLost, match="observe"):
        link.send(4, 4 * TICK_NS, IMU, None, None, None, b"")


def test_repeats_while_the_bench_was_away_get_one_answer(make, sitl):
    """A breakpoint, a paused bench: SITL has asked once a second, and steps once."""
    link = make()
    fly(link, sitl, 3)
    for _ in range(5):
        sitl.ask()
    fly(link, sitl, 4, start=3)
    assert sitl.unread() == []
    assert link.stats.repeats == 5
    assert link.stats.answered_again == 0


def test_a_repeat_that_crossed_the_answer_gets_none(make, sitl):
    link = make()
    send(link, 0)
    sitl.ask()  # left before the answer came
    sitl.step()
    link.wait(0, 0)
    fly(link, sitl, 3, start=1)
    assert sitl.unread() == []
    assert (link.stats.repeats, link.stats.answered_again) == (1, 0)


def test_a_lost_answer_is_sent_again_the_same_bytes_without_a_step(make, sitl):
    link = make()
    fly(link, sitl, 3)
    data = send(link, 3)
    assert len(sitl.unread()) == 1  # lost on the way

    def ask_until_answered():
        sitl.ask()
        sitl.step()

    thread = threading.Thread(target=ask_until_answered)
    thread.start()
    frame = link.wait(3, 3 * TICK_NS)
    thread.join()
    assert frame.tick == 3
    assert sitl.taken[-1].encode() == data
    assert sitl.unread() == []
    assert (link.stats.steps, link.stats.answered_again) == (4, 1)


def test_an_answer_too_many_is_used_up_at_once(make, sitl):
    """However it came about: SITL steps on it unasked, and the link answers the newest packet only."""
    link = make()
    fly(link, sitl, 3)
    data = send(link, 3)
    link._inbox.send(data, link._asker)
    sitl.step()
    sitl.step()
    link.wait(3, 3 * TICK_NS)
    fly(link, sitl, 5, start=4)
    assert sitl.unread() == []
    assert link.stats.unasked_steps == 1


def test_packets_of_the_past_get_no_answer(make, sitl):
    link = make()
    fly(link, sitl, 5)
    sitl.ask(frame_count=2)
    sitl.ask(frame_count=4)
    fly(link, sitl, 3, start=5)
    assert sitl.unread() == []
    assert link.stats.stale == 2


def test_junk_is_counted_and_gets_no_answer(make, sitl):
    link = make()
    fly(link, sitl, 2)
    stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    for data in (b"", b"hello", b"\xff" * 40, b"\0" * 72, bytes(60000)):
        stranger.sendto(data, sitl.to)
        sitl.servo.sendto(data, sitl.to)
    fly(link, sitl, 3, start=2)
    stranger.close()
    assert sitl.unread() == []
    assert link.stats.junk == 10


def test_thirty_two_channels_in_mid_flight_and_back(make, sitl):
    link = make()
    for start, pwm in ((0, HOVER), (4, HOVER + (1500,) * 16), (8, HOVER)):
        sitl.pwm = pwm
        frame = fly(link, sitl, 4, start=start)
        assert len(frame.controls) == 16
        assert frame.controls[:5] == (0.6, 0.601, 0.602, 0.603, 0.0)
        assert link.stats.channels == len(pwm)


def test_a_frame_count_that_wraps_goes_on(make, sitl):
    far = sitl
    link = make()
    fly(link, far, 1)
    link._asked = link._asked._replace(frame_count=2**32 - 2)
    far.count = 2**32 - 2
    send(link, 1)
    far.step()
    link.wait(1, TICK_NS)
    assert link.stats.steps == 2


def test_frames_that_are_missing_end_the_run(make, sitl):
    link = make()
    fly(link, sitl, 3)
    send(link, 3)
    sitl.take()
    sitl.ask(frame_count=sitl.count + 4)
    with pytest.raises(LockstepLost, match="frame count went from 3 to 8") as caught:
        link.wait(3, 3 * TICK_NS)
    assert caught.value.cause == "gap"


def test_a_second_autopilot_on_the_same_port_ends_the_run(make, sitl):
    link = make()
    fly(link, sitl, 3)
    other = sitl.reboot()
    other.ask(frame_count=1234)
    with pytest.raises(LockstepLost, match=r"second autopilot.*1234") as caught:
        send(link, 3)
    assert caught.value.cause == "second_autopilot"
    other.close()


@pytest.mark.parametrize("when", ["before", "after"])
def test_a_reboot_ends_a_mission(make, sitl, when):
    """Seen before our answer (it hung up, we were computing) and while we wait for its."""
    link = make()
    sitl.say(StatusText(0, b"Crash: Disarming", 0, 0))
    fly(link, sitl, 10)
    new = sitl.reboot()
    if when == "before":
        new.ask()
        with pytest.raises(LinkClosed, match=r"started again.*fell from 10 to 0.*Crash: Disarming") as caught:
            send(link, 10)
    else:
        send(link, 10)
        new.ask()
        with pytest.raises(LinkClosed, match="started again") as caught:
            link.wait(10, 10 * TICK_NS)
    assert caught.value.cause == "restarted"
    assert [kind for kind, _ in link.events] == ["restart"]
    assert new.unread() == []
    new.close()


def test_a_server_goes_along_with_reboots(make, sitl):
    link = make(on_restart="reset", mavlink=False, reply_limit_s=math.inf, boot_limit_s=math.inf)
    for _ in range(4):
        fly(link, sitl, 20)
        send(link, 20)
        old, sitl = sitl, sitl.reboot()
        old.ask()  # a last word of the old one, which gets nothing
        sitl.ask()
        with pytest.raises(RestartRequested, match=r"at 0\.050 s"):
            link.wait(20, 20 * TICK_NS)
        old.ask(frame_count=20)
        sitl.ask()
        assert len(old.unread()) == 1
        old.close()
    # Home is where the vehicle stands now, and time begins again.
    link.observe(truth(0, p_WB=(7.0, 7.0, 7.0)))
    link.send(0, 0, IMU, None, None, None, b"")
    text = sitl.take()
    assert value(text, "position") == [0.0, 0.0, 0.0]
    assert value(text, "timestamp") == [0.0]
    assert (link.stats.restarts, link.stats.stale) == (4, 4)
    sitl.close()


def test_a_reboot_on_the_same_source_port_is_one_too(make, sitl):
    link = make(on_restart="reset")
    fly(link, sitl, 7)
    sitl.count = 0
    sitl.ask()
    with pytest.raises(RestartRequested, match="fell from 7 to 0"):
        send(link, 7)
    fly(link, sitl, 3)
    assert sitl.unread() == []


def test_a_reboot_before_the_first_answer_is_nothing_to_speak_of(make, sitl):
    link = make()
    new = sitl.reboot()
    sitl.ask()
    new.ask()
    fly(link, new, 3)
    assert sitl.unread() == []
    assert link.stats.restarts == 0
    new.close()


def test_sitl_in_mid_flight_is_not_taken_over(sitl, make):
    sitl.count = 4711
    with pytest.raises(HandshakeError, match=r"4711.*start it again") as caught:
        make()
    assert caught.value.cause == "midflight"
    assert sitl.unread() == []


def test_words_go_before_the_state_and_telemetry_belongs_to_its_tick(make, sitl):
    link = make()
    sitl.say(beat(81))
    fly(link, sitl, 1)
    assert [frame.msgid for frame in link.take_frames()] == [MSGID["HEARTBEAT"]]
    data = send(link, 1, extra=command(400))
    assert data.startswith(command(400))
    sitl.take()
    # The state has come: what was said before it is there without waiting.
    assert [frame.msgid for frame in sitl.heard()] == [MSGID["COMMAND_LONG"]]
    sitl.say(beat(81 | 128))
    sitl.ask()
    frame = link.wait(1, TICK_NS)
    assert (frame.armed, frame.mode) == (True, 81 | 128)
    assert len(link.take_frames()) == 1
    assert link.take_frames() == []


def test_words_for_an_autopilot_not_heard_yet_wait_for_it(make, sitl):
    link = make()
    send(link, 0, extra=command(1))
    sitl.step()
    link.wait(0, 0)
    assert sitl.heard() == []
    sitl.say(beat(81))
    fly(link, sitl, 1, start=1)
    send(link, 2, extra=command(2))
    assert [frame.payload[28] for frame in sitl.heard()] == [1, 2]


def test_motors_that_turn_are_armed_before_the_next_heartbeat(make, sitl):
    link = make()
    sitl.say(beat(81))
    assert not fly(link, sitl, 1).armed
    sitl.pwm = HOVER
    frame = fly(link, sitl, 1, start=1)
    assert (frame.armed, frame.mode) == (True, 81 | 128)


def test_telemetry_is_read_while_waiting(make, sitl):
    """Before the answer has come: a SITL over TCP stands still if nobody reads, over UDP words would be lost."""
    link = make(reply_limit_s=60.0)
    fly(link, sitl, 1)
    send(link, 1)

    def talk():
        for i in range(1, 401):
            sitl.say(StatusText(6, b"word %d" % i, 0, 0))
            while i % 50 == 0 and link.stats.rx_frames < i:
                time.sleep(0.001)
        sitl.step()

    thread = threading.Thread(target=talk)
    thread.start()
    link.wait(1, TICK_NS)
    thread.join()
    assert len(link.take_frames()) == 400
    assert link.stats.lost_frames == 0


def test_words_over_tcp_and_again_after_a_reboot(sitl):
    """SITL's own way: it listens, and asks nothing before a client has come."""
    listener = socket.create_server((LOOPBACK, 0))
    inbox, side = UdpInbox(0), MavlinkSide(TcpClient(listener.getsockname()[1]))
    link = ArduPilotJsonLink(inbox, side, start_process=sitl.attach(inbox, side), on_restart="reset", boot_limit_s=5.0)
    asked = sitl.ask
    connections = []

    def wait_for_client_then_ask():
        connections.append(listener.accept()[0])
        asked()

    sitl.ask = lambda **changes: threading.Thread(target=wait_for_client_then_ask).start()
    try:
        link.open()
        sitl.ask = asked
        connections[0].sendall(sitl.encoder.frame(MSGID["HEARTBEAT"], pack(beat(81))))
        connections[0].setblocking(True)
        send(link, 0, extra=command(400))
        assert FrameParser().feed(connections[0].recv(4096))[0].msgid == MSGID["COMMAND_LONG"]
        sitl.step()
        link.wait(0, 0)
        connections.pop().close()
        new = sitl.reboot()
        new_asks = threading.Thread(target=lambda: (connections.append(listener.accept()[0]), new.ask()))
        new_asks.start()
        send(link, 1)
        with pytest.raises(RestartRequested):
            link.wait(1, TICK_NS)
        new_asks.join()
        fly(link, new, 3)
        new.close()
    finally:
        link.close()
        for connection in connections:
            connection.close()
        listener.close()


def test_silence_is_told_with_what_is_still_heard(make, sitl):
    link = make(reply_limit_s=0.6)
    fly(link, sitl, 2)
    sitl.say(StatusText(2, b"EKF variance", 0, 0))
    send(link, 2)
    sitl.ask()  # does not take the answer
    with pytest.raises(
        LockstepLost, match=r"repeats frame 2.*1 sent again.*MAVLink is still heard.*process still runs.*EKF variance"
    ) as caught:
        link.wait(2, 2 * TICK_NS)
    assert caught.value.cause == "silent"
    assert len(sitl.unread()) == 2


def test_a_process_that_ended_is_told_with_its_end(make, sitl):
    link = make(reply_limit_s=30.0)
    fly(link, sitl, 2)
    send(link, 2)
    link._process.alive = False
    with pytest.raises(LinkClosed, match=r"(?s)exit status 7.*Panic") as caught:
        link.wait(2, 2 * TICK_NS)
    assert caught.value.cause == "crashed"


def test_nothing_comes_at_all():
    link = ArduPilotJsonLink(UdpInbox(0), boot_limit_s=0.2)
    with pytest.raises(HandshakeError, match=r"nothing came at all.*--sim-port-out \d+"):
        link.open()


def test_frame_rate_that_follows_the_tick_is_no_matter(make, sitl):
    sitl.rate = 401
    link = make()
    fly(link, sitl, 1100)
    assert link.events == []


def test_frame_rate_that_stays_elsewhere_is_told_once(make, sitl):
    link = make(mavlink=False)
    for tick in range(2200):
        sitl.rate = max(600, 1200 - tick)  # walks by 1 Hz a packet
        fly(link, sitl, 1, start=tick)
    ((kind, text),) = link.events
    assert kind == "warning"
    assert "asks for 6" in text
    assert link.stats.frame_rate_hz == 600


def test_command_line(tmp_path):
    (tmp_path / "arducopter").touch()
    settings = {"binary": tmp_path / "arducopter", "folder": tmp_path, "instance": 2, "arguments": ["--rate", "400"]}
    link = ardupilot_sitl(home=(47.397742, 8.545594, 488.0, 90.0), **settings)
    link._inbox.open()
    link._mavlink.open()
    argv = link._start_process().argv
    link.close()
    pairs = dict(zip(argv[2::2], argv[3::2], strict=False))
    assert pairs["--model"] == "JSON:127.0.0.1"
    assert pairs["--sim-port-out"] == str(link._inbox.port)
    assert pairs["--instance"] == "2"
    assert pairs["--home"] == "47.397742000,8.545594000,488.0000,90.0000"
    assert pairs["--defaults"] == str(tmp_path / "bench.parm")
    assert pairs["--serial0"] == f"udpclient:127.0.0.1:{link._mavlink.udp_port}"
    assert pairs["--serial1"] == "none"
    assert "--serial3" not in pairs
    assert argv[-2:] == ["--rate", "400"]
    with pytest.raises(LinkError, match="home 0, 0"):
        ardupilot_sitl(home=(0.0, 0.0, 0.0, 0.0), **settings)._start_process()


@pytest.mark.parametrize(
    ("tick_hz", "loop_hz"), [(250, 125), (333, 166), (400, 200), (500, 250), (800, 400), (1000, 333), (1200, 400)]
)
def test_loop_rate_leaves_enough_gyro_samples_for_arming(tick_hz, loop_hz):
    parameters = copter_parameters(hover_control=0.598, thrust_model_factor=1.0, tick_hz=tick_hz)
    assert parameters["SCHED_LOOP_RATE"] == loop_hz
    assert parameters["SIM_RATE_HZ"] == tick_hz
    assert tick_hz >= 1.8 * loop_hz


def test_parameters_fit_the_vehicle(tmp_path):
    parameters = copter_parameters(
        hover_control=0.598, thrust_model_factor=1.0, tick_hz=400, more={"LOG_DISARMED": 1, "MOT_SPIN_ARM": 0.05}
    )
    assert parameters["MOT_THST_EXPO"] == pytest.approx(8 / 11, abs=1e-6)
    assert parameters["MOT_THST_HOVER"] == pytest.approx(
        hover_throttle(0.598, 1.0, spin_min=SPIN_MIN, spin_max=SPIN_MAX), abs=1e-6
    )
    text = write_defaults(tmp_path / "run" / "bench.parm", parameters).read_text()
    assert text.startswith(DEFAULTS_PATH.read_text())
    read = {}
    for line in text.splitlines():
        if line and not line.startswith("#"):
            name, number = line.split()
            read[name] = float(number)
    assert read["FRAME_CLASS"] == read["FRAME_TYPE"] == 1
    assert (read["MOT_SPIN_MIN"], read["MOT_SPIN_MAX"]) == (SPIN_MIN, SPIN_MAX)
    assert (read["LOG_DISARMED"], read["MOT_SPIN_ARM"]) == (1, 0.05)
    # Hover throttle beyond what ArduPilot allows is held at its end.
    assert copter_parameters(hover_control=0.9, thrust_model_factor=1.0, tick_hz=400)["MOT_THST_HOVER"] == 0.6875
    with pytest.raises(LinkError, match="too slow"):
        copter_parameters(hover_control=0.5, thrust_model_factor=1.0, tick_hz=90)


def test_wrong_settings_are_named(tmp_path):
    home = (47.0, 8.0, 488.0, 0.0)
    with pytest.raises(PortNotFound, match="no such program"):
        ardupilot_sitl(binary=tmp_path / "arducopter", folder=tmp_path, home=home)
    with pytest.raises(LinkError, match="`home`"):
        ardupilot_sitl(binary=tmp_path / "arducopter")
    for text in ("serial:1", "udp:", "udp:x", "tcp"):
        with pytest.raises(LinkError, match="udp:PORT, tcp:PORT or none"):
            ardupilot_sitl(mavlink=text)
    assert ardupilot_sitl(mavlink="none", instance=3)._inbox.port == 9032


def test_a_program_that_ends_at_once_is_told_with_its_last_words(tmp_path):
    program = tmp_path / "arducopter"
    program.write_text("#!/bin/sh\necho PANIC: no such frame\nexit 3\n")
    program.chmod(0o755)
    link = ardupilot_sitl(binary=program, folder=tmp_path / "run", home=(47.0, 8.0, 488.0, 0.0), boot_limit_s=20.0)
    with pytest.raises(LinkClosed, match=r"(?s)before its first.*exit status 3.*PANIC: no such frame") as caught:
        link.open()
    assert caught.value.cause == "crashed"
    assert (tmp_path / "run" / "bench.parm").is_file()
