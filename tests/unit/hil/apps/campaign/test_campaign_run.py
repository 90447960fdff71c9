"""Small campaigns flown whole: the same table for any number of workers, resumed, extended and stopped."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from hil.apps.campaign.campaign import Campaign, is_chosen
from hil.apps.campaign.command import CampaignOptions, run_campaign
from hil.apps.campaign.flight import Job, Limit, Outcome
from hil.apps.campaign.identity import case_id
from hil.apps.campaign.store import Store
from hil.config import load_bench
from signals.errors import ConfigError

# One flight passes, one ends as FAIL: 8 s are too short for the mission.
SPEC = """
settings:
  mission: rigs/missions/short.waypoints
  autopilot: {transport: loopback}
  limits: {max_cross_track_m: 5}
axes: {duration_s: [60, 8], seed: [1]}
recheck: 1.0
keep: none
"""


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    path = tmp_path / "small.yaml"
    path.write_text(SPEC)
    return path


def fly(spec: Path, out: Path, **options: Any) -> int:
    return run_campaign(spec, CampaignOptions(out=out, quiet=True, **options), Console(quiet=True))


def rows(out: Path) -> list[dict[str, str]]:
    with (out / "results.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_one_table_for_any_number_of_workers_and_nothing_flown_twice(spec: Path, tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    assert fly(spec, one, workers=1) == 1
    assert fly(spec, two, workers=2) == 1
    assert (one / "results.csv").read_bytes() == (two / "results.csv").read_bytes()
    assert (one / "results.jsonl").read_bytes() == (two / "results.jsonl").read_bytes()
    table = rows(one)
    assert [row["case"] for row in table] == sorted(row["case"] for row in table)
    assert {(row["duration_s"], row["status"]) for row in table} == {("60", "PASS"), ("8", "FAIL")}
    assert all("waypoints" in row["reason"] for row in table if row["status"] == "FAIL")
    assert len({row["digest"] for row in table}) == 2
    summary = json.loads((one / "campaign.json").read_text())
    assert [summary[key] for key in ("schema", "cases", "pass", "fail", "error", "flake")] == [1, 2, 1, 1, 0, 0]
    assert summary["pass_rate"] == pytest.approx([0.0945, 0.5, 0.9055], abs=1e-4)  # Wilson, 1 of 2
    assert summary["flown"] == 4, "each case is flown twice: recheck is 1"

    with pytest.raises(ConfigError, match="--resume"):
        fly(spec, one)
    before = (one / "results.csv").read_bytes()
    assert fly(spec, one, resume=True) == 1
    assert json.loads((one / "campaign.json").read_text())["flown"] == 0
    assert (one / "results.csv").read_bytes() == before

    spec.write_text(SPEC.replace("duration_s: [60, 8], seed: [1]", "duration_s: [60], seed: [1, 2]"))
    assert fly(spec, one, resume=True) == 0
    assert json.loads((one / "campaign.json").read_text())["flown"] == 2, "seed 2, twice"
    assert [row["status"] for row in rows(one)] == ["PASS", "PASS"]


def test_faults_that_no_flight_met_are_told(spec: Path, tmp_path: Path) -> None:
    """The mission takes some 40 s: the gust at 300 s never comes, so that case says nothing about it."""
    spec.write_text(
        SPEC.replace(
            "duration_s: [60, 8], seed: [1]", "wind.gusts: [[], [{at_s: 300, velocity_W_mps: [3, 0, 0], rise_s: 1}]]"
        )
        .replace("  limits:", "  wind: {steady_W_mps: [0, 0, 0]}\n  duration_s: 60\n  limits:")
        .replace("recheck: 1.0", "recheck: 0.0")
    )
    said = io.StringIO()
    assert run_campaign(spec, CampaignOptions(out=tmp_path / "out", quiet=True), Console(file=said, width=300)) == 1
    assert "warning: 1 case without what was declared, such as " in said.getvalue()
    assert "gust at 300 s never began: the flight ended at" in said.getvalue()
    assert json.loads((tmp_path / "out" / "campaign.json").read_text())["unmet"] == 1
    assert (tmp_path / "out" / "junit.xml").read_text().count('name="unmet"') == 1


def test_cases_in_which_nothing_flew_are_told(spec: Path, tmp_path: Path) -> None:
    """The vehicle of one case has no mission and stands at its start, which no limit minds: it was green."""
    spec.write_text(
        "settings: {rig: mock, duration_s: 60, autopilot: {transport: loopback}}\n"
        "axes: {mission: [null, rigs/missions/short.waypoints]}\nrecheck: 0.0\n"
    )
    said = io.StringIO()
    assert run_campaign(spec, CampaignOptions(out=tmp_path / "out", quiet=True), Console(file=said, width=300)) == 0
    assert [row["status"] for row in rows(tmp_path / "out")] == ["PASS", "PASS"], "no limit minds it: only told"
    assert "warning: 1 case without what was declared, such as " in said.getvalue()
    assert "nothing was flown or judged" in said.getvalue()
    assert json.loads((tmp_path / "out" / "campaign.json").read_text())["unmet"] == 1
    assert (tmp_path / "out" / "junit.xml").read_text().count('name="unmet"') == 1


def test_a_campaign_that_nobody_flies_is_refused(spec: Path, tmp_path: Path) -> None:
    spec.write_text("settings: {rig: mock, mission: null}\naxes: {seed: [1, 2]}\n")
    with pytest.raises(ConfigError, match=r"small.yaml: flies nothing: nobody flies the vehicle of its bench"):
        fly(spec, tmp_path / "out")


def test_second_flights_that_could_not_be_made_are_told(
    spec: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec.write_text(SPEC.replace("duration_s: [60, 8], seed: [1]", "duration_s: [60], seed: [1]"))
    compare = Campaign._compare
    lost = Outcome("ERROR", error_type="WorkerLost", error="out of memory")
    monkeypatch.setattr(Campaign, "_compare", lambda self, job, _: compare(self, job, lost))
    said = io.StringIO()
    run_campaign(spec, CampaignOptions(out=tmp_path / "out", quiet=True), Console(file=said, width=300))
    assert "warning: 1 second flight could not be made; --resume flies the rest" in said.getvalue()


def test_a_second_flight_with_another_verdict_is_a_flake(
    spec: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A client that fails after every other flight changes no digest: both flights were called the same."""
    spec.write_text(SPEC.replace("duration_s: [60, 8], seed: [1]", "duration_s: [60], seed: [1]"))
    compare = Campaign._compare

    def failed(self: Campaign, job: Job, outcome: Outcome) -> None:
        compare(self, job, replace(outcome, status="FAIL", reasons=("detect ended with status 1",)))

    monkeypatch.setattr(Campaign, "_compare", failed)
    assert fly(spec, tmp_path / "out") == 1
    (row,) = rows(tmp_path / "out")
    assert row["status"] == "FLAKE"
    assert row["reason"] == "the same flight was PASS and then FAIL: detect ended with status 1"


