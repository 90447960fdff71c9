"""Presets of sensors, and the keys of a bench file merged over them.

A bench names an installed preset, or the path of a file of the same form (`sim.sensors.presets`) relative to
the file that names it. A section of a preset, such as a radar's `chirp`, is merged key by key. A list, and a section
that has several possible models, is replaced whole.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel

from hil.config.layers import Settings
from signals.documents.document import Place, shown_path
from signals.documents.validate import COMMAND_LINE, at, nearest, shown
from signals.errors import ConfigError, Problem
from sim.sensors.catalog import PRESETS, Preset
from sim.sensors.presets import load_preset

_SUFFIXES = (".yaml", ".yml")


def is_preset_path(name: str) -> bool:
    """Return True if `name` means a file and not an installed preset."""
    return "/" in name or "\\" in name or name.endswith(_SUFFIXES)


def find_preset(value: Any, settings: Settings, place: Place, problems: list[Problem]) -> Preset | None:
    """Return the preset that the setting at `place` names. Returns None and appends to `problems` if there is none."""
    if isinstance(value, str) and is_preset_path(value):
        return _read(value, settings, place, problems)
    if not isinstance(value, str) or value not in PRESETS:
        problems.append(at(settings, place, f"is unknown: {shown(value)}", nearest(str(value), PRESETS)))
        return None
    return PRESETS[value]


def named_file(name: str, settings: Settings, place: Place, problems: list[Problem]) -> Path | None:
    """Return the file that a setting names, relative to the file of the setting; None, with a problem, without one."""
    origin = settings.where(place)
    folder = Path()
    if not origin.startswith(COMMAND_LINE):
        source, _, line = origin.rpartition(":")
        folder = Path(source if line.isdigit() else origin).parent
    try:
        path = folder / Path(name).expanduser()
        exists = path.is_file()
    except (OSError, RuntimeError, ValueError):  # too long, '~name' without such a user, or a zero byte
        exists = False
    if not exists:
        hint = f"looked in {shown_path(folder.resolve())}"
        problems.append(at(settings, place, f"names a file that does not exist: {name}", hint))
        return None
    return path


def _read(name: str, settings: Settings, place: Place, problems: list[Problem]) -> Preset | None:
    path = named_file(name, settings, place, problems)
    if path is None:
        return None
    try:
        return load_preset(Path(shown_path(path)))
    except ConfigError as error:
        problems += error.problems
        return None


def merge_keys(model: type[BaseModel], base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Return `base` with the keys of `over`, both plain data of `model`; mappings with one model are merged too."""
    return _merge_section_keys(model, base, over, inside=False)


def _merge_section_keys(
    model: type[BaseModel], base: Mapping[str, Any], over: Mapping[str, Any], *, inside: bool
) -> dict[str, Any]:
    merged = dict(base)
    for key, value in over.items():
        section = _section(model, key, optional=inside)
        if section is not None and isinstance(value, dict) and isinstance(base.get(key), dict):
            merged[key] = _merge_section_keys(section, base[key], value, inside=True)
        else:
            merged[key] = value
    return merged


def _section(model: type[BaseModel], key: str, *, optional: bool) -> type[BaseModel] | None:
    """Return the model of a key if it has exactly one; with `optional`, also if the value may be null instead."""
    field = model.model_fields.get(key)
    if field is None:
        return None
    kinds = [field.annotation]
    if optional:
        kinds = [kind for kind in get_args(field.annotation) or kinds if kind is not type(None)]
    if len(kinds) == 1 and isinstance(kinds[0], type) and issubclass(kinds[0], BaseModel):
        return kinds[0]
    return None
