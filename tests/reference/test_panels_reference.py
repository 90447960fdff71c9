"""Loads of the panels against their reference in CasADi. Whole flights: test_plane_reference.py."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from hil.apps.bench_suite.physics.panels_reference import Flight, influence, panels
from sim.physics.forces.force import Effects
from sim.physics.forces.panels import Panels
from sim.physics.vehicle import load_vehicle


def trainer_panels() -> Panels:
    part = load_vehicle("trainer").forces[0]
    assert isinstance(part, Panels)
    return part


def test_mutual_velocities_of_the_panels() -> None:
    part = trainer_panels()
    seen, _ = influence(part)
    assert np.abs(seen - np.array(part.make(Effects()).influence)).max() < 1e-14


@pytest.mark.parametrize("seed", range(20))
def test_loads_in_any_flow(seed: int) -> None:
    """All directions and speeds from rest to 30 m/s, all deflections, body rates to 6 rad/s."""
    part, random = trainer_panels(), np.random.default_rng(seed)
    air = random.normal(size=3) * random.choice([0.1, 1.0, 8.0, 15.0])
    w, angles = random.uniform(-6.0, 6.0, 3), random.uniform(-0.52, 0.52, 4)
    force, torque = part.make(Effects()).wrench(tuple(air), tuple(w), list(angles), density_ratio=0.9)
    flight = Flight(ca.SX(ca.DM(air)), ca.SX(ca.DM(w)), ca.SX(500.0), ca.SX(ca.DM([0, 0, 1])), ())
    exact = ca.Function("loads", [], [*panels(part, flight, ca.SX(ca.DM(angles)))])()
    for got, key in ((force, "o0"), (torque, "o1")):
        assert got == pytest.approx(0.9 * np.array(exact[key]).ravel(), rel=1e-11, abs=1e-12)
