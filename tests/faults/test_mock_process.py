"""The mock as a process: its command line, its end, and its messages if it cannot start."""

import os
import pty
import select
import signal
import subprocess
import sys
import time
import tty

import pytest

from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, message_class, pack, unpack
from firmware_bridge.mock_pixhawk.line import SendBuffer
from tests.worlds.mock_pixhawk_world import World
from tests.worlds.patience import PATIENCE_S

LIMIT_S = PATIENCE_S


class Process:
    """The mock on a pseudo-terminal; the test holds the other end."""

    def __init__(self, *arguments):
        self.fd, far = pty.openpty()
        tty.setraw(far)
        port = os.ttyname(far)
        argv = [sys.executable, "-m", "firmware_bridge.mock_pixhawk", "--port", port, *arguments]
        self.child = subprocess.Popen(argv, stderr=subprocess.PIPE, text=True)
        self.parser = FrameParser()
        self.frames = []
        self.wait_for(MSGID["HEARTBEAT"])
        os.close(far)

    def wait_for(self, msgid):
        """Read until a frame of this kind arrives."""
        while True:
            ready, _, _ = select.select([self.fd], [], [], LIMIT_S)
            assert ready, f"nothing came within {LIMIT_S} s"
            found = self.parser.feed(os.read(self.fd, 65536))
            self.frames += found
            if any(frame.msgid == msgid for frame in found):
                return

    def hang_up(self):
        if self.fd >= 0:
            os.close(self.fd)
            self.fd = -1

    def end(self):
        """Return exit status and output."""
        _, said = self.child.communicate(timeout=LIMIT_S)
        return self.child.returncode, said

    def close(self):
        self.hang_up()
        if self.child.poll() is None:
            self.child.kill()
        self.child.communicate()


@pytest.fixture
def start():
    processes = []

    def make(*arguments):
        processes.append(Process(*arguments))
        return processes[-1]

    yield make
    for process in processes:
        process.close()


def sensor_writes(ticks):
    """Return the bytes that the bench writes in each of the first `ticks` ticks."""
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


def test_the_process_answers_as_the_object_does(start):
    process, world = start("--boot-sensors", "0"), World(boot_sensors=0)
    expected = [frame.raw for frame in world.received]
    for data in sensor_writes(300):
        os.write(process.fd, data)
        process.wait_for(MSGID["HIL_ACTUATOR_CONTROLS"])
        expected += [frame.raw for frame in world._parser.feed(world.autopilot.feed(data))]
    assert [frame.raw for frame in process.frames] == expected


@pytest.mark.parametrize("mode", [(), ("--hitl",)], ids=["lockstep", "hitl"])
def test_it_ends_when_the_line_hangs_up(start, mode):
    process = start(*mode)
    process.hang_up()
    assert process.end() == (0, "")


def timesync(process, number):
    """Send TIMESYNC and return the board's answer [ns]."""
    message = message_class("TIMESYNC")(tc1=0, ts1=number)
    os.write(process.fd, FrameEncoder(255, 190).frame(message.MSGID, pack(message)))
    while True:
        process.wait_for(message.MSGID)
        for frame in process.frames:
            if frame.msgid == message.MSGID and unpack(frame).ts1 == number:
                return unpack(frame).tc1


def test_in_hitl_the_command_line_sets_clock_and_baud_rate(start):
    process = start("--hitl", "--clock-offset-us", "5000000000", "--clock-drift-ppm", "50", "--baud", "57600")
    assert 5_000_000_000_000 < timesync(process, 1234) < 5_000_000_000_000 + LIMIT_S * 1e9
    process.wait_for(MSGID["HEARTBEAT"])
    kinds = {frame.msgid for frame in process.frames}
    assert not kinds & {MSGID["HIL_ACTUATOR_CONTROLS"], MSGID["STATUSTEXT"]}  # too slow a line
    assert process.parser.bad_crc == process.parser.garbage_bytes == 0


