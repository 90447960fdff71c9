"""Checks that the keys and values of the section `autopilot` fit its kind."""

from __future__ import annotations

import os
from pathlib import Path

from firmware_bridge.autopilots.catalog import PROFILES
from firmware_bridge.autopilots.firmware import Firmware
from hil.config.checks.program_checks import program_problem
from hil.config.layers import Settings
from hil.config.schema import Autopilot, BenchConfig
from signals.documents.validate import COMMAND_LINE, at
from signals.errors import Problem

# Keys of the section that only some kinds have.
_KEYS_OF_KINDS = sorted(frozenset().union(*(profile.keys for profile in PROFILES.values())))
_HINTS = {"faults": "see faults.links for faults of any link"}


def autopilot_problems(config: BenchConfig, settings: Settings) -> list[Problem]:
    """Report settings that do not fit the chosen autopilot."""
    problems: list[Problem] = []

    def report(key: str, message: str, hint: str = "") -> None:
        problems.append(at(settings, ("autopilot", key), message, hint))

    autopilot = config.autopilot
    profile = autopilot.profile
    for key in _KEYS_OF_KINDS:
        given = getattr(autopilot, key) != Autopilot.model_fields[key].get_default(call_default_factory=True)
        if given and key not in profile.keys:
            hint = _HINTS.get(key, "leave it out or choose another rig")
            report(key, f"has no meaning for {autopilot.kind}", hint)
    if autopilot.transport == "loopback" and autopilot.port is not None:
        report("port", "has no meaning with the transport 'loopback'", "leave it out")
    if profile.is_program:
        for key in ("params", "params_of_file", "arguments", "env"):
            if getattr(autopilot, key) and not autopilot.start:
                message = "has no effect: the bench does not start the autopilot (autopilot.start is false)"
                report(key, message, "give it to the program that you start")
        if autopilot.start and autopilot.binary is None:
            message = "must name your own build of the firmware, which the bench starts"
            hint = "--set autopilot.binary=PATH, or --set autopilot.start=false if you start it yourself"
            report("binary", message, hint)
    for place, message, hint in profile.misfits(autopilot):
        if place[:-1] == ("autopilot", "params") and settings.where(place).startswith(COMMAND_LINE):
            hint = hint.replace("did you mean '", "did you mean 'autopilot.params.", 1)
        problems.append(at(settings, place, message, hint))
    if autopilot.mavlink_port == "none" and config.mission is not None:
        report("mavlink_port", "is none, so the mission cannot be uploaded", "--set mission=null")
    return problems + _own_fault_problems(config, settings) + _mavlink_problems(config, settings)


def build_problems(config: BenchConfig, settings: Settings, *, winged: bool) -> list[Problem]:
    """Report an `autopilot.binary` that is not the program which flies a vehicle with wings, or without."""
    autopilot = config.autopilot
    program, other = (autopilot.profile.program_for(winged=wings) for wings in (winged, not winged))
    if autopilot.binary is None or not autopilot.start or program is None:
        return []
    problem = program_problem(Path(os.path.expanduser(autopilot.binary)), program, other if other != program else None)
    return [] if problem is None else [at(settings, ("autopilot", "binary"), problem, program.makes)]


def set_point_problems(config: BenchConfig, firmware: Firmware, settings: Settings) -> list[Problem]:
    """Report pilots that fly by set-points, which the firmware does not take on this vehicle."""
    if firmware.project is not None or not config.autopilot.profile.mavlink:
        return []
    pilots = {
        ("companion", "control"): config.companion.flies,
        ("ros2", "control"): config.ros2.flies,
        ("follow", "log"): config.follow.flies,
    }
    message = f"flies by set-points, which {firmware.program or firmware.name} does not take"
    hint = "leave it out, or choose another rig"
    return [at(settings, place, message, hint) for place, flies in pilots.items() if flies]


def _mavlink_problems(config: BenchConfig, settings: Settings) -> list[Problem]:
    """Report settings that need MAVLink, which some kinds do not speak."""
    autopilot = config.autopilot
    needs = {
        ("mission",): config.mission is not None,
        ("companion", "control"): config.companion.flies,
        ("ros2", "control"): config.ros2.flies,
        ("follow", "log"): config.follow.flies,
        ("manual", "device"): config.manual.device is not None,
        ("autopilot", "params"): bool(autopilot.params),
    }
    message = f"needs MAVLink, which {autopilot.kind} does not speak"
    found = [place for place, needed in needs.items() if needed and not autopilot.profile.mavlink]
    return [at(settings, place, message, "leave it out or choose another rig") for place in found]


def _own_fault_problems(config: BenchConfig, settings: Settings) -> list[Problem]:
    """Report faults of the autopilot itself that would have no effect. A kind without any does not have the key."""
    autopilot = config.autopilot
    able = autopilot.profile.own_faults
    asked = [name for name in type(autopilot.faults).model_fields if getattr(autopilot.faults, name) is not None]
    if not asked or not able:
        return []
    if autopilot.port is not None:
        message = f"have no effect: the bench does not start the mock on {autopilot.port}, which gets them at its start"
        return [at(settings, ("autopilot", "faults"), message, "start it with --fault KIND@SECONDS, or leave port out")]
    message, hint = f"has no effect on {autopilot.kind}", f"it has {', '.join(able)}"
    return [at(settings, ("autopilot", "faults", name), message, hint) for name in asked if name not in able]
