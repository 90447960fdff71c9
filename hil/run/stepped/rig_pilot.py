"""An autopilot of a rig (PX4, ArduPilot, the mock) as the pilot of one vehicle of a stepped world.

The autopilot gets samples of the rig's sensors at every tick and its motor commands move the vehicle in the next, with
the phases of `hil.run.loop.scheduler`. Desired states go to it as set-points (`OffboardPilot`): the first one that
moves arms the vehicle, `land` begins the autopilot's own landing, and after it the next flight may begin.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.ground_station.offboard_pilot import OffboardPilot
from firmware_bridge.ground_station.phased_flight import Phase
from hil.config import Bench
from hil.run.autopilot import geodetic_from_W, grid_ns
from hil.run.loop.scheduler import CommandSource, Scheduler
from hil.run.part import Part, RunContext
from hil.run.parts.catalog import link_parts
from hil.run.recorder.no_recorder import NoRecorder
from hil.run.runs.vehicle_run import VehicleRun
from signals.desired import DesiredState
from signals.samples import TruthState
from sim.physics.vehicle_physics import VehiclePhysics

_SETPOINT_HZ = 50.0
Log = Callable[[str], None]


class RigPilot:
    """Pilot of a vehicle. Making one starts the autopilot; `close` ends it. Both raise the errors of its link."""

    def __init__(self, bench: Bench, physics: VehiclePhysics, log: Log) -> None:
        """`bench`: the rig; its tick must be that of `physics`."""
        config = bench.config
        if config.tick_ns != physics.tick_ns:
            raise ValueError(f"the rig ticks at {config.tick_hz} Hz, and the world every {physics.tick_ns} ns")
        wanted = set(config.autopilot_sensors().values())
        sensors = {name: sensor for name, sensor in config.sensors.items() if name in wanted}
        self._bench = replace(bench, config=config.model_copy(update={"sensors": sensors}))
        self._log = log
        self._flight = _Flight(self._bench, physics, log)
        self._stack = ExitStack()
        try:
            out = Path(self._stack.enter_context(TemporaryDirectory(prefix="hil-rig-", ignore_cleanup_errors=True)))
            parts = [_Vehicle(physics), _sensors(self._bench), self._flight, *link_parts(self._bench)]
            run = VehicleRun(self._bench, out, parts, quiet=True)
            run.context.event = lambda kind, text, t_ns=None: log(f"{kind}: {text}")  # type: ignore[method-assign]  # noqa: ARG005
            for part in parts:
                part.check()
            run.build(self._stack, NoRecorder(config.tick_ns))
            for part in parts:
                self._stack.enter_context(part.around_flight())
        except BaseException:
            self._stack.close()
            raise
        self._scheduler: Scheduler = run.context.scheduler
        self._began = False

    @property
    def ready(self) -> bool:
        """True once the autopilot would arm, and while it flies."""
        return self._flight.pilot.ready

    @property
    def flying(self) -> bool:
        """True from arming to disarming."""
        return self._flight.pilot.phase in (Phase.ARMING, Phase.FLYING, Phase.LANDING)

    def prepare(self) -> None:
        """Prepare the next flight if the last one has ended."""
        if self._flight.pilot.phase in (Phase.LANDED, Phase.DONE):
            self._flight.renew()

    def desire(self, desired: DesiredState) -> None:
        """Fly a desired state from now on. After a landing, the next one that moves starts a new flight."""
        if desired.moves:
            self.prepare()
        self._flight.pilot.set_desired(desired, self._scheduler.t_ns)

    def controls(self, truth: TruthState) -> Sequence[float]:
        """Give the autopilot the samples of a tick, and return its commands until the next. Raises LinkError."""
        scheduler = self._scheduler
        if not self._began:
            self._began = True
            scheduler.begin()
        tick = scheduler.tick  # the autopilot's time begins with its start
        truth = truth._replace(tick=tick, t_ns=tick * scheduler.tick_ns)
        scheduler.send(truth, time.perf_counter_ns())
        scheduler.work()
        scheduler.wait()
        return scheduler.begin()

    def close(self) -> None:
        """End the autopilot."""
        self._stack.close()


class _Vehicle(Part):
    """The vehicle that the stepped world moves."""

    name = "vehicle"

    def __init__(self, physics: VehiclePhysics) -> None:
        self._physics = physics

    def open(self, run: RunContext) -> None:
        run.physics = self._physics


class _Flight(Part):
    """Source of the autopilot's commands."""

    name = "flight"

    def __init__(self, bench: Bench, physics: VehiclePhysics, log: Log) -> None:
        self._bench, self._physics, self._log = bench, physics, log
        self._run: RunContext | None = None
        self.pilot = self._make()

    def build(self, run: RunContext) -> None:
        self._run = run

    def renew(self) -> None:
        """Begin a new flight."""
        self.pilot = self._make()

    def _make(self) -> OffboardPilot:
        config = self._bench.config
        return OffboardPilot(
            geodetic_from_W(self._bench, self._physics.state),
            tick_ns=config.tick_ns,
            setpoint_hz=_SETPOINT_HZ,
            projection=config.autopilot.profile.firmware.project,
            target_sysid=None,
            grid_ns=grid_ns(self._bench),
            needs_estimator=config.autopilot.profile.needs_estimator,
            on_event=lambda _t_ns, kind, text: self._log(f"{kind}: {text}"),
            may_arm=lambda: self._run is None or self._run.may_arm(),
        )

    def command_sources(self) -> list[CommandSource]:
        return [self]

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        """Return the bytes to send at `t_ns`."""
        return self.pilot.step(t_ns, frames)


def _sensors(bench: Bench) -> Any:
    return import_module("hil.run.parts.simulated.sensors").make(bench)
