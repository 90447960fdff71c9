"""The sensors of one run as the scheduler samples them, and whatever is made to go wrong while it flies.

Gusts and faults are declared in the bench, begin with a script's action, or are put in by hand.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from firmware_bridge.faults.faulty_transport import FaultyTransport
from firmware_bridge.faults.link_fault import LinkFault
from firmware_bridge.transports.transport import Transport
from hil.companion.link_faults import CompanionFault
from hil.config import Bench, BenchConfig
from hil.config.schema import SensorConfig
from hil.frame_stages import description, wanted_parts
from hil.missions.script import Injected, SensorFault
from hil.recorder.recorder import Recorder
from hil.scheduler import SensorSlot
from hil.signals.time import RateAccumulator
from hil.simulated_sensors import SimulatedSensors, tick_rates, write_calibration
from hil.stages import StagePlan
from sim.frame.source import FrameSource
from sim.physics.faults import RotorFault
from sim.physics.quadrotor import QuadrotorPhysics
from sim.scene.wind import GustEvent
from sim.sensors.catalog import KINDS
from sim.sensors.faults import FaultySensor
from sim.sensors.radar import Radar

if TYPE_CHECKING:
    from hil.companion.link import CompanionLink


class SensorSlots:
    """Builds only the sensors that have a consumer."""

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


class Injector:
    """Lets gusts and faults begin: at the vehicle, its sensors, the wire to the autopilot, the companion's link."""

    def __init__(
        self,
        config: BenchConfig,
        physics: QuadrotorPhysics,
        sensors: SensorSlots,
        companion: CompanionLink | None,
        recorder: Recorder,
        *,
        now_ns: Callable[[], int],
        by_hand: bool,
    ) -> None:
        """`by_hand`: faults of the wire may come that nobody declared."""
        self._config, self._recorder, self._now_ns, self._by_hand = config, recorder, now_ns, by_hand
        self._physics, self._sensors, self._companion = physics, sensors, companion
        self.wire: FaultyTransport | None = None

    def wrap(self, wire: Transport) -> Transport:
        """The wire to the autopilot with the faults declared for it."""
        faults = self._config.faults.links
        if not faults and not self._by_hand:
            return wire  # any fault costs a look at every frame
        self.wire = FaultyTransport(wire, faults, self._config.seed, self._now_ns, self._recorder.event)
        return self.wire

    def inject(self, what: Injected) -> None:
        """A gust or fault that a script lets begin now."""
        if isinstance(what, GustEvent | RotorFault):
            self._physics.inject(what)
        else:
            self._sensors.inject(what)

    def inject_by_hand(self, what: Injected | LinkFault | CompanionFault) -> None:
        """As `inject`, of a sensor or a link that nobody expected to fail. ValueError where it does not fit."""
        if isinstance(what, LinkFault):
            if self.wire is None:
                raise ValueError("the wire to this autopilot is not MAVLink: it has no faults")
            self.wire.inject(what)
            return
        if isinstance(what, CompanionFault):
            if self._companion is None:
                raise ValueError("this run has no companion")
            self._companion.inject(what, self._now_ns())
            return
        if not isinstance(what, GustEvent | RotorFault):
            self._sensors.put_at_risk(what.sensor)
        self.inject(what)
