"""Geometry that cameras and LiDARs see: the scene with all vehicles, posed when it is needed."""

from __future__ import annotations

from collections.abc import Mapping

from hil.apps.airsim.world.drone import Drone
from hil.apps.airsim.world.objects.present_world import PresentWorld
from hil.run.stepped.world import SteppedWorld
from sim.frame.source import SharedFrames
from sim.physics.vehicle_bodies import with_vehicles
from sim.scene.scene_map import Actor


class Frames:
    """Source of geometry of one server. It is built at the first use, and again after a vehicle was added."""

    def __init__(self, world: SteppedWorld, present: PresentWorld, drones: Mapping[str, Drone]) -> None:
        """`present`: the scene with its objects, without vehicles; `drones`: all vehicles by name."""
        self._world, self._scenery, self._drones = world, present, drones
        present.on_moved, present.on_new_world = self.moved, self.forget
        self._source: SharedFrames | None = None
        self._seen_by: dict[str, SharedFrames] = {}  # by vehicle
        self._names: tuple[str, ...] = ()
        self.generation = 0  # grows when all sources are made anew; whoever keeps renderers makes them anew too

    def forget(self) -> None:
        """Build everything anew at the next use, after the scene or an object in it was changed."""
        self._source = None

    def moved(self, actor: Actor) -> None:
        """Take notice that an actor of the scene was put elsewhere."""
        if self._source is not None:
            self._source.moved(actor)

    @property
    def is_made(self) -> bool:
        """True if the next question finds the geometry ready."""
        return self._source is not None and self._names == tuple(self._world.vehicles) and self._scenery.is_settled

    def seen_by(self, vehicle: str = "", t_ns: int | None = None) -> SharedFrames:
        """Return the source for the sensors of a vehicle, which it does not show; "" is nobody, everything is shown.

        All is posed for a tick of the last seconds, None: the present one, but objects that clients move are as now.
        """
        self._scenery.settle()
        vehicles = self._world.vehicles
        names = tuple(vehicles)
        if self._source is None or names != self._names:
            world = with_vehicles(self._scenery.world, {name: each.vehicle for name, each in vehicles.items()})
            self._source, self._names = SharedFrames(world), names
            self._seen_by = {"": self._source}
            self.generation += 1
        if vehicle not in self._seen_by:
            self._seen_by[vehicle] = self._source.seen_by(vehicle)
        for name, each in vehicles.items():
            self._source.place_alone(name, each.truth if t_ns is None else self._drones[name].past.at(t_ns))
        found = self._seen_by[vehicle]
        found.expect(self._world.t_ns if t_ns is None else t_ns)
        return found
