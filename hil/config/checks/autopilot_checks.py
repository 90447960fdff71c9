"""Checks that the keys and values of the section `autopilot` fit its kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

from firmware_bridge.autopilots.catalog import PROFILES
from firmware_bridge.links.px4.sitl import airframe_problem
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from hil.config.checks.program_checks import program_problem
from hil.config.merge.layers import Settings
from hil.config.schema import MOCK_AIRFRAMES, PROGRAM_KINDS, Autopilot, BenchConfig, MockFaults
from signals.documents.document import Place
from signals.documents.validate import COMMAND_LINE, Located, at, nearest
from signals.errors import Problem

# Key of the section `autopilot` -> kinds of real firmware that have it.
_KEYS_OF_KINDS = {
    "binary": PROGRAM_KINDS | {"ardupilot_eahrs"},
    "arguments": PROGRAM_KINDS | {"ardupilot_eahrs"},
    "env": {"px4_sitl"},
    "port": {"px4_hitl", "ardupilot_eahrs"},
    "mavlink_port": {"ardupilot_sitl", "ardupilot_eahrs"},
    "airframe": {"px4_sitl", "px4_hitl"},
}
# How to make the program that each kind starts.
_PROGRAM_MAKES = {
    "px4_sitl": "`make px4_sitl` in PX4-Autopilot makes build/px4_sitl_default/bin/px4",
    "ardupilot_sitl": "`./waf configure --board sitl && ./waf copter` in ardupilot makes build/sitl/bin/arducopter",
}
# Kind whose builds come with a list of their airframes -> what is wrong with a name or number, and what to do.
_AIRFRAME_CHECKS: dict[str, Callable[[Path, str], tuple[str, str] | None]] = {"px4_sitl": airframe_problem}
# Kinds of boards, which report only the number of their airframe.
_AIRFRAME_NUMBERS = frozenset({"px4_hitl"})
_PROGRAM_MAKES["ardupilot_eahrs"] = _PROGRAM_MAKES["ardupilot_sitl"]


def autopilot_problems(config: BenchConfig, settings: Settings) -> list[Problem]:
    """Report settings that do not fit the chosen autopilot."""
    problems: list[Problem] = []

    def report(key: str, message: str, hint: str = "") -> None:
        problems.append(at(settings, ("autopilot", key), message, hint))

    autopilot = config.autopilot
    if autopilot.transport == "loopback" and autopilot.port is not None:
        report("port", "has no meaning with the transport 'loopback'", "leave it out")
    if autopilot.is_mock:
        if not autopilot.start and autopilot.port is None:
            report("start", "is false, but autopilot.port is not set")
        for key in ("binary", "mavlink_port", "arguments", "env"):
            if getattr(autopilot, key):
                report(key, "has no meaning for the mock autopilot", "leave it out or choose another rig")
        if autopilot.airframe is not None and autopilot.airframe not in MOCK_AIRFRAMES:
            hint = nearest(autopilot.airframe, MOCK_AIRFRAMES)
            report("airframe", f"is unknown to the mock autopilot: {autopilot.airframe!r}", hint)
        params = autopilot.params.items()
        problems += mock_param_problems({("autopilot", "params", name): value for name, value in params}, settings)
    problems += _own_fault_problems(autopilot, settings)
    if autopilot.transport == "loopback" and autopilot.kind != "mock":
        report("transport", "is 'loopback', which only the mock in lockstep can", "leave it out")
    for key, kinds in _KEYS_OF_KINDS.items():
        given = getattr(autopilot, key) != Autopilot.model_fields[key].get_default(call_default_factory=True)
        if given and autopilot.kind not in kinds and not autopilot.is_mock:
            report(key, f"has no meaning for {autopilot.kind}", "leave it out or choose another rig")
    if autopilot.on_restart != "error" and autopilot.kind != "ardupilot_sitl":
        report("on_restart", f"has no meaning for {autopilot.kind}", "leave it out")
    if autopilot.kind in PROGRAM_KINDS:
        for key in ("params", "arguments", "env"):
            if getattr(autopilot, key) and not autopilot.start:
                message = "has no effect: the bench does not start the autopilot (autopilot.start is false)"
                report(key, message, "give it to the program that you start")
        if autopilot.start and autopilot.binary is None:
            message = "must name your own build of the firmware, which the bench starts"
            hint = "--set autopilot.binary=PATH, or --set autopilot.start=false if you start it yourself"
            report("binary", message, hint)
    if autopilot.binary is not None and autopilot.start and autopilot.kind in _PROGRAM_MAKES:
        problem = program_problem(Path(str(autopilot.binary)).expanduser(), autopilot.kind)
        if problem is not None:
            report("binary", problem, _PROGRAM_MAKES[autopilot.kind])
    if autopilot.airframe is not None:
        check = _AIRFRAME_CHECKS.get(autopilot.kind)
        if (
            check is not None
            and autopilot.binary is not None
            and (found := check(Path(autopilot.binary), autopilot.airframe))
        ):
            report("airframe", *found)
        if autopilot.kind in _AIRFRAME_NUMBERS and not autopilot.airframe.isdigit():
            message = f"must be a number, not {autopilot.airframe!r}: it is compared with the board's SYS_AUTOSTART"
            report("airframe", message, "choose the airframe in the ground station")
    if autopilot.mavlink_port == "none" and config.mission is not None:
        report("mavlink_port", "is none, so the mission cannot be uploaded", "--set mission=null")
    return problems


def _own_fault_problems(autopilot: Autopilot, located: Located) -> list[Problem]:
    """Report faults of the autopilot itself that would have no effect."""
    able = PROFILES[autopilot.kind].own_faults
    asked = [name for name in MockFaults.model_fields if getattr(autopilot.faults, name) is not None]
    if asked and not able:
        hint = "see faults.links for faults of any link"
        return [at(located, ("autopilot", "faults"), "are only for the mock autopilot", hint)]
    if asked and autopilot.port is not None:
        message = f"have no effect: the bench does not start the mock on {autopilot.port}, which gets them at its start"
        return [at(located, ("autopilot", "faults"), message, "start it with --fault KIND@SECONDS, or leave port out")]
    message, hint = f"has no effect on {autopilot.kind}", f"it has {', '.join(able)}"
    return [at(located, ("autopilot", "faults", name), message, hint) for name in asked if name not in able]


@cache
def _table() -> ParamTable:
    return ParamTable.of_firmware(hitl=True)


def mock_param_problems(params: Mapping[Place, float], located: Located) -> list[Problem]:
    """Report parameters, by their place, that the mock autopilot does not have or whose values are out of range."""
    problems: list[Problem] = []
    for place, value in params.items():
        name = str(place[-1])
        param = _table().find(name)
        if param is None:
            hint = nearest(name, _table().names())
            if not hint.startswith("did"):
                hint = "names are PX4's; the mock has those in firmware_bridge/mock_pixhawk/parameters/parameters.txt"
            elif located.where(place).startswith(COMMAND_LINE):
                hint = hint.replace("'", "'autopilot.params.", 1)
            problems.append(at(located, place, "is unknown to the mock autopilot", hint))
        elif (refusal := param.refusal(value)) is not None:
            problems.append(at(located, place, f"cannot be {value:g}: it is {refusal}"))
    return problems
