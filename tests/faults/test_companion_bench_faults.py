"""Clients that die, stall, flood or send invalid answers in a whole run: a named error, or an undisturbed flight.

No run leaves a process, shared memory or socket behind.
"""

from __future__ import annotations

import io
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgpack
import pytest
from rich.console import Console

import hil.run.companion.started as started
from firmware_bridge.companion.server import CompanionServer
from hil.config import load_bench
from hil.run.bench_run import RunResult, run_bench
from hil.run.part import FlightEnded, Part
from hil.run.recorder.reading import Recording, read_messages
from hil.run.replay import fly_and_compare
from tests.worlds.companion_server import RawClient
from tests.worlds.hop_flights import ROOT, fly, mapped_rings, marked_processes, saved, write_bench
from tests.worlds.patience import PATIENCE_S, until
from tests.worlds.run_json_schema import problems_of

PILOT = "start: [waypoints], control: true, rate_hz: 25"
SHORT = ("duration_s=6",)
ONE_PORT = "arrangement: one_port"


MARK = "HIL_TEST_RUN"


@pytest.fixture(autouse=True)
def nothing_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Fail if a process, shared memory or socket of the benches in this process is left."""
    monkeypatch.setenv(MARK, str(tmp_path))
    monkeypatch.setattr(started, "END_S", 0.3)  # many clients here cannot end
    made: list[Path] = []
    opened = CompanionServer.open

    def open_and_remember(self: CompanionServer) -> None:
        opened(self)
        if self.endpoint.startswith("ipc://"):
            made.append(Path(self.endpoint.removeprefix("ipc://")))
            made.extend(mapped_rings(os.getpid()))
            assert len(made) >= 2

    monkeypatch.setattr(CompanionServer, "open", open_and_remember)
    yield
    assert not [path for path in made if path.exists()]
    assert marked_processes(f"{MARK}={tmp_path}") == set()


@pytest.fixture
def port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        number: int = probe.getsockname()[1]
        return number


@contextmanager
def alongside(act: Callable[[], None]) -> Iterator[list[BaseException]]:
    """Run `act` in a thread during the flight and raise its error at the end."""
    failed: list[BaseException] = []

    def run() -> None:
        try:
            act()
        except BaseException as error:  # noqa: BLE001 (told by the test)
            failed.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield failed
    finally:
        thread.join(PATIENCE_S)
    assert not thread.is_alive()
    assert not failed, failed


def run_on(folder: Path, port: int, companion: str, *settings: str) -> RunResult:
    """Fly the bench with its companion link on this port."""
    return fly(folder, f"{ONE_PORT}, {companion}", settings=(f"companion.port={port}", *settings))


def assert_error(outcome: RunResult, kind: str, *words: str) -> None:
    run = saved(outcome.out)
    assert problems_of(run) == []
    assert (run["status"], run["error"]["type"]) == ("ERROR", kind), run["error"]
    for word in words:
        assert word in run["error"]["message"], run["error"]
    assert not (outcome.out / "traceback.txt").exists()


CUT = """
import os, signal, sys, time
class Cut:
    topics = ("truth",)
    control = True
    def __call__(self, frame):
        from hil_companion import Desired
        FAULT
        x, y, _ = frame["truth"]["p_WB"] if frame.frame == 0 else self.start
        self.start = (x, y, 0.0)
        return Desired(p_W=(x, y, 3.0))
"""


def hostile(folder: Path, fault: str, monkeypatch: pytest.MonkeyPatch) -> str:
    """Write a faulty pilot and return the companion section that starts it."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "hostile.py").write_text(CUT.replace("FAULT", fault))
    monkeypatch.setenv("PYTHONPATH", str(folder))
    return "start: ['hostile:Cut'], control: true, rate_hz: 25"


STALL_S = 5.0  # longer than an answer takes on a busy machine
LIMITS = (f"companion.reply_timeout_s={STALL_S}", "companion.reconnect_s=0.5")


