"""One vehicle of a stepped world: its true state, and of one that flies its physics and the pilot of its rotors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite

from signals._kernel import det_cos, det_sin
from signals.errors import ModelRangeError
from signals.rotation import NO_TURN
from signals.samples import Quat, TruthState, Vec3
from sim._kernels import IdealController as Kernel
from sim.physics.flight_start import FlightStart
from sim.physics.scene_contact import SceneContact
from sim.physics.vehicle import Vehicle
from sim.physics.vehicle_physics import NO_MOTION, Cruise, VehiclePhysics, check_motion
from sim.scene.scene import Scene
from sim.scene.scene_map import Actor

Pilot = Callable[[TruthState], Sequence[float]]  # true state -> commands 0..1 of the rotors until the next tick


class FlyingVehicle:
    """Vehicle with physics. Made by `SteppedWorld.add`."""

    def __init__(self, name: str, vehicle: Vehicle, start: TruthState, physics: VehiclePhysics) -> None:
        self.name = name
        self.vehicle = vehicle
        self.physics = physics
        self.start = start
        self._truth: TruthState | None = start  # None: the physics knows it
        self.pilot: Pilot | None = None  # None: the rotors stand still
        self.is_empty = False  # the battery: rotors stand still until `reset`
        self._still = (0.0,) * len(vehicle.rotors)

    @property
    def truth(self) -> TruthState:
        """True state at the last tick, or where the vehicle was placed since."""
        if self._truth is None:
            self._truth = self.physics.truth
        return self._truth

    @truth.setter
    def truth(self, truth: TruthState) -> None:
        self._truth = truth

    def hold(
        self, commands: Sequence[float] | Kernel, ticks: int, cruised: Cruise | None = None
    ) -> ModelRangeError | None:
        """Fly as `SteppedWorld.hold`, alone in the world; return the error of a tick that left the model's range.

        Raises ValueError for a command that is not finite.
        """
        if not isinstance(commands, Kernel) and not all(map(isfinite, commands)):
            raise ValueError(f"{self.name}: the commands are {list(commands)}; every command must be finite")
        self._truth = None
        try:
            self.physics.hold(self._still if self.is_empty else commands, ticks, cruised)
        except ModelRangeError as error:
            return error
        return None

    def cruised(self, ticks: int) -> None:
        """Take notice of ticks that `cruise_flights` has flown."""
        self._truth = None
        self.physics.cruised(ticks)

    @property
    def cruises(self) -> bool:
        """True if `cruise_flights` may fly the coming ticks."""
        return self.physics.cruises and self.pilot is None and not self.is_empty

    def controls(self) -> Sequence[float]:
        """Return the pilot's commands for the coming tick. Raises ValueError for one that is not finite."""
        if self.pilot is None:
            return self._still
        controls = self.pilot(self.truth)
        if not all(map(isfinite, controls)):
            raise ValueError(f"{self.name}: the pilot commanded {list(controls)}; every command must be finite")
        return self._still if self.is_empty else controls

    def place(
        self,
        p_WB: Vec3,
        q_WB: Quat = NO_TURN,
        v_WB_W: Vec3 = NO_MOTION,
        w_WB_B: Vec3 = NO_MOTION,
        rotor_speed_radps: Sequence[float] | None = None,
    ) -> None:
        """Put the vehicle elsewhere; see `VehiclePhysics.place`. Raises ValueError."""
        self.truth = self.physics.place(p_WB, q_WB, v_WB_W, w_WB_B, rotor_speed_radps)

    def touch(self) -> SceneContact | None:
        """Return the contact of the vehicle with the scene where it is now; None if it touches nothing."""
        return self.physics.touch(self.truth.t_ns)

    def surround(self, scene: Scene) -> None:
        """Put the vehicle, where it is, into another scene of the same gravity and friction."""
        self.physics.surround(scene)

    def reset(self) -> None:
        """Put the vehicle back to its start."""
        self.is_empty = False
        self.truth = self.physics.reset()

    def restart(self, seed: int) -> None:
        """Return to the start and to tick 0, as a new vehicle of a world of this seed."""
        self.is_empty = False
        self.truth = self.physics.restart(seed)


class StandingVehicle:
    """Vehicle that only stands where it is put. Made by `SteppedWorld.stand`."""

    def __init__(
        self, name: str, vehicle: Vehicle, start: TruthState, make_physics: Callable[[], VehiclePhysics]
    ) -> None:
        """`make_physics`: makes the model that finds contacts."""
        self.name = name
        self.vehicle = vehicle
        self.start = start
        self.truth = start
        self._make_physics = make_physics
        self._contact_model: VehiclePhysics | None = None

    def place(
        self,
        p_WB: Vec3,
        q_WB: Quat = NO_TURN,
        v_WB_W: Vec3 = NO_MOTION,
        w_WB_B: Vec3 = NO_MOTION,
        rotor_speed_radps: Sequence[float] | None = None,  # noqa: ARG002 (its rotors stand still)
    ) -> None:
        """Put the vehicle elsewhere. Raises ValueError."""
        check_motion(p_WB, q_WB, v_WB_W, w_WB_B)
        self.truth = self.truth._replace(p_WB=p_WB, q_WB=q_WB, v_WB_W=v_WB_W, w_WB_B=w_WB_B)

    def touch(self) -> SceneContact | None:
        """Return the contact of the vehicle with the scene where it is now; None if it touches nothing."""
        model = self._contact_model = self._contact_model or self._make_physics()
        model.place(self.truth.p_WB, self.truth.q_WB)
        return model.touch(self.truth.t_ns)

    def surround(self, scene: Scene) -> None:  # noqa: ARG002 (the model that finds contacts is made anew)
        """Take notice of another scene."""
        self._contact_model = None

    def actor_changed(self, actor: Actor, t_ns: int) -> None:
        """Take notice that an actor was put elsewhere."""
        if self._contact_model is not None:
            self._contact_model.actor_changed(actor, t_ns)

    def reset(self) -> None:
        """Put the vehicle back to its start."""
        self.truth = self.start._replace(tick=self.truth.tick, t_ns=self.truth.t_ns)

    def restart(self, seed: int) -> None:  # noqa: ARG002 (nothing of it is random)
        """Return to the start and to tick 0."""
        self.truth = self.start._replace(tick=0, t_ns=0)


SteppedVehicle = FlyingVehicle | StandingVehicle


def standing_truth(vehicle: Vehicle, start: FlightStart) -> TruthState:
    """Return the state of a vehicle without physics at its start."""
    x, y, z = start.ground_W
    p_WB = start.p_WB if start.p_WB is not None else (x, y, z + vehicle.standing_height_m)
    q_WB = (det_cos(0.5 * start.yaw_rad), 0.0, 0.0, det_sin(0.5 * start.yaw_rad))
    still = (0.0, 0.0, 0.0)
    return TruthState(0, 0, p_WB, q_WB, still, still, still, still, (0.0,) * len(vehicle.rotors), False)
