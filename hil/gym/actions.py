"""Action kinds: actions in -1..1 to commands of a vehicle.

    motors     one value for each rotor: command (a + 1) / 2
    controls   one value for each command of the vehicle: those of its rotors as above, -1..1 of its surfaces
    rates      body rates about x, y, z of B, and collective thrust: 1 + a (thrust_ratio - 1) times the weight
    velocity   forward, left (of the present heading), up, and yaw rate
    position   east, north, up from the episode's origin, and heading from east: +-pi

Rates, velocities and positions are flown by the ideal controller (hil.run.stepped.ideal_controller), velocities and
positions also by the autopilot of a rig. Finite values beyond -1..1 are clipped.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi, sqrt
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from hil.config import Bench
from hil.gym.options import FlightOptions
from hil.run.stepped.ideal_controller import (
    CLIMB,
    HEIGHT,
    MOST_SPEED_MPS,
    POSITION,
    RATES,
    THRUST,
    VELOCITY,
    IdealController,
)
from hil.run.stepped.vehicle import FlyingVehicle
from hil.run.stepped.world import SteppedWorld
from signals.desired import DesiredState
from signals.errors import ConfigError, HilError
from signals.samples import TruthState, Vec3
from sim._kernels import IdealController as Kernel
from sim.physics.multirotor import hover_control, unfit
from sim.physics.vehicle import Vehicle

_BOOT_S = 120.0  # simulated time in which an autopilot has to be ready to arm


def action_space(options: FlightOptions, vehicle: Vehicle, name: str) -> Box:
    """Return the space of one vehicle's actions. Raises ConfigError for a vehicle that they cannot fly."""
    wrong = None
    if options.action == "motors" and len(vehicle.commands) > len(vehicle.rotors):
        wrong = "has surfaces besides its rotors"
    elif options.action in ("rates", "velocity", "position") and options.controller == "ideal":
        wrong = (unfit(vehicle) or ("", None))[1]
    if wrong is not None:
        message = f"action {options.action!r} does not fly {vehicle.name!r}, which {wrong}"
        raise ConfigError.at(name, message, 'action="controls" commands its rotors and surfaces')
    counts = {"motors": len(vehicle.rotors), "controls": len(vehicle.commands)}
    return Box(-1.0, 1.0, (counts.get(options.action, 4),), np.float32)


def checked(action: Any, shape: tuple[int, ...], name: str) -> list[float]:
    """Return the values of an action, clipped to -1..1. Raises ValueError for a wrong shape or NaN."""
    try:
        array = np.asarray(action, np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name}: the action {action!r} is not an array of numbers; its space is Box{shape}") from None
    if array.shape != shape:
        raise ValueError(
            f"{name}: the action has the shape {array.shape}, and the space {shape}; give {shape[-1]} values of -1..1"
        )
    values: list[float] = array.tolist()
    for index, value in enumerate(values):
        if not -1.0 <= value <= 1.0:
            if not abs(value) < float("inf"):
                raise ValueError(
                    f"{name}: action[{index}] is {value}; every value must be finite (a policy that diverged?)"
                )
            values[index] = 1.0 if value > 0.0 else -1.0
    return values


class Driver:
    """Commands of one vehicle."""

    held: Sequence[float] | Kernel | None  # for `SteppedWorld.hold`; None: the vehicle has a pilot
    cruises = False  # `cruise_flights` can fly the actions

    def rest(self) -> Sequence[float]:
        """Return the action that is flown before the first one has arrived: of set-points, that which hovers."""
        return (0.0, 0.0, 0.0, 0.0)

    def pilot(self, truth: TruthState) -> Sequence[float]:
        """Return the commands of the rotors until the next tick, in a world of several vehicles."""
        raise NotImplementedError

    def begin(self, origin_W: Vec3) -> None:
        """Begin an episode, after the vehicle was put to its start."""

    def command(self, values: Sequence[float]) -> None:
        """Take an action for the coming step."""
        raise NotImplementedError

    def close(self) -> None:
        """End an autopilot."""


