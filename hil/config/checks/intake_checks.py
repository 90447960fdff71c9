"""Checks that the autopilot takes what a bench gives it: its sensors, and the faults declared for them.

What each autopilot takes is data in `firmware_bridge.autopilots`.
"""

from __future__ import annotations

from typing import Any

from firmware_bridge.autopilots.catalog import PROFILES
from firmware_bridge.autopilots.firmware import Firmware
from firmware_bridge.autopilots.intake import Intake, Samples, Simulated
from firmware_bridge.codecs.sensor_rotation import named_rotation
from firmware_bridge.faults.link_fault import LinkFault
from firmware_bridge.ground_station.modes import plain_word
from hil.config.layers import Settings
from hil.config.missions.script import MissionScript, SensorFault, injected_at
from hil.config.schema import BenchConfig, SensorConfig
from hil.config.sensors.resolve import sample_types
from signals.documents.validate import at, shown
from signals.errors import Problem
from sim.frame.mount import Mount
from sim.sensors.catalog import KINDS
from sim.sensors.faults import TRANSMITTERS, acted_field, fault_problems

_NO_MAVLINK = "none"


def intake_of(config: BenchConfig, name: str) -> Intake | None:
    """Return what the autopilot takes of a sensor that feeds it; None: nothing."""
    return config.autopilot.profile.sensors.get(config.sensors[name].kind)


def untaken_sensors(config: BenchConfig) -> list[str]:
    """Describe each sensor that is there for an autopilot that takes nothing of it."""
    kind = config.autopilot.kind
    return [
        f"sensor {name}: {kind} takes no {sensor.kind}: its samples go only to the recording and to companions "
        "(with autopilot: false beside it this is not told again)"
        for name, sensor in config.sensors.items()
        if sensor.autopilot and intake_of(config, name) is None
    ]


def intake_notes(config: BenchConfig) -> list[str]:
    """Describe sensors that the autopilot does not take, or that are late for it, or that its firmware simulates."""
    notes = [*untaken_sensors(config), *_late_sensors(config)]
    simulated = simulated_sensors(config)
    if not simulated:
        return notes
    own = (
        f"{config.autopilot.kind} simulates {', '.join(simulated)} itself, with parameters of its own: settings and "
        "noise of the bench do not reach it; faults of these sensors are made by its parameters"
    )
    return [*notes, own]


def _late_sensors(config: BenchConfig) -> list[str]:
    """Describe the sensors with a latency beyond the delays that the autopilot documents."""
    notes = []
    for name, sensor in config.sensors.items():
        intake = intake_of(config, name) if sensor.autopilot else None
        delay = intake.delay if isinstance(intake, Samples) else None
        if delay is not None and _latency_ms(sensor) > delay.most_ms:
            notes.append(
                f"sensor {name}: its latency_s is {sensor.parameters.latency_s:g}, and {config.autopilot.kind} "
                f"documents {delay.names[0]} up to {delay.most_ms:g} ms"
            )
    return notes


def _latency_ms(sensor: SensorConfig) -> float:
    return round(1e3 * sensor.parameters.latency_s, 6)


def intake_parameters(config: BenchConfig) -> dict[str, float]:
    """Return the parameters that let the firmware use the sensors that feed the autopilot, and use them rightly."""
    parameters: dict[str, float] = {}
    for name, sensor in config.sensors.items():
        intake = intake_of(config, name) if sensor.autopilot else None
        if isinstance(intake, Samples):
            parameters |= intake.parameters
            if intake.direction is not None and (rotation := _rotation(sensor)) is not None:
                parameters[intake.direction] = float(rotation)
            if intake.limits is not None:
                p = sensor.parameters
                parameters |= dict(zip(intake.limits, (p.min_distance_m, p.max_distance_m), strict=True))
            if intake.delay is not None:
                parameters |= dict.fromkeys(intake.delay.names, _latency_ms(sensor))
    return parameters


def simulated_sensors(config: BenchConfig) -> list[str]:
    """Return the names of the sensors that feed the autopilot and that its firmware simulates itself."""
    fed = [name for name, sensor in config.sensors.items() if sensor.autopilot]
    return [name for name in fed if isinstance(intake_of(config, name), Simulated)]


def refusal(config: BenchConfig, fault: Any) -> tuple[str, str, str] | None:
    """Return key, message and remedy if a fault of a sensor has no effect or cannot reach the autopilot that it feeds.

    The fault must fit its sensor (`sim.sensors.faults.fault_problems`).
    """
    sensor = config.sensors[fault.sensor]
    field = acted_field(fault, KINDS[sensor.kind].sample_type)
    if field is not None and field in getattr(sensor.parameters, "unmeasured", ()):
        return "field", f"is {field!r}, which {fault.sensor!r} does not measure", "take another sensor or field"
    if fault.kind in TRANSMITTERS and sensor.parameters.sky is None:
        message = f"is {fault.kind!r}, and {fault.sensor!r} does not see the scene: its sky is open whatever is there"
        return "kind", message, f"give {fault.sensor!r} a `sky`"
    if not sensor.autopilot:
        return None  # it is for companions and the recording
    autopilot, intake = config.autopilot, intake_of(config, fault.sensor)
    key = "kind" if field is None or intake is None or not fault.field else "field"
    what = fault.kind if field is None else f"{fault.kind} of {field}"
    others = [
        kind
        for kind, profile in PROFILES.items()
        if (other := profile.sensors.get(sensor.kind)) is not None and other.takes(fault.kind, field)
    ]
    reaches = f"; this one reaches {', '.join(others)}" if others else ""
    if intake is None:
        hint = f"with autopilot: false beside {fault.sensor!r} it is for companions and the recording{reaches}"
        return "sensor", f"is {fault.sensor!r}, and {autopilot.kind} takes no {sensor.kind}", hint
    if not intake.takes(fault.kind, field):
        hint = f"{fault.sensor!r} can have here: {intake.faults()}{reaches}"
        own = f", which simulates its {sensor.kind} itself" if isinstance(intake, Simulated) else ""
        return key, f"cannot be {what}: it would not reach {autopilot.kind}{own}", hint
    source = intake.replaced.get(field or "") if isinstance(intake, Samples) else None
    instead = [name for name, present in config.sensors.items() if present.autopilot and present.kind == source]
    if instead:
        message = f"cannot be {what}: {autopilot.kind} gets the {field} of {instead[0]!r} in its place"
        return key, message, f"declare it of {instead[0]!r}"
    if isinstance(intake, Simulated) and autopilot.mavlink_port == _NO_MAVLINK:
        message = (
            f"cannot be {what}: {autopilot.kind} simulates its {sensor.kind}, so the fault is made by parameters of "
            "the firmware, and autopilot.mavlink_port is none"
        )
        return "kind", message, "give autopilot.mavlink_port an address, or let the program that speaks MAVLink set it"
    return None


