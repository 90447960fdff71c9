"""The section `foxglove`: a run that Foxglove follows live, and that its clients may hold and alter.

The server follows the run and never delays it: before a tick the run only compares the clock, and about twenty times a
second it hands references to a thread that encodes and sends them. If that thread is busy, the update is left out. The
digest is the same with and without clients, until one of them gives a command that alters the flight.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from firmware_bridge.transports.loopback_host import is_loopback
from hil.config import Bench
from hil.run.loop.by_hand import HandControl, HandledVehicle
from hil.run.loop.scheduler import Scheduler
from hil.run.part import Part, RunContext
from hil.run.parts.links.foxglove.commands import PACE, PAUSED, STEADY, TURBULENCE, Commands
from hil.run.parts.links.foxglove.feed import VehicleFeed
from hil.run.parts.links.foxglove.scene import Drone, SceneView
from hil.run.parts.links.foxglove.server import LiveServer
from hil.run.sensors.frame_stages import output_ports
from signals.samples import FRAME_SAMPLES, Vec3
from sim.scene.wind import Wind
from sim.sensors.catalog import KINDS

_POLL_NS = 12_000_000  # wall clock between two looks at the clients' commands
_STOP_S = 2.0  # longest wait for the encoding thread at the end


@dataclass(frozen=True)
class FlightAccess:
    """The part of a built run that commands read and change; see `hil.run.loop.by_hand.Access`."""

    scheduler: Scheduler
    inject: Callable[[Any], None]
    set_turbulence: Callable[[float], None]
    event: Callable[[int, str, str], None]
    lockstep: bool


class FollowedVehicle(HandledVehicle):
    """One vehicle of a run with a server."""

    def __init__(self, name: str, feed: VehicleFeed) -> None:
        super().__init__(name)
        self.feed = feed
        self.drone: Drone | None = None

    def attach(self, run: RunContext) -> None:
        """Take a built run."""
        self._access = FlightAccess(
            run.scheduler,
            lambda fault: run.inject(fault, declared=False),
            run.physics.set_turbulence,
            run.recorder.event,
            run.link.caps.lockstep,
        )
        self.feed.attach(run)
        vehicle = run.bench.vehicle
        path = [run.legs[0].start_W, *(leg.end_W for leg in run.legs)] if run.legs else []
        radii_m = [constants.radius_m for constants in vehicle.constants_of_rotors]
        self.drone = Drone(
            self.name, [(r.position_m, radius_m) for r, radius_m in zip(vehicle.rotors, radii_m, strict=True)], path
        )


class FoxgloveServer:
    """Server of one run, for all its vehicles."""

    def __init__(self, bench: Bench) -> None:
        """Raise ConfigError where the SDK is not installed."""
        self._bench = bench
        self._settings = settings = bench.config.foxglove
        self._may_control = settings.may_control
        self._server = LiveServer(settings)
        self._commands = Commands(self._server)
        self._vehicles: dict[str, FollowedVehicle] = {}
        self._own = HandControl(self._vehicles, paused=settings.paused)
        self._control = self._own  # the dashboard's, if the run has one
        self._view: SceneView | None = None
        self._period_ns = round(1e9 / settings.rate_hz)
        self._poll_ns = self._update_ns = 0
        self._served_tick = -1
        self._jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._busy = False
        self._defect = ""
        self._thread: threading.Thread | None = None
        self._steady_W_mps: Vec3 = (0.0, 0.0, 0.0)
        self._say: Callable[[str, str], None] = lambda *_: None

    def vehicle(self, name: str) -> FollowedVehicle:
        """Return the vehicle of that name; empty in a run of one."""
        feed = VehicleFeed(self._server, name, self._settings.jpeg_quality)
        return self._vehicles.setdefault(name, FollowedVehicle(name, feed))

    def _open(self, run: RunContext) -> None:
        """Listen, once for all vehicles. Raises PortBusy or PortNotFound."""
        config = run.bench.config
        capabilities, services, end_ns = ["Time"], [], None
        if self._may_control:
            capabilities += ["Parameters", "Services"]
            services = self._commands.services()
            # Without an autopilot that waits for the bench there is nothing to pause.
            end_ns = round(config.duration_s * 1e9) if self._control.can_hold else None
        self._server.start(f"{config.rig}: {run.bench.scene.name}", self._commands, capabilities, services, end_ns)
        # Made before the run confines itself to one processor, so that it has all of them.
        self._thread = threading.Thread(target=self._work, name="foxglove", daemon=True)
        self._thread.start()
        self._say = run.say
        run.say("foxglove", f"open {self._server.address} in Foxglove{self._warning()}")

    def _warning(self) -> str:
        if is_loopback(self._settings.host):
            return ""
        may = "watch this run and alter it" if self._may_control else "watch this run"
        return f"; without a password, every machine in the network can {may}"

    def attach(self, vehicle: FollowedVehicle, run: RunContext) -> None:
        """Take a built run of one vehicle; after the last one, offer the topics of all together."""
        vehicle.attach(run)
        if not all(each.built for each in self._vehicles.values()):
            return
        dashboard = next((part.hand_control for part in run.parts if part.hand_control is not None), None)
        self._control.serving = vehicle
        if dashboard is not None:
            dashboard.paused = dashboard.paused or self._own.paused
            self._control = dashboard
            self._control.watchers.append(self._look)
        wind: Wind | None = run.bench.config.wind
        self._steady_W_mps = run.bench.scene.wind_W_mps if wind is None else wind.steady_W_mps
        if not self._control.can_hold:
            self._control.release()
        drones = [each.drone for each in self._vehicles.values() if each.drone is not None]
        self._view = SceneView(self._server, run.bench.scene, run.bench.world, drones)
        self._open(run)
        self._show()

    # -- before a tick ------------------------------------------------------------------------------------------------

    def before_tick(self, vehicle: FollowedVehicle) -> None:
        """Carry out commands, update the clients if that is due, and hold the tick if the run is paused."""
        now_ns = time.perf_counter_ns()
        if now_ns < self._poll_ns and not self._commands.waiting:
            return
        tick = vehicle.access.scheduler.tick
        if self._served_tick == tick:  # another vehicle has called
            return
        self._served_tick = tick
        own = self._control is self._own
        if own:
            self._own.serving = vehicle
        self._look()
        if own and self._own.holds:
            self._own.hold(self._wait, self._look, lambda: False)
        self._poll_ns = 0 if own and self._own.holds else time.perf_counter_ns() + _POLL_NS

    def _wait(self, limit_s: float) -> None:
        self._commands.wake.wait(limit_s)
        self._commands.wake.clear()

    def _look(self) -> None:
        if self._commands.waiting:
            vehicles: Mapping[str, HandledVehicle] = self._vehicles
            if self._control is not self._own:
                vehicles = {name: self._control.vehicle(name) for name in vehicles}
            self._commands.carry_out(self._control, vehicles, self._steady_W_mps)
            self._show()
        now_ns = time.perf_counter_ns()
        if now_ns >= self._update_ns:
            # A late update does not delay the updates after it.
            self._update_ns = max(self._update_ns + self._period_ns, now_ns + self._period_ns // 2)
            self._update()
            for text in self._server.refusals():
                self._say("foxglove", text)

    def _show(self) -> None:
        """Tell the clients pace, pause and wind as they are now."""
        if not self._may_control or not self._server.serves:
            return
        control, bench = self._control, self._bench.config
        by_hand, steady = control.wind_W_mps, self._steady_W_mps
        turbulence = bench.wind.turbulence if bench.wind is not None else None
        base_mps = 0.0 if turbulence is None else turbulence.strength_mps
        self._commands.show(
            {
                PACE: float((control.pace if control.paces or control.pace else bench.pace) or 0.0),
                PAUSED: control.paused,
                STEADY: [a + b for a, b in zip(by_hand, steady, strict=True)],
                TURBULENCE: base_mps if control.turbulence_mps is None else control.turbulence_mps,
            }
        )
        self._server.playback(self._commands.playback_state(paused=control.paused, t_ns=self._t_ns()))

    def _t_ns(self) -> int:
        return max(each.access.scheduler.t_ns for each in self._vehicles.values())

    def _update(self) -> None:
        server, vehicles = self._server, self._vehicles
        subscribed = self._commands.subscribed
        wanted = server.wanted()
        for vehicle in vehicles.values():
            vehicle.feed.watched = bool(wanted)
        server.broadcast_time(self._t_ns())
        if self._busy or self._defect or not (wanted or subscribed):
            return
        topics = {subscribed.popleft() for _ in range(len(subscribed))}
        pending = [(each.feed, each.feed.take(repeat=bool(topics))) for each in vehicles.values()]
        truths = {name: truth for name, each in vehicles.items() if (truth := each.feed.newest_truth) is not None}
        t_ns = self._t_ns()

        def job() -> None:
            for topic in topics:
                server.repeat(topic, t_ns)
            for feed, each in pending:
                feed.publish(each, wanted)
            if self._view is not None:
                self._view.update(truths, wanted, t_ns)

        self._busy = True
        self._jobs.put(job)

    def _work(self) -> None:
        """Encode and send updates, in a thread of its own."""
        while (job := self._jobs.get()) is not None:
            try:
                job()
            except Exception as defect:  # noqa: BLE001 (the flight goes on)
                self._defect = f"{type(defect).__name__}: {defect}"
                self._server.status(f"no more updates: {self._defect} (a defect of the bench)", level="Error")
            self._busy = False

    # -- the end -----------------------------------------------------------------------------------------------------

    def close(self) -> None:
        """Tell the clients that the run is over, and stop. Idempotent."""
        self._commands.close()
        if not self._server.serves:
            return
        with suppress(Exception):  # the run's result matters more
            if self._defect == "" and self._may_control and all(each.built for each in self._vehicles.values()):
                self._update_last()
        self._jobs.put(None)
        if self._thread is not None:
            self._thread.join(_STOP_S)
        self._server.stop("the flight is over")

    def _update_last(self) -> None:
        state = self._commands.playback_state(paused=True, t_ns=self._t_ns(), ended=True)
        self._server.playback(state)
        self._update()

    @property
    def defect(self) -> str:
        return self._defect


class FoxglovePart(Part):
    name = "foxglove"

    def __init__(self, server: FoxgloveServer, name: str, config: Any) -> None:
        """`name`: of the vehicle in a run of several; empty in a run of one."""
        self._server, self._config = server, config
        self._vehicle = server.vehicle(name)
        self.injects = config.foxglove.may_control

    @property
    def paused_s(self) -> float:  # type: ignore[override]
        return self._vehicle.paused_s

    def watched_ports(self) -> frozenset[str]:
        """Return the cameras, LiDARs and radars of the bench, if they are computed for the clients."""
        if not self._config.foxglove.sensors:
            return frozenset()
        sensors = self._config.sensors
        frames = [name for name, sensor in sensors.items() if KINDS[sensor.kind].sample_type in FRAME_SAMPLES]
        return frozenset(port.name for name in frames for port in output_ports(name, sensors[name]))

    def tap(self) -> VehicleFeed:
        return self._vehicle.feed

    def exchange(self) -> VehicleFeed:
        return self._vehicle.feed

    def begin(self, run: RunContext) -> None:
        self._server.attach(self._vehicle, run)

    def before_tick(self) -> None:
        self._server.before_tick(self._vehicle)

    def close(self) -> None:
        self._server.close()

    def finish(self, run: RunContext) -> None:
        if self._server.defect:
            run.event("error", f"Foxglove got no more updates: {self._server.defect} (a defect of the bench)")

    def repeatable(self) -> bool:
        return not self._vehicle.altered

    def run_keys(self) -> dict[str, Any]:
        return {"by_hand": self._vehicle.commands} if self._vehicle.commands else {}


def parts_maker(bench: Bench) -> Callable[[str], list[Part]]:
    """Return the function that makes the part of each vehicle by name; all share one server."""
    server = FoxgloveServer(bench)
    return lambda name: [FoxglovePart(server, name, (bench.vehicles[name] if name else bench).config)]
