"""The mock in HITL as a process on a pseudo-terminal, in real time. Bounds are loose: the machine may be busy."""

import os
import pty
import select
import subprocess
import sys
import time
import tty

import pytest

from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, message_class, pack, unpack

LIMIT_S = 30.0


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


def test_its_clock_and_its_line_are_as_the_command_line_says(start):
    board = start("--clock-offset-us", "5000000000", "--clock-drift-ppm", "50", "--baud", "57600")
    board.send("TIMESYNC", tc1=0, ts1=1234)
    board.read_until(lambda: [m for m in board.of("TIMESYNC") if m.ts1 == 1234])
    (answer,) = (m for m in board.of("TIMESYNC") if m.ts1 == 1234)
    assert 5_000_000_000_000 < answer.tc1 < 5_000_000_000_000 + LIMIT_S * 1e9
    board.read_until(lambda: len(board.of("HEARTBEAT")) >= 3)
    assert board.of("HIL_ACTUATOR_CONTROLS") == []  # too slow a line
    assert board.of("STATUSTEXT") == []
    assert board.parser.bad_crc == board.parser.garbage_bytes == 0


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
