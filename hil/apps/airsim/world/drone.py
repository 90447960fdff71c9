"""One vehicle as AirSim's API shows it: its frame, its flight controller, its task, and its last collision."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from hil.apps.airsim.flight.simple_flight import SimpleFlight
from hil.apps.airsim.rpc.arguments import Vector
from hil.apps.airsim.settings.vehicles import Vehicle as VehicleSettings
from hil.apps.airsim.world.ned import NedFrame
from hil.apps.airsim.world.past import Past
from hil.apps.airsim.world.sensors.suite import SensorSuite
from hil.run.stepped.vehicle import FlyingVehicle, SteppedVehicle
from signals.frames import ned_from_enu
from signals.rotation import norm
from signals.samples import TruthState, Vec3
from sim.physics.scene_contact import SceneContact
from sim.physics.vehicle_group import VehicleContact

_RESTING_MPS = 0.1  # FastPhysicsEngine::kRestingVelocityMax
_LEAST_UPWARD = 0.7  # z of a normal of a surface that a vehicle can stand on
_RESTING_DEPTH_M = 1e-3  # a vehicle that was put deeper into something is moved out of it
_MOST_PUSHES = 8
_MOST_TEXTS = 1000
_WARNING = 4  # severity of MAVLink


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
    texts: list[tuple[int, int, str]] = field(default_factory=list)  # for the page: t_ns, severity, text

    def reset(self) -> None:
        """Return to the start; api control and arming must be asked for again."""
        self.vehicle.reset()
        self.past.begin(self.vehicle.truth)
        self.collision, self.touching, self.touched = Collision(), self.vehicle.truth.in_contact, ""
        if self.flight is not None:
            self.flight.reset()
            self.flight.landed = self.touching

    def refuse(self, t_ns: int, text: str) -> None:
        """Keep a text about a move that was refused, for the page."""
        if len(self.texts) < _MOST_TEXTS:
            self.texts.append((t_ns, _WARNING, text))

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

    def touch(self) -> None:
        """Keep a contact with the scene that begins, goes on or meets another object.

        Standing on something, and leaving something, is not a collision.
        """
        vehicle, truth, flight = self.vehicle, self.vehicle.truth, self.flight
        begins, self.touching = not self.touching, truth.in_contact
        if not truth.in_contact:
            self.touched = ""
        if not truth.in_contact or not isinstance(vehicle, FlyingVehicle):
            return
        if not begins and flight is not None and flight.landed and norm(truth.v_WB_W) <= _RESTING_MPS:
            return  # without a look at the contacts, because vehicles stand for a long time
        contact = vehicle.physics.contact()
        if contact is None:
            return
        if begins or _collides(truth, contact) or self.touched not in ("", contact.name):
            self.collide(contact)
        self.touched = contact.name

    def push_out(self) -> None:
        """Move a vehicle that was put into something out of it, as AirSim does; the contact would throw it far away."""
        vehicle = self.vehicle
        for push in range(_MOST_PUSHES):
            contact = vehicle.touch()
            if contact is None or contact.depth_m < _RESTING_DEPTH_M:
                return
            if push == 0:
                self.collide(contact)
            truth = vehicle.truth
            x, y, z = (p + contact.depth_m * n for p, n in zip(truth.p_WB, contact.normal_W, strict=True))
            vehicle.place((x, y, z), truth.q_WB, truth.v_WB_W, truth.w_WB_B, truth.rotor_speed_radps)

    def meet(self, other: str, contact: VehicleContact) -> None:
        """Keep a contact with another vehicle."""
        p_W = self.vehicle.truth.p_WB
        (x, y, z), (a, b, c) = p_W, contact.point_W
        length_m = norm((x - a, y - b, z - c)) or 1.0
        normal = ((x - a) / length_m, (y - b) / length_m, (z - c) / length_m)
        self.collision = Collision(contact.t_ns, other, contact.point_W, normal, p_W)

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


def _collides(truth: TruthState, contact: SceneContact) -> bool:
    """Return True for a contact in which a vehicle neither stands nor leaves."""
    vx, vy, vz = truth.v_WB_W
    nx, ny, nz = contact.normal_W
    away_mps = vx * nx + vy * ny + vz * nz
    if away_mps > _RESTING_MPS:
        return False
    along_mps = norm((vx - away_mps * nx, vy - away_mps * ny, vz - away_mps * nz))
    return nz < _LEAST_UPWARD or away_mps < -_RESTING_MPS or along_mps > _RESTING_MPS
