"""ArduPilot SITL over its JSON link: started by the bench from the user's build, or by the user."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from firmware_bridge.autopilots.ardupilot import plane
from firmware_bridge.autopilots.ardupilot.copter import PROGRAM, frame_misfits
from firmware_bridge.autopilots.ardupilot.firmware import ARDUPILOT
from firmware_bridge.autopilots.ardupilot.sensors import SITL
from firmware_bridge.autopilots.ardupilot.vehicle_parameters import base_file, build_name, vehicle_parameters
from firmware_bridge.autopilots.installation import WORK_FOLDER, Home, Installation, Surroundings
from firmware_bridge.autopilots.profile import Profile, StartCommand
from firmware_bridge.ground_station.projections import GeodeticFromW, Place, ardupilot_sitl_world
from firmware_bridge.links.ardupilot.json_link import StateLine
from firmware_bridge.links.ardupilot.sitl import (
    TCP_PORT,
    ardupilot_sitl,
    hand_start_command,
    loop_parameters,
    write_defaults,
)
from firmware_bridge.links.autopilot_link import AutopilotLink
from signals.errors import file_errors
from signals.samples import Vec3

_DEFAULTS_NAME, _SUITE_DEFAULTS_NAME = "bench.parm", "vehicle.parm"


def make_link(installation: Installation, around: Surroundings) -> AutopilotLink:
    """Make the link, to the user's running SITL if `autopilot.start` is false, else to `autopilot.binary`."""
    own, limits = installation.settings, installation.timeouts
    settings: dict[str, Any] = {
        "instance": own.instance,
        "on_restart": own.on_restart,
        "state_line": StateLine(installation.gravity_mps2, installation.windy, installation.home[2]),
        "signed": installation.signed_controls,
        "on_event": around.on_event,
        "timeouts": limits if own.on_restart == "error" else replace(limits, reply_s=math.inf),
    }
    if not own.start:
        return ardupilot_sitl(home=installation.home, mavlink=_mavlink_address(installation), **settings)
    return ardupilot_sitl(
        build=around.build(own, log=f"{WORK_FOLDER}/{build_name(installation.vehicle)}.log"),
        home=installation.home,
        parameters=_vehicle_parameters(installation),
        base=base_file(installation.vehicle),
        **settings,
    )


def _mavlink_address(installation: Installation) -> str:
    """Return the address of the MAVLink of a SITL that the user starts."""
    settings = installation.settings
    return settings.mavlink_port or f"tcp:{TCP_PORT + 10 * settings.instance}"


def _vehicle_parameters(installation: Installation) -> dict[str, float]:
    """Return the parameters of this vehicle, its sensors and the tick, with those of the bench over them."""
    own = vehicle_parameters(installation.vehicle) | loop_parameters(installation.tick_hz)
    return own | dict(installation.sensor_parameters) | installation.settings.all_params


def start_command(installation: Installation, folder: Path) -> StartCommand:
    """Return the command that starts SITL for a bench that waits for it; its defaults file goes to `folder`.

    Raises RecordingError if the file cannot be written.
    """
    settings, path = installation.settings, folder / _DEFAULTS_NAME
    with file_errors(path):
        defaults = write_defaults(path, _vehicle_parameters(installation), base_file(installation.vehicle))
    argv = hand_start_command(
        build_name(installation.vehicle) if settings.binary is None else Path(settings.binary).expanduser().resolve(),
        home=installation.home,
        defaults=defaults,
        instance=settings.instance,
        mavlink=_mavlink_address(installation),
        arguments=settings.arguments,
    )
    return StartCommand({}, argv)


def suite_env(installation: Installation, folder: Path) -> Mapping[str, str]:
    """Return the model and the file of this vehicle's parameters for a test suite that starts SITL itself."""
    defaults = folder / _SUITE_DEFAULTS_NAME
    parameters = _vehicle_parameters(installation)
    defaults.write_text("".join(f"{name} {value!r}\n" for name, value in parameters.items()))
    return {"HIL_MODEL": "JSON:127.0.0.1", "HIL_DEFAULTS": str(defaults)}


def _world(geodetic: GeodeticFromW, home: Home, home_W: Vec3) -> GeodeticFromW:  # noqa: ARG001 (SITL has its own)
    return ardupilot_sitl_world(Place(*home[:3]), home_W)


PROFILE = Profile(
    firmware=ARDUPILOT,
    sensors=SITL,
    make_link=make_link,
    lockstep=True,
    keys=frozenset({"binary", "arguments", "mavlink_port", "on_restart", "params_file"}),
    program=PROGRAM,
    flies_planes=True,
    flies_vtols=True,
    vtol_kinds=frozenset({"standard", "tiltrotor", "tailsitter"}),
    plane_program=plane.PROGRAM,
    vehicle_misfits=lambda settings, vehicle: frame_misfits(vehicle),  # noqa: ARG005
    wall_clock_telemetry=True,
    line=None,  # of its link only MAVLink has frames
    world=_world,
    airsim_type="ArduCopter",
    start_command=start_command,
    suite_env=suite_env,
)
