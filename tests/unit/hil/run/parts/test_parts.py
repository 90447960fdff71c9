"""Parts of a run: every registered one keeps the life cycle, and a bench can name parts of its own."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any, ClassVar

import pytest
from hypothesis import given, strategies

from hil.config import load_bench
from hil.run.bench_run import run_bench
from hil.run.part import Part, RunContext
from hil.run.parts.catalog import parts_of
from hil.run.runs.vehicle_run import VehicleRun
from hil.run.verdict.verdict import Row, Verdict
from signals.errors import ConfigError
from tests.worlds.followed_log import line, write_log

ROOT = Path(__file__).resolve().parents[5]
SHORT = ["autopilot.transport=loopback", "record.mcap=false", "record.tlog=false", "record.report=false"]
BENCHES = {
    "default": ["duration_s=1"],
    "parameters": ["autopilot.params.MPC_XY_P=0.9"],
    "companion": ["companion.clients=1", "companion.control=true"],
    "router and manual": ["router.gcs=udp:127.0.0.1:14550", "manual.device=keyboard"],
    "explore": [],
    "people_search": [],
    "plane": [],
    "vtol": [],
    "script": ["mission=rigs/missions/rectangle_gust.yaml"],
    "nobody flies": ["mission=null", "plane_limits.max_bank_deg=20"],
    "suite": ["parts.test_suite.command=[suite.py]"],
    "radar": ["sensors.radar={{preset: bgt60tr13c, rate_hz: 10}}"],
    "vibration": ["vibration=estimated"],
    "satellites": ["sensors.gps.sky={{}}"],
    "signing": ["autopilot.signing_key_file={folder}/signing.key"],
    "follow": ["mission=null", "follow.log={folder}/flight.csv", "follow.columns={folder}/flight.yaml"],
}


# `test_suite`, a file beside the folders, is a part that benches name in their section `parts`.
FILES = {path.stem for path in (ROOT / "hil/run/parts").glob("*/[a-z]*.py")} | {"test_suite"}
EVERY_PART = pytest.mark.parametrize("name", sorted(FILES))


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Part]:
    """Return one part of every name in the catalogue, from several benches."""
    folder = tmp_path_factory.mktemp("keys")
    (folder / "signing.key").write_text("ab" * 32)
    (folder / "signing.key").chmod(0o600)
    write_log(folder, line(5.0, 10.0, 40.0), 40.0)
    found: dict[str, Part] = {}
    for name, texts in BENCHES.items():
        settings = [text.format(folder=folder) for text in texts]
        rig = name if name in ("explore", "people_search", "plane", "vtol") else None
        for part in parts_of(load_bench(ROOT / "rigs" / f"{rig}.yaml" if rig else None, settings=settings)):
            found.setdefault(part.name, part)
    return found


def test_the_catalogue_is_covered_and_names_are_those_of_the_files(parts: dict[str, Part]) -> None:
    assert set(parts) == FILES


@EVERY_PART
def test_a_part_that_was_never_opened_still_answers_and_closes(parts: dict[str, Part], name: str) -> None:
    part = parts[name]
    assert isinstance(dict(part.run_keys()), dict)
    assert all("what" in row for row in part.skipped(0))
    assert part.repeatable() in (True, False)
    assert part.verdict().status in ("PASS", "FAIL")
    part.close()
    part.close()


@EVERY_PART
def test_no_part_overrides_what_does_not_exist(parts: dict[str, Part], name: str) -> None:
    public = {method for method in vars(type(parts[name])) if not method.startswith("_")}
    own = {
        "scene",
        "samples_due",
        "can_have_faults",
        "unmet",
        "has_met",
        "flying",
        "autopilot_signing",
        "link",
        "reached",
        "step",
    }
    assert public - set(dir(Part)) <= own


class Finds(Part):
    """Part with a verdict of its own."""

    def __init__(self, name: str, verdict: Verdict) -> None:
        self.name, self._verdict = name, verdict

    def verdict(self) -> Verdict:
        return self._verdict


@EVERY_PART
def test_no_part_takes_away_what_another_has_found(parts: dict[str, Part], name: str, tmp_path: Path) -> None:
    row = Row("a_row", 1.0, None, "m", True)
    before = Finds("before", Verdict([row], ["an early reason"]))
    after = Finds("after", Verdict(causes=["a late cause"]))
    bench = load_bench(settings=SHORT)
    verdict = VehicleRun(bench, tmp_path, [before, parts[name], after], quiet=True).mark_unfinished().run["verdict"]
    assert verdict["reasons"][0] == "a late cause"
    assert "an early reason" in verdict["reasons"]
    assert verdict["rows"][0] == row.as_map()
    own = parts[name].verdict()
    assert verdict["rows"][1:] == [other.as_map() for other in own.rows]
    assert set(own.reasons) < set(verdict["reasons"])


ROWS = strategies.lists(
    strategies.builds(
        Row,
        strategies.uuids().map(str),
        strategies.none() | strategies.floats(),
        strategies.none() | strategies.floats(),
        strategies.just("m"),
        strategies.booleans(),
    ),
    max_size=3,
)
TEXTS = strategies.lists(strategies.text(max_size=3), max_size=3)
VERDICTS = strategies.lists(strategies.builds(Verdict, ROWS, TEXTS, TEXTS), max_size=5)


@given(VERDICTS)
def test_verdicts_together_keep_every_row_and_reason(verdicts: list[Verdict]) -> None:
    together = Verdict.together(verdicts)
    assert list(together.rows) == [row for verdict in verdicts for row in verdict.rows]
    assert set(together.reasons) == {reason for verdict in verdicts for reason in verdict.reasons}
    causes = [cause for verdict in verdicts for cause in verdict.causes]
    assert list(together.reasons[: len(causes)]) == causes
    failed = any(verdict.reasons or not all(row.ok for row in verdict.rows) for verdict in verdicts)
    assert together.status == ("FAIL" if failed else "PASS")


@pytest.mark.parametrize(
    ("own", "words"),
    [
        ('verdict(self): return Verdict([Row("final_error_m", 0.0, None, "m", True)])', "are called 'final_error_m'"),
        ("verdict(self): pass", "NoneType"),
        ('run_keys(self): return {"status": "PASS"}', "'own' returns the key 'status'"),
        ('run_keys(self): return {"mission": {}}', "'own' returns the key 'mission'"),
    ],
)
def test_a_part_that_would_hide_the_word_of_another_ends_the_run(own: str, words: str, tmp_path: Path) -> None:
    names: dict[str, Any] = {"Part": Part, "Row": Row, "Verdict": Verdict}
    exec(f"class Own(Part):\n  name = 'own'\n  def {own}", names)
    result = run_bench(load_bench(settings=SHORT), tmp_path, quiet=True, more=[names["Own"]()])
    assert (result.status, result.run["sim_s"]) == ("ERROR", 0.0)
    assert words in result.run["error"]["message"]
    assert result.run["mission"]["waypoints"] == 0  # what the parts of the bench say is there


def test_what_nobody_asked_for_is_not_imported() -> None:
    code = (
        "import sys; from hil.config import load_bench; from hil.run.bench_run import parts_of; parts_of(load_bench());"
        "print([m for m in ('zmq', 'cv2', 'hil.run.parts.judges.goal', 'hil.run.parts.links.router',"
        " 'hil.apps.dash.part', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


PART = """
from typing import Annotated
from pydantic import Field
from hil.run.part import Part, RunContext
from hil.run.verdict.verdict import Verdict
from signals.documents.validate import Section


