"""The free-running link against the mock in HITL, in real time. No bound here depends on how fast the machine is."""

from __future__ import annotations

import dataclasses
import io
import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from firmware_bridge.codecs.mavlink_frame import FrameParser
from firmware_bridge.codecs.messages import MSGID, NAME
from firmware_bridge.faults.faulty_transport import FaultyTransport
from firmware_bridge.faults.link_fault import LinkFault
from firmware_bridge.links.autopilot_link import InvalidControls, LinkCaps, LinkTimeouts, TickSamples
from firmware_bridge.links.px4 import hitl_setup
from firmware_bridge.links.px4.free_running import FreeRunningLink
from firmware_bridge.links.px4.hitl_setup import HitlSetup
from firmware_bridge.transports.serial import SerialTransport
from firmware_bridge.transports.transport import Transport
from hil.apps.devices.command import check_board
from hil.config import load_bench
from hil.run.bench_run import RunResult, run_bench
from signals.errors import ConfigError, HandshakeError, LinkClosed, LinkError
from signals.samples import RangeSample
from signals.time import NS_PER_S
from tests.worlds.hitl_board import HitlBoard
from tests.worlds.patience import PATIENCE_S, PATIENT, expect_silence
from tests.worlds.resting_vehicle import GPS, IMU, Drive

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")

TICK_NS = 4_000_000
CAPS = LinkCaps("px4_hitl", lockstep=False, deterministic=False, boot_sensors=0)
ARM, FORCE = 400, 21196.0

Boards = Callable[..., HitlBoard]
Drives = Callable[..., "HitlDrive"]
Flights = Callable[..., RunResult]


class HitlDrive(Drive):
    """A free-running link over `transport`."""

    def __init__(self, transport: Transport, *, checked: bool = False, **settings: Any) -> None:
        self.events: list[tuple[str, str]] = []
        settings = {
            "period_ns": TICK_NS,
            "timeouts": PATIENT,
            "on_event": lambda kind, text: self.events.append((kind, text)),
        } | settings
        super().__init__(FreeRunningLink(transport, CAPS, motors=4 if checked else None, **settings), TICK_NS)


@pytest.fixture
def drive() -> Iterator[Drives]:
    made: list[HitlDrive] = []

    def make(transport: Transport | HitlBoard, *, opened: bool = True, **settings: Any) -> HitlDrive:
        wire = SerialTransport(transport.port) if isinstance(transport, HitlBoard) else transport
        made.append(HitlDrive(wire, **settings))
        if opened:
            made[-1].link.open()
        return made[-1]

    yield make
    for one in made:
        one.link.close()


def test_samples_go_out_by_the_clock_and_the_newest_command_comes_back(board: Boards, drive: Drives) -> None:
    far = board()
    driven = drive(far, checked=True)
    began_ns = time.monotonic_ns()
    driven.run(250)
    assert time.monotonic_ns() - began_ns >= 249 * TICK_NS - 2_000_000
    assert driven.seen
    assert all(frame.controls == (0.0,) * 16 and not frame.armed for frame in driven.seen)
    # Every tick written arrives whole and once.
    link = driven.link
    assert far.wait_for(lambda: link.send_stats().pending == 0)
    sent = link.send_stats()
    assert sent.sent + sent.dropped + sent.refused == 250
    assert far.wait_for(lambda: far.mock.steps == sent.sent)
    heard = [NAME[number] for number in far.tap.heard if number is not None]
    assert None not in far.tap.heard
    assert "TIMESYNC" in heard
    assert "HIL_STATE_QUATERNION" not in heard
    assert far.mock.timing.state_quaternions == 0  # type: ignore[union-attr]
    # Armed by force, its commands come through, whatever they are.
    driven.step(driven.command(ARM, 1.0, FORCE))
    driven.run_until(lambda: driven.seen[-1].armed)
    assert driven.seen[-1].tick == driven.tick - 1
    kinds = {frame.msgid for frame in driven.frames}
    assert {MSGID["HEARTBEAT"], MSGID["HIL_ACTUATOR_CONTROLS"], MSGID["ATTITUDE"]} <= kinds
    assert link.stats.steps == driven.tick
    assert link.stats.bad_crc == link.stats.garbage_bytes == 0
    assert link.stats.rtt.count > 0
    assert link.timesync.best() is not None


def test_the_bytes_of_a_tick_in_their_order(board: Boards, drive: Drives) -> None:
    driven = drive(board())
    driven.link.begin(0)
    extra = driven.words("HEARTBEAT", 6, 8, 0, 0, 4, 3)
    height = RangeSample(0, 0, 0, 3.0, 0.1, 10.0, 0.02, 100, (0.0, 0.0, -1.0))
    sent = driven.link.send(0, 0, TickSamples(IMU, gps=GPS, others=[height]), extra)
    names = [NAME[frame.msgid] for frame in FrameParser().feed(sent)]
    assert names == ["HEARTBEAT", "DISTANCE_SENSOR", "TIMESYNC", "HIL_GPS", "HIL_SENSOR"]


