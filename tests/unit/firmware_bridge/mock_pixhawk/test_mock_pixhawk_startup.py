"""The mock's start, answers, refusals and silence: PX4's behaviour as measured (docs/autopilots.md)."""

import random
import struct

import pytest

from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, unpack
from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from signals.errors import ConfigError
from tests.worlds.mock_pixhawk_world import World, messages, results, texts

SENSOR = struct.Struct("<Q13fIB")
ACTUATORS = MSGID["HIL_ACTUATOR_CONTROLS"]
ALL_GROUPS = 0x1BFF


class Rest:
    """A source of HIL_SENSOR for a vehicle at rest, without physics; `noise` 0 makes every sample the same."""

    def __init__(self, *, noise=1.0, fields=ALL_GROUPS, start_us=0, **autopilot):
        self.autopilot = MockPixhawk(**autopilot)
        self.encoder = FrameEncoder(255, 200)
        self.random = random.Random(1)
        self.noise, self.fields = noise, fields
        self.t_us = start_us - 4000

    def payload(self, *, t_us=None, fields=None, sensor_id=0):
        n = [self.noise * self.random.uniform(-1, 1) + 0.0 for _ in range(10)]  # + 0.0: no negative zeros
        return SENSOR.pack(
            self.t_us if t_us is None else t_us,
            *(0.02 * n[0], 0.02 * n[1], -9.81 + 0.02 * n[2]),
            *(0.002 * n[3], 0.002 * n[4], 0.002 * n[5]),
            *(0.21 + 1e-3 * n[6], 0.01 + 1e-3 * n[7], 0.43 + 1e-3 * n[8]),
            *(955.0 + 0.01 * n[9], 0.0, 490.0, 20.0),
            self.fields if fields is None else fields,
            sensor_id,
        )

    def sensor(self, **changes):
        return self.encoder.frame(MSGID["HIL_SENSOR"], self.payload(**changes))

    def step(self, **changes):
        self.t_us += 4000
        return FrameParser().feed(self.autopilot.feed(self.sensor(**changes)))

    def run(self, count, **changes):
        return [frame for _ in range(count) for frame in self.step(**changes)]


def actuators(frames):
    return [unpack(frame) for frame in frames if frame.msgid == ACTUATORS]


def test_boot_sends_the_messages_of_px4():
    request, heartbeat = (unpack(frame) for frame in FrameParser().feed(MockPixhawk().boot()))
    assert (request.command, request.param1, request.param2) == (511, 115.0, 5000.0)
    assert (heartbeat.type, heartbeat.autopilot, heartbeat.base_mode & 128) == (2, 12, 0)


@pytest.mark.parametrize("count", [0, 1, 20, 36])
def test_the_first_sensors_get_no_answer_then_each_gets_one(count):
    rest = Rest(boot_sensors=count)
    for _ in range(count):
        assert rest.step() == []
    for _ in range(50):
        answers = actuators(rest.step())
        assert len(answers) == 1
        assert answers[0].time_usec == rest.t_us
        assert (answers[0].flags, answers[0].mode) == (1, 1)
        assert answers[0].controls == (0.0,) * 16


def test_requests_before_the_first_answer_are_answered_with_it():
    world = World(boot_sensors=20)
    world.command(512, 148)
    frames = world.run(19 * 0.004)
    assert frames == []
    frames = world.run(0.02)
    assert results(frames) == [(512, 0)]
    assert len(messages(frames, "AUTOPILOT_VERSION")) == 1


def test_the_answer_comes_last_in_its_write():
    world = World()
    for _ in range(1000):
        frames = world.step()
        if frames:
            assert frames[-1].msgid == ACTUATORS


def test_checks_pass_at_4_3_seconds_after_a_start_at_zero():
    world = World()
    frames = world.run(10.0)
    ready = [m.onboard_control_sensors_health >> 28 & 1 for m in messages(frames, "SYS_STATUS")]
    assert ready.index(1) == pytest.approx(4.3 / 0.5, abs=1)
    assert all(ready[ready.index(1) :])


def test_checks_pass_much_later_after_a_start_at_another_time():
    world = World()
    world.tick = 2500  # 10 s
    world.physics._tick = 2500
    frames = world.run(20.0)
    ready = [m.onboard_control_sensors_health >> 28 & 1 for m in messages(frames, "SYS_STATUS")]
    assert ready.index(1) == pytest.approx(18.0 / 0.5, abs=2)


def test_arming_before_that_is_refused_with_reasons():
    world = World()
    world.run(1.0)
    world.command(400, 1)
    frames = world.run(0.1)
    assert results(frames) == [(400, 1)]
    said = texts(frames)
    assert said[0] == "Arming denied: Resolve system health failures first"
    assert any(text.startswith("Preflight Fail: ") for text in said)


def test_without_gps_position_modes_do_not_arm():
    world = World(gps=False)
    world.run(6.0)
    world.command(400, 1)
    frames = world.run(0.1)
    assert results(frames) == [(400, 1)]
    assert "Preflight Fail: no GPS" in texts(frames)


def test_noise_free_data_is_stale():
    rest = Rest(noise=0.0)
    said = texts(rest.run(400))
    assert "Preflight Fail: MAG #0 failed: STALE" in said
    assert "Preflight Fail: ACCEL #0 failed: STALE" in said
    assert len(said) == len(set(said))  # reported once


