"""Fails a flight that did not meet a declared fault or gust: its result would pass for theirs.

A run that was stopped by hand only warns of them. `unmet` of run.json has them, too, for what makes many runs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from firmware_bridge.faults.link_fault import LinkFault
from hil.config import Bench
from hil.config.missions.script import SensorFault
from hil.config.schema import BenchConfig
from hil.run.part import Part, RunContext
from hil.run.verdict.verdict import Verdict
from signals.time import NS_PER_S


class UnmetFaultsPart(Part):
    name = "unmet_faults"

    def __init__(self, bench: Bench) -> None:
        self._config = bench.config
        actions = () if bench.script is None else bench.script.script.actions
        timed = [spec for spec in actions if spec.in_settings]  # merged into the bench's own
        self._judged_by_script = {spec.at_s for spec in timed}
        self._not_required = {spec.at_s for spec in timed if not spec.required}
        waiting = [spec.fault for spec in actions if spec.fault and spec.required and not spec.in_settings]
        self._at_events = {(fault.get("sensor"), fault.get("kind")) for fault in waiting}
        self._unmet: list[str] = []
        self._reasons: list[str] = []

    def conclude(self, run: RunContext) -> None:
        """Say which faults began after the flight, or met nothing on which they act."""

        def tell(text: str, *, fails: bool) -> None:
            self._unmet.append(text)
            if fails and not run.stopped_by_hand:
                self._reasons.append(text)
            else:
                run.say("warning", text)

        end_s = run.now_ns() / NS_PER_S
        for what, at_s in _instants(self._config):
            if at_s >= end_s:
                text = f"{what} at {at_s:g} s never began: the flight ended at {end_s:g} s"
                tell(text, fails=at_s not in self._judged_by_script)
        sensors = {slot.port for slot in run.sensors.slots}
        unread = [fault for fault in self._config.faults.sensors if fault.sensor not in sensors]
        for fault in (*unread, *run.sensors.unmet()):
            if fault.at_s < end_s:
                what = "it was not sampled: nothing reads it" if fault in unread else "no sample fell into its time"
                text = f"{_of_sensor(fault)} at {fault.at_s:g} s had no effect: {what}"
                begun = (fault.sensor, fault.kind) in self._at_events
                tell(text, fails=begun or self._is_required(fault, self._config.faults.sensors))
        for fault in run.part("faults").unmet:
            if fault.at_s < end_s:
                text = f"{_of_link(fault)} at {fault.at_s:g} s had no effect: no such message passed"
                tell(text, fails=self._is_required(fault, self._config.faults.links))

    def _is_required(self, fault: SensorFault | LinkFault, declared: Sequence[SensorFault | LinkFault]) -> bool:
        """Return True for a fault that the bench declares, or its script at a time, and not for one begun by hand."""
        return fault in declared and fault.at_s not in self._not_required

    def verdict(self) -> Verdict:
        return Verdict(reasons=self._reasons)

    def run_keys(self) -> dict[str, Any]:
        return {"unmet": self._unmet} if self._unmet else {}


def _instants(config: BenchConfig) -> Iterator[tuple[str, float]]:
    """Yield each declared fault and gust with the time at which it begins [s]."""
    for rotor in config.faults.rotors:
        yield f"fault of rotor {rotor.rotor}: {rotor.kind}", rotor.at_s
    for surface in config.faults.surfaces:
        yield f"fault of surface {surface.surface}: {surface.kind}", surface.at_s
    for sensor in config.faults.sensors:
        yield _of_sensor(sensor), sensor.at_s
    for link in config.faults.links:
        yield _of_link(link), link.at_s
    for key, at_s in config.autopilot.faults:
        if at_s is not None:
            yield f"fault of the autopilot: {key.removesuffix('_at_s')}", at_s
    for gust in () if config.wind is None else config.wind.gusts:
        yield "gust", gust.at_s


def _of_sensor(fault: SensorFault) -> str:
    return f"fault of {fault.sensor}: {fault.kind}"


def _of_link(fault: LinkFault) -> str:
    return f"fault of the link: {fault.kind}{' of ' if fault.messages else ''}{', '.join(fault.messages)}"


def make(bench: Bench) -> Part:
    return UnmetFaultsPart(bench)