def test_a_bench_that_falls_behind_slips_and_reports_it(board: Boards, drive: Drives) -> None:
    driven = drive(board())
    driven.run(10)
    driven.events.clear()
    time.sleep(0.3)
    driven.run(10)
    schedule = driven.link.schedule
    assert schedule.slip_count >= 1
    assert schedule.slipped_ns >= 250_000_000
    (kind, text), *_ = driven.events
    assert kind == "slip"
    assert "behind the wall clock: later ticks move by that" in text
    assert len(driven.events) <= schedule.slip_count  # each reported once
    assert any("could not keep up" in finding.text for finding in driven.link.findings())


# -- unplugged ------------------------------------------------------------------------------------------------------


def test_unplugged_and_back_by_a_declared_fault(board: Boards, drive: Drives) -> None:
    far = board()
    fault = LinkFault(kind="unplug", at_s=0.4, for_s=0.5)
    told: list[tuple[int, str, str]] = []
    wire = FaultyTransport(
        SerialTransport(far.port, follow=True),
        [fault],
        1,
        lambda: driven.now_ns(),
        lambda t_ns, kind, text: told.append((t_ns, kind, text)),
    )
    driven = drive(wire, opened=False, own_sender=False)
    driven.link.open()
    driven.run(100)
    assert {kind for kind, _ in driven.events} <= {"slip"}
    steps = far.mock.steps
    driven.run(100)
    kinds = [kind for kind, _ in driven.events if kind != "slip"]
    assert kinds == ["unplugged", "replugged"]
    assert any(kind == "slip" for kind, _ in driven.events)  # it waited meanwhile
    assert driven.link.reconnects == 1
    assert [text for _, _, text in told] == ["link fault 0: unplugged", "link fault 0: plugged in again"]
    assert {t_ns for t_ns, _, _ in told} == {400_000_000}  # simulated time stood still
    assert far.wait_for(lambda: far.mock.steps >= steps + 90)
    driven.seen.clear()
    driven.run_until(lambda: bool(driven.seen))
    assert driven.link.send_stats().sent >= 190


def test_a_board_that_is_really_unplugged_and_put_back(board: Boards, drive: Drives, tmp_path: Path) -> None:
    first = board()
    port = tmp_path / "ttyACM0"
    port.symlink_to(first.port)
    driven = drive(SerialTransport(str(port)))
    driven.run(50)
    before = driven.link.send_stats().sent
    first.unplug()
    second = board()
    port.unlink()
    port.symlink_to(second.port)
    driven.run_until(lambda: second.mock.steps >= 20)
    assert [kind for kind, _ in driven.events if kind != "slip"] == ["unplugged", "replugged"]
    assert "is back after" in driven.events[[kind for kind, _ in driven.events].index("replugged")][1]
    assert driven.link.send_stats().sent >= before + 20
    assert driven.link.send_stats().scheduling


@pytest.mark.parametrize("reconnect_s", [0.0, 0.3])
def test_a_board_that_stays_unplugged_is_named(
    board: Boards, drive: Drives, tmp_path: Path, reconnect_s: float
) -> None:
    far = board()
    port = tmp_path / "ttyACM0"
    port.symlink_to(far.port)
    driven = drive(SerialTransport(str(port)), timeouts=dataclasses.replace(PATIENT, reconnect_s=reconnect_s))
    driven.run(20)
    far.unplug()
    port.unlink()
    with pytest.raises(LinkClosed) as caught:
        driven.run(2000)
    assert caught.value.cause == "unplugged"
    if reconnect_s:
        assert "did not come back within 0.3 s" in str(caught.value)
        assert "no such serial port" in str(caught.value)
        assert [kind for kind, _ in driven.events if kind != "slip"] == ["unplugged"]


# -- silent ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("older_s", [0.0, 0.3])
def test_a_board_that_falls_silent_is_named(board: Boards, drive: Drives, older_s: float) -> None:
    """Also if its last command was older than its last message."""
    far = board()
    driven = drive(far)
    driven.run(50)
    far.tap.mute.add("all")
    expect_silence(driven.link, 1.0)
    driven.link._commanded_ns -= int(older_s * NS_PER_S)
    with pytest.raises(LinkError, match=r"no message has come for \d+\.\d s") as caught:
        driven.run(5000)
    assert caught.value.cause == "silent"


