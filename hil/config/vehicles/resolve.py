"""A bench with the section `vehicles`: one complete bench for each vehicle, all in one world."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

from hil.config.bench import Bench
from hil.config.formation import formation_offsets
from hil.config.group_schema import Group
from hil.config.layers import SettingsPart, parse_setting
from hil.config.loading import BenchLoading
from hil.config.schema import VEHICLE_NAME, BenchConfig, Companion
from hil.config.vehicles.checks import SHARED_KEYS, vehicles_problems
from signals.documents.document import Place
from signals.documents.validate import COMMAND_LINE, at, nearest, shown
from signals.errors import ConfigError, Problem
from signals.samples import Vec3

# Keys that one vehicle may have; all others belong to the world, or to all vehicles together.
VEHICLE_KEYS = frozenset({
    "rig", "description", "vehicle", "mission", "mission_offset_m", "start", "autopilot", "router", "companion",
    "sensors", "quality", "faults", "limits", "plane_limits", "vtol_limits", "crash", "goal", "search", "manual",
    "parts", "ros2", "follow",
})  # fmt: skip
_WORLD_KEYS = ("map_seed", "weather", "randomize")  # like the scene, which is compared by its file
# Ports that differ by the vehicle's number, unless it sets its own. PX4 numbers the ports of SDKs so.
_PORTS: dict[tuple[str, str], Any] = {("router", "sdk"): None, ("companion", "port"): Companion().port}
# Folders of OUT that do not belong to a vehicle: the copied map, the fresh run of `hil replay`, and others.
_RESERVED_NAMES = frozenset({"autopilot", "calibration", "replay", "scene_map"})
_MAX_VEHICLES = 100
_NUMBER = "{n}"  # in a name: stands for 1 to `count`


def with_vehicles(bench: Bench, loading: BenchLoading, *, flown: bool = True) -> Bench:
    """Return the bench with the benches of its vehicles. Raises ConfigError with every problem found."""
    problems: list[Problem] = []
    places = _places(bench.config, loading, problems)
    if problems:
        raise ConfigError(problems)
    formation = bench.config.formation
    offsets = {} if formation is None else formation_offsets(formation, list(places))
    for name in () if formation is None else formation.offsets_m:
        where: Place = ("formation", "offsets_m", name)
        if name not in places:
            problems.append(at(loading.settings, where, "is not a vehicle of this bench"))
        elif name == next(iter(places)) and any(offsets[name]):
            message = "must be [0, 0, 0]: the places of a formation are relative to its first vehicle"
            problems.append(at(loading.settings, where, message))
    vehicles: dict[str, Bench] = {}
    for number, (name, place) in enumerate(places.items()):
        try:
            vehicles[name] = _vehicle(bench, loading, name, place, number, offsets.get(name), flown=flown)
        except ConfigError as error:
            problems += error.problems
    if not problems:
        located = {name: SettingsPart(loading.settings, places[name]) for name in places}
        problems = vehicles_problems(vehicles, located, flown=flown)
    if problems:
        raise ConfigError(list({str(problem): problem for problem in problems}.values()))
    return replace(bench, vehicles=vehicles)


def _places(config: BenchConfig, loading: BenchLoading, problems: list[Problem]) -> dict[str, Place]:
    """Return the place of the settings of each vehicle by its name, in the order of the file."""
    settings = loading.settings
    written = [key for key in config.vehicles if not settings.where(("vehicles", key)).startswith(COMMAND_LINE)]
    places: dict[str, Place] = {}
    for key, overlay in config.vehicles.items():
        place: Place = ("vehicles", key)
        if settings.where(place).startswith(COMMAND_LINE) and isinstance(overlay, dict):
            problems.append(at(settings, place, "is not a vehicle of this bench", nearest(key, written)))
            continue
        names = [key]
        if _NUMBER in key:
            if config.count is None:
                problems.append(at(settings, place, "stands for several vehicles, and `count` is not set", "count: 10"))
                continue
            names = [key.replace(_NUMBER, str(n)) for n in range(1, config.count + 1)]
        # The last name is the longest.
        if not re.fullmatch(VEHICLE_NAME, names[-1]):
            message = "cannot be the name of a vehicle: a letter from a to z, then up to 31 of a-z, 0-9 and _"
            problems.append(at(settings, place, message, "drone{n} stands for `count` vehicles"))
            continue
        if key in _RESERVED_NAMES:
            message = f"cannot be the name of a vehicle: OUT/{key} is another folder of a run"
            problems.append(at(settings, place, message, "give the vehicle another name"))
        if isinstance(overlay, dict):
            for own in overlay:
                if own in BenchConfig.model_fields and own not in VEHICLE_KEYS:
                    message = "belongs to the whole bench, not to one vehicle"
                    problems.append(at(settings, (*place, own), message, f"write {own} at the top of the file"))
        elif overlay is not None and not isinstance(overlay, str):
            message = f"must be a mapping of keys or the path of a bench file, not {shown(overlay)}"
            problems.append(at(settings, place, message))
        for name in names:
            if name in places:
                problems.append(at(settings, place, f"names the vehicle {name!r} a second time"))
            places[name] = place
    if config.count is not None and not any(_NUMBER in key for key in config.vehicles):
        problems.append(at(settings, ("count",), "has no meaning: no name of a vehicle contains {n}", "leave it out"))
    if len(places) > _MAX_VEHICLES:
        place = ("vehicles",) if config.count is None else ("count",)
        message = f"gives the bench {len(places)} vehicles, and it can have {_MAX_VEHICLES}"
        problems.append(at(settings, place, message, "each has an autopilot.instance from 0 to 99"))
    return places


def _vehicle(
    bench: Bench, loading: BenchLoading, name: str, place: Place, number: int, offset_W_m: Vec3 | None, *, flown: bool
) -> Bench:
    """Load the bench of one vehicle. Raises ConfigError."""
    overlay = SettingsPart(loading.settings, place)
    file = bench.config.vehicles[str(place[1])]
    if isinstance(file, str):
        return _from_file(bench, loading, name, place, file, flown=flown)
    loaded = BenchLoading(loading.path, loading.options, _general(loading), overlay=overlay, scene=bench.scene)
    settings = loaded.settings
    for key in ("count", "formation"):
        settings.data.pop(key, None)
    _set_default(loaded, overlay, ("autopilot", "instance"), number)
    _merge_own_options(loaded, loading, place)
    if offset_W_m is not None:
        x, y, z = bench.config.start.p_W
        _set_default(loaded, overlay, ("start",), {
            "p_W": [x + offset_W_m[0], y + offset_W_m[1], z], "yaw_deg": bench.config.start.yaw_deg
        })  # fmt: skip
        if "mission" not in overlay.data:
            _set_default(loaded, overlay, ("mission_offset_m",), list(offset_W_m))
    for port, default in _PORTS.items():
        section = settings.data.get(port[0])
        if isinstance(section, dict) and not overlay.covers(port):
            settings.set(port, _raised(section.get(port[1], default), number), settings.where(port))
    settings.set(("name",), name, settings.where(()))
    vehicle = loaded.bench(flown=flown)
    if differing := _other_world(vehicle, loaded, bench, loading):
        message = f"belongs to the whole bench, and {name} sets it to another value"
        raise ConfigError([at(settings, (key,), message, "write it at the top of the bench file") for key in differing])
    return vehicle


def _other_world(vehicle: Bench, loaded: BenchLoading, bench: Bench, loading: BenchLoading) -> list[str]:
    """Return the settings of the world that a vehicle's own files set to another value than the bench."""
    stated = [key for key in _WORLD_KEYS if key in loaded.settings.data]
    differing = [key for key in stated if getattr(vehicle.config, key) != getattr(bench.config, key)]
    is_option = loading.settings.where(("scene",)).startswith(COMMAND_LINE)  # for all vehicles
    if "scene" in loaded.settings.data and not is_option:
        differing += ["scene"] * (loaded.files["scene"].resolve() != loading.files["scene"].resolve())
    return differing


