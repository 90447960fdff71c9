"""Free flight of VTOLs against the CasADi model solved by CVODES: tilts, transitions, sets of rotors, gusts."""

from __future__ import annotations

import numpy as np
import pytest

from hil.apps.bench_suite.physics.plane_cases import GUSTY, errors_of
from hil.apps.bench_suite.physics.vtol_cases import VtolFlight, cases, hover_commands
from sim.physics.integration import Integration
from sim.physics.vehicle import load_vehicle

CASES = cases(10.0)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if "ahead" in name else []) for name in CASES]
)
def test_ten_seconds_of_any_commands(name: str) -> None:
    flight = CASES[name]
    flown, winds = flight.fly()
    errors = errors_of(flight.vehicle, flown, flight.exact(flown[0], winds))
    assert errors.position_m < 1e-6
    assert errors.attitude_rad < 1e-6
    assert errors.deflection_rad < 1e-12


def test_tilts_cross_their_range_at_full_speed() -> None:
    """The cases have what they claim: tilts at both ends and in motion, and a vehicle that turns over."""
    flown = CASES["tiltrotor: transition, gusty"].fly()[0]
    tilts = flown[:, 17:19]
    assert tilts.min() < 0.1
    assert tilts.max() > 1.4
    assert np.max(np.abs(np.diff(tilts, axis=0))) == pytest.approx(np.radians(114.6) * 0.004, rel=1e-3)
    up = 1.0 - 2.0 * (flown[:, 4] ** 2 + flown[:, 5] ** 2)
    assert up.min() < 0.0


def test_the_torque_of_a_spin_that_turns_is_needed() -> None:
    """Rotors without inertia fly elsewhere: the reference sees dh/dt of the tilts."""
    vehicle = load_vehicle("tiltrotor")
    flight = VtolFlight(vehicle, hover_commands(vehicle, 1.0, 5), wind=GUSTY)
    flown, winds = flight.fly()
    bare = vehicle.model_copy(
        update={"rotor_constants": vehicle.rotor_constants.model_copy(update={"inertia_kgm2": 0})}
    )
    exact = VtolFlight(bare, flight.commands, wind=GUSTY).exact(flown[0], winds)
    assert errors_of(vehicle, flown, exact).attitude_rad > 1e-3


def test_the_classical_method_sees_the_same_motion() -> None:
    vehicle = load_vehicle("tiltrotor")
    flight = VtolFlight(vehicle, hover_commands(vehicle, 1.0, 6))
    flown, winds = flight.fly()
    exact = flight.exact(flown[0], winds)
    fine = errors_of(vehicle, flight.fly(Integration("classical", 250_000))[0], exact).position_m
    assert errors_of(vehicle, flown, exact).position_m < 1e-9
    assert fine < 1e-6
