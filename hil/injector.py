"""Gusts and faults that begin while a run flies: a script's, and those that somebody puts in by hand."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from firmware_bridge.faults.faulty_transport import FaultyTransport
from firmware_bridge.faults.link_fault import LinkFault
from firmware_bridge.transports.transport import Transport
from hil.companion.link_faults import CompanionFault
from hil.config import BenchConfig
from hil.missions.script import Injected
from hil.recorder.recorder import Recorder
from hil.sensor_slots import SensorSlots
from sim.physics.faults import RotorFault
from sim.physics.quadrotor import QuadrotorPhysics
from sim.scene.wind import GustEvent

if TYPE_CHECKING:
    from hil.companion.link import CompanionLink


class Injector:
    """Knows what can fail in one run."""

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
