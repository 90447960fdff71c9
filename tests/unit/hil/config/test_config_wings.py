"""Planes that cannot fly, with file, line and the figure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from sim.physics.fixed_wing import Airframe
from sim.physics.surface_faults import SurfaceFault, check_surface_faults
from sim.physics.vehicle import VEHICLE_DIR, Vehicle, load_vehicle
from tests.worlds.bench_files import elsewhere, load, refused  # noqa: F401 (the fixture is for every test)
from tests.worlds.docs_blocks import ROOT, blocks

EXAMPLES = [yaml.safe_load(block.text) for block in blocks(ROOT / "docs/planes.md", "yaml")]


def write_plane(old: str, new: str) -> int:
    """Write mine.yaml, a changed copy of the Skywalker X8; return the line of the change."""
    text = (VEHICLE_DIR / "skywalker_x8.yaml").read_text()
    assert text.count(old) >= 1
    Path("mine.yaml").write_text(text.replace(old, new, 1))
    return text[: text.index(old)].count("\n") + 1


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        ("cruise_mps: 18", "cruise_mps: 10", "is 10 m/s, and the vehicle stalls at 9.4 m/s (cruise at 13.2 m/s"),
        ("cruise_mps: 18", "cruise_mps: 40", "more thrust than the engines have (it flies level from"),
    ],
)
def test_a_cruise_speed_that_cannot_be_flown(old: str, new: str, found: str) -> None:
    line = write_plane(old, new)
    told = refused("vehicle: mine.yaml\n")
    problem = next(text for text in told if f"mine.yaml:{line}: cruise_mps" in text)
    assert found in problem


def test_a_centre_of_mass_behind_the_neutral_point() -> None:
    write_plane("alpha: -0.4629", "alpha: 0.4629")
    problem = next(text for text in refused("vehicle: mine.yaml\n") if "neutral point" in text)
    assert "mine.yaml:" in problem
    assert "11% of the chord, behind the neutral point" in problem


def test_surfaces_that_do_not_reach() -> None:
    write_plane("pitch: {zero: 0.02275", "pitch: {zero: 0.40")
    problem = next(text for text in refused("vehicle: mine.yaml\n") if "cannot fly level" in text)
    assert "would need elevon_left beyond the end of its range" in problem


def test_surfaces_with_twin_names() -> None:
    write_plane("elevon_right", "elevon_left")
    assert any(
        "mine.yaml:" in text and "elevon_left is there twice" in text for text in refused("vehicle: mine.yaml\n")
    )


def test_no_engine() -> None:
    """A lifting rotor alone makes neither a plane nor a multirotor."""
    write_plane("axis: [1.0, 0.0, 0.0]", "axis: [0.2, 0.0, 0.3]")
    assert any("holds 1 rotors" in text and "at least 3" in text for text in refused("vehicle: mine.yaml\n"))


def test_a_fault_of_a_surface_that_is_not_there() -> None:
    told = refused("faults:\n  surfaces:\n    - {kind: lost, surface: rudder, at_s: 1}\n")
    assert any("names 'rudder', but the vehicle has no control surfaces" in text for text in told)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: " ".join(example))
def test_the_examples_of_the_docs(example: dict[str, Any]) -> None:
    fields = load_vehicle(example["vehicle"]).model_dump() | example.get("vehicle_settings", {})
    vehicle = Vehicle.model_validate(fields)
    airframe = Airframe(vehicle)
    assert 0.0 < airframe.trim(airframe.cruise_mps).throttle < 1.0
    faults = [SurfaceFault.model_validate(entry) for entry in example.get("faults", {}).get("surfaces", [])]
    check_surface_faults(faults, vehicle)
    assert set(example) <= {"vehicle", "vehicle_settings", "faults"}