def test_in_hitl_a_reader_that_does_not_read_does_not_stop_it(start):
    process = start("--hitl")
    time.sleep(1.0)  # more than the line holds: the mock must drop, not wait
    assert timesync(process, 77) > 1_000_000_000
    assert process.child.poll() is None


def test_terminate_ends_it_cleanly(start):
    process = start()
    process.child.send_signal(signal.SIGTERM)
    assert process.end() == (0, "")


def test_die_ends_it_with_its_own_status(start):
    process = start("--boot-sensors", "0", "--fault", "die@0.1")
    for data in sensor_writes(25):
        os.write(process.fd, data)
        process.wait_for(MSGID["HIL_ACTUATOR_CONTROLS"])
    os.write(process.fd, sensor_writes(26)[-1])
    assert process.end() == (70, "mock_pixhawk: died of an injected fault at 0.1 s\n")


def test_it_ends_with_its_parent():
    # The parent opens the line, starts the mock and dies; the test keeps the line open.
    near, far = pty.openpty()
    tty.setraw(far)
    script = (
        "import subprocess, sys, time\n"
        "child = subprocess.Popen([sys.executable, '-m', 'firmware_bridge.mock_pixhawk', '--port', sys.argv[1]])\n"
        "print(child.pid, flush=True)\n"
        "sys.stdin.readline()\n"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", script, os.ttyname(far)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    child = int(parent.stdout.readline())
    ready, _, _ = select.select([near], [], [], LIMIT_S)
    assert ready
    os.close(far)
    descriptor = os.pidfd_open(child)
    parent.communicate("\n")
    gone, _, _ = select.select([descriptor], [], [], LIMIT_S)
    os.close(near)
    os.close(descriptor)
    assert gone


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (["--port", "/dev/no-such-port"], 3, "cannot open /dev/no-such-port"),
        (["--port", "/dev/null"], 3, "cannot open /dev/null"),
        (["--port", "x", "--airframe", "zeppelin"], 2, "there are: iris, plane, standard_vtol, x500"),
        (["--port", "x", "--param", "MPC_XY_CRUSE=3"], 2, "did you mean MPC_XY_CRUISE"),
        (["--port", "x", "--param", "MPC_XY_CRUISE"], 2, "not NAME=NUMBER"),
        (["--port", "x", "--fault", "explode@3"], 2, "KIND@SECONDS"),
        (["--port", "x", "--sysid", "300"], 2, "--sysid"),
        (["--port", "x", "--boot-sensors", "-1"], 2, "--boot-sensors"),
        ([], 2, "--port"),
    ],
)
def test_wrong_arguments_are_named(arguments, status, said):
    argv = [sys.executable, "-m", "firmware_bridge.mock_pixhawk", *arguments]
    ended = subprocess.run(argv, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert (ended.returncode, ended.stdout) == (status, "")
    assert said in ended.stderr
    assert "Traceback" not in ended.stderr


def test_start_up_imports_nothing_heavy():
    heavy = ("mujoco", "casadi", "scipy", "matplotlib", "cv2", "pydantic", "pymavlink.mavutil")
    script = "import sys, firmware_bridge.mock_pixhawk.__main__; print(*sys.modules)"
    modules = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    assert [name for name in heavy if name in modules] == []


def test_messages_that_do_not_fit_are_dropped_whole_and_the_rest_arrives_in_order():
    near, far = os.pipe()
    os.set_blocking(far, False)
    os.set_blocking(near, False)
    buffer = SendBuffer(far, size=1000)
    sent = 0
    while not buffer.dropped:
        buffer.write(bytes([sent % 251]) * 300)
        sent += 1
    assert buffer.dropped == 300
    assert len(buffer.pending) <= 1000
    arrived = b""
    while True:
        try:
            arrived += os.read(near, 65536)
        except BlockingIOError:
            if not buffer.pending:
                break
            buffer.write(b"")
    os.close(near)
    os.close(far)
    assert arrived == b"".join(bytes([k % 251]) * 300 for k in range(sent - 1))
