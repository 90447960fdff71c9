"""The autopilot's process dies, hangs, never starts or never reads: one clear error each, and nothing left behind."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from firmware_bridge.links.autopilot_link import LinkTimeouts, TickSamples
from firmware_bridge.links.child_process import ChildProcess
from firmware_bridge.links.px4.lockstep import LinkCaps, LockstepLink
from firmware_bridge.transports.pty import PtyTransport
from signals.errors import HandshakeError, LinkClosed, LockstepLost, PortNotFound
from signals.samples import ImuSample
from tests.worlds.patience import PATIENT, SILENCE_S, expect_silence, let_arrive, until

FAKE_PATH = Path(__file__).parents[1] / "worlds" / "scripted_autopilot.py"
TICK_NS = 4_000_000
CAPS = LinkCaps("fake", lockstep=True, deterministic=True, boot_sensors=3)
IMU = ImuSample(0, 0, 0, (0.0, 0.0, 9.81), (0.0, 0.0, 0.0), 25.0)


@pytest.fixture
def make_link():
    links = []

    def make(*arguments, argv=None, timeouts=PATIENT, stderr_path=None):
        transport = PtyTransport()

        def start():
            command = argv or [sys.executable, str(FAKE_PATH), "--port", transport.far_path, *arguments]
            return ChildProcess(command, stderr_path=stderr_path)

        link = LockstepLink(transport, CAPS, start_process=start, timeouts=timeouts)
        links.append(link)
        return link

    yield make
    for link in links:
        link.close()


def fly(link, ticks, *, first=0, extra=b""):
    for tick in range(first, first + ticks):
        link.send(tick, tick * TICK_NS, TickSamples(IMU), extra)
        link.wait(tick, tick * TICK_NS)


def gone(pid):
    """Return True if there is no such process, not even a zombie of ours."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


def test_exit_in_flight_reports_status_and_last_output(make_link, tmp_path):
    link = make_link("--fault", "exit", stderr_path=tmp_path / "out" / "autopilot.stderr")
    link.open()
    with pytest.raises(LinkClosed, match=r"(?s)exit status 7.*estimator diverged"):
        fly(link, 20)
    assert "estimator diverged" in (tmp_path / "out" / "autopilot.stderr").read_text()
    assert link.stats.steps == 8


def test_killed_in_flight_reports_the_signal(make_link):
    link = make_link("--fault", "kill")
    link.open()
    with pytest.raises(LinkClosed, match=r"signal SIGKILL.*said nothing"):
        fly(link, 20)


def test_alive_but_hung_is_lost_lockstep_and_is_ended_by_close(make_link):
    link = make_link("--fault", "hang")
    link.open()
    pid = link._process.pid
    fly(link, 7)  # three of its boot, four with an answer
    expect_silence(link)
    with pytest.raises(LockstepLost, match="no bytes came; its process still runs"):
        fly(link, 1, first=7)
    link.close()
    assert gone(pid)


def test_a_process_that_ignores_sigterm_is_killed(tmp_path):
    code = "import signal,sys,time; signal.signal(15, signal.SIG_IGN); open(sys.argv[1], 'w'); time.sleep(3600)"
    child = ChildProcess([sys.executable, "-c", code, str(tmp_path / "ignores")])
    child.start()
    pid = child.pid
    until((tmp_path / "ignores").exists, "the program's first line")
    child.close()
    assert gone(pid)


def test_a_program_that_cannot_start_is_named(make_link):
    with pytest.raises(PortNotFound, match="no-such-autopilot"):
        make_link(argv=["/nonexistent/no-such-autopilot"]).open()


def test_a_program_that_ends_at_once_is_named(make_link):
    link = make_link(argv=[sys.executable, "-c", "raise SystemExit('bad parameter file')"])
    with pytest.raises(LinkClosed, match=r"(?s)before its first heartbeat.*exit status 1.*bad parameter file"):
        link.open()


def test_a_silent_program_is_named(make_link):
    link = make_link("--mute", timeouts=LinkTimeouts(connect_s=SILENCE_S))
    with pytest.raises(HandshakeError, match="no bytes came at all"):
        link.open()
    assert link._process is None


def test_a_program_with_another_protocol_is_named(make_link):
    code = "import sys,time; f=open(sys.argv[1],'wb',0); f.write(b'NuttShell (NSH)\\n'*20); time.sleep(3600)"
    transport = PtyTransport()

    class Started(ChildProcess):
        def start(self):
            super().start()
            let_arrive(link)  # the program's start does not count

    link = LockstepLink(
        transport,
        CAPS,
        start_process=lambda: Started([sys.executable, "-c", code, transport.far_path]),
        timeouts=LinkTimeouts(connect_s=SILENCE_S),
    )
    with pytest.raises(HandshakeError, match="none of them a MAVLink message"):
        link.open()


def test_large_writes_arrive_whole(make_link):
    link = make_link()
    link.open()
    fly(link, 6, extra=bytes(30_000))
    assert link.stats.garbage_bytes == 0


def test_recovery_after_every_kind_of_death(make_link):
    """The same link object is opened and flown again after its process was lost."""
    link = make_link()
    link.open()
    fly(link, 10)
    os.kill(link._process.pid, signal.SIGKILL)
    with pytest.raises(LinkClosed):
        fly(link, 10)
    link.close()
    link.open()
    fly(link, 10)
    assert link.stats.rtt.count == 7


def test_child_dies_with_its_parent(tmp_path):
    code = (
        "import sys,time; from firmware_bridge.links.child_process import ChildProcess\n"
        "c = ChildProcess([sys.executable, '-c', 'import time; time.sleep(3600)']); c.start()\n"
        "print(c.pid, flush=True); time.sleep(3600)"
    )
    root = str(Path(__file__).parents[2])
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, env=os.environ | {"PYTHONPATH": root}
    ) as parent:
        pid = int(parent.stdout.readline())
        assert not gone(pid)
        parent.kill()
        parent.wait()
    until(lambda: orphan_ended(pid), "the end of the child")


def orphan_ended(pid):
    """Return True if it is gone, or a zombie that its new parent has yet to reap."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] in "ZX"
    except OSError:
        return True
