"""Methods that fly a vehicle through space: AirSim's moves by velocity, to places and on paths, and their cancellation.

A move is a state machine of `hil.apps.airsim.flight`; its result comes when it is over in simulated time. A new move
cancels the running one, whose caller receives False. Angles and frames are those of the wire: FRD and NED, radians in
moveBy*, degrees in yaw modes and rotate*.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hil.apps.airsim.api.session import VEHICLE, flight_of
from hil.apps.airsim.flight import timed
from hil.apps.airsim.flight.move import Move, MoveError
from hil.apps.airsim.flight.path import PathOptions, TakeOff, go_home, move_on_path, move_to_position, move_to_z
from hil.apps.airsim.flight.spot import Hover, Land, RotateToYaw
from hil.apps.airsim.flight.yaw import YawMode
from hil.apps.airsim.rpc.arguments import (
    BOOL,
    COUNT,
    FLOAT,
    FLOAT_OR_NAN,
    INT,
    VECTOR,
    VECTOR_OR_NAN,
    Vector,
    list_of,
    one_of,
    struct,
)
from hil.apps.airsim.rpc.methods import Method, Parameter, Pending, RpcError, method, optional
from hil.apps.airsim.simulation import Simulation
from hil.apps.airsim.world.drone import Drone

_NO_LIMIT_S = 3e38
_TAKEOFF_S, _LAND_S = 20.0, 60.0
_MOST_POINTS = 100_000

YAW_MODE = struct("YawMode", YawMode, is_rate=BOOL, yaw_or_rate=FLOAT)


def numbers(*names: str) -> list[Parameter]:
    return [Parameter(name, FLOAT) for name in names]


# Infinity is a time limit that has none.
DURATION = Parameter("duration", FLOAT_OR_NAN)
TIMEOUT = optional("timeout_sec", FLOAT_OR_NAN, _NO_LIMIT_S)
YAW = optional("yaw_mode", YAW_MODE, YawMode())
DRIVETRAIN = optional("drivetrain", one_of("DrivetrainType", 0, 1), 0)
LOOKAHEAD = [optional("lookahead", FLOAT, -1.0), optional("adaptive_lookahead", FLOAT, 1.0)]


def start(simulation: Simulation, name: str, vehicle: str, make: Callable[[Drone], Move]) -> Pending:
    """Begin a move of a vehicle and return its result to come. Raises RpcError."""
    drone = simulation.drone(vehicle)
    flight = flight_of(drone, name)
    pending = Pending()

    def refused(error: MoveError) -> RpcError:
        drone.refuse(simulation.world.t_ns, f"{name} was refused: {error}")
        return RpcError(f"{drone.name}: {error}")

    def over(result: bool | MoveError) -> None:
        pending.resolve(refused(result) if isinstance(result, MoveError) else result)

    try:
        flight.start(make(drone), over)
    except MoveError as error:
        raise refused(error) from None
    simulation.wake()
    return pending


def joined(name: str, call: Callable[..., Pending], *parameters: Parameter) -> Method:
    """Return a method that ends with a move, for which clients wait."""
    return method(name, call, *parameters)._replace(is_joined=True)


def move(sim: Simulation, name: str, make: Callable[..., Move], *parameters: Parameter) -> Method:
    """Return the method of a move; `make` receives the arguments but the last, the vehicle's name."""

    def call(*arguments: Any) -> Pending:
        return start(sim, name, arguments[-1], lambda _drone: make(*arguments[:-1]))

    return joined(name, call, *parameters, VEHICLE)


