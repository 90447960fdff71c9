"""A campaign under bad input, lost workers, full disks and other processes. Only the last tests make flights."""

from __future__ import annotations

import gc
import json
import os
import random
import resource
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections import deque
from contextlib import suppress
from importlib.machinery import ModuleSpec
from itertools import product
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from rich.console import Console

from hil.apps.campaign import command, flight
from hil.apps.campaign.campaign import Campaign, Progress
from hil.apps.campaign.cases.campaign_file import Stop, load_campaign
from hil.apps.campaign.cases.plan import Plan
from hil.apps.campaign.command import CampaignOptions, run_campaign
from hil.apps.campaign.engines import local
from hil.apps.campaign.engines.engine import Done
from hil.apps.campaign.engines.flight_number import FlightNumber
from hil.apps.campaign.engines.local import LocalEngine
from hil.apps.campaign.flight import Job, Outcome
from hil.apps.campaign.store import Store
from signals.errors import ConfigError, OutOfFiles, RecordingError
from tests.worlds.patience import PATIENCE_S

HEAD = """
settings: {mission: rigs/missions/short.waypoints, autopilot: {transport: loopback}, wind: {steady_W_mps: [0, 0, 0]}}
recheck: 0
keep: none
"""


class FakeEngine:
    """Engine without flights: outcomes are a function of the case. `losses`: workers lost on the way to each."""

    def __init__(self, losses: int = 0, capacity: int = 3) -> None:
        self.capacity, self.losses, self.seen = capacity, losses, dict[str, int]()
        self._jobs: deque[Job] = deque()

    @property
    def busy(self) -> int:
        return len(self._jobs)

    def submit(self, job: Job) -> None:
        self._jobs.append(job)

    def wait(self, timeout_s: float) -> list[Done]:
        if not self._jobs:
            return []
        job = self._jobs.pop()  # the last one first: another order than the plan's
        self.seen[job.case] = self.seen.get(job.case, 0) + 1
        if self.seen[job.case] <= self.losses:
            return [Done(job, None, "worker 0 was ended by SIGKILL")]
        return [Done(job, Outcome("PASS", digest=job.case, repeatable=True))]

    def renew(self) -> None: ...

    def close(self) -> None: ...


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch) -> FakeEngine:
    made = FakeEngine()
    monkeypatch.setattr(command, "make_engine", lambda *_: made)
    return made


class SecondFlightsEnd(FakeEngine):
    """Engine whose second flights end with one outcome."""

    def __init__(self, second: Outcome) -> None:
        super().__init__()
        self._second, self._renewed = second, False

    def wait(self, timeout_s: float) -> list[Done]:
        return [Done(done.job, self._second if self._renewed else done.outcome) for done in super().wait(timeout_s)]

    def renew(self) -> None:
        self._renewed = True


def campaign(folder: Path, text: str, **options: Any) -> int:
    path = folder / "c.yaml"
    path.write_text(HEAD + text)
    return run_campaign(path, CampaignOptions(**{"out": folder / "out", "quiet": True, **options}), Console(quiet=True))


