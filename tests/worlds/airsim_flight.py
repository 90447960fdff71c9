"""Vehicle under the ideal controller and AirSim's moves in the real physics, without a server."""

from __future__ import annotations

from math import acos, sqrt

from hil.apps.airsim.flight.move import Move, MoveError, NedState
from hil.apps.airsim.flight.ned_edge import NedEdge
from hil.apps.airsim.flight.simple_flight import SimpleFlight
from hil.run.stepped.ideal_controller import IdealController
from hil.run.stepped.setpoint import Setpoint
from signals.rotation import cos_tilt_of
from signals.samples import TruthState, Vec3
from signals.time import NS_PER_S
from sim.physics.disturbances import Disturbances
from sim.physics.flight_start import FlightStart
from sim.physics.forces.force import Effects
from sim.physics.vehicle import Vehicle, load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import Box, Scene, load_scene
from sim.scene.wind import Wind

TICK_NS = 4_000_000
AIRFIELD = load_scene("airfield")
GRAVITY_MPS2 = AIRFIELD.gravity_mps2


def with_boxes(*boxes: Box) -> Scene:
    """Return the airfield with boxes on it."""
    return AIRFIELD.model_copy(update={"boxes": boxes})


def calm(steady_W_mps: Vec3 = (0.0, 0.0, 0.0)) -> Disturbances:
    """Return a steady wind."""
    return Disturbances(wind=Wind(steady_W_mps=steady_W_mps))


def airborne(
    vehicle: Vehicle,
    p_W: Vec3,
    *,
    tick_ns: int = TICK_NS,
    scene: Scene = AIRFIELD,
    effects: Effects = Effects(),  # noqa: B008 (frozen)
    disturbances: Disturbances = Disturbances(),  # noqa: B008 (frozen)
) -> VehiclePhysics:
    """Return the physics of a vehicle in the air, its rotors at the speed of hovering."""
    start = FlightStart(p_WB=p_W)
    physics = VehiclePhysics(vehicle, scene, tick_ns, start=start, effects=effects, disturbances=disturbances)
    lift = sum(share * rotor.axis[2] for share, rotor in zip(vehicle.thrust_shares, vehicle.rotors, strict=True))
    k = vehicle.rotor_constants.thrust_coefficient_n_per_radps2
    physics.state[13:] = sqrt(vehicle.mass_kg * GRAVITY_MPS2 / (lift * k * physics.density_ratio))
    return physics


class Flown:
    """Vehicle under the ideal controller; `log` holds the states since it was last cleared."""

    def __init__(self, physics: VehiclePhysics) -> None:
        self.physics = physics
        self.controller = IdealController(
            physics.vehicle, physics.tick_ns, GRAVITY_MPS2, density_ratio=physics.density_ratio
        )
        self.truth = physics.advance(0, ())
        self.log: list[TruthState] = []

    def fly(self, setpoint: Setpoint, seconds: float) -> TruthState:
        """Fly one set-point; return the last state."""
        for _ in range(round(seconds * NS_PER_S / self.physics.tick_ns)):
            controls = self.controller.controls(self.truth, setpoint)
            self.truth = self.physics.advance(self.truth.tick + 1, controls)
            self.log.append(self.truth)
        return self.truth


class Pilot:
    """Vehicle under `simple_flight`, with API control and armed. Its NED frame begins where it starts."""

    def __init__(self, physics: VehiclePhysics | None = None, *, vehicle: str = "iris") -> None:
        if physics is None:
            physics = VehiclePhysics(load_vehicle(vehicle), AIRFIELD, TICK_NS)
        self.physics = physics
        self.truth = physics.advance(0, ())
        self.start_W = self.truth.p_WB
        self.flight = SimpleFlight(
            physics.vehicle, physics.tick_ns, GRAVITY_MPS2, self.start_W, density_ratio=physics.density_ratio
        )
        self._edge = NedEdge(physics.vehicle, GRAVITY_MPS2, self.start_W)
        self.flight.enable_api_control(True)
        self.flight.arm(True)
        self.log: list[NedState] = []

    @property
    def ned(self) -> NedState:
        """State in AirSim's frames."""
        return self._edge.state(self.truth, self.flight.landed)

    @property
    def t_s(self) -> float:
        """Time since the start."""
        return self.truth.t_ns / NS_PER_S

    def tick(self) -> None:
        """Advance by one tick."""
        self.truth = self.physics.advance(self.truth.tick + 1, self.flight.controls(self.truth))
        self.log.append(self.ned)
        self.flight.observe(self.truth)

    def wait(self, seconds: float) -> NedState:
        """Advance, and return the state."""
        for _ in range(round(seconds * NS_PER_S / self.physics.tick_ns)):
            self.tick()
        return self.ned

    def do(self, move: Move, most_s: float = 120.0) -> tuple[bool, float]:
        """Fly a move to its end; return its result and the time it took. Raises its MoveError."""
        results: list[bool | MoveError] = []
        self.flight.start(move, results.append)
        begin_s = self.t_s
        while not results:
            assert self.t_s - begin_s < most_s, "the move does not end"
            self.tick()
        (result,) = results
        if isinstance(result, MoveError):
            raise result
        return result, self.t_s - begin_s


def tilt_rad(truth: TruthState) -> float:
    """Return the angle between the body's z axis and the vertical."""
    return acos(max(-1.0, min(1.0, cos_tilt_of(truth.q_WB))))
