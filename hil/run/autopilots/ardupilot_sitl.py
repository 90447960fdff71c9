"""ArduPilot SITL over its JSON link: started by the bench from the user's build, or by the user."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from firmware_bridge.links.ardupilot.sitl import TCP_PORT, ardupilot_sitl, copter_parameters
from firmware_bridge.links.autopilot_link import AutopilotLink
from hil.config import Bench
from hil.config.checks.intake_checks import intake_parameters
from hil.config.checks.rotor_checks import ardupilot_frame
from hil.run.autopilots.surroundings import WORK_FOLDER, Surroundings, firmware_build, timeouts
from signals.errors import LinkError
from sim.physics import multirotor
from sim.physics.vehicle import Vehicle


def make_link(bench: Bench, around: Surroundings) -> AutopilotLink:
    """Make the link, to the user's running SITL if `autopilot.start` is false, else to `autopilot.binary`."""
    autopilot = bench.config.autopilot
    limits = timeouts(bench)
    settings: dict[str, Any] = {
        "instance": autopilot.instance,
        "on_restart": autopilot.on_restart,
        "gravity_mps2": bench.scene.gravity_mps2,
        "sends_wind": _windy(bench),
        "on_event": around.on_event,
        "timeouts": limits if autopilot.on_restart == "error" else replace(limits, reply_s=math.inf),
    }
    if not autopilot.start:
        return ardupilot_sitl(home=around.home, mavlink=mavlink_address(bench), **settings)
    return ardupilot_sitl(
        build=firmware_build(bench, around, log=f"{WORK_FOLDER}/arducopter.log"),
        home=around.home,
        parameters=vehicle_parameters(bench),
        **settings,
    )


def mavlink_address(bench: Bench) -> str:
    """Return where the MAVLink of a SITL is that the user starts."""
    autopilot = bench.config.autopilot
    return autopilot.mavlink_port or f"tcp:{TCP_PORT + 10 * autopilot.instance}"


def vehicle_parameters(bench: Bench) -> dict[str, float]:
    """Return the parameters of this vehicle, its sensors and the tick, with `autopilot.params` over them."""
    vehicle = bench.vehicle
    return copter_parameters(
        hover_control=multirotor.hover_control(vehicle),
        thrust_model_factor=vehicle.rotor_constants.thrust_model_factor,
        tick_hz=bench.config.tick_hz,
        more=frame_parameters(vehicle) | intake_parameters(bench.config) | bench.config.autopilot.params,
    )


def frame_parameters(vehicle: Vehicle) -> dict[str, float]:
    """Return the parameters of ArduCopter's frame for the rotors. LinkError if it has none."""
    frame = ardupilot_frame(vehicle)
    if frame is None:
        raise LinkError("ardupilot", f"has no frame with the rotors of the vehicle {vehicle.name!r}")
    return frame.parameters()


def _windy(bench: Bench) -> bool:
    """Return True if the bench or the scene has wind. Otherwise the link sends none."""
    return bench.config.wind is not None or bench.scene.wind_W_mps != (0.0, 0.0, 0.0)
