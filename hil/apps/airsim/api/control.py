"""Methods that fly a vehicle: AirSim's moves, their cancellation, controller gains and the remote control.

A move is a state machine of `hil.apps.airsim.flight`; its result comes when it is over in simulated time. A new move
cancels the running one, whose caller receives False. Angles and frames are those of the wire: FRD and NED, radians in
moveBy*, degrees in yaw modes and rotate*.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from hil.apps.airsim.api.session import VEHICLE, flown
from hil.apps.airsim.flight import timed
from hil.apps.airsim.flight.move import Move, MoveError
from hil.apps.airsim.flight.path import PathOptions, TakeOff, go_home, move_on_path, move_to_position, move_to_z
from hil.apps.airsim.flight.remote import Manual, RcData
from hil.apps.airsim.flight.spot import Hover, Land, RotateToYaw
from hil.apps.airsim.flight.yaw import YawMode
from hil.apps.airsim.rpc.arguments import (
    BOOL,
    COUNT,
    FLOAT,
    FLOAT_OR_NAN,
    INT,
    TEXT,
    TIME,
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
_RATES_SWITCH = 1
_MOST_POINTS = 100_000

YAW_MODE = struct("YawMode", YawMode, is_rate=BOOL, yaw_or_rate=FLOAT)


class RcSticks(NamedTuple):
    """AirSim's RCData, as a client gives it."""

    timestamp: int = 0
    pitch: float = 0.0
    roll: float = 0.0
    throttle: float = 0.0
    yaw: float = 0.0
    left_z: float = 0.0
    right_z: float = 0.0
    switches: int = 0
    vendor_id: str = ""
    is_initialized: bool = False
    is_valid: bool = False


_STICK = dict.fromkeys(("pitch", "roll", "throttle", "yaw", "left_z", "right_z"), FLOAT)
# Clients before 2019 have switch1 to switch8, which are ignored.
RC_DATA = struct(
    "RCData", RcSticks, timestamp=TIME, **_STICK, switches=INT, vendor_id=TEXT, is_initialized=BOOL, is_valid=BOOL
)


def _numbers(*names: str) -> list[Parameter]:
    return [Parameter(name, FLOAT) for name in names]


# Infinity is a time limit that has none.
DURATION = Parameter("duration", FLOAT_OR_NAN)
TIMEOUT = optional("timeout_sec", FLOAT_OR_NAN, _NO_LIMIT_S)
YAW = optional("yaw_mode", YAW_MODE, YawMode())
DRIVETRAIN = optional("drivetrain", one_of("DrivetrainType", 0, 1), 0)
LOOKAHEAD = [optional("lookahead", FLOAT, -1.0), optional("adaptive_lookahead", FLOAT, 1.0)]


def start(simulation: Simulation, name: str, vehicle: str, make: Callable[[Drone], Move]) -> Pending:
    """Begin a move of a vehicle and return its result to come. Raises RpcError."""
    drone = flown(simulation.drone(vehicle), name)
    assert drone.flight is not None
    pending = Pending()

    def refused(error: MoveError) -> RpcError:
        drone.refuse(simulation.world.t_ns, f"{name} was refused: {error}")
        return RpcError(f"{drone.name}: {error}")

    def over(result: bool | MoveError) -> None:
        pending.resolve(refused(result) if isinstance(result, MoveError) else result)

    try:
        drone.flight.start(make(drone), over)
    except MoveError as error:
        raise refused(error) from None
    simulation.wake()
    return pending


