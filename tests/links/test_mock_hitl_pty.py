"""The mock in HITL as a process on a pseudo-terminal, in real time. Bounds are loose: the machine may be busy."""

import os
import pty
import select
import subprocess
import sys
import time
import tty
from itertools import pairwise

import pytest

from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, message_class, pack, unpack
from tests.unit.mock_pixhawk_world import World

LIMIT_S = 30.0
OUTPUT = MSGID["HIL_ACTUATOR_CONTROLS"]
HIL_BIT = 32


class Board:
    """The process, and the bench's end of its line."""

    def __init__(self, *arguments):
        self.fd, far = pty.openpty()
        tty.setraw(far)
        argv = [sys.executable, "-m", "firmware_bridge.mock_pixhawk", "--hitl", "--port", os.ttyname(far), *arguments]
        self.child = subprocess.Popen(argv, stderr=subprocess.PIPE, text=True)
        self.parser = FrameParser()
        self.encoder = FrameEncoder(255, 190)
        self.frames = []
        self.read_until(lambda: self.of("HEARTBEAT"))
        os.close(far)

    def of(self, name):
        return [unpack(frame) for frame in self.frames if frame.msgid == MSGID[name]]

    def read_for(self, seconds):
        """Read for `seconds` of wall clock."""
        end_s = time.monotonic() + seconds
        while (left_s := end_s - time.monotonic()) > 0.0:
            ready, _, _ = select.select([self.fd], [], [], left_s)
            if ready:
                self.frames += self.parser.feed(os.read(self.fd, 65536))

    def read_until(self, done):
        end_s = time.monotonic() + LIMIT_S
        while not done():
            assert time.monotonic() < end_s, "it did not happen"
            self.read_for(0.02)

    def send(self, name, **fields):
        message = message_class(name)(**fields)
        os.write(self.fd, self.encoder.frame(message.MSGID, pack(message)))

    def close(self):
        if self.fd >= 0:
            os.close(self.fd)
            self.fd = -1
        if self.child.poll() is None:
            self.child.kill()
        self.child.communicate()


@pytest.fixture
def start():
    boards = []

    def make(*arguments):
        boards.append(Board(*arguments))
        return boards[-1]

    yield make
    for board in boards:
        board.close()


def sensor_writes(ticks):
    """What a bench at rest writes in each of the first `ticks` ticks of 4 ms."""
    world = World(boot_sensors=0)
    written = []
    feed = world.autopilot.feed

    def tap(data):
        written.append(data)
        return feed(data)

    world.autopilot.feed = tap
    for _ in range(ticks):
        world.step()
    return written


def test_outputs_at_200_hz_by_its_own_clock_among_telemetry_and_it_takes_sensors(start):
    board = start()
    for data in sensor_writes(750):
        os.write(board.fd, data)
        board.read_for(0.004)
    outputs = board.of("HIL_ACTUATOR_CONTROLS")
    times = [m.time_usec for m in outputs]
    gaps = sorted(b - a for a, b in pairwise(times))
    # By the board's clock, which misses instants only where the machine does not let it run.
    assert times[-1] - times[0] > 2_000_000
    assert gaps[0] > 0
    assert 4_000 < gaps[len(gaps) // 2] < 10_000
    assert (len(times) - 1) / (times[-1] - times[0]) * 1e6 < 202.0
    assert {(m.flags, m.mode) for m in outputs} == {(0, 53)}
    # The rest is told apart by message id.
    assert len(board.of("HEARTBEAT")) >= 2
    assert all(m.base_mode & HIL_BIT for m in board.of("HEARTBEAT"))
    assert len(board.of("ATTITUDE")) > 5
    # Gyro, accelerometer, compass, barometer, GPS.
    assert any(m.onboard_control_sensors_health & 0x2F == 0x2F for m in board.of("SYS_STATUS"))
    assert board.parser.bad_crc == board.parser.garbage_bytes == 0


def test_timesync_with_offset_and_forced_arming(start):
    board = start("--clock-offset-us", "5000000000", "--clock-drift-ppm", "50")
    board.send("TIMESYNC", tc1=0, ts1=1234)
    board.read_until(lambda: [m for m in board.of("TIMESYNC") if m.ts1 == 1234])
    (answer,) = (m for m in board.of("TIMESYNC") if m.ts1 == 1234)
    assert 5_000_000_000_000 < answer.tc1 < 5_000_000_000_000 + LIMIT_S * 1e9
    numbers = {f"param{n}": 0.0 for n in range(3, 8)}
    board.send(
        "COMMAND_LONG",
        target_system=1,
        target_component=1,
        command=400,
        confirmation=0,
        param1=1.0,
        param2=21196.0,
        **numbers,
    )
    board.read_until(lambda: board.of("HIL_ACTUATOR_CONTROLS")[-1].mode == 181)


def test_a_slow_line_gives_no_hil(start):
    board = start("--baud", "57600")
    for data in sensor_writes(50):
        os.write(board.fd, data)
    board.read_until(lambda: len(board.of("HEARTBEAT")) >= 3)
    assert board.of("HIL_ACTUATOR_CONTROLS") == []
    assert board.of("STATUSTEXT") == []


def test_a_reader_that_does_not_read_does_not_stop_it(start):
    board = start()
    time.sleep(1.0)  # more than the line holds: it must drop, not wait
    frames_before = len(board.frames)
    board.read_until(lambda: len(board.frames) > frames_before + 300)
    newest = board.of("HIL_ACTUATOR_CONTROLS")[-1].time_usec
    board.send("TIMESYNC", tc1=0, ts1=77)
    board.read_until(lambda: [m for m in board.of("TIMESYNC") if m.ts1 == 77])
    assert newest > 1_000_000
    assert board.child.poll() is None


def test_it_ends_when_the_line_hangs_up(start):
    board = start()
    os.close(board.fd)
    board.fd = -1
    _, said = board.child.communicate(timeout=LIMIT_S)
    assert (board.child.returncode, said) == (0, "")
