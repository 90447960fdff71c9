"""PX4 SITL in lockstep over TCP: started by the bench from the user's build, or by the user."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from firmware_bridge.autopilots.installation import Aircraft, FixedWing, Installation, Surroundings, Vtol
from firmware_bridge.autopilots.line import HIL_LINE
from firmware_bridge.autopilots.profile import Misfit, Profile, Program, StartCommand
from firmware_bridge.autopilots.px4.firmware import PX4
from firmware_bridge.autopilots.px4.rotor_parameters import matching_airframe
from firmware_bridge.autopilots.px4.sensors import SENSORS, with_horizon
from firmware_bridge.autopilots.px4.vehicle_parameters import PWM_OUTPUTS, command_count, vehicle_parameters
from firmware_bridge.autopilots.px4.vtol_parameters import tilt_problem
from firmware_bridge.autopilots.settings import AutopilotSettings
from firmware_bridge.links.autopilot_link import AutopilotLink
from firmware_bridge.links.px4.sitl import airframe_problem, px4_hand_start, px4_sitl_link, px4_sitl_process

EXTERNAL_AIRFRAME, EXTERNAL_PLANE = "none_iris", "gazebo-classic_plane"
EXTERNAL_VTOL = "gazebo-classic_standard_vtol"
_OUTPUTS, MOST_SURFACES = 16, 8
_PLANE_MODULES = ("fw_att_control", "fw_rate_control", "fw_mode_manager", "airspeed_selector")
_VTOL_MODULES = ("vtol_att_control",)
# PX4's own defaults, as the mock has them, where the airframe has those of its aircraft.
_PLANE_DEFAULTS = {
    "FW_LND_ANG": 5.0,
    "FW_P_LIM_MIN": -30.0,
    "FW_THR_ASPD_MAX": 0.0,
    "FW_THR_MAX": 1.0,
    "FW_THR_MIN": 0.0,
    "NPFG_PERIOD": 10.0,
}


def make_link(installation: Installation, around: Surroundings) -> AutopilotLink:
    """Make the link, to `autopilot.binary`, or to the user's running SITL if `autopilot.start` is false."""
    settings = installation.settings
    process = None
    airframe, params = airframe_and_params(installation)
    if settings.start:
        process = px4_sitl_process(
            around.build(settings),
            airframe=airframe,
            tick_hz=installation.tick_hz,
            params=params,
            instance=settings.instance,
        )
    return px4_sitl_link(
        settings.instance,
        start_process=None if process is None else lambda: process,
        timeouts=installation.timeouts,
        wrap=around.wrap,
        uneven_answers=isinstance(installation.vehicle, Vtol),
    )


def airframe_and_params(installation: Installation) -> tuple[str, dict[str, float]]:
    """Return PX4's airframe and parameters: those of the bench over those of its sensors and of the vehicle.

    Without `autopilot.airframe` it is PX4's for external simulators, with the rotors of the vehicle unless it has them.
    """
    settings, vehicle = installation.settings, installation.vehicle
    params = with_horizon(installation.sensor_parameters) | settings.all_params
    if settings.airframe is not None:
        return settings.airframe, params
    if isinstance(vehicle, FixedWing | Vtol):
        # The airframe's own outputs beyond the vehicle's, of which one is reversed, are off.
        off = {f"{PWM_OUTPUTS}{n}": 0.0 for n in range(1, _OUTPUTS + 1)} | {"PWM_MAIN_REV": 0.0}
        airframe = EXTERNAL_VTOL if isinstance(vehicle, Vtol) else EXTERNAL_PLANE
        return airframe, off | _PLANE_DEFAULTS | vehicle_parameters(vehicle) | params
    rotors = {} if matching_airframe(vehicle) == "iris" else vehicle_parameters(vehicle)
    return EXTERNAL_AIRFRAME, rotors | params


def start_command(installation: Installation, folder: Path) -> StartCommand:  # noqa: ARG001 (PX4 needs no file)
    """Return the command that starts PX4 for a bench that waits for it."""
    settings = installation.settings
    airframe, params = airframe_and_params(installation)
    env, argv = px4_hand_start(
        None if settings.binary is None else Path(settings.binary).expanduser().resolve(),
        airframe=airframe,
        tick_hz=installation.tick_hz,
        params=params,
        instance=settings.instance,
    )
    return StartCommand(env | settings.env, [*argv, *settings.arguments])


def misfits(settings: AutopilotSettings) -> Sequence[Misfit]:
    """Report an airframe that the build does not have."""
    if settings.airframe is None or settings.binary is None:
        return ()
    found = airframe_problem(Path(settings.binary), settings.airframe)
    return () if found is None else (Misfit(("autopilot", "airframe"), *found),)


def vehicle_misfits(settings: AutopilotSettings, vehicle: Aircraft) -> Sequence[Misfit]:
    """Report a vehicle with more outputs than PX4 has, or wings for which the build has no controller."""
    found = []
    wing = vehicle.wing if isinstance(vehicle, Vtol) else vehicle if isinstance(vehicle, FixedWing) else None
    if wing is not None and len(wing.surfaces) > MOST_SURFACES:
        message = f"{vehicle.name!r} has {len(wing.surfaces)} control surfaces, and PX4 takes {MOST_SURFACES}"
        found.append(Misfit(("vehicle",), message, "let one surface stand for several that move together"))
    if command_count(vehicle) > _OUTPUTS:
        message = f"{vehicle.name!r} has {command_count(vehicle)} commands, and PX4 SITL has {_OUTPUTS} outputs"
        found.append(Misfit(("vehicle",), message))
    unfit = tilt_problem(vehicle) if isinstance(vehicle, Vtol) else None
    if unfit is not None:
        found.append(Misfit(("vehicle",), *unfit))
    lacking = [] if settings.binary is None else _lacking_modules(Path(os.path.expanduser(settings.binary)), vehicle)
    if lacking:
        message = f"this PX4 cannot fly {vehicle.name!r}: it was built without {', '.join(lacking)}"
        found.append(
            Misfit(("autopilot", "binary"), message, "px4_sitl_default has them, unless its board file says no")
        )
    return found


def _lacking_modules(binary: Path, vehicle: Aircraft) -> list[str]:
    """Return the modules that a vehicle needs and a build does not have: each has a link beside the program."""
    has = {path.name for path in binary.parent.glob("px4-*")}
    needs = (*_PLANE_MODULES, *_VTOL_MODULES) if isinstance(vehicle, Vtol) else _PLANE_MODULES
    if not has or not isinstance(vehicle, FixedWing | Vtol):
        return []
    return [name for name in needs if f"px4-{name}" not in has]


PROFILE = Profile(
    firmware=PX4,
    sensors=SENSORS,
    line=HIL_LINE,
    make_link=make_link,
    lockstep=True,
    keys=frozenset({"binary", "arguments", "env", "airframe", "params_file"}),
    program=Program("PX4", b"SYS_AUTOSTART", "`make px4_sitl` in PX4-Autopilot makes build/px4_sitl_default/bin/px4"),
    misfits=misfits,
    heading_wait="MIS_YAW_TMT",
    vehicle_misfits=vehicle_misfits,
    wall_clock_telemetry=True,
    airsim_type="PX4Multirotor",
    start_command=start_command,
    flies_planes=True,
    flies_vtols=True,
    vtol_kinds=frozenset({"standard", "tiltrotor", "tailsitter"}),
)
