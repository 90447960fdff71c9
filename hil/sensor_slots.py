"""The sensors of one run as the scheduler samples them, with faults that are declared, scripted or put in by hand."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hil.config import Bench
from hil.config.schema import SensorConfig
from hil.frame_stages import description, wanted_parts
from hil.missions.script import SensorFault
from hil.recorder.recorder import Recorder
from hil.scheduler import SensorSlot
from hil.signals.time import RateAccumulator
from hil.simulated_sensors import SimulatedSensors, tick_rates, write_calibration
from hil.stages import StagePlan
from sim.frame.source import FrameSource
from sim.sensors.catalog import KINDS
from sim.sensors.faults import FaultySensor
from sim.sensors.radar import Radar


class SensorSlots:
    """Those that somebody reads; the others are not made."""

    def __init__(
        self,
        bench: Bench,
        wanted: Mapping[str, SensorConfig],
        plan: StagePlan,
        frames: FrameSource | None,
        recorder: Recorder,
        out: Path,
    ) -> None:
        """`frames`: what cameras, LiDARs and radars look at. Writes their calibrations to `out`."""
        self._bench, self._recorder = bench, recorder
        self.radars: dict[str, Radar] = {}
        self._plain: dict[str, Any] = {}  # by name, without their faults
        self._faulty: dict[str, FaultySensor] = {}
        simulated = SimulatedSensors(bench, wanted, frames)
        # Cameras before the radars that read them; the order within a tick changes nothing else.
        last = sorted(wanted, key=lambda name: getattr(wanted[name].parameters, "frame", None) is not None)
        for name in last:
            sensor = simulated.make(name, wanted_parts(name, wanted[name], plan))
            self._plain[name] = sensor
            if isinstance(sensor, Radar):
                self.radars[name] = sensor
            if frames is not None and KINDS[wanted[name].kind].needs_frames:
                recorder.describe(name, description(name, sensor))
                write_calibration(out, name, sensor, rate_hz=wanted[name].rate_hz)
        self.slots = [self._slot(name, wanted[name]) for name in last]

    def inject(self, fault: SensorFault) -> None:
        """A fault that begins now. KeyError for a sensor that nobody expected to fail."""
        self._faulty[fault.sensor].inject(fault)

    def put_at_risk(self, name: str) -> None:
        """From now on it can fail, though nobody expected it to. ValueError for one that is not sampled."""
        if name in self._faulty:
            return
        slot = next((slot for slot in self.slots if slot.port == name), None)
        if slot is None:
            raise ValueError(f"no sensor {name!r} is sampled in this run")
        self._faulty[name] = FaultySensor(self._plain[name], (), on_event=self._recorder.event)
        slot.sample = self._faulty[name].sample

    def _slot(self, name: str, sensor: SensorConfig) -> SensorSlot:
        config, script = self._bench.config, self._bench.script
        made = self._plain[name]
        faults = [fault for fault in config.faults.sensors if fault.sensor == name]
        if faults or (script is not None and name in script.sensors_at_risk):
            made = self._faulty[name] = FaultySensor(made, faults, on_event=self._recorder.event)
        rates = RateAccumulator(**tick_rates(sensor, config.tick_hz))
        return SensorSlot(made, rates, after_send=KINDS[sensor.kind].needs_frames)
