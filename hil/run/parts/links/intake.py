"""Warns of sensors that the autopilot does not take, and makes the faults of those that its firmware simulates.

Faults of a sensor that the firmware simulates itself are parameters of the firmware while they hold. The bench's own
samples of that sensor, which go to companions and the recording, have them too.
"""

from __future__ import annotations

from typing import Any

from firmware_bridge.autopilots.intake import Simulated, axis_number
from firmware_bridge.ground_station.parameter_faults import ParameterFault, ParameterFaults
from hil.config import Bench
from hil.config.checks.intake_checks import intake_of, refusal, simulated_sensors, untaken_sensors
from hil.config.missions.script import SensorFault, injected_at
from hil.config.sensors.resolve import sample_types
from hil.run.autopilot import home_of
from hil.run.part import Part, RunContext
from sim.sensors.catalog import KINDS
from sim.sensors.faults import acted_field, fault_problems


class IntakePart(Part):
    name = "intake"

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._simulated = frozenset(simulated_sensors(bench.config))
        self._faults: ParameterFaults | None = None

    def build(self, run: RunContext) -> None:
        if not self._simulated:
            return
        altitude_m = home_of(self._bench.scene.site, run.physics.state)[2]
        self._faults = ParameterFaults(altitude_m=altitude_m, on_event=run.recorder.event)
        for fault in self._bench.config.faults.sensors:
            if fault.sensor in self._simulated:
                self._faults.add(self._made(fault))
        script = self._bench.script
        for spec in () if script is None else script.script.actions:
            if spec.fault is not None and spec.fault.get("sensor") in self._simulated and not spec.in_settings:
                made = self._made(injected_at(spec, 0.0))
                self._faults.expect(made.text, made.changes)

    def command_sources(self) -> list[ParameterFaults]:
        return [] if self._faults is None else [self._faults]

    def begin(self, run: RunContext) -> None:
        for text in untaken_sensors(self._bench.config):
            run.say("warning", text)

    def inject(self, fault: Any, *, declared: bool) -> bool:  # noqa: ARG002 (makes no difference here)
        config = self._bench.config
        if not isinstance(fault, SensorFault) or any(fault_problems((fault,), sample_types(config))):
            return False  # not a sensor's, or refused by the sensor
        refused = refusal(config, fault)
        if refused is not None:
            key, message, hint = refused
            raise ValueError(f"{key} {message} ({hint})")
        if self._faults is not None and fault.sensor in self._simulated:
            self._faults.add(self._made(fault))
        return False  # the bench's samples have the fault too

    def conclude(self, run: RunContext) -> None:  # noqa: ARG002
        if self._faults is not None:
            self._faults.check_confirmed()

    def run_keys(self) -> dict[str, Any]:
        return {} if self._faults is None else {"firmware_faults": self._faults.records}

    def _made(self, fault: Any) -> ParameterFault:
        """Return a fault of a sensor that the firmware simulates as parameters of the firmware."""
        intake = intake_of(self._bench.config, fault.sensor)
        assert isinstance(intake, Simulated)
        field = acted_field(fault, KINDS[self._bench.config.sensors[fault.sensor].kind].sample_type)
        begin_ns, end_ns = fault.span_ns
        return ParameterFault(
            f"{fault.sensor}: {fault.kind}",
            begin_ns,
            end_ns,
            intake.changes(fault.kind, field, axis_number(getattr(fault, "axis", None))),
            offset=getattr(fault, "value", 0.0),
            rate_per_s=getattr(fault, "rate_per_s", 0.0),
        )


def make(bench: Bench) -> Part:
    return IntakePart(bench)
