"""What a run is judged by: the flight's own measurements, a script's, and those of a goal or a search."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from firmware_bridge.ground_station.actions import Record
from hil.config import Bench
from hil.measurements import DeclaredMeasurements, judge_scripted
from hil.missions.path import Leg
from hil.signals.samples import TruthState
from hil.verdict import FlightMeasurement, Verdict, judge
from sim.frame.source import FrameSource

if TYPE_CHECKING:
    from hil.goal.judgement import GoalMeasurement
    from hil.search.judgement import SearchMeasurement


class Judging:
    """The measurements of one run. Until `begin` nothing has been measured, which a verdict can be made of too."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._flight = FlightMeasurement(())
        self._declared = DeclaredMeasurements(())
        self.goal: GoalMeasurement | None = None
        self.search: SearchMeasurement | None = None

    def begin(self, legs: Sequence[Leg]) -> None:
        """Make what the bench asks for. `legs`: the path that the mission plans."""
        config, script = self._bench.config, self._bench.script
        self._flight = FlightMeasurement(legs, config.limits)
        if script is not None:
            self._declared = DeclaredMeasurements(script.script.expect)
        if config.goal is not None:
            from hil.goal.judgement import GoalMeasurement  # OpenCV, which most runs do without

            self.goal = GoalMeasurement(config.goal, self._bench.vehicle)
        if config.search is not None:
            from hil.search.judgement import SearchMeasurement

            self.search = SearchMeasurement(config.search, config.sensors[config.search.camera])

    def observers(self, *, of_flight: bool) -> list[Callable[[TruthState], None]]:
        """What is to see every truth. Without `of_flight` the flight itself is not measured."""
        found: list[Callable[[TruthState], None]] = [self._flight.add] if of_flight else []
        if self._bench.script is not None:
            found.append(self._declared.add)
        return found + [further.add for further in self._further()]

    def conclude(self, make_frames: Callable[[], FrameSource], out: Path) -> None:
        """What is judged from the scene itself, after the flight; a search leaves its pictures in `out`."""
        if not self._further():
            return
        frames = make_frames()
        if self.goal is not None:
            self.goal.conclude(frames.geometry)
        if self.search is not None:
            self.search.conclude(frames, frames.geometry.world)
            self.search.write(out)

    def verdict(self, records: Sequence[Record]) -> Verdict:
        """Of everything measured so far. `records`: what became of a script's actions."""
        limits, script = self._bench.config.limits, self._bench.script
        if script is None:
            verdict = judge(self._flight.result(), limits)
        else:
            declared = self._declared.results()
            verdict = judge_scripted(self._flight.result(), limits, script.script, declared, records)
        for further in self._further():
            verdict = verdict.with_rows(*further.judged())
        return verdict

    def run_keys(self) -> dict[str, Any]:
        """The keys `goal` and `search` of run.json, where there are such."""
        parts = {"goal": self.goal, "search": self.search}
        return {name: part.result.as_map() for name, part in parts.items() if part is not None}

    def _further(self) -> list[GoalMeasurement | SearchMeasurement]:
        return [part for part in (self.goal, self.search) if part is not None]
