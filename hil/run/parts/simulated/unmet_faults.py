"""Warns of declared faults and gusts that the flight did not meet, so that nobody takes its result for theirs.

`unmet` of run.json has them, too, for what makes many runs.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from firmware_bridge.faults.link_fault import LinkFault
from hil.config import Bench
from hil.config.missions.script import SensorFault
from hil.config.schema import BenchConfig
from hil.run.part import Part, RunContext
from signals.time import NS_PER_S


class UnmetFaultsPart(Part):
    name = "unmet_faults"

    def __init__(self, config: BenchConfig) -> None:
        self._config = config
        self._unmet: list[str] = []

    def conclude(self, run: RunContext) -> None:
        """Say which faults began after the flight, or met nothing on which they act."""

        def tell(text: str) -> None:
            self._unmet.append(text)
            run.say("warning", text)

        end_s = run.now_ns() / NS_PER_S
        for what, at_s in _instants(self._config):
            if at_s >= end_s:
                tell(f"{what} at {at_s:g} s never began: the flight ended at {end_s:g} s")
        sensors = {slot.port for slot in run.sensors.slots}
        unread = [fault for fault in self._config.faults.sensors if fault.sensor not in sensors]
        for fault in (*unread, *run.sensors.unmet()):
            if fault.at_s < end_s:
                what = "it was not sampled: nothing reads it" if fault in unread else "no sample fell into its time"
                tell(f"{_of_sensor(fault)} at {fault.at_s:g} s had no effect: {what}")
        for fault in run.part("faults").unmet:
            if fault.at_s < end_s:
                tell(f"{_of_link(fault)} at {fault.at_s:g} s had no effect: no such message passed")

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
    return UnmetFaultsPart(bench.config)
