"""Kinds of sensors by name: every module of this folder with a `KIND`, under its file's name."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from sim.sensors.sensor import Kind

__all__ = ["KINDS", "Kind"]

_ABOVE = ("__init__", "catalog", "kinds", "presets")  # import this module


def _kinds() -> dict[str, Kind]:
    """Return the kinds in the order of their names."""
    names = sorted(file.stem for file in Path(__file__).parent.glob("*.py") if file.stem not in _ABOVE)
    found = {name: getattr(import_module(f"sim.sensors.{name}"), "KIND", None) for name in names}
    return {name: kind for name, kind in found.items() if isinstance(kind, Kind)}


KINDS: dict[str, Kind] = _kinds()