def summary(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "out" / "campaign.json").read_text())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("axes: {seed: []}", "c.yaml:5: axes.seed must hold at least 1"),
        ("axes: {wnd.x: [1]}", "wnd: unknown key"),
        ("axes: {wind.steady_W_mps.7: [1]}", "entry 7 of a list with 3 entries"),
        ("axes: {limits.7: [1]}", "needs limits in the section settings"),
        ("axes: {seed: {count: 1000000000000}, map_seed: {count: 1000000000000}}", r"1e\+24 points; the most is"),
        (
            "axes: {load: [{label: a, settings: {seed: 1}}, {label: a, settings: {seed: 2}}]}",
            "c.yaml:5: axes.load has two values with the label 'a'",
        ),
        ("axes: {seed: [1, 2]}\nskip: [{seed: {above: 0}}]", "c.yaml:6: skip leaves no point"),
        ("axes: {seed: [1, 2]}\nskip: [{seed: {above: x}}]", r"c.yaml:6.*with numbers above and below"),
        ("axes: {seed: [1, 2]}\nskip: [{seed: {}}]", "with numbers above and below"),
        ("axes: {seed: [1, 2]}\nskip: [{}]", "would skip every point"),
        ("axes: {digest: [{label: a, settings: {seed: 3}}]}", "name of a column of results.csv"),
        ("sampled: {wind.steady_W_mps.0: {uniform: [-1.0e+308, 1.0e+308]}}", "too far apart"),
        ("samples: 2000000\nmethod: latin_hypercube\nsampled: {seed: {integers: [1, 9]}}", "at most 1000000 samples"),
        (
            "method: sobol\nsampled:\n" + "".join(f"  autopilot.params.P{i}: {{uniform: [0, 1]}}\n" for i in range(65)),
            "at most 64 axes",
        ),
    ],
)
def test_bad_files_are_told_before_any_flight(tmp_path: Path, engine: FakeEngine, text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        campaign(tmp_path, text)
    assert not (tmp_path / "out").exists()


def test_a_million_million_points_take_no_memory_until_they_are_flown(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(HEAD + "axes: {seed: {count: 1000000000000}}\n")
    plan = Plan(load_campaign(path))
    assert len(plan) == 10**12
    assert plan.point(10**12 - 1).values == {"seed": 10**12}
    assert [point.number for point, _ in zip(plan, range(3), strict=False)] == [0, 1, 2]


def test_only_some_combinations_cannot_be_loaded(tmp_path: Path, engine: FakeEngine) -> None:
    axes = "axes: {tick_hz: [1000, 400], sensors.baro.rate_hz: [50, 1000]}"
    assert campaign(tmp_path, axes) == 3, "an ERROR"
    table = (tmp_path / "out" / "results.csv").read_text().splitlines()
    assert len(table) == 5
    (error,) = [line for line in table if ",ERROR," in line]
    assert ",400,1000," in error
    assert "ConfigError" in error


@pytest.mark.parametrize(("losses", "status", "flights"), [(1, 0, 4), (2, 0, 6), (9, 3, 6)])
def test_a_lost_worker_s_case_is_flown_again(
    tmp_path: Path, engine: FakeEngine, losses: int, status: int, flights: int
) -> None:
    engine.losses = losses
    assert campaign(tmp_path, "axes: {seed: [1, 2]}") == status
    assert sum(engine.seen.values()) == flights, "three attempts at most"
    assert summary(tmp_path)["error"] == (2 if status else 0)
    if status:
        engine.losses = 0
        assert campaign(tmp_path, "axes: {seed: [1, 2]}", resume=True) == 0, "an ERROR is flown again"


def test_two_campaigns_in_one_folder(tmp_path: Path, engine: FakeEngine) -> None:
    first = engine.wait

    def other_campaign(timeout_s: float) -> list[Done]:
        engine.wait = first  # type: ignore[method-assign]
        with pytest.raises(RecordingError, match="another run is writing here"):
            campaign(tmp_path, "axes: {seed: [1, 2]}", resume=True)
        with pytest.raises(ConfigError, match="--resume"):
            campaign(tmp_path, "axes: {seed: [1, 2]}")
        return first(timeout_s)

    engine.wait = other_campaign  # type: ignore[method-assign]
    assert campaign(tmp_path, "axes: {seed: [1, 2]}") == 0


def test_another_file_does_not_continue_a_campaign(tmp_path: Path, engine: FakeEngine) -> None:
    assert campaign(tmp_path, "axes: {seed: [1, 2]}") == 0
    other = tmp_path / "other.yaml"
    other.write_text(HEAD + "axes: {seed: [3]}")
    with pytest.raises(ConfigError, match=r"holds 'c', and this is 'other': .*--out"):
        run_campaign(other, CampaignOptions(out=tmp_path / "out", resume=True, quiet=True), Console(quiet=True))
    assert summary(tmp_path)["cases"] == 2
    assert campaign(tmp_path, "axes: {seed: [2, 3]}", resume=True) == 0


def test_a_folder_that_cannot_be_used(tmp_path: Path, engine: FakeEngine) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match="cannot be used as a folder"):
        campaign(tmp_path, "axes: {seed: [1]}", out=tmp_path / "file")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "campaign.sqlite").write_bytes(b"no database" * 100)
    with pytest.raises(RecordingError, match=r"campaign.sqlite: .*not a database"):
        campaign(tmp_path, "axes: {seed: [1]}", resume=True)
    (tmp_path / "out" / "campaign.sqlite").unlink()
    with sqlite3.connect(tmp_path / "out" / "campaign.sqlite") as database:
        database.execute("PRAGMA user_version = 7")
    with pytest.raises(RecordingError, match="is of version 7"):
        campaign(tmp_path, "axes: {seed: [1]}", resume=True)


