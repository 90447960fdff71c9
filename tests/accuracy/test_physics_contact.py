"""Landings, falls, walls: rest, depth, energy, and hand-over between flight and contact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hil.apps.bench_suite.physics.flight_cases import ThisProject, landing
from hil.apps.bench_suite.physics.landing_checks import drop
from sim.physics.multirotor import multirotor_names
from sim.physics.vehicle import load_vehicle
from sim.scene.scene import Box


@pytest.mark.parametrize("name", multirotor_names())
@pytest.mark.parametrize("tick_ns", [1_000_000, 2_000_000, 4_000_000])
def test_landing_rests_within_a_second_and_five_millimetres(name: str, tick_ns: int) -> None:
    for height_m, v_W in ((0.1, (0.0, 0.0, 0.0)), (0.3, (0.5, -0.3, -0.5))):
        landed = drop(load_vehicle(name), height_m, tick_ns=tick_ns, seconds=1.5, v_W=v_W)
        assert landed.finite
        assert landed.rest_s <= 1.0
        assert landed.depth_m <= 5e-3
        assert landed.gain_j <= 0.0


@pytest.mark.parametrize("height_m", [0.01, 2.0, 20.0])
def test_falls_stay_shallow(height_m: float) -> None:
    landed = drop(load_vehicle("x500"), height_m, tick_ns=4_000_000, seconds=(height_m / 4.9) ** 0.5 + 1.0)
    assert landed.depth_m <= 5e-3
    assert landed.rest_s <= 1.0
    assert landed.gain_j <= 0.0


@pytest.mark.parametrize("speed_mps", [1.0, 8.0, 20.0])
def test_a_wall_is_not_passed_and_gives_no_energy(speed_mps: float) -> None:
    flight = landing(4.0, seconds=0.6 if speed_mps > 5.0 else 3.0)
    wall = Box(name="wall", center_m=(3.0, 0.0, 5.0), size_m=(0.2, 40.0, 10.0))
    flight = replace(flight, scene=flight.scene.model_copy(update={"boxes": (wall,)}))
    flight.start[7:10] = (speed_mps, 0.3, 2.0)
    flown = ThisProject(4.0).fly(flight, record=True)
    assert flown[:, 0].max() < 2.9
    kinetic = 0.5 * flight.vehicle.mass_kg * np.sum(flown[:, 7:10] ** 2, axis=1)
    kinetic += 0.5 * np.sum(np.array(flight.vehicle.inertia_kgm2) * flown[:, 10:13] ** 2, axis=1)
    energy = kinetic + flight.vehicle.mass_kg * 9.80665 * flown[:, 2]
    assert energy.max() <= energy[0] * (1 + 1e-12)


def test_a_tumbling_landing_gains_no_energy() -> None:
    """A spinning vehicle in contact: an explicit gyroscopic step would feed it."""
    flight = landing(0.5, seconds=2.5)
    flight.start[10:13] = (15.0, -20.0, 10.0)
    flown = ThisProject(4.0).fly(flight, record=True)
    kinetic = 0.5 * flight.vehicle.mass_kg * np.sum(flown[:, 7:10] ** 2, axis=1)
    kinetic += 0.5 * np.sum(np.array(flight.vehicle.inertia_kgm2) * flown[:, 10:13] ** 2, axis=1)
    energy = kinetic + flight.vehicle.mass_kg * 9.80665 * flown[:, 2]
    assert energy.max() <= energy[0] * (1 + 1e-12)
    assert np.abs(flown[-1, 7:13]).max() < 0.05