def test_a_trial_flight_that_is_an_error_fails_the_dry_run(spec: Path, tmp_path: Path) -> None:
    assert fly(spec, tmp_path / "out", dry_run=True) == 0
    spec.write_text(SPEC.replace("{transport: loopback}", "{transport: loopback, faults: {die_at_s: 2}}"))
    assert fly(spec, tmp_path / "out", dry_run=True) == 3


def test_a_digest_that_differs_is_a_flake(spec: Path, tmp_path: Path) -> None:
    spec.write_text(SPEC.replace("duration_s: [60, 8], seed: [1]", "duration_s: [60], seed: [1]"))
    out = tmp_path / "out"
    assert fly(spec, out, workers=1) == 0
    (row,) = rows(out)
    with Store(out) as store:
        outcome = store.outcome(row["case"])
        assert outcome is not None
        store.put(row["case"], replace(outcome, digest="0" * 64), ())
        store._db.do("DELETE FROM checked")
    assert fly(spec, out, resume=True) == 1
    (row,) = rows(out)
    assert row["status"] == "FLAKE"
    assert "digest" in row["reason"]
    assert json.loads((out / "campaign.json").read_text())["flake"] == 1


@pytest.mark.slow
def test_stop_rules_give_the_same_part_of_the_plan(spec: Path, tmp_path: Path) -> None:
    spec.write_text(
        SPEC.replace("duration_s: [60, 8]", "duration_s: [60, 8, 9, 7]").replace("recheck: 1.0", "recheck: 0")
    )
    tables = []
    for workers in (1, 2):
        out = tmp_path / str(workers)
        assert fly(spec, out, workers=workers, stop_after=("failure",)) == 1
        tables.append((out / "results.csv").read_bytes())
        assert "not a PASS" in json.loads((out / "campaign.json").read_text())["stopped"]
    assert tables[0] == tables[1]
    assert [row["status"] for row in rows(tmp_path / "1")].count("FAIL") == 1


