"""PX4 SITL in lockstep over TCP: started by the bench from the user's build, or by the user."""

from __future__ import annotations

from firmware_bridge.links.autopilot_link import AutopilotLink
from firmware_bridge.links.px4.sitl import px4_sitl_link, px4_sitl_process
from hil.config import Bench
from hil.run.autopilots.rotor_parameters import matching_airframe, px4_parameters
from hil.run.autopilots.surroundings import Surroundings, firmware_build, timeouts

EXTERNAL_AIRFRAME = "none_iris"


def make_link(bench: Bench, around: Surroundings) -> AutopilotLink:
    """Make the link, to `autopilot.binary`, or to the user's running SITL if `autopilot.start` is false."""
    config = bench.config
    autopilot = config.autopilot
    process = None
    airframe, params = airframe_and_params(bench)
    if autopilot.start:
        process = px4_sitl_process(
            firmware_build(bench, around),
            airframe=airframe,
            tick_hz=config.tick_hz,
            params=params,
            instance=autopilot.instance,
        )
    return px4_sitl_link(
        autopilot.instance,
        start_process=None if process is None else lambda: process,
        timeouts=timeouts(bench),
        wrap=around.wrap,
    )


def airframe_and_params(bench: Bench) -> tuple[str, dict[str, float]]:
    """Return PX4's airframe and parameters: those of the bench over those of the vehicle.

    Without `autopilot.airframe` it is PX4's for external simulators, with the rotors of the vehicle unless it has them.
    """
    autopilot = bench.config.autopilot
    if autopilot.airframe is not None:
        return autopilot.airframe, autopilot.params
    rotors = {} if matching_airframe(bench.vehicle) == "iris" else px4_parameters(bench.vehicle)
    return EXTERNAL_AIRFRAME, rotors | autopilot.params
