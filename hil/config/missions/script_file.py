"""Reads mission scripts (.yaml) and merges their faults and limits over the settings of the bench.

Every problem is reported at once with its line in the script, also where a
script does not fit the bench, such as a sensor or rotor that does not exist.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from hil.config.layers import Settings
from hil.config.missions.mission import Mission
from hil.config.missions.script import (
    AUTOPILOT_FAULTS,
    SENSOR_FAULTS,
    MissionScript,
    Script,
    fault_at,
    fault_model,
    injected_at,
    parse_event,
)
from signals.documents.document import Place, shown_path
from signals.documents.validate import COMMAND_LINE, at, nearest, validate
from signals.documents.yaml_lines import read_yaml
from signals.errors import ConfigError, Problem
from sim.physics.faults import RotorFault, misfits
from sim.physics.surface_faults import SurfaceFault, surface_misfits
from sim.physics.vehicle import Vehicle
from sim.scene.wind import Wind
from sim.sensors.faults import fault_problems

SUFFIXES = (".yaml", ".yml")
PLAN_SUFFIXES = (".plan", ".waypoints")
_TARGETS = ("rotor", "surface", "sensor", "link", "autopilot")


def is_script(path: Path) -> bool:
    """Return True if a mission is a script by its suffix."""
    return path.suffix.lower() in SUFFIXES


def read_script(path: Path) -> MissionScript:
    """Read and check a script. Raises ConfigError with every problem found."""
    document = read_yaml(path)
    script, problems = validate(Script, document.data, document)
    # Checked in the raw data, so that an invalid action does not hide the problems of the others.
    entries = document.data.get("actions") if isinstance(document.data, dict) else None
    for index, entry in enumerate(entries if isinstance(entries, list) else ()):
        if isinstance(entry, dict) and isinstance(entry.get("fault"), dict):
            place: Place = ("actions", index, "fault")
            problems += _fault_problems(entry["fault"], document, place, timed=entry.get("at_s") is not None)
    if script is None:
        raise ConfigError(problems)
    plan_path: Path | None = None
    if script.plan is not None:
        plan_path = _find_plan(path, script.plan)
        if plan_path is None:
            hint = f"looked beside {shown_path(path)}"
            problems.append(at(document, ("plan",), f"names a file that does not exist: {script.plan}", hint))
        elif plan_path.suffix.lower() not in PLAN_SUFFIXES:
            problems.append(at(document, ("plan",), f"must be a {' or '.join(PLAN_SUFFIXES)} file, not {script.plan}"))
    elif not script.actions and not problems:
        problems.append(Problem(document.where(()), "has neither a plan nor actions"))
    if script.outcome == "crashed":
        judged = [name for name, limit in script.limits.items() if limit is not None]
        hint = "leave it out; write measurements of the fall under expect"
        problems += [at(document, ("limits", name), "is not judged with outcome: crashed", hint) for name in judged]
    if problems:
        raise ConfigError(problems)
    return MissionScript(path, script, plan_path, document)


def _find_plan(script: Path, name: str) -> Path | None:
    """Find the plan relative to the script, or by its name beside the script, as in the folder of a run."""
    for candidate in (script.parent / name, script.parent / Path(name).name):
        if os.path.isfile(candidate):
            return candidate
    return None


def _fault_problems(fault: Mapping[str, Any], document: Any, place: Place, *, timed: bool) -> Iterator[Problem]:
    targets = [key for key in _TARGETS if key in fault]
    if len(targets) != 1:
        known = "rotor, surface, sensor, link or autopilot"
        yield at(document, place, f"must name exactly one {known}, it names {' and '.join(targets) or 'none'}")
        return
    target = targets[0]
    if target in ("link", "autopilot"):
        if not timed:
            yield at(document, place, f"of the {target} needs at_s: it cannot wait for an event")
        if target == "autopilot":
            if fault["autopilot"] not in AUTOPILOT_FAULTS:
                yield at(document, (*place, target), "is unknown", nearest(str(fault[target]), AUTOPILOT_FAULTS))
            yield from (at(document, (*place, key), "unknown key") for key in fault if key != target)
        elif not isinstance(fault["link"], dict):
            yield at(document, (*place, target), "must be a mapping of keys")
        return
    for key in ("at_s", "until_s"):
        if key in fault:
            yield at(document, (*place, key), "does not belong here", "write at_s beside fault, and for_s inside it")
            return
    model: Any = fault_model(fault)
    if target == "sensor":
        kind = fault.get("kind")
        model = SENSOR_FAULTS.get(kind) if isinstance(kind, str) else None
        if model is None:
            hint = nearest(str(kind), SENSOR_FAULTS)
            yield at(document, (*place, "kind"), f"is unknown: {kind!r}" if "kind" in fault else "is missing", hint)
            return
        if "for_s" in fault and not (type(fault["for_s"]) in (int, float) and fault["for_s"] > 0):
            yield at(document, (*place, "for_s"), f"must be above 0 s, not {fault['for_s']!r}")
            return
    _, problems = validate(model, fault_at(fault, 0.0), document, below=place)
    yield from problems


def mission_problems(script: MissionScript, mission: Mission | None) -> list[Problem]:
    """Report actions that wait for a waypoint or item that the plan does not have."""
    problems: list[Problem] = []
    for index, spec in enumerate(script.script.actions):
        event = None if spec.after is None else parse_event(spec.after)
        if event is None or event.kind not in ("waypoint", "item"):
            continue
        place: Place = ("actions", index, "after")
        if mission is None:
            if script.script.plan is None:  # else the problems of the plan are reported
                problems.append(at(script.document, place, f"waits for {spec.after}, but the script has no plan"))
        elif event.kind == "waypoint" and event.number > len(mission.waypoints):
            message = f"waits for {spec.after}, but the plan has {len(mission.waypoints)}"
            problems.append(at(script.document, place, message, "take-off and landing are not waypoints"))
        elif event.kind == "item" and event.number >= len(mission.items):
            message = f"waits for {spec.after}, but the plan has items 0 to {len(mission.items) - 1}"
            problems.append(at(script.document, place, message))
    return problems


def bench_problems(script: MissionScript, *, sensors: Mapping[str, type], vehicle: Vehicle) -> list[Problem]:
    """Report faults that wait for an event and do not fit the bench. `sensors`: name -> sample type."""
    problems: list[Problem] = []
    for index, spec in enumerate(script.script.actions):
        if spec.fault is None or spec.in_settings:
            continue
        place: Place = ("actions", index, "fault")
        fault: Any = injected_at(spec, 0.0)
        if isinstance(fault, RotorFault):
            misfitting = [(key, message) for _, key, message in misfits([fault], vehicle)]
        elif isinstance(fault, SurfaceFault):
            misfitting = [(key, message) for _, key, message in surface_misfits([fault], vehicle)]
        else:
            misfitting = [(key, message) for _, key, message in fault_problems([fault], sensors)]
        problems += [at(script.document, (*place, key), message) for key, message in misfitting]
    return problems


def merge_script(settings: Settings, script: MissionScript) -> None:
    """Merge limits and timed faults over the settings. Limits set on the command line take precedence."""
    where = script.document.where
    for key, value in script.script.limits.items():
        place: Place = ("limits", key)
        if not settings.where(place).startswith(COMMAND_LINE):
            settings.set(place, value, where(place))
    if script.script.failsafe is not None and not settings.where(("failsafe",)).startswith(COMMAND_LINE):
        settings.set(("failsafe",), script.script.failsafe, where(("failsafe",)))
    for index, spec in enumerate(script.script.actions):
        if spec.fault is None or spec.at_s is None:
            continue
        origin = where(("actions", index, "fault"))
        if "autopilot" in spec.fault:
            settings.set(("autopilot", "faults", f"{spec.fault['autopilot']}_at_s"), spec.at_s, origin)
        elif "link" in spec.fault:
            _append(settings, ("faults", "links"), {**spec.fault["link"], "at_s": spec.at_s}, origin)
        else:
            section = next(f"{target}s" for target in ("sensor", "surface", "rotor") if target in spec.fault)
            _append(settings, ("faults", section), fault_at(spec.fault, spec.at_s), origin)


def _append(settings: Settings, place: tuple[str, str], entry: dict[str, Any], origin: str) -> None:
    """Append an entry to a list of the settings and keep the origins of the others."""
    section = settings.data.get(place[0])
    present = section.get(place[1]) if isinstance(section, dict) else None
    if (section is not None and not isinstance(section, dict)) or (
        present is not None and not isinstance(present, list)
    ):
        return  # a mistake in the bench file, which validation reports
    origins = {p: o for p, o in settings.origins.items() if p[: len(place)] == place}
    index = len(present or ())
    settings.set(place, [*(present or ()), entry], origin)
    settings.origins.update(origins)
    settings.origins[(*place, index)] = origin


def with_gusts(wind: Wind | None, steady_W_mps: tuple[float, float, float], script: MissionScript) -> Wind | None:
    """Return the wind of the bench, or else the steady wind of the scene [m/s], with the timed gusts of the script."""
    timed = [spec for spec in script.script.actions if spec.gust is not None and spec.at_s is not None]
    if not timed:
        return wind
    base = wind if wind is not None else Wind(steady_W_mps=steady_W_mps)
    gusts = tuple(spec.gust.event(spec.at_s) for spec in timed if spec.gust is not None and spec.at_s is not None)
    return base.model_copy(update={"gusts": (*base.gusts, *gusts)})