def test_a_board_that_sends_no_commands_is_named(board: Boards, drive: Drives) -> None:
    far = board(mute=["HIL_ACTUATOR_CONTROLS"])
    driven = drive(far, timeouts=LinkTimeouts(reply_s=3.0))
    with pytest.raises(HandshakeError, match=r"no HIL_ACTUATOR_CONTROLS for 3 s: is SYS_HITL 1") as caught:
        driven.run(5000)
    assert caught.value.cause == "no_controls"
    assert driven.seen == []


def test_repeated_invalid_commands_end_the_run(board: Boards, drive: Drives) -> None:
    far = board()
    driven = drive(far)
    driven.run(50)
    far.tap.spoil = 3
    # Two outputs within one tick count as one command.
    driven.run_until(lambda: far.tap.spoil == 0 and 1 <= driven.link.stats.bad_controls <= 3)
    seen = len(driven.seen)
    driven.run_until(lambda: len(driven.seen) > seen + 5)  # it goes on
    far.tap.spoil = 1 << 30
    with pytest.raises(
        InvalidControls, match=r"tick \d+: HIL_ACTUATOR_CONTROLS at .* out of -1\.\.1.*the 25 commands before"
    ):
        driven.run(5000)


def test_a_missing_heartbeat_is_named(board: Boards, drive: Drives) -> None:
    far = board(mute=["HEARTBEAT"])
    driven = drive(far, timeouts=LinkTimeouts(connect_s=3.0), opened=False)
    with pytest.raises(HandshakeError, match=r"no heartbeat within 3 s of wall clock; [1-9]\d* other messages"):
        driven.link.open()
    assert driven.link.send_stats() is None


# -- set up ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def setup(board: Boards) -> Iterator[Callable[..., tuple[HitlBoard, HitlSetup]]]:
    lines: list[SerialTransport] = []

    def make(**settings: Any) -> tuple[HitlBoard, HitlSetup]:
        far = board(**settings)
        line = SerialTransport(far.port)
        line.open()
        lines.append(line)
        return far, HitlSetup(line, FrameParser(), motors=4)

    yield make
    for line in lines:
        line.close()


Setup = Callable[..., tuple[HitlBoard, HitlSetup]]


def test_parameters_are_set_in_their_own_type(setup: Setup) -> None:
    """PX4 refuses a value of another type, such as an integer for a float."""
    far, asked = setup()
    asked.set({"MPC_XY_P": 1.0, "MPC_XY_VEL_MAX": 5.7, "COM_RC_IN_MODE": 4.0})
    assert far.mock.params["MPC_XY_P"] == 1.0
    assert far.mock.params["MPC_XY_VEL_MAX"] == pytest.approx(5.7)
    assert far.mock.params["COM_RC_IN_MODE"] == 4
    assert asked.read(["COM_RC_IN_MODE", "MPC_XY_VEL_MAX"]) == {
        "COM_RC_IN_MODE": 4.0,
        "MPC_XY_VEL_MAX": pytest.approx(5.7),
    }


def test_refused_and_unknown_parameters_are_named(setup: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    _, asked = setup()
    assert asked.problems() == []
    monkeypatch.setattr(hitl_setup, "_TRY_S", 0.5)
    with pytest.raises(ConfigError) as caught:
        asked.set({"HIL_ACT_FUNC1": 5000.0, "MPC_XY_CRUSE": 1.0, "COM_RC_IN_MODE": 1.5})
    told = str(caught.value).splitlines()
    assert "HIL_ACT_FUNC1: is 101 on the board, not 5000" in told[0]
    assert "COM_RC_IN_MODE: is 3 on the board, not 1.5 (it is a whole number)" in told[1]
    assert "MPC_XY_CRUSE: is unknown to the board (did you mean 'MPC_XY_CRUISE'?)" in told[2]


def test_a_lost_answer_is_not_taken_for_a_missing_parameter(setup: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hitl_setup, "_TRY_S", 2.0)
    far, asked = setup()
    feed, lost = far.mock.feed, []

    def lossy(data: bytes) -> bytes:
        out = feed(data)
        if b"HIL_ACT_FUNC3" in out and not lost:
            lost.append(out)
            return b""
        return out

    far.mock.feed = lossy  # type: ignore[method-assign]
    assert asked.problems() == []
    assert lost


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"params": ["SYS_HITL=0", "HIL_ACT_FUNC2=0"]}, "SYS_HITL is 0, must be 1; HIL_ACT_FUNC2 is 0, must be 102"),
        ({"mute": ["HIL_ACTUATOR_CONTROLS"]}, "parameters are right, but it sends no HIL_ACTUATOR_CONTROLS"),
        ({"baud": 57600}, "57600 baud is not"),
    ],
)
def test_a_board_not_set_up_is_refused_with_advice(
    setup: Setup, monkeypatch: pytest.MonkeyPatch, settings: dict[str, Any], says: str
) -> None:
    monkeypatch.setattr(hitl_setup, "_LISTEN_S", 0.5)
    _, asked = setup(**settings)
    with pytest.raises(HandshakeError, match="`hil devices --check PORT --fix`") as caught:
        asked.require()
    assert says in str(caught.value)
    assert caught.value.cause == "setup"