def test_a_bench_that_cannot_be_loaded_is_told_before_any_flight(spec: Path, tmp_path: Path) -> None:
    spec.write_text(SPEC.replace("seed: [1]", "scene: [airfield, nowhere]"))
    with pytest.raises(ConfigError, match=r"small.yaml:6.*nowhere"):
        fly(spec, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("text", ["width=2", "width=x", "90", "m", "above", ""])
def test_a_stop_rule_that_is_none_is_refused(spec: Path, tmp_path: Path, text: str) -> None:
    with pytest.raises(ConfigError, match="stop-after"):
        fly(spec, tmp_path / "out", stop_after=(text,))


def test_many_points_need_a_yes(spec: Path, tmp_path: Path) -> None:
    spec.write_text(SPEC.replace("seed: [1]", "seed: {first: 1, count: 1000000000}"))
    with pytest.raises(ConfigError, match=r"2,000,000,000 points.*--yes"):
        fly(spec, tmp_path / "out")


def test_the_identity_follows_what_changes_a_flight_and_nothing_else() -> None:
    base = case_id(load_bench(None))
    same = ["record.mcap=false", "pace=2", "autopilot.instance=3", "foxglove.port=8765", "ros2.domain=0"]
    other = [
        "seed=2",
        "vehicle_settings.mass_kg=2.1",
        "scene=city_park",
        "mission=rigs/missions/survey.plan",
        "tick_hz=500",
        "ros2={domain: 0, control: true}",
    ]
    assert {case_id(load_bench(None, settings=[text])) for text in same} == {base}
    identities = {case_id(load_bench(None, settings=[text])) for text in other}
    assert len(identities | {base}) == len(other) + 1


@pytest.mark.parametrize("module", ["pilot", "pilots.square"])
def test_an_edited_client_is_flown_again(module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A result of the old client would pass for one of the new."""
    monkeypatch.chdir(tmp_path)
    source = tmp_path / f"{module.replace('.', '/')}.py"
    helper = source.with_name("helper.py")
    source.parent.mkdir(exist_ok=True)
    weights = tmp_path / "weights.bin"
    for path in (source, helper, weights):
        path.write_text("gain = 1")
    texts = [f"companion={{start: ['{module}:fly'], settings: {{model: weights.bin}}}}"]

    def now() -> str:
        return case_id(load_bench(None, settings=texts))

    identities = [now()]
    for path in (source, helper, weights):
        assert now() == identities[-1]
        path.write_text("gain = 10")
        identities.append(now())
    assert len(set(identities)) == 4


def test_a_setting_is_no_file_of_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file `mock` in the current folder took the place of the autopilot's kind."""
    monkeypatch.chdir(tmp_path)
    program = tmp_path / "px4"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    changes = {
        ("companion={clients: 1, settings: {mode: low}}",): False,
        ("companion={clients: 1, trace: answers}",): True,
        ("rig=px4_sitl", "autopilot.binary=px4"): True,
    }
    for name in ("answers", "low"):
        (tmp_path / name).write_text("1")

    before = {texts: case_id(load_bench(None, settings=texts)) for texts in changes}
    for name in ("mock", "pty", "answers", "low", "px4"):
        with (tmp_path / name).open("a") as file:
            file.write("# edited\n")
    assert {texts: case_id(load_bench(None, settings=texts)) != before[texts] for texts in changes} == changes


def test_the_package_of_a_client_is_listed_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was walked again for each of thousands of cases."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pilots").mkdir()
    (tmp_path / "pilots" / "square.py").touch()
    walked: list[str] = []
    rglob = Path.rglob
    monkeypatch.setattr(Path, "rglob", lambda folder, files: walked.append(folder.name) or rglob(folder, files))
    for seed in range(3):
        case_id(load_bench(None, settings=["companion={start: ['pilots.square:fly']}", f"seed={seed}"]))
    assert walked.count("pilots") == 1


def test_a_share_of_the_cases_is_chosen_by_their_identity() -> None:
    cases = [f"{i * 2654435761 % 2**32:020x}" for i in range(20_000)]
    for share in (0.0, 0.02, 1.0):
        chosen = sum(is_chosen(case, share) for case in cases) / len(cases)
        assert chosen == pytest.approx(share, abs=0.004)


@pytest.mark.parametrize(
    ("value", "limit", "ok", "margin"),
    [
        (0.3, 1.0, True, 0.7),  # a maximum that is kept
        (1.5, 1.0, False, -0.5),
        (0.95, 0.9, True, 0.0555555),  # a minimum that is kept
        (0.45, 0.9, False, -0.5),
        (1.0, 1.0, True, 0.0),
        (2.0, 0.0, False, -2.0),  # a limit of zero: in its own unit
        (None, 1.0, False, None),
        (1.0, None, True, None),
    ],
)
def test_margins(value: float | None, limit: float | None, ok: bool, margin: float | None) -> None:
    found = Limit("x", value, limit, "m", ok).margin
    assert found == (None if margin is None else pytest.approx(margin, abs=1e-6))


def test_an_outcome_survives_its_way_through_json() -> None:
    outcome = Outcome("FAIL", ("too far",), limits=(Limit("a", 1.25, 1.0, "m", False),), digest="ab", repeatable=True)
    assert Outcome.from_data(json.loads(json.dumps(outcome.data()))) == outcome
