"""A world of vehicles that is advanced tick by tick from outside.

Time moves only in `step`. Between two steps, vehicles may be added, placed and reset at no cost. The same calls in the
same order give the same bits.

A vehicle that leaves the model's range (200 m/s, 50 km from the site, ...) does not end the world: it is stopped where
it was one tick before, and `take_departures` reports it. One whose battery is empty falls with rotors that stand still.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from hil.run.stepped.vehicle import FlyingVehicle, StandingVehicle, SteppedVehicle, standing_truth
from signals.errors import ModelRangeError
from signals.samples import TruthState, Vec3
from sim._kernels import IdealController as Kernel
from sim.physics.disturbances import Disturbances
from sim.physics.flight_start import FlightStart
from sim.physics.forces.force import Effects
from sim.physics.integration import Integration
from sim.physics.surface_faults import VehicleFault
from sim.physics.vehicle import Vehicle
from sim.physics.vehicle_group import VehicleContact, VehicleGroup
from sim.physics.vehicle_physics import Cruise, VehiclePhysics
from sim.scene.scene import Scene
from sim.scene.scene_map import Actor
from sim.scene.wind import Wind


class Departure(NamedTuple):
    """Vehicle that left the range of the model and was stopped."""

    t_ns: int
    vehicle: str
    message: str


class SteppedWorld:
    """Vehicles in one scene. `observers` are called with the world after each tick."""

    def __init__(
        self,
        scene: Scene,
        tick_ns: int,
        *,
        seed: int = 1,
        wind: Wind | None = None,
        downwash: bool = False,
        integration: Integration = Integration(),  # noqa: B008 (frozen)
    ) -> None:
        """`downwash`: the wakes of vehicles are wind for others."""
        self._integration = integration
        self.scene = scene
        self.tick_ns = tick_ns
        self.tick = 0
        self.vehicles: dict[str, SteppedVehicle] = {}
        self.observers: list[Callable[[SteppedWorld], None]] = []
        self._seed, self._downwash = seed, downwash
        self._wind = self._declared_wind = wind if wind is not None else Wind(steady_W_mps=scene.wind_W_mps)
        self._group: VehicleGroup | None = None
        self._flying: list[FlyingVehicle] = []
        self._standing: list[StandingVehicle] = []
        self._departures: list[Departure] = []

    @property
    def t_ns(self) -> int:
        """Time since the world began."""
        return self.tick * self.tick_ns

    @property
    def wind_W_mps(self) -> Vec3:
        """Steady wind."""
        return self._wind.steady_W_mps

    def add(
        self,
        name: str,
        vehicle: Vehicle,
        start: FlightStart = FlightStart(),  # noqa: B008 (frozen)
        *,
        effects: Effects = Effects(),  # noqa: B008 (frozen)
        faults: Sequence[VehicleFault] = (),
    ) -> FlyingVehicle:
        """Add a vehicle between two ticks. Raises ValueError for a name that is taken, or a battery that is missing."""
        self._check_free(name)
        physics = self._physics(vehicle, start, effects, faults)
        truth = physics.join(self.tick)._replace(tick=self.tick, t_ns=self.t_ns)
        added = self.vehicles[name] = FlyingVehicle(name, vehicle, truth, physics)
        self._flying.append(added)
        self._group = VehicleGroup({each.name: each.physics for each in self._flying}, downwash=self._downwash)
        return added

    def stand(
        self,
        name: str,
        vehicle: Vehicle,
        start: FlightStart = FlightStart(),  # noqa: B008 (frozen)
        *,
        effects: Effects = Effects(),  # noqa: B008 (frozen)
    ) -> StandingVehicle:
        """Add a vehicle without physics between two ticks. Raises ValueError for a name that is taken."""
        self._check_free(name)
        truth = standing_truth(vehicle, start)._replace(tick=self.tick, t_ns=self.t_ns)
        added = StandingVehicle(name, vehicle, truth, lambda: self._physics(vehicle, start, effects))
        self.vehicles[name] = added
        self._standing.append(added)
        return added

    def _check_free(self, name: str) -> None:
        if name in self.vehicles:
            raise ValueError(f"there is a vehicle {name!r} already")

    def _physics(
        self, vehicle: Vehicle, start: FlightStart, effects: Effects, faults: Sequence[VehicleFault] = ()
    ) -> VehiclePhysics:
        return VehiclePhysics(
            vehicle,
            self.scene,
            self.tick_ns,
            start=start,
            effects=effects,
            disturbances=Disturbances(wind=self._wind, seed=self._seed, faults=faults),
            integration=self._integration,
        )

    def step(self) -> None:
        """Advance all vehicles by one tick. Raises ValueError if a pilot's command is not finite."""
        controls = [vehicle.controls() for vehicle in self._flying]
        self.tick += 1
        if self._group is not None:
            self._advance(self._group, controls)
        t_ns = self.t_ns
        for vehicle in self._standing:
            vehicle.truth = vehicle.truth._replace(tick=self.tick, t_ns=t_ns)
        for observer in self.observers:
            observer(self)

    def hold(self, commands: Sequence[float] | Kernel, ticks: int, cruised: Cruise | None = None) -> None:
        """Advance a world of one flying vehicle without a pilot by `ticks` ticks.

        `commands`: the same 0..1 in all ticks, or an `IdealController.kernel` that flies its set-point. The vehicle has
        the bits of `step` with a pilot that returns them; observers are called once, at the end. `cruised`: what
        `cruise_flights` has flown of these ticks.
        Raises ValueError for another world, or a command that is not finite.
        """
        if len(self.vehicles) != 1 or len(self._flying) != 1 or self._flying[0].pilot is not None:
            raise ValueError("hold() needs a world with a single vehicle, which has physics and no pilot")
        vehicle, last = self._flying[0], self.tick + ticks
        while self.tick < last:
            departed = vehicle.hold(commands, last - self.tick, cruised)
            cruised = None
            self.tick = last if departed is None else departed.tick
            if departed is not None:
                vehicle.truth = self._stop(vehicle, vehicle.physics.body.position_before(), departed)
        for observer in self.observers:
            observer(self)

    def cruised(self, ticks: int) -> None:
        """Take notice of ticks that `cruise_flights` has flown whole with the vehicle of a world as for `hold`."""
        self.tick += ticks
        for vehicle in self._flying:
            vehicle.cruised(ticks)
        for observer in self.observers:
            observer(self)

    def _advance(self, group: VehicleGroup, controls: Sequence[Sequence[float]]) -> None:
        before = [vehicle.truth for vehicle in self._flying]
        try:
            truths = group.advance(self.tick, controls)
        except ModelRangeError as error:
            truths = [self._stopped(*each, error) for each in zip(self._flying, before, strict=True)]
        for vehicle, truth in zip(self._flying, truths, strict=True):
            vehicle.truth = truth

    def _stopped(self, vehicle: FlyingVehicle, before: TruthState, error: ModelRangeError) -> TruthState:
        if vehicle.name != error.vehicle:
            return vehicle.physics.truth
        return self._stop(vehicle, before.p_WB, error)

    def _stop(self, vehicle: FlyingVehicle, p_WB: Vec3, error: ModelRangeError) -> TruthState:
        self._departures.append(Departure(self.t_ns, vehicle.name, str(error)))
        self.forget_contacts(vehicle.name)
        if error.variable == "battery_charge":
            vehicle.physics.end_battery()
            vehicle.is_empty = True
        return vehicle.physics.place(p_WB)

    def restart(self, seed: int) -> None:
        """Return to tick 0 with all vehicles at their starts, as a new world with this seed of its wind begins.

        Vehicles that were added later begin at tick 0, too. Pilots are not told.
        """
        self.tick, self._wind = 0, self._declared_wind
        self._departures.clear()
        for vehicle in self.vehicles.values():
            vehicle.restart(seed)
            self.forget_contacts(vehicle.name)
        self.take_contacts()

    def set_wind(self, wind_W_mps: Vec3) -> None:
        """Set the steady wind for all vehicles from the next tick on."""
        self._wind = self._wind.model_copy(update={"steady_W_mps": wind_W_mps})
        for vehicle in self._flying:
            vehicle.physics.set_steady_wind(wind_W_mps)

    def surround(self, scene: Scene) -> None:
        """Put all vehicles, where they are, into another scene of the same gravity and friction."""
        self.scene = scene
        for vehicle in self.vehicles.values():
            vehicle.surround(scene)
        if self._group is not None:
            self._group.forget_scene()

    def actor_changed(self, actor: Actor) -> None:
        """Take notice that an actor of the scene that rests was put elsewhere."""
        if self._group is not None:
            self._group.actor_changed(actor, self.t_ns)
        for vehicle in self._standing:
            vehicle.actor_changed(actor, self.t_ns)

    def forget_contacts(self, name: str) -> None:
        """Forget the contacts with other vehicles of one that was placed elsewhere."""
        if self._group is not None and isinstance(self.vehicles[name], FlyingVehicle):
            self._group.forget(name)

    def take_contacts(self) -> list[VehicleContact]:
        """Return the contacts between vehicles since the last call."""
        return [] if self._group is None else self._group.take_contacts()

    def take_departures(self) -> list[Departure]:
        """Return the vehicles that were stopped since the last call."""
        departures, self._departures = self._departures, []
        return departures