def test_noisy_data_is_not_stale():
    assert texts(Rest().run(400)) == []


@pytest.mark.parametrize(
    ("fields", "group"),
    [(0x1BFF & ~0x1, "accel"), (0x1BFF & ~0x20, "gyro"), (0x1BFF & ~0x40, "mag"), (0x1BFF & ~0x200, "baro")],
)
def test_incomplete_groups_are_ignored_and_counted(fields, group):
    rest = Rest(fields=fields)
    frames = rest.run(300)
    intake = rest.autopilot.firmware.sensors
    assert intake.incomplete_groups == 300
    assert len(actuators(frames)) == 280  # answered all the same
    lost = {"accel": 0, "gyro": 1, "mag": 2, "baro": 3}[group]
    if group in ("mag", "baro"):
        assert intake.lost(lost, rest.t_us)
    else:
        assert intake.lost(0, rest.t_us)
        assert intake.lost(1, rest.t_us)


def test_other_imus_are_ignored():
    rest = Rest(boot_sensors=0)
    rest.run(10)
    assert rest.step(sensor_id=1) == []
    assert len(actuators(rest.step())) == 1


def test_a_duplicate_changes_nothing():
    one, two = Rest(boot_sensors=0), Rest(boot_sensors=0)
    for _ in range(200):
        one.t_us += 4000
        two.t_us += 4000
        data = one.sensor()
        expected = one.autopilot.feed(data)
        assert two.autopilot.feed(data) == expected
        assert two.autopilot.feed(data) == b""


def test_ground_truth_is_ignored():
    one, two = Rest(boot_sensors=0), Rest(boot_sensors=0)
    truth = FrameEncoder(255, 200).frame(MSGID["HIL_STATE_QUATERNION"], bytes(range(64)))
    for _ in range(100):
        one.t_us += 4000
        two.t_us += 4000
        data = one.sensor()
        assert one.autopilot.feed(data) == two.autopilot.feed(truth + data)


def test_output_does_not_depend_on_how_the_input_was_cut():
    whole, cut = World(seed=3), MockPixhawk()
    cut.boot()
    fed, out = [], []
    feed = whole.autopilot.feed
    whole.autopilot.feed = lambda data: (fed.append(data), feed(data), None)[1]
    original = whole.autopilot.feed

    def tap(data):
        answer = original(data)
        out.append(answer)
        return answer

    whole.autopilot.feed = tap
    whole.command(512, 148)
    whole.run(5.0)
    stream, rng, got = b"".join(fed), random.Random(2), []
    at = 0
    while at < len(stream):
        n = rng.randint(1, 300)
        got.append(cut.feed(stream[at : at + n]))
        at += n
    assert b"".join(got) == b"".join(out)


def test_offboard_selected_while_disarmed_without_setpoints_silences():
    for silent in (True, False):
        world = World(offboard_silence=silent)
        world.run(1.0)
        world.command(176, 1, 6)
        world.step()
        world.step()
        assert world.answered is not silent


def test_a_pause_of_five_seconds_is_tolerated():
    world = World()
    world.run(5.0)
    world.tick += 1250
    world.physics._tick += 1250
    world.run(1.0)
    assert world.answered


def test_wrong_parameters_and_airframes_are_all_reported():
    with pytest.raises(ConfigError) as caught:
        MockPixhawk(params=["MPC_XY_CRUSE=3", "MPC_XY_CRUISE=500", "NAV_ACC_RAD=wide"])
    assert len(caught.value.problems) == 3
    assert "MPC_XY_CRUISE" in str(caught.value.problems[0])  # the nearest legal name
    with pytest.raises(ConfigError, match="iris, plane, standard_vtol, x500"):
        MockPixhawk(airframe="x5000")
    with pytest.raises(ConfigError, match="CA_ROTOR"):
        MockPixhawk(params=["CA_ROTOR_COUNT=3"])  # in range, but it makes no vehicle


@pytest.mark.parametrize("name", [b"\xff" * 16, "ÄÖÜÄÖÜÄÖ".encode(), b"\0" * 16, b"MPC\xff"])
def test_invalid_parameter_names_are_reported(name):
    rest = Rest(boot_sensors=0)
    rest.run(5)
    raw = name.ljust(16, b"\0")[:16]
    rest.autopilot.feed(rest.encoder.frame(MSGID["PARAM_SET"], struct.pack("<fBB", 1.0, 1, 1) + raw + b"\x09"))
    rest.autopilot.feed(rest.encoder.frame(MSGID["PARAM_REQUEST_READ"], struct.pack("<hBB", -1, 1, 1) + raw))
    replies = rest.step()
    assert len(actuators(replies)) == 1
    assert all(text.isascii() for text in texts(replies))


@pytest.mark.parametrize("time_usec", [2**62, 2**63 - 1, 2**63, 2**64 - 1])
def test_invalid_times_are_ignored(time_usec):
    rest = Rest(boot_sensors=0)
    rest.run(5)
    ignored = rest.autopilot.ignored
    assert rest.step(t_us=time_usec) == []
    assert rest.autopilot.ignored == ignored + 1
    assert len(actuators(rest.step())) == 1
