"""Kinds of sensors by name: every module of this folder that ends with `KIND = Kind(...)`, under its file's name."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from sim.sensors.sensor import Kind

__all__ = ["KINDS", "Kind"]


def _kinds() -> dict[str, Kind]:
    """Import the modules that define a kind, in the order of their names."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    names = [file.stem for file in files if "\nKIND = Kind(" in file.read_text(encoding="utf-8")]
    return {name: import_module(f"sim.sensors.{name}").KIND for name in names}


KINDS: dict[str, Kind] = _kinds()
