"""Methods of the sticks, and of the gains of the flight controller that follows them."""

from __future__ import annotations

from typing import NamedTuple

from hil.apps.airsim.api.control import DRIVETRAIN, DURATION, YAW, joined, numbers, start
from hil.apps.airsim.api.session import VEHICLE, flight_of
from hil.apps.airsim.flight.move import Move, MoveError
from hil.apps.airsim.flight.remote import Manual, RcData
from hil.apps.airsim.flight.yaw import YawMode
from hil.apps.airsim.rpc.arguments import BOOL, FLOAT, INT, TEXT, TIME, list_of, struct
from hil.apps.airsim.rpc.methods import Method, Parameter, Pending, RpcError, method
from hil.apps.airsim.simulation import Simulation
from hil.apps.airsim.world.drone import Drone

_RATES_SWITCH = 1


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


def methods(sim: Simulation) -> list[Method]:
    """Return the methods of this group."""

    def by_manual(vx: float, vy: float, z: float, duration: float, drivetrain: int, yaw: YawMode, name: str) -> Pending:
        def make(drone: Drone) -> Move:
            receiver = flight_of(drone, "moveByManual").receiver
            return Manual(receiver, (vx, vy), z, duration, drivetrain, yaw)

        return start(sim, "moveByManual", name, make)

    def by_rc(sticks: RcSticks, name: str) -> None:
        flight = flight_of(sim.drone(name), "moveByRC")
        rates = bool(sticks.switches & _RATES_SWITCH)
        time_ns = max(0, sticks.timestamp - sim.epoch_ns) if sticks.timestamp else 0
        data = RcData(time_ns, sticks.pitch, sticks.roll, sticks.throttle, sticks.yaw, rates, sticks.is_valid)
        flight.set_rc(data)

    def gains(name: str, loop: str) -> Method:
        def call(kp: list[float], ki: list[float], kd: list[float], vehicle: str) -> None:
            drone = sim.drone(vehicle)
            flight = flight_of(drone, name)
            try:
                ignored = flight.set_gains(loop, kp, ki, kd)
            except MoveError as error:
                raise RpcError(f"{drone.name}: {error}") from None
            if ignored:
                sim.log(f"{name}: ki and kd have no effect here; the controller has no steady error")

        vector = list_of(FLOAT, exactly=3)
        return method(name, call, Parameter("kp", vector), Parameter("ki", vector), Parameter("kd", vector), VEHICLE)

    return [
        joined("moveByManual", by_manual, *numbers("vx_max", "vy_max", "z_min"), DURATION, DRIVETRAIN, YAW, VEHICLE),
        method("moveByRC", by_rc, Parameter("rcdata", RC_DATA), VEHICLE),
        gains("setAngleRateControllerGains", "rate"),
        gains("setAngleLevelControllerGains", "attitude"),
        gains("setVelocityControllerGains", "velocity"),
        gains("setPositionControllerGains", "position"),
        method("setRCData", by_rc, Parameter("rcdata", RC_DATA), VEHICLE),
    ]  # fmt: skip
