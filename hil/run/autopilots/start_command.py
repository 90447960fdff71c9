"""The command with which the user starts the firmware of a bench by hand (`hil run --print-command`)."""

from __future__ import annotations

import shlex
from pathlib import Path

from firmware_bridge.links.ardupilot.sitl import hand_start_command, write_defaults
from firmware_bridge.links.px4.sitl import px4_hand_start
from hil.config import Bench
from hil.run.autopilots.ardupilot_sitl import mavlink_address, vehicle_parameters
from hil.run.autopilots.px4_sitl import airframe_and_params
from hil.run.autopilots.surroundings import home_of
from hil.run.loop.restartable_physics import make_physics
from signals.errors import ConfigError, Problem, RecordingError

DEFAULTS_NAME = "bench.parm"


def start_command(bench: Bench, folder: Path) -> str:
    """Return the command, as a line for a shell. The defaults file of ArduPilot goes to `folder`.

    Raises ConfigError for an autopilot that is not a program to start by hand, RecordingError if `folder` cannot be
    written.
    """
    autopilot = bench.config.autopilot
    binary = None if autopilot.binary is None else Path(autopilot.binary).expanduser().resolve()
    if autopilot.kind == "ardupilot_sitl":
        path = folder.resolve() / DEFAULTS_NAME
        try:
            defaults = write_defaults(path, vehicle_parameters(bench))
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written ({error.strerror or error})") from error
        argv = hand_start_command(
            binary or "arducopter",
            home=home_of(bench.scene.site, make_physics(bench).state),
            defaults=defaults,
            instance=autopilot.instance,
            mavlink=mavlink_address(bench),
            arguments=autopilot.arguments,
        )
        return shlex.join(argv)
    if autopilot.kind == "px4_sitl":
        airframe, params = airframe_and_params(bench)
        env, argv = px4_hand_start(
            binary,
            airframe=airframe,
            tick_hz=bench.config.tick_hz,
            params=params,
            instance=autopilot.instance,
        )
        words = [f"{name}={shlex.quote(value)}" for name, value in (env | autopilot.env).items()]
        return " ".join([*words, shlex.join([*argv, *autopilot.arguments])])
    message = f"only works with a SITL, which the autopilot {autopilot.kind!r} is not"
    raise ConfigError([Problem("--print-command", message, "use it with --rig ardupilot_sitl or --rig px4_sitl")])