def link_refusal(config: BenchConfig, fault: LinkFault) -> tuple[str, str] | None:
    """Return message and remedy if a fault of the link names a message that never travels on the line it acts on."""
    kind = config.autopilot.kind
    line = config.autopilot.profile.line
    strange = [name for name in fault.messages if line is not None and not line.carries(name, fault.direction)]
    if line is None or not strange:
        return None
    way = "" if fault.direction == "both" else f" {fault.direction.replace('_', ' the ')}"
    message = f"names {', '.join(strange)}, which the line of {kind} does not carry{way}: the fault would hit none"
    carried = {d: ", ".join(sorted(getattr(line, d))) or "no HIL message" for d in ("to_autopilot", "from_autopilot")}
    others = "; and commands, missions and telemetry in both directions" if line.others else ""
    hint = f"it carries {carried['to_autopilot']} to the autopilot, {carried['from_autopilot']} from it{others}"
    return message, hint


def intake_problems(config: BenchConfig, settings: Settings) -> list[Problem]:
    """Report directions of sensors, and declared faults of sensors and of the link, that cannot reach the autopilot."""
    problems = _direction_problems(config, settings)
    unfit = {index for index, _, _ in fault_problems(config.faults.sensors, sample_types(config))}
    if config.faults.links and config.autopilot.profile.line is None:
        message, hint = f"cannot be applied to {config.autopilot.kind}", "see faults.sensors and faults.rotors"
        problems.append(at(settings, ("faults", "links"), message, hint))
    for index, link_fault in enumerate(config.faults.links):
        if (missed := link_refusal(config, link_fault)) is not None:
            problems.append(at(settings, ("faults", "links", index, "messages"), *missed))
    for index, fault in enumerate(config.faults.sensors):
        found = None if index in unfit else refusal(config, fault)
        if found is not None:
            key, message, hint = found
            problems.append(at(settings, ("faults", "sensors", index, key), message, hint))
    return problems


def _rotation(sensor: SensorConfig) -> int | None:
    """Return the MAV_SENSOR_ROTATION of a sensor's direction; None: it has none."""
    p = sensor.parameters
    return named_rotation(Mount(p.mount_m, p.mount_rpy_deg, optical=False).axis_B)


def _direction_problems(config: BenchConfig, settings: Settings) -> list[Problem]:
    """Report sensors that look where the autopilot cannot be told."""
    problems: list[Problem] = []
    for name, sensor in config.sensors.items():
        intake = intake_of(config, name) if sensor.autopilot else None
        if not isinstance(intake, Samples) or intake.direction is None:
            continue
        if _rotation(sensor) is None:
            message = (
                f"cannot be {shown(list(sensor.parameters.mount_rpy_deg))}: {config.autopilot.kind} gets no direction "
                f"with a {sensor.kind}'s samples, and its {intake.direction} has ten: down, up, and level in steps of "
                "45 degrees"
            )
            hint = f"with autopilot: false beside {name!r} it may look anywhere, for companions and the recording"
            problems.append(at(settings, ("sensors", name, "mount_rpy_deg"), message, hint))
    return problems


def script_intake_problems(config: BenchConfig, script: MissionScript, firmware: Firmware) -> list[Problem]:
    """Report required modes and parameters that the autopilot does not have, and faults that cannot reach it."""
    types = sample_types(config)
    problems: list[Problem] = []
    profile = config.autopilot.profile
    for place, value in script.required_params.items():
        asked = config.autopilot.model_copy(update={"params": {str(place[-1]): value}})
        for misfit in profile.misfits(asked):
            if misfit.place[:-1] == ("autopilot", "params"):
                problems.append(at(script.document, place, misfit.message, misfit.hint))
    for index, spec in enumerate(script.script.actions):
        for key, word in spec.modes.items():
            if spec.required and plain_word(word) not in firmware.modes:
                problems.append(at(script.document, ("actions", index, key), *_no_mode(firmware, word)))
        fault = None if spec.fault is None or spec.in_settings else injected_at(spec, 0.0)
        if not isinstance(fault, SensorFault) or any(fault_problems([fault], types)):
            continue
        found = refusal(config, fault)
        if found is not None:
            key, message, hint = found
            problems.append(at(script.document, ("actions", index, "fault", key), message, hint))
    return problems


def _no_mode(firmware: Firmware, word: str) -> tuple[str, str]:
    hint = f"it has {', '.join(firmware.modes)}; with required: false the action is left out there"
    return f"names the mode {word}, which {firmware.name} does not have", hint
