"""One vehicle as AirSim's API shows it: its frame, its flight controller, its task, and its last collision."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from hil.apps.airsim.flight.simple_flight import SimpleFlight
from hil.apps.airsim.rpc.arguments import Vector
from hil.apps.airsim.settings.vehicles import Vehicle as VehicleSettings
from hil.apps.airsim.world.ned import NedFrame
from hil.apps.airsim.world.past import Past
from hil.apps.airsim.world.sensors.suite import SensorSuite
from hil.run.stepped.vehicle import SteppedVehicle
from signals.frames import ned_from_enu
from signals.samples import Vec3
from sim.physics.scene_contact import SceneContact


@dataclass(frozen=True)
class Collision:
    """Collision of a vehicle, in W."""

    t_ns: int = 0
    object_name: str = ""
    point_W: Vec3 | None = None  # None: no collision
    normal_W: Vec3 = (0.0, 0.0, 0.0)  # away from the object
    position_W: Vec3 = (0.0, 0.0, 0.0)  # of the vehicle
    depth_m: float = 0.0


@dataclass
class Drone:
    """Vehicle of the server. `origin` is its own NED frame: its start, level."""

    name: str
    settings: VehicleSettings
    vehicle: SteppedVehicle
    origin: NedFrame
    flight: SimpleFlight | None  # None in ComputerVision
    sensors: SensorSuite
    past: Past
    collision: Collision = Collision()
    touching: bool = False
    touched: str = ""  # name of the object of the last contact
    departed_ns: int | None = None  # last time that the vehicle left the range of the model

    def reset(self) -> None:
        """Return to the start; api control and arming must be asked for again."""
        self.vehicle.reset()
        self.past.begin(self.vehicle.truth)
        self.collision, self.touching, self.touched = Collision(), self.vehicle.truth.in_contact, ""
        if self.flight is not None:
            self.flight.reset()
            self.flight.landed = self.touching

    def collide(self, contact: SceneContact) -> None:
        """Keep a contact with the scene."""
        truth = self.vehicle.truth
        self.collision = Collision(
            truth.t_ns,
            contact.name,
            contact.point_W,
            contact.normal_W,
            truth.p_WB,
            contact.depth_m,
        )

    def collision_info(self, epoch_ns: int, id_of: Callable[[str], int]) -> dict[str, Any]:
        """Return AirSim's collision info; time stamps count from `epoch_ns`, and `id_of` knows the objects' ids."""
        c, nothing = self.collision, Vector()
        collided = c.point_W is not None
        return {
            "has_collided": collided,
            "penetration_depth": float(c.depth_m),
            "time_stamp": epoch_ns + c.t_ns if collided else 0,
            "normal": Vector(*ned_from_enu(c.normal_W)) if collided else nothing,
            "impact_point": Vector(*self.origin.from_W(c.point_W)) if c.point_W is not None else nothing,
            "position": Vector(*self.origin.from_W(c.position_W)) if collided else nothing,
            "object_name": c.object_name,
            "object_id": id_of(c.object_name) if collided else -1,
        }
