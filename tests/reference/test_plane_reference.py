"""Free flight of planes against the CasADi model solved by CVODES: ordinary flight, stall, spin, tail slide, wind."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from hil.apps.bench_suite.physics.plane_cases import (
    CALM,
    GUSTY,
    INVERTED,
    LEVEL,
    SIDEWAYS,
    SPIN,
    TAIL_SLIDE,
    PlaneFlight,
    errors_of,
    prompt_engine,
    random_commands,
)
from sim.physics.integration import Integration
from sim.physics.vehicle import load_vehicle
from sim.scene.wind import Wind


@pytest.mark.parametrize("name", ["skywalker_x8", "aerosonde", "trainer"])
@pytest.mark.parametrize(
    ("start", "seed", "wind"),
    [
        pytest.param(LEVEL, 1, GUSTY, id="random, gusty"),
        pytest.param(SPIN, 2, GUSTY, id="spin, gusty", marks=pytest.mark.slow),
        pytest.param(INVERTED, 3, CALM, id="inverted", marks=pytest.mark.slow),
        pytest.param(TAIL_SLIDE, 4, CALM, id="tail slide"),
        pytest.param(SIDEWAYS, 5, GUSTY, id="sideways", marks=pytest.mark.slow),
    ],
)
def test_ten_seconds_of_any_commands(name: str, start: Mapping[int, float], seed: int, wind: Wind) -> None:
    vehicle = prompt_engine(load_vehicle(name))
    flight = PlaneFlight(vehicle, random_commands(vehicle, 10.0, seed), start, wind)
    flown, winds = flight.fly()
    errors = errors_of(vehicle, flown, flight.exact(flown[0], winds))
    assert errors.position_m < 1e-6
    assert errors.attitude_rad < 1e-6
    assert errors.deflection_rad < 1e-12


def test_the_classical_method_is_of_order_four() -> None:
    """Slow servos without a rate limit: nothing in the flight has a corner but the commands."""
    vehicle = load_vehicle("skywalker_x8")
    (table,) = vehicle.forces
    surfaces = tuple(
        s.model_copy(update={"rate_degps": None, "time_constant_s": 0.1})
        for s in table.surfaces  # type: ignore[attr-defined]
    )
    vehicle = vehicle.model_copy(update={"forces": (table.model_copy(update={"surfaces": surfaces}),)})
    flight = PlaneFlight(vehicle, random_commands(vehicle, 3.0, 7))
    flown, winds = flight.fly()
    exact = flight.exact(flown[0], winds)
    errors = [errors_of(vehicle, flight.fly(Integration("classical", s))[0], exact)[0] for s in (4_000_000, 2_000_000)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.3), errors


def test_step_bounds_of_the_force_are_needed() -> None:
    """The corner where a servo leaves its rate limit lies within ticks of this flight."""
    vehicle = load_vehicle("skywalker_x8")
    flight = PlaneFlight(vehicle, random_commands(vehicle, 3.0, 7))
    flown, winds = flight.fly()
    exact = flight.exact(flown[0], winds)
    own = errors_of(vehicle, flown, exact).position_m
    classical = errors_of(
        vehicle, flight.fly(Integration("classical", 4_000_000))[0], exact
    ).position_m  # no such bound
    assert own < 1e-9 < 1e-7 < classical