class MotorDriver(Driver):
    """Commands of the rotors."""

    held: Sequence[float] = ()
    cruises = True

    def __init__(self, vehicle: FlyingVehicle) -> None:
        self._vehicle = vehicle

    def rest(self) -> Sequence[float]:
        """Return the commands that keep turning rotors at hover, and others still."""
        turning = max(self._vehicle.truth.rotor_speed_radps, default=0.0) > 0.0
        command = hover_control(self._vehicle.vehicle) if turning else 0.0
        return [2.0 * command - 1.0] * len(self._vehicle.vehicle.rotors)

    def pilot(self, truth: TruthState) -> Sequence[float]:  # noqa: ARG002 (of other drivers)
        return self.held

    def command(self, values: Sequence[float]) -> None:
        self.held = [0.5 * (value + 1.0) for value in values]


class ControlsDriver(MotorDriver):
    """All commands of the vehicle, its surfaces too."""

    cruises = False

    def __init__(self, vehicle: FlyingVehicle) -> None:
        super().__init__(vehicle)
        self._signed = [command.signed for command in vehicle.vehicle.commands]

    def rest(self) -> Sequence[float]:
        """Return the commands that about keep the rotors' speeds, surfaces neutral."""
        most = self._vehicle.vehicle.rotor_constants.max_speed_radps
        shares = [(speed / most) * (speed / most) for speed in self._vehicle.truth.rotor_speed_radps]
        rotors = [2.0 * min(share, 1.0) - 1.0 for share in shares]
        return rotors + [0.0 if signed else -1.0 for signed in self._signed[len(rotors) :]]

    def command(self, values: Sequence[float]) -> None:
        self.held = [v if signed else 0.5 * (v + 1.0) for v, signed in zip(values, self._signed, strict=True)]


class IdealDriver(Driver):
    """Set-points for the ideal controller."""

    held: Kernel

    def __init__(self, vehicle: FlyingVehicle, world: SteppedWorld, options: FlightOptions) -> None:
        self._vehicle, self._options = vehicle, options
        thin = 1.0 if vehicle.physics is None else vehicle.physics.density_ratio
        self.held = IdealController(vehicle.vehicle, world.tick_ns, world.scene.gravity_mps2, density_ratio=thin).kernel
        self._aim = self.held.aim
        self._origin_W: Vec3 = (0.0, 0.0, 0.0)
        commands = {"rates": self._rates, "velocity": self._velocity, "position": self._position}
        self.command = commands[options.action]  # type: ignore[method-assign]
        self.cruises = options.action == "rates"

    def pilot(self, truth: TruthState) -> Sequence[float]:
        t = truth
        return self.held.commands(
            t.p_WB, t.q_WB, t.v_WB_W, t.w_WB_B, t.a_WB_W, t.alpha_WB_B, t.rotor_speed_radps, t.in_contact
        )

    def begin(self, origin_W: Vec3) -> None:
        self._origin_W = origin_W
        self.held.reset()

    def _rates(self, values: Sequence[float]) -> None:
        p, q, r, thrust = values
        o = self._options
        ratio = max(0.0, 1.0 + thrust * (o.thrust_ratio - 1.0))
        rate = o.rate_radps
        self._aim(RATES, p * rate, q * rate, THRUST, ratio, True, r * o.yaw_rate_radps, MOST_SPEED_MPS)

    def _velocity(self, values: Sequence[float]) -> None:
        x, y, z = velocity_W(self._vehicle.truth, values, self._options)
        self._aim(VELOCITY, x, y, CLIMB, z, True, values[3] * self._options.yaw_rate_radps, MOST_SPEED_MPS)

    def _position(self, values: Sequence[float]) -> None:
        x, y, z = position_W(self._origin_W, values, self._options)
        self._aim(POSITION, x, y, HEIGHT, z, False, values[3] * pi, self._options.speed_mps)


