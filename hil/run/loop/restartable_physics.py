"""The vehicle of a bench. If the autopilot may reboot, the vehicle can return to its start while time goes on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from hil.config import Bench
from signals.samples import TruthState
from sim.physics.disturbances import Disturbances
from sim.physics.integration import Integration
from sim.physics.vehicle_physics import PhysicsEvent, VehiclePhysics


class RestartablePhysics:
    """Wraps a `VehiclePhysics` from `make`, and replaces it by a new one at the tick after `restart`.

    Wind and declared faults follow the time since the restart, so they happen again.
    """

    def __init__(self, make: Callable[[], VehiclePhysics], *, tick_ns: int) -> None:
        self._make = make
        self._tick_ns = tick_ns
        self._physics = make()
        self._first_tick: int | None = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._physics, name)

    def restart(self) -> None:
        """Put the vehicle back to its start from the next tick on."""
        self._physics = self._make()
        self._first_tick = None

    def advance(self, tick: int, controls: Sequence[float]) -> TruthState:
        """Advance to `tick` with these controls; see `VehiclePhysics.advance`. Returns truth in the bench's time."""
        if self._first_tick is None:
            self._first_tick = tick
            self._physics.start_ns = tick * self._tick_ns  # people in the scene keep walking
        truth = self._physics.advance(tick - self._first_tick, controls)
        return truth._replace(tick=tick, t_ns=tick * self._tick_ns)

    def take_events(self) -> list[PhysicsEvent]:
        """Return and clear the events of the physics, in the bench's time."""
        shift_ns = (self._first_tick or 0) * self._tick_ns
        return [event._replace(t_ns=event.t_ns + shift_ns) for event in self._physics.take_events()]


def make_physics(bench: Bench) -> Any:
    """Return the bench's vehicle: a `VehiclePhysics`, or a `RestartablePhysics` where the autopilot may reboot."""
    config = bench.config

    def make() -> VehiclePhysics:
        return VehiclePhysics(
            bench.vehicle,
            bench.scene,
            config.tick_ns,
            start=config.start.flight_start(),
            effects=config.physics.effects,
            disturbances=Disturbances(faults=config.faults.of_vehicle, wind=config.wind, seed=config.noise_seed),
            integration=Integration(
                contact_skipping=config.physics.contact_skipping,
                step_ns=None if config.physics.step_us is None else config.physics.step_us * 1000,
            ),
        )

    if config.autopilot.on_restart == "reset":
        return RestartablePhysics(make, tick_ns=config.tick_ns)
    return make()
