"""Finds a PASS of nothing: the vehicle stood where it was all the time, and nothing else of the bench minds that.

Four kinds of benches do not. One that flies nothing itself may be flown by a program on `router.sdk`, a ground
station, sticks or AirSim's API; it is judged by crash, failsafe and `fly_away_m` alone, which one at rest meets. A
script without a plan is judged by its own measurements, most of which a vehicle at rest meets, too. A goal with another
outcome than `goal` takes the word of a client that reports it at once. And a script with `outcome: aborted` or `any`
takes a mission that was not completed. What was never begun is not aborted: that is a FAIL.
The others are warned of, because a start that is refused may be what the test is about. So is an aborted mission whose
vehicle was in the air when the time of the run was over: it may only have been too long.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from hil.config import Bench
from hil.config.missions.script import Outcome
from hil.run.part import Part, RunContext
from hil.run.verdict.verdict import AIRBORNE_M, Verdict
from signals.samples import TruthState, Vec3

NOTHING_FLIES = (
    "nothing was flown or judged: the bench has no mission, and the vehicle never left its start; name a mission "
    "(--mission FILE), or connect the program that flies it before the flight ends (duration_s)"
)
NO_PLAN = "nothing was flown: the vehicle never left its start; have the script arm it and take off"
ANY_OUTCOME = "nothing was flown: the vehicle never left its start, and the script takes that (outcome: any)"
OTHER_OUTCOME = "nothing was flown: the vehicle never left its start, and the goal takes that (goal.outcome: {})"
NOT_BEGUN = "the vehicle never left its start: the mission was not aborted, it never began"
OUT_OF_TIME = (
    "the run ended at duration_s with the vehicle in the air, and the script takes that as an aborted mission; one "
    "that is only too long for duration_s looks the same"
)


class UnflownPart(Part):
    name = "unflown"

    def __init__(self, outcome: Outcome, *, unflown: str = NOTHING_FLIES, last_tick: int | None = None) -> None:
        """`unflown`: what to say of a vehicle that never left its start. `last_tick`: the run goes no further."""
        self._outcome, self._unflown, self._last_tick = outcome, unflown, last_tick
        self._out_of_time = False
        self._start_W: Vec3 | None = None  # from the first tick on
        self._moved = False
        self._told = ""

    def observers(self) -> list[Callable[[TruthState], None]]:
        return [self._observe]

    def _observe(self, truth: TruthState) -> None:
        if self._start_W is None:
            self._start_W = truth.p_WB
        self._moved = self._moved or math.dist(truth.p_WB, self._start_W) > AIRBORNE_M
        if self._last_tick is not None and truth.tick >= self._last_tick:
            self._out_of_time = not truth.in_contact

    def conclude(self, run: RunContext) -> None:
        if self._moved and self._out_of_time and self._outcome == "aborted":
            run.say("warning", OUT_OF_TIME)
        if not self._moved and self._outcome != "aborted":
            self._told = ANY_OUTCOME if self._outcome == "any" else self._unflown
            run.say("warning", self._told)

    def run_keys(self) -> dict[str, Any]:
        return {"unflown": self._told} if self._told else {}  # for what makes many runs

    def verdict(self) -> Verdict:
        begun = self._moved or self._start_W is None
        return Verdict(reasons=[] if begun or self._outcome != "aborted" else [NOT_BEGUN])


def make(bench: Bench) -> Part:
    last_tick = round(bench.config.duration_s * bench.config.tick_hz) - 1
    goal = bench.config.goal
    unflown = NOTHING_FLIES if bench.script is None else NO_PLAN
    unflown = unflown if goal is None else OTHER_OUTCOME.format(goal.outcome)
    return UnflownPart(bench.outcome, unflown=unflown, last_tick=last_tick)
