"""Fails a flight that did not meet a declared fault or gust: its result would pass for theirs.

So does one whose vehicle stood on the ground during a whole gust, or from a fault of a rotor or surface on, and flew at
another time.

`unmet` of run.json has them, for what makes many runs. Only warned of are those

- that a script does not require, or that someone began by hand,
- of a sensor that nothing reads: recordings and watchers do not change a verdict,
- of a link fault that more than half of the seeds would have met: the bench is sound, and this seed had bad luck,
- that would have begun after the crash or the abort that the script expects, once another one has begun,
- of a run that was stopped by hand.

Of several vehicles, one that has met a fault or gust of all of them is enough.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any, NamedTuple

from firmware_bridge.faults.link_fault import LinkFault
from hil.config import Bench
from hil.config.missions.script import ActionSpec, SensorFault, injected_at
from hil.config.schema import BenchConfig
from hil.run.part import Part, RunContext
from hil.run.verdict.verdict import REST_CONTACT_NS, Verdict
from signals.samples import TruthState
from signals.time import NS_PER_S
from signals.words import counted
from sim.physics.faults import RotorFault
from sim.physics.surface_faults import SurfaceFault
from sim.scene.wind import GustEvent

_InFlight = RotorFault | SurfaceFault | GustEvent
_IN_FLIGHT = (RotorFault, SurfaceFault, GustEvent)  # have no effect on a vehicle that stands
_ROLLING_MPS = 1.0
_LIKELY_UNMET = 0.5  # probability above which the bench is to blame for a link fault without a hit, not the seed


class Unmet(NamedTuple):
    """A fault or gust that a flight did not meet."""

    what: Any  # as the configuration or the script has it
    text: str
    fails: bool


class UnmetFaultsPart(Part):
    name = "unmet_faults"
    _run: RunContext  # from `open` on

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._declared = [what for what, _, _ in _instants(bench.config)]  # also by the script, at a time
        self._own = list(self._declared)  # of the bench
        actions = () if bench.script is None else bench.script.script.actions
        timed = [(_declared_by(spec), spec.required) for spec in actions if spec.in_settings]
        for what, _ in timed:
            if what in self._own:
                self._own.remove(what)
        self._required = [*self._own, *(what for what, required in timed if required)]
        self._grounded = {what: _span_ns(what) for what in self._declared if isinstance(what, _IN_FLIGHT)}
        self._contact_ns: int | None = None
        self._flew = False
        self._unmet: list[str] = []
        self._reasons: list[str] = []

    def open(self, run: RunContext) -> None:
        self._run = run

    def observers(self) -> list[Callable[[TruthState], None]]:
        return [self._observe] if self._grounded else []

    def _observe(self, truth: TruthState) -> None:
        """Note what has met the vehicle in flight, or rolling on the ground."""
        if self._contact_ns is None or truth.in_contact:
            self._contact_ns = truth.t_ns
        # At rest it trembles, and is not always in contact.
        if truth.t_ns - self._contact_ns <= REST_CONTACT_NS and math.hypot(*truth.v_WB_W) <= _ROLLING_MPS:
            return
        self._flew = True
        met = [what for what, (begin_ns, end_ns) in self._grounded.items() if begin_ns <= truth.t_ns < end_ns]
        for what in met:
            del self._grounded[what]

    def conclude(self, run: RunContext) -> None:
        """Say which faults began after the flight, or met nothing on which they act."""
        others = [part for other in run.fleet if other is not run and (part := other.part(self.name)) is not None]
        for what, text, fails in self.unmet:
            if any(part.has_met(what) for part in others):
                continue
            self._unmet.append(text)
            if fails and not run.stopped_by_hand:
                self._reasons.append(text)
            else:
                run.say("warning", text)

    def has_met(self, what: Any) -> bool:
        """Return True if the bench of this vehicle declares a fault or gust, too, and its flight has met it."""
        return what in self._declared and what not in [unmet.what for unmet in self.unmet]

    @cached_property
    def unmet(self) -> list[Unmet]:
        """Faults and gusts that the flight did not meet, at its end; every other vehicle asks for them."""
        return list(self._found())

    def _found(self) -> Iterator[Unmet]:
        run, config = self._run, self._bench.config
        end_s = run.now_ns() / NS_PER_S
        script = run.part("script")
        at_events = [] if script is None else script.begun
        required = [*self._required, *(what for what, needed in at_events if needed)]
        begun = bool(at_events) or any(at_s < end_s for _, _, at_s in _instants(config))
        ends_early = self._bench.outcome in ("crashed", "aborted") and begun
        for what, name, at_s in _instants(config):
            if at_s >= end_s:  # of those of a script, its own part judges
                text = f"{name} at {at_s:g} s never began: the flight ended at {end_s:g} s"
                yield Unmet(what, text, what in self._own and not ends_early)
            elif what in self._grounded and self._flew:
                text = f"{name} at {at_s:g} s had no effect: the vehicle stood on the ground"
                yield Unmet(what, text, what in required and not ends_early)
        read = self._read_sensors()
        for fault, why in run.sensors.unmet():
            if fault.at_s < end_s:
                text = f"{_of_sensor(fault)} at {fault.at_s:g} s had no effect: {why}"
                yield Unmet(fault, text, fault in required and fault.sensor in read)
        for fault, count in run.part("faults").unmet:
            if fault.at_s < end_s:
                why = f"it hit none of {counted(count, fault.unit)}" if count else "no such message passed"
                text = f"{_of_link(fault)} at {fault.at_s:g} s had no effect: {why}"
                fails = fault in required and fault.chance_of_no_hit(count) > _LIKELY_UNMET
                yield Unmet(fault, text, fails)

    def _read_sensors(self) -> set[str]:
        """Return the sensors that the autopilot or a companion reads, whatever is recorded or watched."""
        ports = frozenset[str]().union(*(part.ports() for part in self._run.parts))
        return {*self._bench.config.autopilot_sensors().values(), *(port.partition("/")[0] for port in ports)}

    def verdict(self) -> Verdict:
        return Verdict(reasons=self._reasons)

    def run_keys(self) -> dict[str, Any]:
        return {"unmet": self._unmet} if self._unmet else {}


def _instants(config: BenchConfig) -> Iterator[tuple[Any, str, float]]:
    """Yield each declared fault and gust, its name, and the time at which it begins [s]."""
    for rotor in config.faults.rotors:
        yield rotor, f"fault of rotor {rotor.rotor}: {rotor.kind}", rotor.at_s
    for surface in config.faults.surfaces:
        yield surface, f"fault of surface {surface.surface}: {surface.kind}", surface.at_s
    for sensor in config.faults.sensors:
        yield sensor, _of_sensor(sensor), sensor.at_s
    for link in config.faults.links:
        yield link, _of_link(link), link.at_s
    for key, at_s in config.autopilot.faults:
        if at_s is not None:
            yield (key, at_s), f"fault of the autopilot: {key.removesuffix('_at_s')}", at_s
    for gust in () if config.wind is None else config.wind.gusts:
        yield gust, "gust", gust.at_s


def _span_ns(what: _InFlight) -> tuple[int, float]:
    """Return begin and end of a gust, or of a fault of a rotor or surface [ns]."""
    lasts_s: float | None = None
    if isinstance(what, RotorFault):
        lasts_s = what.for_s
    elif isinstance(what, GustEvent) and what.fall_s is not None:
        lasts_s = what.rise_s + what.hold_s + what.fall_s
    return round(what.at_s * NS_PER_S), math.inf if lasts_s is None else (what.at_s + lasts_s) * NS_PER_S


def _declared_by(spec: ActionSpec) -> Any:
    """Return what an action at a time has put into the configuration, as `_instants` yields it."""
    fault, at_s = spec.fault or {}, spec.at_s
    assert at_s is not None
    if "autopilot" in fault:
        return f"{fault['autopilot']}_at_s", at_s
    if "link" in fault:
        return LinkFault.model_validate_json(json.dumps({**fault["link"], "at_s": at_s}))  # strict: a list is no tuple
    return injected_at(spec, at_s)


def _of_sensor(fault: SensorFault) -> str:
    return f"fault of {fault.sensor}: {fault.kind}"


def _of_link(fault: LinkFault) -> str:
    return f"fault of the link: {fault.kind}{' of ' if fault.messages else ''}{', '.join(fault.messages)}"


def make(bench: Bench) -> Part:
    return UnmetFaultsPart(bench)