class RigDriver(Driver):
    """Set-points for the autopilot of the bench's rig, which is started anew for every episode."""

    held: None = None

    def __init__(self, bench: Bench, vehicle: FlyingVehicle, world: SteppedWorld, options: FlightOptions) -> None:
        self._bench, self._vehicle, self._world, self._options = bench, vehicle, world, options
        self._origin_W: Vec3 = (0.0, 0.0, 0.0)
        self._pilot: Any = None

    def pilot(self, truth: TruthState) -> Sequence[float]:
        commands: Sequence[float] = self._pilot.controls(truth)
        return commands

    def begin(self, origin_W: Vec3) -> None:
        """Start the autopilot and let the time go on until it would arm. Raises LinkError."""
        from hil.run.stepped.rig_pilot import RigPilot  # loads the links

        self.close()
        self._origin_W = origin_W
        pilot = self._pilot = RigPilot(self._bench, self._vehicle.physics, lambda _text: None)
        self._vehicle.pilot = self.pilot
        ticks = round(_BOOT_S * self._bench.config.tick_hz)
        while not pilot.ready:
            self._world.step()
            ticks -= 1
            if ticks < 0:
                kind = self._bench.config.autopilot.kind
                raise HilError(f"{kind} is not ready to arm after {_BOOT_S:g} s; fly the bench with hil run to see why")

    def command(self, values: Sequence[float]) -> None:
        o = self._options
        if o.action == "velocity":
            v_W = velocity_W(self._vehicle.truth, values, o)
            desired = DesiredState(v_W=v_W, yaw_rate_radps=values[3] * o.yaw_rate_radps, hold=True)
        else:
            desired = DesiredState(p_W=position_W(self._origin_W, values, o), yaw_rad=values[3] * pi, hold=True)
        self._pilot.desire(desired)

    def close(self) -> None:
        if self._pilot is not None:
            self._pilot.close()
            self._pilot = self._vehicle.pilot = None


def cruise_commands(actions: NDArray[np.float64], options: FlightOptions) -> NDArray[np.float64]:
    """Return motors or rates, a row for each vehicle, as commands for `cruise_flights`: the bits of the drivers."""
    if options.action == "motors":
        return 0.5 * (actions + 1.0)
    commands = actions * (options.rate_radps, options.rate_radps, options.yaw_rate_radps, options.thrust_ratio - 1.0)
    np.maximum(0.0, 1.0 + commands[:, 3], out=commands[:, 3])
    return commands


def velocity_W(truth: TruthState, values: Sequence[float], options: FlightOptions) -> Vec3:
    """Return a velocity that is commanded forward, left and up, in W."""
    w, x, y, z = truth.q_WB
    east, north = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)  # x of B
    size = sqrt(east * east + north * north)
    c, s = (east / size, north / size) if size > 1e-6 else (1.0, 0.0)
    forward, left = values[0] * options.speed_mps, values[1] * options.speed_mps
    return c * forward - s * left, s * forward + c * left, values[2] * options.climb_mps


def position_W(origin_W: Vec3, values: Sequence[float], options: FlightOptions) -> Vec3:
    """Return a position that is commanded around the origin of the episode."""
    (x, y, z), (ex, ey, ez) = origin_W, options.extent_m
    return x + values[0] * ex, y + values[1] * ey, z + values[2] * ez


def make_driver(bench: Bench, vehicle: FlyingVehicle, world: SteppedWorld, options: FlightOptions) -> Driver:
    """Return the driver of a vehicle."""
    if options.action == "motors":
        return MotorDriver(vehicle)
    if options.action == "controls":
        return ControlsDriver(vehicle)
    if options.controller == "rig":
        return RigDriver(bench, vehicle, world, options)
    return IdealDriver(vehicle, world, options)
