"""Serialising a bench or a scene calls no Python: pydantic drops what that raises, such as a signal's interrupt."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from hil.config import load_bench
from sim.scene.scene import load_scene

ROOT = Path(__file__).resolve().parents[4]
SETTINGS = ("randomize={light: true, people: {count: [5, 5]}}", "scene=urban_delivery")


def functions_called(act: Callable[[], Any]) -> set[str]:
    """Return the Python functions that a call of pydantic calls itself."""
    called: set[str] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code.co_name != "model_dump":
            called.add(f"{Path(frame.f_code.co_filename).name}: {frame.f_code.co_name}")

    act()  # schemas are built when they are first used
    sys.setprofile(note)
    try:
        act()
    finally:
        sys.setprofile(None)
    return called


@pytest.mark.parametrize("settings", [(), SETTINGS], ids=["default", "with choices"])
def test_a_bench_is_serialised_without_python(settings: tuple[str, ...]) -> None:
    config = load_bench(ROOT / "hil.yaml", settings=list(settings)).config
    dump = config.model_dump
    assert functions_called(lambda: dump(mode="json", exclude={"sensors"})) <= {"test_config_serialised.py: <lambda>"}
    for sensor in config.sensors.values():
        dump = sensor.parameters.model_dump
        assert functions_called(lambda: dump(mode="json")) <= {"test_config_serialised.py: <lambda>"}  # noqa: B023


@pytest.mark.parametrize("name", ["city_park", "urban_delivery", "airfield"])
def test_a_scene_is_serialised_without_python(name: str) -> None:
    dump = load_scene(name).model_dump
    assert functions_called(lambda: dump(mode="json")) <= {"test_config_serialised.py: <lambda>"}
