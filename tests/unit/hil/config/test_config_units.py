"""Vehicles with a number in another unit than that of its key are refused, with its line and the likely unit."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.config.checks.unit_checks import unit_problems
from signals.documents.document import Document
from sim.physics.vehicle import VEHICLE_DIR, load_vehicle, vehicle_names
from tests.worlds.bench_files import elsewhere, refused  # noqa: F401 (the fixture is for every test)

# What is replaced, the key that is told, and the end of its message.
MISTAKES = {
    "rev/min": ("max_speed_radps: 1000.0", "9549", "max_speed_radps", "at Mach 3.6 (9549 rev/min are 1000 rad/s)"),
    "N per (rev/min)^2": (
        "thrust_coefficient_n_per_radps2: 8.54858e-06",
        "9.37e-08",
        "thrust_coefficient_n_per_radps2",
        "(thrust is per (rad/s)^2, and it seems to be per (rev/min)^2)",
    ),
    "inches": (
        "radius_m: 0.127",
        "5",
        "thrust_coefficient_n_per_radps2",
        "(radius_m is in m, and it seems to be in inches)",
    ),
    "diameter": (
        "radius_m: 0.127",
        "0.254",
        "thrust_coefficient_n_per_radps2",
        "(radius_m is the radius, and it seems to be the diameter)",
    ),
    "grams": ("mass_kg: 2.064307692307692", "802", "mass_kg", "0.0043 times its weight (802 g are 0.802 kg)"),
    "kg cm2": (
        "inertia_kgm2: [0.023891, 0.023891, 0.044000]",
        "[23.9, 23.9, 44.0]",
        "inertia_kgm2",
        "(give inertias in kg m2, mass_kg in kg, and positions in m)",
    ),
    "N mm": ("moment_ratio_m: 0.016 ", "0.6 ", "moment_ratio_m", "(give torque over thrust in m)"),
}


@pytest.mark.parametrize("unit", MISTAKES)
def test_the_wrong_unit_is_told_at_its_line(unit: str) -> None:
    right, number, key, told = MISTAKES[unit]
    text = (VEHICLE_DIR / "x500.yaml").read_text()
    assert text.count(right) == 1
    Path("mine.yaml").write_text(text.replace(right, f"{right.partition(' ')[0]} {number}"))
    line = next(i for i, row in enumerate(text.splitlines(), start=1) if row.strip().startswith(f"{key}:"))
    (problem,) = refused("vehicle: ./mine.yaml\n")
    assert problem.startswith(f"mine.yaml:{line}: ")
    assert problem.endswith(told)


@pytest.mark.parametrize("name", vehicle_names())
def test_shipped_vehicles_are_in_range(name: str) -> None:
    assert unit_problems(load_vehicle(name), Document(name, {})) == []
