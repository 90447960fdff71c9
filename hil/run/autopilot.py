"""The autopilot of a bench in terms of its profile: the facts it is made from, its link, its start by hand."""

from __future__ import annotations

import math
import shlex
from pathlib import Path

from numpy import float64
from numpy.typing import NDArray

from firmware_bridge.autopilots.catalog import PROFILES
from firmware_bridge.autopilots.installation import Home, Installation
from firmware_bridge.devices.serial_path import only_board, serial_path
from firmware_bridge.ground_station.projections import GeodeticFromW
from firmware_bridge.transports.serial import check_port
from hil.config import Bench
from hil.config.airframe_facts import airframe_facts
from hil.config.checks.intake_checks import intake_parameters
from hil.run.loop.restartable_physics import make_physics
from signals.errors import ConfigError
from signals.geodesy import LocalFrame
from signals.rotation import yaw_of
from signals.time import NS_PER_S
from sim.scene.scene import Site

State = NDArray[float64]  # of the vehicle: p_W [m], q_WB (w, x, y, z), then velocities


def installation_of(bench: Bench, state: State) -> Installation:
    """Return the facts about the autopilot of a bench whose vehicle starts in this state."""
    config, scene = bench.config, bench.scene
    return Installation(
        settings=config.autopilot,
        vehicle=airframe_facts(bench.vehicle, scene.site, config.physics.effects),
        tick_hz=config.tick_hz,
        home=home_of(scene.site, state),
        geodetic=LocalFrame(scene.site).geodetic_from_enu,
        gravity_mps2=scene.gravity_mps2,
        windy=config.wind is not None or scene.wind_W_mps != (0.0, 0.0, 0.0),
        noise_seed=config.noise_seed,
        sensor_parameters=intake_parameters(config),
        link_faults=bool(config.faults.links),
        signed_controls=bench.vehicle.signed_commands,
    )


def check_ports(bench: Bench) -> None:
    """Check the serial ports of this bench's autopilot without opening one. Raises LinkError."""
    autopilot = bench.config.autopilot
    for port in (autopilot.port, autopilot.mavlink_port):
        if port is not None and not port.startswith(("udp:", "tcp:")) and port != "none":
            check_port(serial_path(port))
    board_ports = () if autopilot.binary is not None else autopilot.profile.board_ports
    missing = [key for key in board_ports if getattr(autopilot, key) is None]
    if missing == [autopilot.profile.usb_port]:
        only_board()


def home_of(site: Site, state: State) -> Home:
    """Return latitude and longitude [deg], altitude [m MSL], heading [deg from north] of a vehicle in this state."""
    x, y, z, *q_WB = state[:7].tolist()
    yaw_deg = math.degrees(yaw_of(q_WB))
    return *LocalFrame(site).geodetic_from_enu((x, y, z)), (90.0 - yaw_deg) % 360.0


def grid_ns(bench: Bench) -> int:
    """Return the spacing of the times at which the autopilot may be sent requests [ns]; 0: any time."""
    return NS_PER_S if bench.config.autopilot.profile.wall_clock_telemetry else 0


def geodetic_from_W(bench: Bench, state: State) -> GeodeticFromW:
    """Return the map from W to the geodetic coordinates that the autopilot uses, for a flight from this state."""
    site = bench.scene.site
    x, y, z = state[:3].tolist()
    return bench.config.autopilot.profile.world(LocalFrame(site).geodetic_from_enu, home_of(site, state), (x, y, z))


def start_command(bench: Bench, folder: Path) -> str:
    """Return the command with which the user starts the firmware by hand, as a line for a shell; files go to `folder`.

    Raises ConfigError for an autopilot that is not a program to start by hand, RecordingError if `folder` cannot be
    written.
    """
    kind, make = bench.config.autopilot.kind, bench.config.autopilot.profile.start_command
    if make is None:
        rigs = " or ".join(f"--rig {name}" for name, profile in PROFILES.items() if profile.start_command is not None)
        message = f"only works with a SITL, which the autopilot {kind!r} is not"
        raise ConfigError.at("--print-command", message, f"use it with {rigs}")
    command = make(installation_of(bench, make_physics(bench).state), folder.resolve())
    words = [f"{name}={shlex.quote(value)}" for name, value in command.env.items()]
    return " ".join([*words, shlex.join(command.argv)])