DAMAGED_JSON = [
    *("", "{", "null", "[]", "7", '"text"', "{}", "nan", "[" * 100_000, "\ufeff{}", "{'status': 'PASS'}"),
    *('{"status": "PASS"}', '{"status": "PASS", "limits": 1}', '{"status": "PASS", "limits": [1]}'),
    *('{"status": "PASS", "limits": [{}]}', '{"status": 1}', '{"more": 1}', "\x00", '{"status": "FAIL"}}'),
]


def test_a_damaged_result_is_told_and_nothing_is_lost(tmp_path: Path, engine: FakeEngine) -> None:
    assert campaign(tmp_path, "axes: {seed: [1, 2]}") == 0
    out = tmp_path / "out"
    whole = (out / "campaign.sqlite").read_bytes()
    for number, (text, column) in enumerate(product(DAMAGED_JSON, ("outcome", "texts", "status", "id"))):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "campaign.sqlite").write_bytes(whole)
        with sqlite3.connect(folder / "campaign.sqlite") as database:
            database.execute(f"UPDATE flown SET {column} = ? WHERE rowid = 1", (text,))
        database.close()
        with pytest.raises(RecordingError, match=r"campaign.sqlite: is damaged .*use another --out"):
            Store(folder)
    shutil.copy(folder / "campaign.sqlite", out)
    before = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}
    with pytest.raises(RecordingError, match=r"campaign.sqlite: is damaged .*use another --out"):
        campaign(tmp_path, "axes: {seed: [1, 2, 3]}", resume=True)
    assert {name: (out / name).read_bytes() for name in before} == before
    assert sum(engine.seen.values()) == 2


@pytest.mark.parametrize("seed", range(4))
def test_one_flipped_bit_never_changes_a_table(tmp_path: Path, engine: FakeEngine, seed: int) -> None:
    assert campaign(tmp_path, "axes: {seed: [1, 2]}") == 0
    out, numbers = tmp_path / "out", random.Random(seed)
    table, data = (out / "results.csv").read_bytes(), bytearray((out / "campaign.sqlite").read_bytes())
    data[numbers.choice([at for at, byte in enumerate(data) if byte])] ^= 1 << numbers.randrange(8)
    (out / "campaign.sqlite").write_bytes(data)
    with suppress(RecordingError):
        assert campaign(tmp_path, "axes: {seed: [1, 2]}", resume=True) == 0
    assert (out / "results.csv").read_bytes() == table