def test_a_board_that_answers_for_no_parameter_is_named(setup: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hitl_setup, "_TRY_S", 0.05)
    monkeypatch.setattr(hitl_setup, "_LISTEN_S", 0.5)
    _, asked = setup(mute=["PARAM_VALUE", "HIL_ACTUATOR_CONTROLS"])
    with pytest.raises(HandshakeError, match=r"answered none of the requests.*is it PX4"):
        asked.require()


def test_a_board_without_parameters_that_sends_commands_is_accepted(
    setup: Setup, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hitl_setup, "_TRY_S", 0.05)
    monkeypatch.setattr(hitl_setup, "_LISTEN_S", PATIENCE_S)
    _, asked = setup(mute=["PARAM_VALUE"])
    asked.require()


def check(port: str, *, fix: bool = False) -> tuple[bool, str]:
    out = io.StringIO()
    ready = check_board(Console(file=out, width=200), port, baud=921_600, fix=fix)
    return ready, out.getvalue()


def test_a_board_is_checked_and_configured(board: Boards, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hitl_setup, "_LISTEN_S", PATIENCE_S)
    far = board(params=["SYS_HITL=0", "HIL_ACT_FUNC4=0"])
    ready, text = check(far.port)
    assert not ready
    assert "SYS_HITL is 0, must be 1" in text
    assert "HIL_ACT_FUNC4 is 0, must be 104" in text
    assert "--fix" in text
    assert far.mock.params["SYS_HITL"] == 0  # read only
    ready, text = check(far.port, fix=True)
    assert not ready  # only after a restart
    assert "set SYS_HITL, HIL_ACT_FUNC4; the board restarts" in text
    assert far.wait_for(lambda: far.mock.boots == 2)
    ready, text = check(far.port)
    assert ready
    assert "wrong" not in text
    assert text.count("right") == 2


def test_a_board_that_has_not_been_restarted(board: Boards, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hitl_setup, "_LISTEN_S", 0.3)
    far = board(params=["SYS_HITL=0"])
    far.mock.params.set("SYS_HITL", 1.0)
    ready, text = check(far.port)
    assert (ready, far.mock.boots) == (False, 1)
    assert "it was not restarted yet, or the connection is too slow" in text
    assert not check(far.port, fix=True)[0]
    assert far.wait_for(lambda: far.mock.boots == 2)
    monkeypatch.setattr(hitl_setup, "_LISTEN_S", PATIENCE_S)
    assert check(far.port)[0]


# -- the rig --------------------------------------------------------------------------------------------------------


@pytest.fixture
def fly(tmp_path: Path) -> Flights:
    def run(*settings: str) -> RunResult:
        bench = tmp_path / "bench.yaml"
        bench.write_text("")
        keep = ("record.mcap=false", "record.tlog=false", "record.report=false")
        return run_bench(load_bench(bench, rig="mock_hitl", settings=(*keep, *settings)), tmp_path / "out", quiet=True)

    return run


def test_the_rig_without_a_mission(fly: Flights) -> None:
    result = fly("duration_s=2")
    assert result.run["error"] is None
    assert result.run["sim_s"] == 2.0
    assert result.run["deterministic"] is False
    timing = result.run["autopilot"]["realtime"]
    assert timing["sent"] + timing["dropped"] >= 500
    assert result.run["autopilot"]["link"]["bad_crc"] == 0


@pytest.mark.parametrize(
    ("settings", "kind", "cause", "says"),
    [
        ("autopilot.faults.die_at_s=1.5", "LinkClosed", "crashed", "exit status 70"),
        # Well after the begin of the flight, which takes seconds of the wall clock on a busy machine.
        ("autopilot.faults.stall_at_s=30 autopilot.reply_timeout_s=5", "LinkError", "silent", "its process still runs"),
        ("autopilot.params.SYS_HITL=0", "HandshakeError", "setup", "--fix"),
    ],
)
def test_how_the_rig_ends(fly: Flights, settings: str, kind: str, cause: str, says: str) -> None:
    result = fly("duration_s=60", *settings.split())
    error = result.run["error"]
    assert (result.status, error["type"], error["cause"]) == ("ERROR", kind, cause)
    assert says in json.dumps(error)