def methods(simulation: Simulation) -> list[Method]:
    """Return the methods of this group."""
    sim = simulation

    def move(name: str, make: Callable[..., Move], *parameters: Parameter) -> Method:
        """Return the method of a move; `make` receives the arguments but the last, the vehicle's name."""

        def call(*arguments: Any) -> Pending:
            return start(sim, name, arguments[-1], lambda _drone: make(*arguments[:-1]))

        return joined(name, call, *parameters, VEHICLE)

    def joined(name: str, call: Callable[..., Pending], *parameters: Parameter) -> Method:
        return method(name, call, *parameters)._replace(is_joined=True)

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

    def by_manual(vx: float, vy: float, z: float, duration: float, drivetrain: int, yaw: YawMode, name: str) -> Pending:
        def make(drone: Drone) -> Move:
            assert drone.flight is not None
            return Manual(drone.flight.receiver, (vx, vy), z, duration, drivetrain, yaw)

        return start(sim, "moveByManual", name, make)

    def by_rc(sticks: RcSticks, name: str) -> None:
        drone = flown(sim.drone(name), "moveByRC")
        assert drone.flight is not None
        rates = bool(sticks.switches & _RATES_SWITCH)
        time_ns = max(0, sticks.timestamp - sim.epoch_ns) if sticks.timestamp else 0
        data = RcData(time_ns, sticks.pitch, sticks.roll, sticks.throttle, sticks.yaw, rates, sticks.is_valid)
        drone.flight.set_rc(data)

    def cancel(name: str) -> None:
        drone = sim.drone(name)
        if drone.flight is not None:
            drone.flight.cancel()

    def gains(name: str, loop: str) -> Method:
        def call(kp: list[float], ki: list[float], kd: list[float], vehicle: str) -> None:
            drone = flown(sim.drone(vehicle), name)
            assert drone.flight is not None
            try:
                ignored = drone.flight.set_gains(loop, kp, ki, kd)
            except MoveError as error:
                raise RpcError(f"{drone.name}: {error}") from None
            if ignored:
                sim.log(f"{name}: ki and kd have no effect here; the controller has no steady error")

        vector = list_of(FLOAT, exactly=3)
        return method(name, call, Parameter("kp", vector), Parameter("ki", vector), Parameter("kd", vector), VEHICLE)

    def path(points: list[Vector], *rest: Any) -> Move:
        return move_on_path([(p.x_val, p.y_val, p.z_val) for p in points], options(*rest))

    velocity = Parameter("velocity", FLOAT)
    follow = [velocity, TIMEOUT, DRIVETRAIN, YAW, *LOOKAHEAD]

    def safety(*arguments: Any) -> bool:
        sim.log(f"setSafety: obstacles and geofences are not watched here; {sim.drone(arguments[-1]).name} flies on")
        return False

    return [
        move("takeoff", TakeOff, optional("timeout_sec", FLOAT_OR_NAN, _TAKEOFF_S)),
        move("land", Land, optional("timeout_sec", FLOAT_OR_NAN, _LAND_S)),
        move("goHome", go_home, TIMEOUT),
        move("hover", Hover),
        move(
            "moveByVelocity",
            lambda x, y, z, *rest: timed.move_by_velocity((x, y, z), *rest),
            *_numbers("vx", "vy", "vz"), DURATION, DRIVETRAIN, YAW,
        ),
        move(
            "moveByVelocityZ",
            lambda x, y, *rest: timed.move_by_velocity_z((x, y), *rest),
            *_numbers("vx", "vy", "z"), DURATION, DRIVETRAIN, YAW,
        ),
        move(
            "moveByVelocityBodyFrame",
            lambda x, y, z, *rest: timed.move_by_velocity_body_frame((x, y, z), *rest),
            *_numbers("vx", "vy", "vz"), DURATION, DRIVETRAIN, YAW,
        ),
        move(
            "moveByVelocityZBodyFrame",
            lambda x, y, *rest: timed.move_by_velocity_z_body_frame((x, y), *rest),
            *_numbers("vx", "vy", "z"), DURATION, DRIVETRAIN, YAW,
        ),
        move("moveOnPath", path, Parameter("path", list_of(VECTOR, most=_MOST_POINTS)), *follow),
        move(
            "moveToPosition",
            lambda x, y, z, *rest: move_to_position((x, y, z), options(*rest)),
            *_numbers("x", "y", "z"), *follow,
        ),
        joined("moveToGPS", to_gps, *_numbers("latitude", "longitude", "altitude"), *follow, VEHICLE),
        move(
            "moveToZ",
            lambda z, speed, limit, yaw, *ahead: move_to_z(z, options(speed, limit, 0, yaw, *ahead)),
            Parameter("z", FLOAT), velocity, TIMEOUT, YAW, *LOOKAHEAD,
        ),
        joined("moveByManual", by_manual, *_numbers("vx_max", "vy_max", "z_min"), DURATION, DRIVETRAIN, YAW, VEHICLE),
        move("rotateToYaw", RotateToYaw, Parameter("yaw", FLOAT), TIMEOUT, optional("margin", FLOAT, 5.0)),
        move("rotateByYawRate", timed.rotate_by_yaw_rate, Parameter("yaw_rate", FLOAT), DURATION),
        method("moveByRC", by_rc, Parameter("rcdata", RC_DATA), VEHICLE),
        move(
            "moveByMotorPWMs",
            lambda a, b, c, d, duration: timed.move_by_motor_pwms((a, b, c, d), duration),
            *_numbers("front_right_pwm", "rear_left_pwm", "front_left_pwm", "rear_right_pwm"), DURATION,
        ),
        move(
            "moveByRollPitchYawZ",
            lambda roll, pitch, *rest: timed.move_by_roll_pitch_yaw_z((roll, pitch), *rest),
            *_numbers("roll", "pitch", "yaw", "z"), DURATION,
        ),
        move(
            "moveByRollPitchYawThrottle",
            lambda roll, pitch, *rest: timed.move_by_roll_pitch_yaw_throttle((roll, pitch), *rest),
            *_numbers("roll", "pitch", "yaw", "throttle"), DURATION,
        ),
        move(
            "moveByRollPitchYawrateThrottle",
            lambda roll, pitch, *rest: timed.move_by_roll_pitch_yawrate_throttle((roll, pitch), *rest),
            *_numbers("roll", "pitch", "yaw_rate", "throttle"), DURATION,
        ),
        move(
            "moveByRollPitchYawrateZ",
            lambda roll, pitch, *rest: timed.move_by_roll_pitch_yawrate_z((roll, pitch), *rest),
            *_numbers("roll", "pitch", "yaw_rate", "z"), DURATION,
        ),
        move(
            "moveByAngleRatesZ",
            lambda x, y, z, *rest: timed.move_by_angle_rates_z((x, y, z), *rest),
            *_numbers("roll_rate", "pitch_rate", "yaw_rate", "z"), DURATION,
        ),
        move(
            "moveByAngleRatesThrottle",
            lambda x, y, z, *rest: timed.move_by_angle_rates_throttle((x, y, z), *rest),
            *_numbers("roll_rate", "pitch_rate", "yaw_rate", "throttle"), DURATION,
        ),
        method("cancelLastTask", cancel, VEHICLE),
        method(
            "setSafety", safety, Parameter("enable_reasons", COUNT), Parameter("obs_clearance", FLOAT_OR_NAN),
            Parameter("obs_strategy", INT), Parameter("obs_avoidance_vel", FLOAT_OR_NAN),
            Parameter("origin", VECTOR_OR_NAN),
            *(Parameter(name, FLOAT_OR_NAN) for name in ("xy_length", "max_z", "min_z")), VEHICLE,
        ),
        gains("setAngleRateControllerGains", "rate"),
        gains("setAngleLevelControllerGains", "attitude"),
        gains("setVelocityControllerGains", "velocity"),
        gains("setPositionControllerGains", "position"),
        # Clients before 2022:
        *(
            move(
                name,
                lambda pitch, roll, z, yaw, duration: timed.move_by_roll_pitch_yaw_z((roll, pitch), yaw, z, duration),
                *_numbers("pitch", "roll", "z", "yaw"), DURATION,
            )
            for name in ("moveByAngleZ", "moveByAngle")
        ),
        move(
            "moveByAngleThrottle",
            lambda pitch, roll, throttle, *rest: timed.move_by_roll_pitch_yawrate_throttle(
                (roll, pitch), rest[0], throttle, rest[1]
            ),
            *_numbers("pitch", "roll", "throttle", "yaw_rate"), DURATION,
        ),
        method("setRCData", by_rc, Parameter("rcdata", RC_DATA), VEHICLE),
    ]  # fmt: skip
