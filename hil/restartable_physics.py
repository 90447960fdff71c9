"""The vehicle of a bench; for autopilots that reboot one that can be put back to where it began, while time goes on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from hil.config import Bench
from hil.signals.samples import TruthState
from sim.physics.quadrotor import PhysicsEvent, QuadrotorPhysics


class RestartablePhysics:
    """Stands for the `QuadrotorPhysics` that `make` gives; `restart` takes a new one from the next tick on.

    Wind and declared faults are those of the vehicle's own time: they happen again.
    """

    def __init__(self, make: Callable[[], QuadrotorPhysics], *, tick_ns: int) -> None:
        self._make = make
        self._tick_ns = tick_ns
        self._physics = make()
        self._first_tick: int | None = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._physics, name)

    def restart(self) -> None:
        self._physics = self._make()
        self._first_tick = None

    def advance(self, tick: int, controls: Sequence[float]) -> TruthState:
        if self._first_tick is None:
            self._first_tick = tick
            self._physics.start_ns = tick * self._tick_ns  # people in the scene go on walking
        truth = self._physics.advance(tick - self._first_tick, controls)
        return truth._replace(tick=tick, t_ns=tick * self._tick_ns)

    def take_events(self) -> list[PhysicsEvent]:
        """What the vehicle underwent, at the bench's time."""
        shift_ns = (self._first_tick or 0) * self._tick_ns
        return [event._replace(t_ns=event.t_ns + shift_ns) for event in self._physics.take_events()]


def make_physics(bench: Bench) -> Any:
    """The vehicle that the bench asks for: a `QuadrotorPhysics`, or what stands for one."""
    config = bench.config

    def vehicle() -> QuadrotorPhysics:
        return QuadrotorPhysics(
            bench.vehicle,
            bench.scene,
            config.tick_ns,
            contact_skipping=config.physics.contact_skipping,
            effects=config.physics.effects,
            faults=config.faults.rotors,
            wind=config.wind,
            seed=config.seed,
            step_ns=None if config.physics.step_us is None else config.physics.step_us * 1000,
        )

    if config.autopilot.on_restart == "reset":
        return RestartablePhysics(vehicle, tick_ns=config.tick_ns)
    return vehicle()