@pytest.mark.parametrize("kind_of_time", ["lockstep", "latency_true", "realtime"])
def test_a_pilot_that_is_killed_is_a_named_error(
    kind_of_time: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dies = hostile(tmp_path, "frame.frame >= 30 and os.kill(os.getpid(), signal.SIGKILL)", monkeypatch)
    paced = ("pace=1",) if kind_of_time == "realtime" else ()
    more = "record: {report: false, tlog: false}\n"
    outcome = fly(tmp_path, f"{dies}, time: {kind_of_time}", more, settings=(*LIMITS, *paced, "duration_s=20"))
    assert_error(outcome, "LinkClosed", "companion Cut", "its connection ended", "signal SIGKILL", "did not come back")
    assert outcome.run["error"]["cause"] == "companion"
    recording = Recording(outcome.out / "run.mcap").scan()
    assert recording.complete
    last_s = max(m.log_time_ns for m in read_messages(outcome.out / "run.mcap") if m.topic == "/truth/pose") * 1e-9
    if kind_of_time == "lockstep":
        assert last_s == pytest.approx(30 / 25, abs=0.005)
    assert outcome.run["timing"]["total_s"] < 60.0  # a safety limit, not a measurement


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("frame.frame == 10 and time.sleep(3600)", "no answer to frame 10 within 5 s"),
        ("frame.frame == 10 and os.kill(os.getpid(), signal.SIGSTOP)", "no answer to frame 10 within 5 s"),
        ("if frame.frame == 10: sys.exit(0)", "its process ended with exit status 0"),
    ],
)
def test_a_pilot_that_stalls_or_fails_is_a_named_error(
    fault: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    outcome = fly(tmp_path, hostile(tmp_path, fault, monkeypatch), settings=(*LIMITS, "duration_s=20"))
    assert_error(outcome, "LinkClosed", "companion Cut", words)


def pilot(port: int, name: str, frames: int, *, wait_s: float = PATIENCE_S) -> int:
    """Hover as a raw pilot for `frames` frames, disconnect without a message, and return the last frame's number."""
    with RawClient(f"tcp://127.0.0.1:{port}") as client:
        client.hello(name, topics=["truth"], control=True, shared_memory=False)
        number = -1
        for _ in range(frames):
            header, _ = client.receive(wait_s)
            while header["k"] != "frame":
                if header["k"] == "end":
                    return number
                if header["k"] == "refused":
                    time.sleep(0.05)
                    client.hello(name, topics=["truth"], control=True, shared_memory=False)
                header, _ = client.receive(wait_s)
            number = header["frame"]
            client.done(number, desired={"p_W": [0.0, 0.0, 3.0]})
        return number


def test_a_pilot_that_dies_and_comes_back_flies_on(tmp_path: Path, port: int) -> None:
    flown: list[int] = []

    def act() -> None:
        flown.append(pilot(port, "raw", 40))
        time.sleep(0.2)
        flown.append(pilot(port, "raw", 10_000))

    with alongside(act):
        outcome = run_on(
            tmp_path, port, "clients: 1, control: true, rate_hz: 25", *SHORT, f"companion.reconnect_s={PATIENCE_S}"
        )
    assert outcome.run["error"] is None, outcome.run["error"]
    assert flown == [39, 149]
    counts = outcome.run["companion"]["clients"]["raw"]
    assert counts["dropped"] == 0
    # The loss changes nothing: the flight depends on the answers alone.
    with alongside(lambda: flown.append(pilot(port, "raw", 10_000))):
        whole = run_on(tmp_path / "whole", port, "clients: 1, control: true, rate_hz: 25", *SHORT)
    assert whole.run["digest"] == outcome.run["digest"]


def watch(port: int, then: Callable[[RawClient, dict[str, Any]], bool], *, credit: int = 2) -> None:
    """Join as an observer during the flight and call `then` with every frame until it returns True."""
    with RawClient(f"tcp://127.0.0.1:{port}") as client:
        client.hello("watcher", topics=["truth"], credit=credit, shared_memory=False)
        client.expect("welcome")
        wait_s = PATIENCE_S  # until the flight begins
        while not client.silent(wait_s):  # silent: the bench has cut the connection, as it may
            header, _ = client.receive()
            wait_s = 3 * STALL_S if header["k"] == "frame" else wait_s
            if header["k"] == "end" or (header["k"] == "frame" and then(client, header)):
                return


def stalls(client: RawClient, header: dict[str, Any]) -> bool:
    if header["frame"] < 30:
        client.done(header["frame"])
    return False


def garbles(client: RawClient, header: dict[str, Any]) -> bool:
    for junk in (
        b"",
        b"\x00\xff" * 40,
        msgpack.packb({"k": "done"}),
        msgpack.packb([1] * 500),
        b"\xdd\xff\xff\xff\xff",
    ):
        client.send(junk)
    client.done(header["frame"] + 7)
    client.done(header["frame"], desired={"p_W": [0.0, 0.0, 90.0]})  # it has no control
    return header["frame"] > 40


def floods(client: RawClient, header: dict[str, Any]) -> bool:
    ping = msgpack.packb({"k": "ping", "id": 1, "t_client_ns": 1})
    for _ in range(2000):
        client.send(ping)
    client.send(b"x" * 900_000)
    client.done(header["frame"])
    return header["frame"] > 20


@pytest.fixture(scope="module")
def unobserved(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the digest of the flight without observers."""
    outcome = fly(tmp_path_factory.mktemp("alone"), f"{ONE_PORT}, {PILOT}", settings=SHORT)
    assert outcome.run["error"] is None
    return str(outcome.run["digest"])


@pytest.mark.parametrize("observer", [stalls, garbles, floods])
def test_a_faulty_observer_does_not_change_the_flight(
    observer: Callable[[RawClient, dict[str, Any]], bool], tmp_path: Path, port: int, unobserved: str
) -> None:
    companion = "start: [waypoints], clients: 2, control: true, rate_hz: 25"
    with alongside(lambda: watch(port, observer)):
        outcome = run_on(tmp_path, port, companion, *SHORT, f"companion.reply_timeout_s={STALL_S}")
    run = outcome.run
    assert run["error"] is None, run["error"]
    assert run["digest"] == unobserved
    flown, watcher = run["companion"]["clients"]["waypoints"], run["companion"]["clients"]["watcher"]
    assert (flown["frames"], flown["dropped"], flown["malformed"]) == (150, 0, 0)
    assert watcher["frames"] > 0


OBSERVER = """
import os, time
class Watcher:
    topics = ("truth",)
    finished = False
    def __call__(self, frame):
        ACT
"""


def observed(folder: Path, act: str, monkeypatch: pytest.MonkeyPatch, *settings: str, more: str = "") -> list[str]:
    """Fly for 2 s with an observer that the bench starts, and return the reasons for a FAIL that name it."""
    (folder / "lazy.py").write_text(OBSERVER.replace("ACT", act))
    monkeypatch.setenv("PYTHONPATH", str(folder))
    outcome = fly(folder, f"start: ['lazy:Watcher'], rate_hz: 25{more}", settings=("duration_s=2", *settings))
    assert outcome.run["error"] is None, outcome.run["error"]
    assert outcome.status == "FAIL"  # the hop takes longer than that
    return [reason for reason in outcome.run["verdict"]["reasons"] if "Watcher" in reason]


@pytest.mark.parametrize(
    ("act", "words"),
    [
        ("if frame.frame == 10: raise RuntimeError('planted')", "it left: CutError"),
        ("frame.frame == 10 and os._exit(0)", "its connection ended"),
        ("frame.frame == 10 and time.sleep(3600)", "no answer to frame 10 within 1 s"),
    ],
)
def test_a_flight_that_lost_the_client_that_the_bench_started_fails(
    act: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (reason,) = observed(tmp_path, act, monkeypatch, "companion.reply_timeout_s=1", "record.mcap=true")
    assert reason.startswith("the companion Watcher was lost 0.4")
    assert words in reason
    (run_dir,) = (path.parent for path in tmp_path.glob("**/run.mcap"))
    assert fly_and_compare(run_dir, None, Console(file=io.StringIO())).identical
    runs = [json.loads((folder / "run.json").read_text()) for folder in (run_dir, run_dir / "replay")]
    assert runs[0]["verdict"]["reasons"] == runs[1]["verdict"]["reasons"]  # no client is lost in a replay
    assert runs[1]["status"] == "FAIL"


def test_a_client_that_fails_after_the_flight_fails_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(started, "END_S", PATIENCE_S)
    stop = "pass\n    def stop(self):\n        assert 2 + 2 == 5, 'the map is empty'"
    (reason,) = observed(tmp_path, stop, monkeypatch, "record.mcap=true")
    assert reason.startswith("the companion Watcher ended with an error: its process ended with exit status 3")
    assert "the map is empty" in reason
    run_dir = tmp_path / "run"
    assert fly_and_compare(run_dir, None, Console(file=io.StringIO())).identical
    assert reason in saved(run_dir / "replay")["verdict"]["reasons"]


def test_a_client_that_does_not_end_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stop = "pass\n    def stop(self):\n        time.sleep(3600)"
    assert not observed(tmp_path, stop, monkeypatch)
    told = [warning["text"] for warning in saved(tmp_path / "run")["warnings"]]
    assert [text for text in told if "Watcher had not ended 0.3 s after the flight and was terminated" in text]


def test_a_client_that_has_finished_or_need_not_come_back_is_not_missed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    leaves = "self.finished = frame.frame >= 10\n        if frame.frame == 20: os._exit(0)"
    assert not observed(tmp_path, leaves, monkeypatch)
    assert not observed(tmp_path, "frame.frame == 10 and os._exit(0)", monkeypatch, more=", on_loss: go_on")


def test_a_pilot_that_commands_nothing_does_not_pass(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "lazy.py").write_text(OBSERVER.replace("ACT", "return None"))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    companion = "start: ['lazy:Watcher'], control: true, rate_hz: 25"
    outcome = fly(tmp_path, companion, settings=("duration_s=8", "mission=null"))
    assert outcome.status == "FAIL"
    (reason,) = outcome.run["verdict"]["reasons"]
    assert reason.endswith("in the phase preflight; they sent no desired state that moves the vehicle")


class Ends(Part):
    """Ends the flight at tick 500, as a test suite does."""

    name = "ends"

    def after_tick(self, tick: int) -> None:
        if tick == 500:
            raise FlightEnded("it is over")


def test_a_pilot_that_had_no_time_to_fly_is_only_warned_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "lazy.py").write_text(OBSERVER.replace("ACT", "return None"))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    path = write_bench(tmp_path, "start: ['lazy:Watcher'], control: true, rate_hz: 25", "")
    bench = load_bench(path, settings=("duration_s=8", "mission=null"))
    outcome = run_bench(bench, tmp_path / "run", quiet=True, more=[Ends()])
    assert (outcome.status, outcome.run["verdict"]["reasons"]) == ("PASS", [])
    assert any(row["text"].startswith("no companion in control ever flew") for row in outcome.run["warnings"])


@pytest.mark.parametrize(("then", "reasons"), [("None", 1), ("Desired(land=True)", 0)])
def test_a_pilot_that_never_lands_does_not_pass(
    then: str, reasons: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fault = f"if frame.t_ns > 9e9: return {then}"  # then it is mute: the vehicle hovers
    companion = hostile(tmp_path, fault, monkeypatch)
    outcome = fly(tmp_path, companion, settings=("duration_s=25", "mission=null"))
    assert outcome.status == ("FAIL" if reasons else "PASS")
    said = outcome.run["verdict"]["reasons"]
    assert len(said) == reasons
    for reason in said:
        assert "never landed: the flight ended at duration_s (25 s) in the phase flying" in reason


def test_missing_clients_are_a_handshake_error(tmp_path: Path) -> None:
    outcome = fly(tmp_path, "clients: 2", settings=("companion.connect_timeout_s=0.3",))
    assert_error(outcome, "HandshakeError", "0 of 2 clients within 0.3 s", "ipc://")


def test_the_output_of_a_started_client_that_ends_at_once_is_reported(tmp_path: Path) -> None:
    outcome = fly(tmp_path, "start: [waypoints], settings: {warp: 9}, control: true")
    assert_error(outcome, "LinkClosed", "companion waypoints", "status 2", "warp")
    assert "warp" in (outcome.out / "companion_waypoints.log").read_text()


def test_a_started_client_that_does_not_exist_is_named(tmp_path: Path) -> None:
    outcome = fly(tmp_path, "start: ['json:Cut']")
    assert_error(outcome, "LinkClosed", "companion Cut", "json")


@pytest.mark.parametrize("arrangement", ["shared_memory", "one_port"])
def test_a_port_in_use_is_named(arrangement: str, tmp_path: Path, port: int) -> None:
    with socket.socket(socket.AF_UNIX if arrangement == "shared_memory" else socket.AF_INET) as other:
        path = Path(tempfile.gettempdir()) / f"hil-companion-{port}"
        other.bind(str(path) if arrangement == "shared_memory" else ("127.0.0.1", port))
        other.listen()
        settings = (f"companion.port={port}", f"companion.arrangement={arrangement}")
        outcome = fly(tmp_path, "clients: 1", settings=settings)
        path.unlink(missing_ok=True)
    assert_error(outcome, "PortBusy", str(port), "another program listens there")


@contextmanager
def bench_process(folder: Path, companion: str, *settings: str) -> Iterator[subprocess.Popen[str]]:
    file = write_bench(folder, companion)
    options = [part for setting in settings for part in ("--set", setting)]
    command = [sys.executable, "-m", "hil.cli", "run", str(file), "--out", str(folder / "run"), *options]
    bench = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        yield bench
    finally:
        bench.kill()
        bench.communicate()


@pytest.mark.parametrize("number", [pytest.param(signal.SIGINT, marks=pytest.mark.slow), signal.SIGTERM])
def test_stopped_while_it_waits_for_clients(number: signal.Signals, tmp_path: Path, port: int) -> None:
    path = Path(tempfile.gettempdir()) / f"hil-companion-{port}"
    with bench_process(tmp_path, "start: [echo], clients: 2", f"companion.port={port}") as bench:
        log = tmp_path / "run" / "companion_echo.log"
        until(lambda: log.exists() and "connected" in log.read_text())
        rings = mapped_rings(bench.pid)
        assert path.exists()
        assert len(rings) == 1
        bench.send_signal(number)
        _, errors = bench.communicate(timeout=PATIENCE_S)
    assert "Traceback" not in errors
    run = saved(tmp_path / "run")
    assert (run["status"], run["error"]["type"]) == ("ERROR", "Interrupted")
    assert not path.exists()
    assert not [ring for ring in rings if ring.exists()]


def test_a_bench_that_is_killed_takes_its_clients_with_it(tmp_path: Path, port: int) -> None:
    with bench_process(tmp_path, PILOT, "pace=1", f"companion.port={port}") as bench:
        until(lambda: (tmp_path / "run" / "companion.jsonl").exists())
        rings = mapped_rings(bench.pid)
        bench.kill()
        bench.communicate()
    until(lambda: marked_processes(f"{MARK}={tmp_path}") == set())
    until(lambda: not [ring for ring in rings if ring.exists()])
    assert saved(tmp_path / "run")["error"]["type"] == "Killed"
    # The socket file that remains does not disturb the next bench.
    path = Path(tempfile.gettempdir()) / f"hil-companion-{port}"
    assert path.exists()
    outcome = fly(tmp_path / "next", PILOT, settings=(f"companion.port={port}", "duration_s=1"))
    assert outcome.run["error"] is None
    assert not path.exists()
