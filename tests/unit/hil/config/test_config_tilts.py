"""Tiltrotors and tailsitters: facts for autopilots, and checks that ask the profile which kinds it flies."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from firmware_bridge.autopilots.catalog import PROFILES
from hil.config.airframe_facts import vtol_facts
from sim.physics.vehicle import load_vehicle
from tests.worlds.bench_files import elsewhere, load, refused  # noqa: F401 (the fixture is for every test)

VEHICLES = ("tiltrotor", "tailsitter")


def test_facts_of_a_tiltrotor() -> None:
    facts = vtol_facts(load_vehicle("tiltrotor"))
    assert facts.kind == "tiltrotor"
    assert (facts.lifters, facts.pushers, facts.engines) == ((0, 1, 2, 3), (), (0, 2))
    assert [tilt.name for tilt in facts.tilts] == ["tilt_right", "tilt_left"]
    right = facts.tilts[0]
    assert tuple(right.rotors) == (0,)
    assert (right.min_rad, right.max_rad) == (0.0, math.radians(90.0))
    assert (right.hover_command, right.ahead_command) == (-1.0, 1.0)
    assert facts.hover_pitch_rad == 0.0
    assert [surface.name for surface in facts.wing.surfaces] == ["elevon_left", "elevon_right"]
    assert [rotor.axis for rotor in facts.wing.rotors] == [pytest.approx((1.0, 0.0, 0.0), abs=1e-12)] * 2
    assert all(rotor.axis == (0.0, 0.0, 1.0) for rotor in facts.hover.rotors)


def test_facts_of_a_tailsitter() -> None:
    facts = vtol_facts(load_vehicle("tailsitter"))
    assert facts.kind == "tailsitter"
    assert facts.hover_pitch_rad == pytest.approx(math.pi / 2)
    assert facts.engines == facts.lifters == (0, 1, 2, 3)
    # Rotor 0 is below on the right in flight: in hover the belly looks ahead, so it is ahead on the right.
    assert facts.hover.rotors[0].position_m == pytest.approx((0.3, -0.3, 0.1975))
    assert np.all(facts.hover.full_effect[3] > 0.0)
    assert facts.hover.full_effect[0, 0] < 0.0  # roll: it lifts the right side, y is to the left


@pytest.mark.parametrize("name", VEHICLES)
def test_an_autopilot_that_does_not_fly_the_kind_is_told(name: str) -> None:
    told = refused(f"vehicle: {name}\nmission: null\n")
    assert any(f"'{name}' is a {name}, which an autopilot of kind 'mock' cannot fly here" in text for text in told)


@pytest.mark.parametrize("name", VEHICLES)
def test_an_autopilot_that_flies_the_kind_is_given_it(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    able = replace(PROFILES["mock"], vtol_kinds=frozenset({"standard", *VEHICLES}))
    monkeypatch.setitem(PROFILES, "mock", able)  # type: ignore[misc]
    assert load(f"vehicle: {name}\nmission: null\n").vehicle.name == name
