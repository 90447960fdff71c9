"""The profiles of all autopilots, by the value of `autopilot.kind` in a bench file."""

from __future__ import annotations

import pkgutil
from collections.abc import Mapping
from importlib import import_module

import firmware_bridge.autopilots
from firmware_bridge.autopilots.profile import Profile


def _profiles() -> dict[str, Profile]:
    """Import the modules of the folders here; return each `PROFILE` by its module's name, in the order of names."""
    here = firmware_bridge.autopilots
    found: dict[str, Profile] = {}
    for folder in pkgutil.iter_modules(here.__path__, f"{here.__name__}."):
        for module in pkgutil.iter_modules(import_module(folder.name).__path__) if folder.ispkg else ():
            profile = getattr(import_module(f"{folder.name}.{module.name}"), "PROFILE", None)
            if profile is not None:
                found[module.name] = profile
    return dict(sorted(found.items()))


PROFILES: Mapping[str, Profile] = _profiles()
SENSOR_KINDS = frozenset(kind for profile in PROFILES.values() for kind in profile.sensors)
"""Kinds of sensors that some autopilot takes."""