def methods(sim: Simulation) -> list[Method]:
    """Return the methods of this group."""

    def options(velocity: float, timeout: float, *rest: Any) -> PathOptions:
        """Return the options of a path: drivetrain, yaw mode, lookahead, adaptive lookahead."""
        return PathOptions(velocity, timeout, *rest)

    def to_gps(latitude: float, longitude: float, altitude: float, *arguments: Any) -> Pending:
        if not (-90.0 <= latitude <= 90.0 and -360.0 <= longitude <= 360.0):
            raise RpcError(f"latitude {latitude:g} and longitude {longitude:g} are not a place; both are in degrees")
        p_W = sim.earth.point_W(latitude, longitude, altitude)

        def make(drone: Drone) -> Move:
            return move_to_position(drone.origin.from_W(p_W), options(*arguments[:-1]))

        return start(sim, "moveToGPS", arguments[-1], make)

    def cancel(name: str) -> None:
        drone = sim.drone(name)
        if drone.flight is not None:
            drone.flight.cancel()

    def path(points: list[Vector], *rest: Any) -> Move:
        return move_on_path([(p.x_val, p.y_val, p.z_val) for p in points], options(*rest))

    def safety(*arguments: Any) -> bool:
        sim.log(f"setSafety: obstacles and geofences are not watched here; {sim.drone(arguments[-1]).name} flies on")
        return False

    velocity = Parameter("velocity", FLOAT)
    follow = [velocity, TIMEOUT, DRIVETRAIN, YAW, *LOOKAHEAD]
    return [
        move(sim, "takeoff", TakeOff, optional("timeout_sec", FLOAT_OR_NAN, _TAKEOFF_S)),
        move(sim, "land", Land, optional("timeout_sec", FLOAT_OR_NAN, _LAND_S)),
        move(sim, "goHome", go_home, TIMEOUT),
        move(sim, "hover", Hover),
        move(
            sim, "moveByVelocity",
            lambda x, y, z, *rest: timed.move_by_velocity((x, y, z), *rest),
            *numbers("vx", "vy", "vz"), DURATION, DRIVETRAIN, YAW,
        ),
        move(
            sim, "moveByVelocityZ",
            lambda x, y, *rest: timed.move_by_velocity_z((x, y), *rest),
            *numbers("vx", "vy", "z"), DURATION, DRIVETRAIN, YAW,
        ),
        move(
            sim, "moveByVelocityBodyFrame",
            lambda x, y, z, *rest: timed.move_by_velocity((x, y, z), *rest, body=True),
            *numbers("vx", "vy", "vz"), DURATION, DRIVETRAIN, YAW,
        ),
        move(
            sim, "moveByVelocityZBodyFrame",
            lambda x, y, *rest: timed.move_by_velocity_z((x, y), *rest, body=True),
            *numbers("vx", "vy", "z"), DURATION, DRIVETRAIN, YAW,
        ),
        move(sim, "moveOnPath", path, Parameter("path", list_of(VECTOR, most=_MOST_POINTS)), *follow),
        move(
            sim, "moveToPosition",
            lambda x, y, z, *rest: move_to_position((x, y, z), options(*rest)),
            *numbers("x", "y", "z"), *follow,
        ),
        joined("moveToGPS", to_gps, *numbers("latitude", "longitude", "altitude"), *follow, VEHICLE),
        move(
            sim, "moveToZ",
            lambda z, speed, limit, yaw, *ahead: move_to_z(z, options(speed, limit, 0, yaw, *ahead)),
            Parameter("z", FLOAT), velocity, TIMEOUT, YAW, *LOOKAHEAD,
        ),
        move(sim, "rotateToYaw", RotateToYaw, Parameter("yaw", FLOAT), TIMEOUT, optional("margin", FLOAT, 5.0)),
        move(sim, "rotateByYawRate", timed.rotate_by_yaw_rate, Parameter("yaw_rate", FLOAT), DURATION),
        method("cancelLastTask", cancel, VEHICLE),
        method(
            "setSafety", safety, Parameter("enable_reasons", COUNT), Parameter("obs_clearance", FLOAT_OR_NAN),
            Parameter("obs_strategy", INT), Parameter("obs_avoidance_vel", FLOAT_OR_NAN),
            Parameter("origin", VECTOR_OR_NAN),
            *(Parameter(name, FLOAT_OR_NAN) for name in ("xy_length", "max_z", "min_z")), VEHICLE,
        ),
    ]  # fmt: skip
