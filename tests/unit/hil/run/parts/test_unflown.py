"""A run in which nobody flew says so, and is no aborted mission; one that anybody flies is neither."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from hil.config import load_bench
from hil.config.missions.script import Outcome
from hil.run.bench_run import run_bench
from hil.run.parts.catalog import parts_of
from hil.run.parts.judges.unflown import (
    ANY_OUTCOME,
    NO_PLAN,
    NOT_BEGUN,
    NOTHING_FLIES,
    OTHER_OUTCOME,
    OUT_OF_TIME,
    UnflownPart,
)

QUICK = ("autopilot.transport=loopback", "record={mcap: false, tlog: false, report: false}", "duration_s=1")


def test_a_bench_that_nobody_flies_says_that_it_judged_nothing(tmp_path: Path) -> None:
    run = run_bench(load_bench(settings=(*QUICK, "mission=null")), tmp_path, quiet=True).run
    assert run["status"] == "PASS"
    assert [row["text"] for row in run["warnings"]] == [NOTHING_FLIES]


@pytest.mark.parametrize(("outcome", "status", "words"), [("aborted", "FAIL", NOT_BEGUN), ("any", "PASS", ANY_OUTCOME)])
def test_a_mission_that_never_began_was_not_aborted(outcome: str, status: str, words: str, tmp_path: Path) -> None:
    script = tmp_path / "script.yaml"
    script.write_text(f"plan: {Path('rigs/missions/rectangle.plan').resolve()}\noutcome: {outcome}\n")
    run = run_bench(load_bench(mission=str(script), settings=QUICK), tmp_path / "run", quiet=True).run
    assert run["status"] == status
    assert words in [*run["verdict"]["reasons"], *(row["text"] for row in run["warnings"])]


def test_what_looks_judged_and_is_not_is_warned_of(tmp_path: Path) -> None:
    """The mission is too long for the run, and the measurement was over before the take-off."""
    script = tmp_path / "script.yaml"
    script.write_text(
        f"plan: {Path('rigs/missions/rectangle.plan').resolve()}\noutcome: aborted\n"
        "expect: [{measure: max_tilt_deg, at_most: 5, to_s: 2}, {measure: max_climb_mps, to_s: 2}]\n"
    )
    settings = (*QUICK[:2], "duration_s=14")
    run = run_bench(load_bench(mission=str(script), settings=settings), tmp_path / "run", quiet=True).run
    assert run["status"] == "PASS"
    out_of_time, on_ground = sorted((row["text"] for row in run["warnings"]), key=len, reverse=True)
    assert out_of_time == OUT_OF_TIME
    assert on_ground.startswith("max_tilt_deg was measured on the ground (from 0 s to 2 s; it took off at ")


def test_a_script_without_a_plan_that_never_flew_says_so(tmp_path: Path) -> None:
    script = tmp_path / "script.yaml"
    script.write_text(
        "actions: [{at_s: 0.5, param: {MIS_TAKEOFF_ALT: 5}, required: false}]\n"
        "expect: [{measure: max_tilt_deg, at_most: 35}]\n"
    )
    run = run_bench(load_bench(mission=str(script), settings=QUICK), tmp_path / "run", quiet=True).run
    assert run["status"] == "PASS"
    assert NO_PLAN in [row["text"] for row in run["warnings"]]


def test_a_script_whose_nodes_never_come_says_so(tmp_path: Path) -> None:
    """It passed without a word: the nodes in control were left to the script, and the script to them."""
    script = tmp_path / "script.yaml"
    script.write_text("actions: [{at_s: 0.5, param: {MIS_TAKEOFF_ALT: 5}}]\n")
    bench = load_bench(mission=str(script), settings=(*QUICK, "ros2={domain: 3, control: true}"))
    run = run_bench(bench, tmp_path / "run", quiet=True).run
    assert (run["status"], run["unflown"]) == ("PASS", NO_PLAN)


def test_what_is_judged_anyhow_has_no_such_part() -> None:
    for settings in (
        (),
        ("mission=null", "companion={clients: 1, control: true}"),
        ("mission=null", "goal={p_W: [1, 2, 3]}", "companion={clients: 1, control: true}"),
    ):
        assert "unflown" not in {part.name for part in parts_of(load_bench(settings=settings))}


def test_a_client_that_stays_may_report_another_outcome() -> None:
    """One that reported `stuck` at once passed without a word."""
    settings = ("mission=null", "goal={p_W: [1, 2, 3], outcome: stuck}", "companion={clients: 1, control: true}")
    (part,) = (part for part in parts_of(load_bench(settings=settings)) if part.name == "unflown")
    said: list[str] = []
    run: Any = SimpleNamespace(say=lambda _kind, text: said.append(text))
    (observe,) = part.observers()
    at_rest: Any = SimpleNamespace(p_WB=(0.0, 0.0, 0.2), tick=0)
    observe(at_rest)
    part.conclude(run)
    assert said == [OTHER_OUTCOME.format("stuck")]


@pytest.mark.parametrize("outcome", ["complete", "any", "aborted"])
@pytest.mark.parametrize(("away_m", "moved"), [(0.0, False), (0.2, False), (0.5, True)])
def test_who_left_its_start_was_flown(away_m: float, moved: bool, outcome: Outcome) -> None:
    part = UnflownPart(outcome)
    said: list[str] = []
    run: Any = SimpleNamespace(say=lambda _kind, text: said.append(text))
    (observe,) = part.observers()
    for x_m in (0.0, away_m, 0.0):
        truth: Any = SimpleNamespace(p_WB=(x_m, 0.0, 0.2))
        observe(truth)
    part.conclude(run)
    assert bool([*said, *part.verdict().reasons]) != moved