def test_a_table_that_breaks_off_leaves_nothing_to_be_said_at_exit(
    tmp_path: Path, engine: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cases that are half read when a full disk ends the tables are freed after the file is closed."""
    assert campaign(tmp_path, "axes: {seed: [1, 2]}") == 0
    ignored: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", ignored.append)
    with Store(tmp_path / "out") as store:
        cases = store.cases()
        next(cases)
    del cases
    gc.collect()
    assert ignored == []


def test_results_through_a_link_are_refused(tmp_path: Path, engine: FakeEngine) -> None:
    assert campaign(tmp_path, "axes: {seed: [1]}") == 0
    mine, other = tmp_path / "out" / "campaign.sqlite", tmp_path / "other"
    mine.rename(other)
    before = other.read_bytes()
    mine.symlink_to(other)
    with pytest.raises(RecordingError, match=r"campaign.sqlite: is a link, not a file of its own"):
        campaign(tmp_path, "axes: {seed: [2]}", resume=True)
    assert other.read_bytes() == before


def test_a_disk_that_fills_keeps_what_was_stored(tmp_path: Path, engine: FakeEngine) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    axes = "axes: {seed: {count: 60}}"
    resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, limits[1]))  # the system answers as for a full disk
    try:
        with pytest.raises(RecordingError, match="continue with --resume"):
            campaign(tmp_path, axes)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    flown = sum(engine.seen.values())
    assert 0 < flown < 60
    assert campaign(tmp_path, axes, resume=True) == 0
    assert summary(tmp_path)["cases"] == 60
    assert sum(engine.seen.values()) <= 60 + engine.capacity, "only what was on its way is flown again"


@pytest.mark.parametrize("moment", [1, 3])
def test_a_signal_leaves_tables_and_nothing_is_flown_twice(tmp_path: Path, engine: FakeEngine, moment: int) -> None:
    waits, first = [0], engine.wait

    def wait(timeout_s: float) -> list[Done]:
        waits[0] += 1
        if waits[0] == moment:
            raise KeyboardInterrupt
        return first(timeout_s)

    engine.wait = wait  # type: ignore[method-assign]
    with pytest.raises(KeyboardInterrupt):
        campaign(tmp_path, "axes: {seed: [1, 2, 3, 4, 5]}")
    assert summary(tmp_path)["cases"] == moment - 1
    assert not summary(tmp_path)["complete"]
    engine._jobs.clear()
    assert campaign(tmp_path, "axes: {seed: [1, 2, 3, 4, 5]}", resume=True) == 0
    assert summary(tmp_path)["cases"] == 5
    assert set(engine.seen.values()) == {1}


def test_progress_is_told_while_a_flight_goes_on(tmp_path: Path, engine: FakeEngine) -> None:
    told: list[Progress] = []
    short = engine.wait
    waits = iter([False] * 5)
    engine.wait = lambda timeout_s: short(timeout_s) if next(waits, True) else []  # type: ignore[method-assign]
    path = tmp_path / "c.yaml"
    path.write_text("settings: {seed: 2}\n")
    file = load_campaign(path)
    with Store(tmp_path / "out") as store:
        Campaign(file, Plan(file), store, engine, tmp_path / "out", Stop(), told.append).run()
    assert [(state.done, state.total) for state in told if state.phase == "flights"][-6:] == [(0, 1)] * 5 + [(1, 1)]


def test_flights_of_one_machine_have_numbers_of_their_own() -> None:
    one, two = FlightNumber(), FlightNumber()
    assert one.number != two.number
    one.free()
    three = FlightNumber()
    assert three.number == one.number, "the lowest free number"
    two.free()
    three.free()


def test_a_ray_that_is_missing_or_cannot_be_reached(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigError, match="--address"):
        campaign(tmp_path, "axes: {seed: [1]}", address="127.0.0.1:6379")
    with pytest.raises(ConfigError, match=r"--engine.*is unknown: 'slurm'"):
        campaign(tmp_path, "axes: {seed: [1]}", engine="slurm")
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ConfigError, match="needs Ray, which is not installed"):
        campaign(tmp_path, "axes: {seed: [1]}", engine="ray")
    found = ModuleType("ray")
    found.__spec__ = ModuleSpec("ray", None)
    monkeypatch.setitem(sys.modules, "ray", found)
    with pytest.raises(ConfigError, match="is not HOST:PORT"):
        campaign(tmp_path, "axes: {seed: [1]}", engine="ray", address="ray://nowhere")
    with pytest.raises(RecordingError, match=r"no Ray cluster answers at 127\.0\.0\.1:1 "):
        campaign(tmp_path, "axes: {seed: [1]}", engine="ray", address="127.0.0.1:1")
    assert not (tmp_path / "out").exists()


def test_workers_get_their_descriptors_or_say_what_they_need() -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (150, hard))
        LocalEngine(40).close()
        assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] >= 180, "the limit is raised where that is allowed"
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(local.resource, "getrlimit", lambda _: (64, 64))
        patch.setattr(local.resource, "setrlimit", _not_allowed)
        with pytest.raises(OutOfFiles, match="40 workers need 180 file descriptors, the limit is 64: use fewer"):
            LocalEngine(40)


def _not_allowed(*_: object) -> None:
    raise ValueError("not allowed to raise maximum limit")


@pytest.mark.parametrize("error", [EOFError(), OSError(24, "Too many open files")])
def test_a_worker_that_cannot_be_started_is_told(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    def start(_: object) -> None:
        raise error

    engine = LocalEngine(1)
    monkeypatch.setattr(engine._context.Process, "start", start)
    try:
        with pytest.raises(RecordingError, match=r"worker \d+ cannot be started \(.*\): use fewer --workers.*--resume"):
            engine.submit(Job("a", None, (), "run"))
    finally:
        engine.close()


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        (MemoryError(), "OutOfMemory"),
        (ImportError("x.so: failed to map segment"), "OutOfMemory"),
        (KeyError(), "KeyError"),
    ],
)
def test_a_flight_without_memory_is_an_error_of_that_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, kind: str
) -> None:
    def flown(*_: object) -> Outcome:
        raise error

    monkeypatch.setattr(flight, "_flown", flown)
    outcome = flight.fly(Job("a", None, (), str(tmp_path / "run")))
    assert (outcome.status, outcome.error_type) == ("ERROR", kind)


SHORT = ("mission=rigs/missions/short.waypoints", "autopilot.transport=loopback", "duration_s=60")


def test_a_worker_that_is_killed_or_hangs_is_replaced(tmp_path: Path) -> None:
    job = Job("a", None, SHORT, str(tmp_path / "run"))
    engine = LocalEngine(1)
    try:
        engine.submit(job)
        os.kill(engine._workers[0]._process.pid, signal.SIGKILL)
        (done,) = engine.wait(60.0)
        assert done.outcome is None
        assert "was ended by SIGKILL" in done.lost
        assert engine.busy == 0
        engine._timeout_s = 0.3
        engine.submit(job)
        os.kill(engine._workers[0]._process.pid, signal.SIGSTOP)
        (done,) = engine.wait(60.0)
        assert done.outcome is not None
        assert (done.outcome.status, done.outcome.error_type) == ("ERROR", "Timeout")
        engine._timeout_s = None
        engine.submit(Job("b", str(tmp_path / "none.yaml"), (), str(tmp_path / "run")))
        (done,) = engine.wait(60.0)
        assert done.outcome is not None
        assert done.outcome.error_type == "ConfigError"
    finally:
        engine.close()


@pytest.mark.parametrize("number", [signal.SIGKILL, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)])
def test_a_campaign_that_is_killed_leaves_no_process_and_is_resumed(tmp_path: Path, number: signal.Signals) -> None:
    path, out = tmp_path / "c.yaml", tmp_path / "out"
    path.write_text(HEAD + "axes: {seed: [1, 2, 3]}\n")
    line = [sys.executable, "-m", "hil.cli", "campaign", str(path), "--out", str(out), "--workers", "1", "--quiet"]
    process = subprocess.Popen(line, stderr=subprocess.PIPE, text=True)
    deadline_s = time.monotonic() + 200.0
    while _stored(out) < 1:
        assert process.poll() is None
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
    children = _children(process.pid)
    assert children
    process.send_signal(number)
    _, said = process.communicate(timeout=PATIENCE_S)
    if number == signal.SIGTERM:
        assert (process.returncode, said.splitlines()) == (3, ["error: stopped by SIGTERM"])
        assert json.loads((out / "campaign.json").read_text())["cases"] >= 1
    while any(Path(f"/proc/{child}").exists() for child in children):
        assert time.monotonic() < deadline_s, "a worker outlives the campaign"
        time.sleep(0.02)
    before = _stored(out)
    assert run_campaign(path, CampaignOptions(out=out, resume=True, workers=1, quiet=True), Console(quiet=True)) == 0
    assert json.loads((out / "campaign.json").read_text())["flown"] == 3 - before
    assert not (out / "work").exists()


def _stored(out: Path) -> int:
    try:
        with sqlite3.connect(f"file:{out / 'campaign.sqlite'}?mode=ro", uri=True) as database:
            return int(database.execute("SELECT count(*) FROM flown").fetchone()[0])
    except sqlite3.Error:
        return 0


def _children(pid: int) -> set[int]:
    """Return all descendants of a process."""
    found = {
        int(child) for task in Path(f"/proc/{pid}/task").iterdir() for child in (task / "children").read_text().split()
    }
    return found.union(*(_children(child) for child in found)) if found else found


@pytest.mark.parametrize(
    ("second", "flakes", "checked"),
    [
        (Outcome("PASS", digest="other", repeatable=True), 1, 1),
        (Outcome("ERROR", error_type="LockstepLost"), 1, 1),
        (Outcome("ERROR", error_type="WorkerLost"), 0, 0),  # says nothing about the bench: made again with --resume
    ],
)
def test_the_end_of_a_second_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, second: Outcome, flakes: int, checked: int
) -> None:
    monkeypatch.setattr(command, "make_engine", lambda *_: SecondFlightsEnd(second))
    path = tmp_path / "c.yaml"
    path.write_text(HEAD.replace("recheck: 0", "recheck: 1") + "axes: {seed: [1]}")
    run_campaign(path, CampaignOptions(out=tmp_path / "out", quiet=True), Console(quiet=True))
    assert summary(tmp_path)["flake"] == flakes
    with sqlite3.connect(tmp_path / "out" / "campaign.sqlite") as db:
        assert db.execute("SELECT COUNT(*) FROM checked").fetchone() == (checked,)
