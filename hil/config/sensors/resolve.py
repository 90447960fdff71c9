"""Resolves the section `sensors` to `SensorConfig`s: preset, keys of the file merged over it, checks."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any

from pydantic import BaseModel, Field, create_model

from firmware_bridge.autopilots.catalog import SENSOR_KINDS
from hil.config.layers import DEFAULTS, Settings
from hil.config.schema import BenchConfig, SensorConfig
from hil.config.sensors.almanac import with_almanac
from hil.config.sensors.preset_values import find_preset, is_preset_path, merge_keys
from hil.config.sensors.radar_checks import frame_problems, rate_problems
from signals.documents.document import Place
from signals.documents.validate import at, nearest, shown, validate
from signals.errors import Problem
from signals.time import period_ns_from_hz
from sim.frame.quality import QUALITIES, with_quality
from sim.sensors.catalog import KINDS, Preset
from sim.sensors.gps import GpsParameters
from sim.sensors.lidar_parameters import LidarParameters
from sim.sensors.lidar_pattern import MAX_POINTS
from sim.sensors.radar_parameters import VIEW_KEYS, RadarParameters

# Names of the bench's own ports and of topics of the recording.
_RESERVED_NAMES = frozenset(
    {"truth", "actuators", "physics", "autopilot", "recorder", "events", "mavlink", "tf", "tf_static", "clock"}
)
_OWN_KEYS = ("preset", "kind", "autopilot", "rate_hz")


@cache
def _entry_model(kind: str) -> type[BaseModel]:
    """Return the model of a sensor's entry in a file: the parameters of its kind and the keys of every sensor."""
    own: dict[str, Any] = {
        "preset": (str | None, None),
        "kind": (str | None, None),
        "autopilot": (bool | None, None),
        "rate_hz": (Annotated[float, Field(gt=0)], ...),
    }
    return create_model(f"{kind}_entry", __base__=KINDS[kind].parameters, **own)


def resolve_sensors(section: Any, settings: Settings, *, tick_hz: int) -> tuple[dict[str, SensorConfig], list[Problem]]:
    """Return the valid sensors of the section, in the order of the file, and every problem.

    A standard sensor that no file names gives way to one of the same kind with a name of its own, unless that one says
    `autopilot: false`; and its preset to a `kind` without a preset.
    """
    if not isinstance(section, dict):
        return {}, [at(settings, ("sensors",), f"must be a mapping of names to sensors, not {shown(section)}")]
    problems: list[Problem] = []
    resolved: dict[str, tuple[SensorConfig, bool | None]] = {}
    broken_kinds: set[str] = set()
    broken: set[str] = set()

    def is_standard(name: str) -> bool:
        return settings.where(("sensors", name)) == DEFAULTS

    for name, entry in section.items():
        if entry is None:  # `name: null` removes a sensor of the rig
            continue
        if isinstance(entry, dict) and "kind" in entry and settings.where(("sensors", name, "preset")) == DEFAULTS:
            entry = {key: value for key, value in entry.items() if key != "preset"}
        sensor, flag, kind = _resolve(name, entry, settings, problems, tick_hz)
        if sensor is None:
            broken_kinds.add(kind or name)
            broken.add(name)
        else:
            resolved[name] = (sensor, flag)
    own_kinds = broken_kinds | {
        sensor.kind for name, (sensor, flag) in resolved.items() if flag is not False and not is_standard(name)
    }
    resolved = {name: row for name, row in resolved.items() if not (is_standard(name) and row[0].kind in own_kinds)}
    chosen = _mark_autopilot_sensors(resolved, broken_kinds, settings, problems)
    problems += frame_problems(chosen, broken, settings)
    return chosen, problems


def sample_types(config: BenchConfig) -> dict[str, type]:
    """Return the type of the samples of each sensor, by its name."""
    return {name: KINDS[sensor.kind].sample_type for name, sensor in config.sensors.items()}


