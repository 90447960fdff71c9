"""The section `goal`: flight of a companion to a goal, judged from ground truth (`hil.run.verdict.goal`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from hil.config import Bench
from hil.config.missions.path import PlanPoint
from hil.config.schema import Goal
from hil.run.part import Part, RunContext
from hil.run.verdict.goal import GoalMeasurement
from hil.run.verdict.verdict import Verdict
from signals.desired import DesiredState
from signals.samples import TruthState


class GoalPart(Part):
    name = "goal"

    def __init__(self, goal: Goal, bench: Bench) -> None:
        self._goal = goal
        self._measured = GoalMeasurement(goal, bench.vehicle)

    def open(self, run: RunContext) -> None:
        run.route = [PlanPoint(self._goal.p_W, "goal")]

    def observers(self) -> list[Callable[[TruthState], None]]:
        return [self._measured.add]

    def on_desired(self, desired: DesiredState, t_apply_ns: int) -> None:
        if desired.land:
            self._measured.end(t_apply_ns)

    def on_report(self, client: str, report: Mapping[str, Any], t_ns: int, *, control: bool) -> None:  # noqa: ARG002
        if control:
            self._measured.reported(report, t_ns)

    def conclude(self, run: RunContext) -> None:
        self._measured.conclude(run.part("sensors").scene(run).geometry)

    def verdict(self) -> Verdict:
        return Verdict(*self._measured.verdict_rows())

    def run_keys(self) -> dict[str, Any]:
        return {"goal": self._measured.result.as_map()}


def make(bench: Bench) -> Part:
    assert bench.config.goal is not None
    return GoalPart(bench.config.goal, bench)
