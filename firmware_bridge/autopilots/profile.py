"""The profile of a kind of autopilot: everything that the rest of the product asks about it.

A kind is a module in a folder of `firmware_bridge/autopilots/` that ends with `PROFILE = Profile(...)`; its name is the
value of `autopilot.kind` in a bench file. Capabilities are data. Nothing outside the folder compares a kind's name or
the class of a link.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from firmware_bridge.autopilots.firmware import Firmware
from firmware_bridge.autopilots.installation import Aircraft, Home, Installation, Surroundings
from firmware_bridge.autopilots.intake import Intake
from firmware_bridge.autopilots.line import ONE_LINE, Line
from firmware_bridge.autopilots.settings import AutopilotSettings
from firmware_bridge.ground_station.projections import GeodeticFromW
from firmware_bridge.links.autopilot_link import AutopilotLink
from signals.mission import MissionItem
from signals.samples import Vec3


class Misfit(NamedTuple):
    """A setting that does not fit the autopilot: its place in the bench file, what is wrong, what to do."""

    place: tuple[str, ...]
    message: str
    hint: str = ""


@dataclass(frozen=True)
class Program:
    """The firmware as a program on this machine, `autopilot.binary`: the user's own build."""

    name: str
    mark: bytes  # in every build of it
    makes: str  # how the user makes one
    always: bool = True  # False: the kind may be a board instead


class StartCommand(NamedTuple):
    """A command with which the user starts the firmware by hand."""

    env: Mapping[str, str]
    argv: Sequence[str]


def _no_misfits(settings: AutopilotSettings) -> Sequence[Misfit]:  # noqa: ARG001
    return ()


def _takes_any_vehicle(settings: AutopilotSettings, vehicle: Aircraft) -> Sequence[Misfit]:  # noqa: ARG001
    return ()


def _takes_any_item(vehicle: Aircraft, items: Sequence[MissionItem]) -> Mapping[int, tuple[str, str]]:  # noqa: ARG001
    return {}


def _exact(geodetic: GeodeticFromW, home: Home, home_W: Vec3) -> GeodeticFromW:  # noqa: ARG001
    return geodetic


@dataclass(frozen=True, kw_only=True)
class Profile:
    """Facts about a kind of autopilot, and its functions."""

    firmware: Firmware
    sensors: Mapping[str, Intake]  # taken of the bench, by kind of sensor
    make_link: Callable[[Installation, Surroundings], AutopilotLink]  # not yet open; LinkError if something is missing
    lockstep: bool  # simulated time stands still until it has answered; else it runs on wall-clock time
    repeatable: bool = False  # the same input gives the same flight, bit for bit

    # The section `autopilot`.
    keys: frozenset[str] = frozenset()  # that mean something to it, of those that not every kind has
    program: Program | None = None
    board_ports: Sequence[str] = ()  # keys of the serial ports of a board
    usb_port: str = ""  # of those, the port of the board's USB, which may be left out if there is only one board
    misfits: Callable[[AutopilotSettings], Sequence[Misfit]] = _no_misfits
    known_params: bool = False  # `misfits` tells parameters that it does not have; else it is asked for them in flight
    vehicle_misfits: Callable[[AutopilotSettings, Aircraft], Sequence[Misfit]] = _takes_any_vehicle

    flies_planes: bool = False  # takes a vehicle that its wings alone carry
    plane_program: Program | None = None  # for vehicles with wings, where it is another one than `program`
    flies_vtols: bool = False  # takes a vehicle with lifters, pushers and wings
    vtol_kinds: frozenset[str] = frozenset({"standard"})  # of these, those that it flies: `Vtol.kind`
    plane_items: frozenset[int] = frozenset()  # MAV_CMD of mission items that it flies with planes (or VTOLs) alone
    vtol_items: frozenset[int] = frozenset()  # the same, with VTOLs alone
    # (vehicle, mission) to what is wrong and what to do, by the number of each item that it refuses; {}: not known.
    item_misfits: Callable[[Aircraft, Sequence[MissionItem]], Mapping[int, tuple[str, str]]] = _takes_any_item

    # The flight.
    flight_sensors: Sequence[str] = ("gps", "barometer", "magnetometer")  # needed to fly a mission, besides the IMU
    mavlink: bool = True  # False: no missions, set-points, parameters or modes
    expects_station: bool = True  # a ground station's heartbeat once a second
    # Its telemetry is sent by threads on wall-clock time: requests go out on whole seconds of simulated time, so that
    # a few milliseconds more or less do not change the flight.
    wall_clock_telemetry: bool = False
    heading_wait: str = ""  # parameter of how long it waits at a waypoint for its heading while it moves on
    needs_estimator: bool = False  # a flight waits until PX4's estimator has converged: a board may have any state
    line: Line | None = ONE_LINE  # on which faults.links act; None: its link can have none
    own_faults: Sequence[str] = ()  # keys of autopilot.faults that have an effect
    # (W to the Earth of the scene, start, start in W) to the map that the autopilot uses.
    world: Callable[[GeodeticFromW, Home, Vec3], GeodeticFromW] = _exact

    # Programs beside the bench.
    airsim_type: str = ""  # the VehicleType of AirSim's settings.json that this kind flies
    start_command: Callable[[Installation, Path], StartCommand] | None = None  # may write files to the folder
    suite_env: Callable[[Installation, Path], Mapping[str, str]] | None = None  # of a test suite with its own SITL

    def program_for(self, *, winged: bool) -> Program | None:
        """Return the program that flies vehicles with wings, or the one for those without."""
        return self.plane_program if winged and self.plane_program is not None else self.program

    @property
    def is_program(self) -> bool:
        """True if the firmware is always a program on this machine."""
        return self.program is not None and self.program.always