def _resolve(
    name: str, entry: Any, settings: Settings, problems: list[Problem], tick_hz: int
) -> tuple[SensorConfig | None, bool | None, str | None]:
    """Return one sensor, the value of its key `autopilot`, and its kind; None for what is unknown."""
    place: Place = ("sensors", name)
    if not name.isidentifier():
        problems.append(at(settings, place, "cannot be the name of a sensor", "use letters, digits and _"))
    elif name in _RESERVED_NAMES:
        hint = f"the bench uses this name itself; reserved names: {', '.join(sorted(_RESERVED_NAMES))}"
        problems.append(at(settings, place, "cannot be the name of a sensor", hint))
    if not isinstance(entry, dict):
        problems.append(at(settings, place, f"must be a mapping of keys, not {shown(entry)}"))
        return None, None, None
    preset, kind = _preset_and_kind(name, entry, settings, problems)
    if kind is None:
        return None, None, None
    own = {key: value for key, value in entry.items() if key not in ("preset", "kind")}
    values = preset.parameters.model_dump(mode="json") if preset is not None else {}
    if own.get("frame") is not None:  # the view of that camera replaces the view of the preset
        values = {key: value for key, value in values.items() if key not in VIEW_KEYS}
    if kind == "camera":
        values, own = _with_quality_level(values, own, settings)
    values = merge_keys(KINDS[kind].parameters, values, own)
    if kind == "imu":
        # An imu is read at every tick, so its rate may be left out.
        values.setdefault("rate_hz", tick_hz)
    checked, entry_problems = validate(_entry_model(kind), values, settings, below=place)
    problems += entry_problems
    if entry_problems or checked is None:
        return None, None, kind
    parameters = KINDS[kind].parameters.model_validate(checked.model_dump(exclude=set(_OWN_KEYS)))
    rate_hz: float = checked.rate_hz  # type: ignore[attr-defined]
    if isinstance(parameters, LidarParameters):
        points = parameters.pattern.points(period_ns_from_hz(rate_hz))
        if points > MAX_POINTS:
            message = f"gives {points} points a sweep, more than {MAX_POINTS}"
            problems.append(at(settings, (*place, "rate_hz"), message, "raise it"))
            return None, None, kind
    if isinstance(parameters, RadarParameters):
        overlaps = rate_problems(name, parameters, rate_hz, settings)
        problems += overlaps
        if overlaps:
            return None, None, kind
    if isinstance(parameters, GpsParameters):
        parameters = with_almanac(parameters, settings, place, problems)
    preset_name: str | None = entry.get("preset")
    if preset_name is not None and is_preset_path(preset_name):
        preset_name = None  # a user's file may change later; its values are in the parameters
    flag: bool | None = checked.autopilot  # type: ignore[attr-defined]
    return (
        SensorConfig(kind=kind, preset=preset_name, autopilot=False, rate_hz=rate_hz, parameters=parameters),
        flag,
        kind,
    )


def _with_quality_level(
    values: dict[str, Any], own: dict[str, Any], settings: Settings
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the preset values and own keys after applying the quality level of the camera, or else of the bench."""
    if own.get("quality") is None and settings.data.get("quality") is not None:
        own = {**own, "quality": settings.data["quality"]}
    quality = own.get("quality")
    if not isinstance(quality, str) or quality not in QUALITIES:
        return values, own  # no level, or one that validation refuses
    given = [key for key in own if key != "quality"]
    colour = {"colour": own["colour"]} if "colour" in own else {}
    merged = with_quality({**values, **colour}, quality, given)
    return {key: value for key, value in merged.items() if key not in colour}, own


def _preset_and_kind(
    name: str, entry: Mapping[str, Any], settings: Settings, problems: list[Problem]
) -> tuple[Preset | None, str | None]:
    """Return the preset and the kind of a sensor: the key `kind`, else the preset's kind, else the sensor's name."""
    place: Place = ("sensors", name)
    kind = entry.get("kind")
    preset = None
    valid = True
    if entry.get("preset") is not None:
        preset = find_preset(entry["preset"], settings, (*place, "preset"), problems)
        valid = preset is not None
    if kind is not None and (not isinstance(kind, str) or kind not in KINDS):
        problems.append(at(settings, (*place, "kind"), f"is unknown: {shown(kind)}", nearest(str(kind), KINDS)))
        valid = False
    if not valid:
        return None, None
    if preset is not None:
        if kind is not None and kind != preset.kind:
            message = f"is {kind!r}, but the preset {entry['preset']!r} is of kind {preset.kind!r}"
            problems.append(at(settings, (*place, "kind"), message))
            return None, None
        kind = preset.kind
    if kind is None:
        if name not in KINDS:
            message = "needs a preset or a kind"
            problems.append(at(settings, place, message, "kinds: " + ", ".join(KINDS)))
            return None, None
        kind = name
    return preset, kind


def _mark_autopilot_sensors(
    resolved: Mapping[str, tuple[SensorConfig, bool | None]],
    broken_kinds: set[str],
    settings: Settings,
    problems: list[Problem],
) -> dict[str, SensorConfig]:
    """Mark the sensor of each kind that feeds the flight controller.

    It is the one with `autopilot: true`, otherwise the first without `autopilot: false`.
    """
    chosen: dict[str, str] = {}
    for name, (sensor, flag) in resolved.items():
        if flag is not True:
            continue
        place: Place = ("sensors", name, "autopilot")
        if sensor.kind not in SENSOR_KINDS:
            problems.append(at(settings, place, f"cannot be true: no flight controller takes a {sensor.kind}"))
        elif sensor.kind in chosen:
            message = f"is true, but {chosen[sensor.kind]!r} already feeds the flight controller as its {sensor.kind}"
            problems.append(at(settings, place, message))
        else:
            chosen[sensor.kind] = name
    for name, (sensor, flag) in resolved.items():
        if flag is None and sensor.kind in SENSOR_KINDS:
            chosen.setdefault(sensor.kind, name)
    if "imu" not in chosen and "imu" not in broken_kinds:
        problems.append(at(settings, ("sensors",), "must hold an imu that feeds the flight controller"))
    return {
        name: sensor.model_copy(update={"autopilot": chosen.get(sensor.kind) == name})
        for name, (sensor, _) in resolved.items()
    }
