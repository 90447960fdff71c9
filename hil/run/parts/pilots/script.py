"""A mission script: actions at declared moments, and what the script expects of the flight."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from firmware_bridge.ground_station.actions import ActionSource
from hil.config import Bench
from hil.config.missions.script import MissionScript, flight_actions
from hil.run.part import Part, RunContext
from hil.run.verdict.measurements import DeclaredMeasurements, judge_script
from hil.run.verdict.verdict import Verdict
from signals.samples import TruthState
from signals.time import NS_PER_S


class ScriptPart(Part):
    name = "script"

    def __init__(self, script: MissionScript, bench: Bench) -> None:
        self._script, self._bench = script, bench
        self._measured = DeclaredMeasurements(script.script.expect, cos_tilt=bench.vehicle.cos_tilt)
        self._actions: ActionSource | None = None

    def build(self, run: RunContext) -> None:
        config = self._bench.config
        self._actions = ActionSource(
            flight_actions(self._script, self._bench.mission, run.inject, tick_ns=config.tick_ns),
            target_sysid=None,
            first_item=config.autopilot.profile.firmware.first_mission_item,
            on_event=run.recorder.event,
            may_begin=run.may_arm,
        )

    def command_sources(self) -> list[ActionSource]:
        return [] if self._actions is None else [self._actions]

    def observers(self) -> list[Callable[[TruthState], None]]:
        return [self._measured.add]

    def verdict(self) -> Verdict:
        return judge_script(self._measured.results(), () if self._actions is None else self._actions.records)

    def run_keys(self) -> dict[str, Any]:
        records = () if self._actions is None else self._actions.records
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