def _general(loading: BenchLoading) -> list[str]:
    """Return the texts of `--set` that concern every vehicle."""
    return [text for text in loading.texts if not text.strip().startswith(("vehicles.", "count=", "formation."))]


def _merge_own_options(loaded: BenchLoading, loading: BenchLoading, place: Place) -> None:
    """Merge the texts of `--set vehicles.NAME.KEY=VALUE` over all other settings of a vehicle."""
    for text in loading.texts:
        if text.strip().startswith(f"vehicles.{place[1]}."):
            own_place, value, origin = parse_setting(text)
            loaded.settings.set(own_place[2:], value, origin)


def _set_default(loaded: BenchLoading, overlay: SettingsPart, place: Place, value: Any) -> None:
    """Set a value that the vehicle's own settings do not set."""
    section = loaded.settings.data.get(str(place[0]), {})
    is_invalid = len(place) > 1 and not isinstance(section, dict)  # reported when it is validated
    if not overlay.covers(place) and not is_invalid:
        loaded.settings.set(place, value, overlay.where(()))


def _raised(address: Any, number: int) -> Any:
    """Return the address or port, raised by the vehicle's number; port 0 and null stay."""
    head, colon, port = str(address).rpartition(":")
    if not port.isdigit() or not int(port):
        return address
    return f"{head}:{int(port) + number}" if colon else int(port) + number


def _from_file(bench: Bench, loading: BenchLoading, name: str, place: Place, file: str, *, flown: bool) -> Bench:
    """Load the bench of a vehicle from a file of its own, as in the folder of a run."""
    path = next((folder / file for folder in (*loading.beside, Path()) if os.path.isfile(folder / file)), None)
    if path is None:
        raise ConfigError([at(loading.settings, place, f"names a file that does not exist: {file}")])
    loaded = BenchLoading(path, {}, _general(loading), scene=bench.scene)
    _merge_own_options(loaded, loading, place)
    loaded.settings.set(("name",), name, loading.settings.where(place))
    vehicle = loaded.bench(flown=flown)
    if vehicle.config.vehicles:
        raise ConfigError([at(loading.settings, place, f"names a file with several vehicles: {path}")])
    differing = [key for key in SHARED_KEYS if getattr(vehicle.config, key) != getattr(bench.config, key)]
    differing += _other_world(vehicle, loaded, bench, loading)
    if differing:
        message = f"differs from the bench in {', '.join(differing)}: {path}"
        raise ConfigError([at(loading.settings, place, message, "all vehicles of a run share these settings")])
    return vehicle


def lone_vehicle_problems(bench: Bench, loading: BenchLoading) -> list[Problem]:
    """Report settings of a bench with one vehicle that have a meaning only for several."""
    config, hint = bench.config, "add the section `vehicles`, or leave it out"
    given: list[tuple[Place, bool]] = [
        (("count",), config.count is not None),
        (("formation",), config.formation is not None),
        (("group",), config.group != Group() and not config.name),
        (("autopilot", "on_loss"), config.autopilot.on_loss != "error" and not config.name),
    ]
    message = "has no meaning for one vehicle"
    return [at(loading.settings, place, message, hint) for place, is_given in given if is_given]
