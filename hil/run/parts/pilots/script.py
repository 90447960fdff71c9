"""A mission script: actions at declared moments, and what the script expects of the flight."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from firmware_bridge.ground_station.actions import ActionSource, Record
from hil.config import Bench
from hil.config.missions.script import Injected, MissionScript, flight_actions
from hil.run.part import Part, RunContext
from hil.run.verdict.measurements import DeclaredMeasurements, judge_script, measured_on_ground
from hil.run.verdict.verdict import Verdict
from signals.samples import TruthState
from signals.time import NS_PER_S


class ScriptPart(Part):
    name = "script"

    def __init__(self, script: MissionScript, bench: Bench) -> None:
        self._script, self._bench = script, bench
        self._measured = DeclaredMeasurements(script.script.expect, cos_tilt=bench.vehicle.cos_tilt)
        self._actions: ActionSource | None = None
        self._run: RunContext | None = None
        self.begun: list[tuple[Injected, bool]] = []  # faults and gusts at events, and whether they are required

    def build(self, run: RunContext) -> None:
        self._run = run
        config = self._bench.config
        self._actions = ActionSource(
            flight_actions(self._script, self._bench.mission, self._inject, tick_ns=config.tick_ns),
            target_sysid=None,
            first_item=config.autopilot.profile.firmware.first_mission_item,
            on_event=run.recorder.event,
            may_begin=run.may_arm,
        )

    def _inject(self, injected: Injected, required: bool) -> None:
        assert self._run is not None
        self._run.inject(injected)
        self.begun.append((injected, required))

    def command_sources(self) -> list[ActionSource]:
        return [] if self._actions is None else [self._actions]

    def observers(self) -> list[Callable[[TruthState], None]]:
        return [self._measured.add]

    def conclude(self, run: RunContext) -> None:
        for text in measured_on_ground(self._measured.results()):
            run.say("warning", text)

    def verdict(self) -> Verdict:
        return judge_script(self._measured.results(), self._records())

    def _records(self) -> list[Record]:
        """Return the result of each action: those of the flight first, then faults and gusts at a known time."""
        if self._actions is None or self._run is None:
            return []
        end_ns = self._run.now_ns()
        records = list(self._actions.records)
        for index, spec in enumerate(self._script.script.actions):
            if not spec.in_settings or spec.at_s is None:
                continue
            at_ns = round(spec.at_s * NS_PER_S)
            begun = at_ns < end_ns
            name, outcome = self._script.name_of(index), "done" if begun else "waiting"
            records.append(Record(name, spec.required, at_ns if begun else None, outcome))
        return records

    def run_keys(self) -> dict[str, Any]:
        records = self._records()
        return {
            "actions": [
                {
                    "name": record.name,
                    "t_s": None if record.t_ns is None else record.t_ns / NS_PER_S,
                    "outcome": record.outcome,
                    "required": record.required,
                }
                for record in records
            ]
        }


def make(bench: Bench) -> Part:
    assert bench.script is not None
    return ScriptPart(bench.script, bench)
