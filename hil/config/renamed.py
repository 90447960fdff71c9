"""Old keys of bench files: each is an error that names the new key, with the file and line of the old one."""

from __future__ import annotations

from typing import Any

from hil.config.layers import Settings
from signals.documents.validate import COMMAND_LINE, at
from signals.errors import Problem

RENAMED_KEYS = {
    "router.hold_heartbeats": "router.repeat_heartbeats",
    "search.doubles_count": "search.count_duplicates",
    "search.visible_looks": "search.visible_samples",
}


def replace_renamed_keys(settings: Settings, *, translate: bool) -> list[Problem]:
    """Remove old keys from the settings, so that validation does not report them as unknown, and report each of them.

    With `translate` their values are moved to the new keys instead of reported. This is for files with complete
    settings, which the bench itself wrote into the folder of a run.
    """
    problems = []
    for old, new in RENAMED_KEYS.items():
        *section, key = old.split(".")
        mapping: Any = settings.data
        for name in section:
            mapping = mapping.get(name) if isinstance(mapping, dict) else None
        if not isinstance(mapping, dict) or key not in mapping:
            continue
        place, value = (*section, key), mapping.pop(key)
        if translate and not settings.where(place).startswith(COMMAND_LINE):
            settings.set(tuple(new.split(".")), value, settings.where(place))
        else:
            problems.append(at(settings, place, f"is now called {new}", "rename it"))
    return problems
