"""What is wrong with the settings of a bench although each value for itself is right."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

from firmware_bridge import _native
from firmware_bridge.mock_pixhawk.params import ParamTable
from hil.config.layers import Settings
from hil.config.schema import MOCK_AIRFRAMES, PROGRAM_KINDS, Autopilot, BenchConfig, MockFaults
from hil.signals.documents.document import Place
from hil.signals.documents.validate import COMMAND_LINE, Located, at, nearest
from hil.signals.errors import Problem
from sim.physics.faults import misfits
from sim.physics.vehicle import Vehicle
from sim.sensors.catalog import KINDS
from sim.sensors.faults import fault_problems

# Keys of the section `autopilot` that are not for every firmware, and whose they are.
_KEYS_OF_KINDS = {
    "binary": PROGRAM_KINDS | {"ardupilot_eahrs"},
    "arguments": PROGRAM_KINDS | {"ardupilot_eahrs"},
    "env": {"px4_sitl"},
    "port": {"px4_hitl", "ardupilot_eahrs"},
    "mavlink_port": {"ardupilot_sitl", "ardupilot_eahrs"},
}


def rate_problem(rate_hz: float, config: BenchConfig) -> str:
    """Why nothing can happen at this rate on the bench's tick; empty where it can."""
    if rate_hz > config.tick_hz:
        return f"must be at most the tick's rate, {config.tick_hz} Hz, not {rate_hz:g} Hz"
    if abs(rate_hz * 1000 - round(rate_hz * 1000)) > 1e-6 or rate_hz < 0.001:
        return f"must be a whole number of millihertz, not {rate_hz!r} Hz"
    return ""


def cross_checks(config: BenchConfig, settings: Settings) -> list[Problem]:
    """What is wrong although each value for itself is right."""
    problems: list[Problem] = []

    def wrong(place: Place, message: str, hint: str = "") -> None:
        problems.append(at(settings, place, message, hint))

    for name, sensor in config.sensors.items():
        place = ("sensors", name, "rate_hz")
        if sensor.rate_hz > config.tick_hz:
            wrong(place, rate_problem(sensor.rate_hz, config), "lower it or raise tick_hz")
        elif sensor.kind == "imu" and sensor.rate_hz != config.tick_hz:
            message = f"must be the tick's rate, {config.tick_hz} Hz, not {sensor.rate_hz:g} Hz"
            wrong(place, message, "an imu is read at every tick: leave rate_hz out")
        elif message := rate_problem(sensor.rate_hz, config):
            wrong(place, message)
    sample_types = {name: KINDS[sensor.kind].sample_type for name, sensor in config.sensors.items()}
    for index, key, message in fault_problems(config.faults.sensors, sample_types):
        wrong(("faults", "sensors", index, key), message)
    step_us = config.physics.step_us
    if step_us is not None and config.tick_ns % (step_us * 1000):
        message = f"must divide the tick of {config.tick_ns / 1000:g} us, and {step_us} us does not"
        wrong(("physics", "step_us"), message)
    if config.goal is not None:
        if config.mission is not None:
            wrong(("goal",), "cannot go with a mission: a flight is judged by one of them", "--set mission=null")
        if not (config.companion.on and config.companion.control):
            wrong(("goal",), "needs a companion that finds the way", "companion: {start: [explore], control: true}")
    if config.search is not None:
        if not config.companion.on:
            wrong(("search",), "needs a companion that searches", "companion: {start: [detect]}")
        camera = config.sensors.get(config.search.camera)
        if camera is None or camera.kind != "camera":
            cameras = [name for name, sensor in config.sensors.items() if sensor.kind == "camera"]
            hint = nearest(config.search.camera, cameras) or f"cameras: {', '.join(cameras) or 'none'}"
            wrong(("search", "camera"), f"is no camera of this bench: {config.search.camera!r}", hint)
    autopilot = config.autopilot
    if autopilot.transport == "loopback" and autopilot.port is not None:
        wrong(("autopilot", "port"), "has no meaning with the transport 'loopback'", "leave it out")
    if autopilot.is_mock:
        if not autopilot.start and autopilot.port is None:
            wrong(("autopilot", "start"), "is false, but no autopilot.port says where the autopilot is")
        for key in ("binary", "mavlink_port", "arguments", "env"):
            if getattr(autopilot, key):
                wrong(("autopilot", key), "has no meaning for the mock autopilot", "leave it out or choose another rig")
        if autopilot.airframe not in MOCK_AIRFRAMES:
            hint = nearest(autopilot.airframe, MOCK_AIRFRAMES)
            wrong(("autopilot", "airframe"), f"is unknown to the mock autopilot: {autopilot.airframe!r}", hint)
        problems += _param_problems(autopilot.params, settings)
    elif autopilot.faults != MockFaults():
        wrong(("autopilot", "faults"), "are the mock autopilot's", "see faults.links for faults of any wire")
    if autopilot.transport == "loopback" and autopilot.kind != "mock":
        wrong(("autopilot", "transport"), "is 'loopback', which only the mock in lockstep can", "leave it out")
    for key, kinds in _KEYS_OF_KINDS.items():
        given = getattr(autopilot, key) != Autopilot.model_fields[key].get_default(call_default_factory=True)
        if given and autopilot.kind not in kinds and not autopilot.is_mock:
            wrong(("autopilot", key), f"has no meaning for {autopilot.kind}", "leave it out or choose another rig")
    if autopilot.on_restart != "error" and autopilot.kind != "ardupilot_sitl":
        wrong(("autopilot", "on_restart"), f"has no meaning for {autopilot.kind}", "leave it out")
    if config.faults.links and autopilot.kind == "ardupilot_sitl":
        wrong(("faults", "links"), "cannot be laid on ArduPilot SITL's wires", "see faults.sensors and faults.rotors")
    if autopilot.kind in PROGRAM_KINDS:
        for key in ("params", "arguments", "env"):
            if getattr(autopilot, key) and not autopilot.start:
                message = "has no effect: the bench does not start the autopilot (autopilot.start is false)"
                wrong(("autopilot", key), message, "give it to the program that you start")
        if autopilot.start and autopilot.binary is None:
            message = "must name your own build of the firmware, which the bench starts"
            hint = "--set autopilot.binary=PATH, or --set autopilot.start=false if you start it yourself"
            wrong(("autopilot", "binary"), message, hint)
        elif autopilot.start and not Path(str(autopilot.binary)).expanduser().is_file():
            wrong(("autopilot", "binary"), f"names a program that does not exist: {autopilot.binary}")
    if autopilot.mavlink_port == "none" and config.mission is not None:
        wrong(("autopilot", "mavlink_port"), "is none, so nobody can be told to fly the mission", "--set mission=null")
    if not autopilot.lockstep and config.pace not in (None, 1.0):
        wrong(("pace",), f"must be 1 or null, not {config.pace:g}: a free-running autopilot keeps wall-clock time")
    return problems


