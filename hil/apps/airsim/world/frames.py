"""Geometry that cameras and LiDARs see: the scene with all vehicles, posed for the present tick when it is needed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim.frame.source import SharedFrames
from sim.physics.vehicle_bodies import with_vehicles
from sim.world_loader import load_world

if TYPE_CHECKING:
    from hil.apps.airsim.world.simulation import Simulation


class Frames:
    """Source of geometry of one server. It is built at the first use, and again after a vehicle was added."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._source: SharedFrames | None = None
        self._seen_by: dict[str, SharedFrames] = {}
        self._names: tuple[str, ...] = ()
        self.generation = 0  # grows when all sources are made anew; whoever keeps renderers makes them anew too

    def seen_by(self, vehicle: str) -> SharedFrames:
        """Return the source for the sensors of a vehicle, with everything posed for the present tick."""
        return self._present(vehicle)

    def of_world(self) -> SharedFrames:
        """Return the source that shows all vehicles, with everything posed for the present tick."""
        return self._present("")

    def forget(self) -> None:
        """Build everything anew at the next use, after the scene or an object in it was changed."""
        self._source = None

    def _present(self, vehicle: str) -> SharedFrames:
        sim = self._simulation
        names = tuple(sim.drones)
        if self._source is None or names != self._names:
            world = with_vehicles(load_world(sim.scene), dict.fromkeys(names, sim.model))
            self._source, self._names, self._seen_by = SharedFrames(world), names, {}
            self.generation += 1
        source = self._source
        if vehicle and vehicle not in self._seen_by:
            self._seen_by[vehicle] = source.seen_by(vehicle)
        for name, drone in sim.drones.items():
            source.place(name, drone.vehicle.truth)
        found = self._seen_by[vehicle] if vehicle else source
        found.expect(sim.world.t_ns)
        return found
