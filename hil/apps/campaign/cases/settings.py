"""Values of axes, put into settings of the bench, and written as the texts of `--set`."""

from __future__ import annotations

import copy
import json
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from signals.errors import ConfigError

BUNDLE_KEYS = {"label", "settings"}
_UNPRINTABLE = re.compile("[^\x20-\x7e\xa0-\ud7ff\ue000-\ufefe\uff00-\ufffd\U00010000-\U0010ffff]")
_FILES = ("bench", "rig", "scene", "mission", "vehicle")


def is_bundle(value: Any) -> bool:
    """Return True if a value of an axis sets several keys at once: {label: NAME, settings: {...}}."""
    return isinstance(value, Mapping) and set(value) == BUNDLE_KEYS and isinstance(value["settings"], Mapping)


def label(value: Any) -> Any:
    """Return how a value of an axis is written in tables: the label of a bundle, else the value."""
    return value["label"] if is_bundle(value) else value


def with_values(settings: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return `settings` with the values of axes in their places. Raises ConfigError for a place that there is not."""
    merged: dict[str, Any] = copy.deepcopy(dict(settings))
    for axis, value in values.items():
        if is_bundle(value):
            _merge(merged, value["settings"])
        else:
            _put(merged, axis, copy.deepcopy(value))
    return merged


def _merge(into: dict[str, Any], settings: Mapping[str, Any]) -> None:
    for key, value in settings.items():
        if isinstance(value, Mapping) and isinstance(into.get(key), dict):
            _merge(into[key], value)
        else:
            into[key] = copy.deepcopy(value)


def _put(settings: dict[str, Any], axis: str, value: Any) -> None:
    *path, last = axis.split(".")
    node: Any = settings
    for number, key in enumerate(path):
        if isinstance(node, list):
            node = node[_index(node, key, axis)]
        elif isinstance(node, dict):
            is_list = (*path, last)[number + 1].isdigit()
            if key not in node and is_list:
                raise _no_list(axis, ".".join(path[: number + 1]))
            node = node.setdefault(key, {})
        else:
            raise _no_list(axis, ".".join(path[:number]))
    if isinstance(node, list):
        node[_index(node, last, axis)] = value
    elif isinstance(node, dict):
        node[last] = value
    else:
        raise _no_list(axis, ".".join(path))


def _index(values: list[Any], key: str, axis: str) -> int:
    if not key.isdigit() or int(key) >= len(values):
        text = f"names entry {key} of a list with {len(values)} entries in settings; the first is 0"
        raise ConfigError.at(f"axis {axis}", text)
    return int(key)


def _no_list(axis: str, place: str) -> ConfigError:
    return ConfigError.at(
        f"axis {axis}", f"needs {place} in the section settings", "write the whole list or mapping there"
    )


def texts_of(settings: Mapping[str, Any], folder: Path | None = None) -> list[str]:
    """Return settings as texts of `--set`. Files beside `folder` are named by their whole path."""
    return [f"{key}={_text(value)}" for key, value in _leaves("", _located(settings, folder))]


def _leaves(prefix: str, settings: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for key, value in settings.items():
        place = f"{prefix}{key}"
        if isinstance(value, Mapping) and value:
            yield from _leaves(f"{place}.", value)
        else:
            yield place, value


def _text(value: Any) -> str:
    """Return a value as YAML 1.2 in one line: JSON, with an escape for each character that YAML does not print."""
    return _UNPRINTABLE.sub(lambda found: f"\\u{ord(found[0]):04x}", json.dumps(value, ensure_ascii=False))


def _located(settings: Mapping[str, Any], folder: Path | None) -> dict[str, Any]:
    """Return settings whose relative files in `folder` have their whole path."""
    if folder is None:
        return dict(settings)

    def whole(name: Any) -> Any:
        inside = isinstance(name, str) and name and not os.path.isabs(name) and os.path.isfile(folder / name)
        return str((folder / name).resolve()) if inside else name

    located = {key: whole(value) if key in _FILES else value for key, value in settings.items()}
    autopilot = located.get("autopilot")
    if isinstance(autopilot, Mapping) and "binary" in autopilot:
        located["autopilot"] = {**autopilot, "binary": whole(autopilot["binary"])}
    return located
