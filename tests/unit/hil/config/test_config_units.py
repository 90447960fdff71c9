"""Vehicles with a number in another unit than that of its key are refused, with its line and the likely unit."""

from __future__ import annotations

from pathlib import Path

import pytest

from hil.config.checks.unit_checks import unit_problems
from signals.documents.document import Document
from sim.physics.vehicle import VEHICLE_DIR, Vehicle, load_vehicle, vehicle_names
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
    "no-load speed": (
        "max_speed_radps: 1000.0",
        "2600",
        "max_speed_radps",
        "at Mach 0.97 (give the full speed under load in rad/s, not kV times volts)",
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


FAN = {"thrust_coefficient_n_per_radps2": 9.73e-7, "radius_m": 0.035, "max_speed_radps": 4712.0}  # 70 mm, 21.6 N


def with_rotors(**constants: float) -> Vehicle:
    x500 = load_vehicle("x500")
    assert x500.rotor_constants is not None
    return x500.model_copy(update={"rotor_constants": x500.rotor_constants.model_copy(update=constants)})


@pytest.mark.parametrize(
    ("mistake", "told"),
    [
        ({}, None),
        ({"thrust_coefficient_n_per_radps2": 8.717e-4}, "thrust is in N, and it seems to be in grams of weight"),
        ({"thrust_coefficient_n_per_radps2": 9.37e-8}, "thrust is per (rad/s)^2, and it seems to be per (rev/min)^2"),
        ({"radius_m": 5.0}, "radius_m is in m, and it seems to be in inches"),
        ({"radius_m": 0.254}, "radius_m is the radius, and it seems to be the diameter"),
        ({"radius_m": 12.7}, "radius_m is in m, and it seems to be in cm"),
    ],
)
def test_units_of_propellers_are_told_with_the_range_of_ducted_fans(
    mistake: dict[str, float], told: str | None
) -> None:
    problems = unit_problems(with_rotors(**mistake), Document("x500", {}))
    assert [problem.hint for problem in problems] == ([] if told is None else [told])


@pytest.mark.parametrize(
    ("mistake", "told"),
    [
        ({}, None),
        ({"thrust_coefficient_n_per_radps2": 9.92e-5}, "thrust is in N, and it seems to be in grams of weight"),
        ({"radius_m": 1.38}, "radius_m is in m, and it seems to be in inches"),
        ({"max_speed_radps": 45_000.0}, "4.5e+04 rev/min are 4712 rad/s"),
    ],
)
def test_a_ducted_fan_is_in_range(mistake: dict[str, float], told: str | None) -> None:
    """Its C_T is 0.17."""
    problems = unit_problems(with_rotors(**FAN | mistake), Document("fan", {}))
    assert [problem.hint for problem in problems] == ([] if told is None else [told])


def test_the_wings_are_part_of_the_reach() -> None:
    """A sailplane with 5 m of span and 2.4 kg, whose spheres are 0.3 m out, has 1 kg m2 about x."""
    x8 = load_vehicle("skywalker_x8").model_copy(update={"hull": ()})
    assert unit_problems(x8, Document("x8", {})) == []
    wing = x8.forces[0]
    span = wing.model_copy(update={"span_m": 5.0})
    sailplane = x8.model_copy(
        update={"mass_kg": 2.4, "inertia_kgm2": (1.0, 0.3, 1.2), "forces": (span, *x8.forces[1:])}
    )
    assert unit_problems(sailplane, Document("sailplane", {})) == []
    for unit in ({"inertia_kgm2": (1e4, 3e3, 1.2e4)}, {"mass_kg": 2400.0}):
        (problem,) = unit_problems(sailplane.model_copy(update=unit), Document("sailplane", {}))
        assert "spheres, rotors and wings reach 2.5 m" in problem.message


@pytest.mark.parametrize("name", vehicle_names())
def test_shipped_vehicles_are_in_range(name: str) -> None:
    assert unit_problems(load_vehicle(name), Document(name, {})) == []