def vehicle_checks(config: BenchConfig, vehicle: Vehicle, settings: Settings) -> list[Problem]:
    """What does not fit the vehicle that flies."""
    problems = [
        at(settings, ("faults", "rotors", index, "rotor"), message)
        for index, message in misfits(config.faults.rotors, len(vehicle.rotors))
    ]
    if config.physics.effects.battery and vehicle.battery is None:
        message = f"is true, but the vehicle {vehicle.name!r} has no battery"
        problems.append(at(settings, ("physics", "effects", "battery"), message))
    return problems


@cache
def _table() -> ParamTable:
    columns = (_native.PARAM_NAMES, _native.PARAM_DEFAULTS, _native.PARAM_MIN, _native.PARAM_MAX)
    return ParamTable(zip(*columns, strict=True), hitl=True)


def _param_problems(params: Mapping[str, float], located: Located) -> list[Problem]:
    """Every name that does not exist and every value outside its range, where it was written."""
    problems: list[Problem] = []
    for name, value in params.items():
        place = ("autopilot", "params", name)
        param = _table().find(name)
        if param is None:
            hint = nearest(name, _table().names())
            if not hint.startswith("did"):
                hint = "names are PX4's; the mock has those in firmware_bridge/mock_pixhawk/parameters.txt"
            elif located.where(place).startswith(COMMAND_LINE):
                hint = hint.replace("'", "'autopilot.params.", 1)
            problems.append(at(located, place, "is unknown to the mock autopilot", hint))
        elif (refusal := param.refusal(value)) is not None:
            problems.append(at(located, place, f"cannot be {value:g}: it is {refusal}"))
    return problems