class Settings(Section):
    ticks: Annotated[int, Field(ge=1)]


class Counter(Part):
    name = "counter"

    def __init__(self, settings):
        self.calls, self._left = [], settings.ticks

    def open(self, run):
        self.calls.append("open")

    def build(self, run):
        self.calls.append("build")

    def observers(self):
        return [self.see]

    def see(self, truth):
        self._left -= 1

    def begin(self, run):
        self.calls.append("begin")

    def ended(self):
        return self._left == 0

    def conclude(self, run):
        self.calls.append("conclude")

    def close(self):
        self.calls.append("close")

    def verdict(self):
        return Verdict([], ["it was counted"])

    def run_keys(self):
        return {"counter": list(self.calls)}


def make(bench, settings):
    return Counter(settings)
"""


@pytest.fixture
def own_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "counter.py").write_text(PART)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    for name in ("mine", "mine.counter"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return tmp_path


def test_a_bench_names_a_part_of_the_users_own(own_part: Path) -> None:
    (own_part / "b.yaml").write_text("parts:\n  mine.counter: {ticks: 25}\n")
    result = run_bench(load_bench(own_part / "b.yaml", settings=SHORT), own_part / "out", quiet=True)
    assert result.run["error"] is None
    assert result.run["sim_s"] == pytest.approx(25 / 250)
    assert result.run["counter"] == ["open", "build", "begin", "conclude", "close"]
    assert (result.status, result.run["verdict"]["reasons"][-1]) == ("FAIL", "it was counted")
    saved = load_bench(own_part / "out" / "bench.yaml")
    assert saved.config.parts["mine.counter"].ticks == 25


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ("mine.counter: {ticks: 0}", r"b\.yaml:2.*parts\.mine\.counter\.ticks.*1"),
        ("mine.counter: {tocks: 3}", r"b\.yaml:2.*tocks: unknown key.*ticks"),
        ("mine.missing: {}", r"b\.yaml:2.*cannot be imported.*mine\.missing"),
        ("missing: {}", r"b\.yaml:2.*cannot be imported"),
        ("catalog: {}", r"b\.yaml:2.*that has no settings"),
    ],
)
def test_wrong_parts_are_named_with_file_and_line(own_part: Path, section: str, message: str) -> None:
    (own_part / "b.yaml").write_text(f"parts:\n  {section}\n")
    with pytest.raises(ConfigError) as error:
        load_bench(own_part / "b.yaml")
    assert re.search(message, str(error.value).replace("\n", " "))


class Fails(Part):
    name = "fails"

    def __init__(self, where: str) -> None:
        self.where, self.closed = where, False

    def __getattribute__(self, name: str) -> Any:
        if name == object.__getattribute__(self, "where"):
            raise ConfigError([])
        return object.__getattribute__(self, name)

    def close(self) -> None:
        self.closed = True


@pytest.mark.parametrize("where", ["open", "ports", "build", "command_sources", "observers", "begin", "conclude"])
def test_a_part_that_fails_ends_the_run_as_an_error_and_is_closed(where: str, tmp_path: Path) -> None:
    part = Fails(where)
    bench = load_bench(settings=[*SHORT, "duration_s=0.1"])
    result = run_bench(bench, tmp_path, quiet=True, more=[part])
    assert (result.status, result.run["error"]["type"]) == ("ERROR", "ConfigError")
    assert part.closed


def test_events_of_the_run_have_its_time() -> None:
    bench = load_bench(settings=SHORT)
    context = RunContext(bench, Path(), [])
    assert (context.now_ns(), context.ticks, context.status().phase) == (0, 0, "serving")
    with pytest.raises(ValueError, match="nothing in this run can have a str"):
        context.inject("fault")


def test_a_wrong_port_is_named_before_anything_is_opened_or_reported(tmp_path: Path) -> None:
    settings = ["autopilot.port=/dev/ttyNOPE", "sensors.imu.rate_hz=250"]
    result = run_bench(load_bench(None, rig="px4_hitl", settings=settings), tmp_path / "out", quiet=True)
    assert result.status == "ERROR"
    assert result.run["error"]["type"] == "PortNotFound"
    assert [file.name for file in (tmp_path / "out").iterdir()] == ["run.json"]


def test_what_a_part_says_stands_on_the_console_and_in_the_recording(capsys: pytest.CaptureFixture[str]) -> None:
    class Recorded:
        events: ClassVar[list[tuple[int, str, str]]] = []

        def event(self, t_ns: int, kind: str, text: str) -> None:
            self.events.append((t_ns, kind, text))

    for quiet, printed in ((True, ""), (False, "restart: the board has flown\n")):
        run = RunContext(load_bench(None), Path(), [], quiet=quiet)
        run.recorder = Recorded()  # type: ignore[assignment]
        run.say("restart", "the board has flown")
        assert capsys.readouterr().out == printed
    assert Recorded.events == [(0, "restart", "the board has flown")] * 2
