"""VTOLs and missions of VTOLs that cannot be flown, with file, line and the figure."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from firmware_bridge.autopilots.catalog import PROFILES
from hil.config.vtol_facts import vtol_facts
from sim.physics.vehicle import VEHICLE_DIR, load_vehicle
from tests.e2e.test_plane_flights import Item, mission_file
from tests.worlds.bench_files import elsewhere, load, refused  # noqa: F401 (the fixture is for every test)

FLAT = (0.0, 0.0, 0.0, 0.0)
BENCH = "vehicle: {}\nscene: meadow\nmission: flown.waypoints\n"


def write_vtol(*changes: tuple[str, str]) -> int:
    """Write mine.yaml, a changed copy of the quadplane; return the line of the first change."""
    text = (VEHICLE_DIR / "quadplane.yaml").read_text()
    line = text[: text.index(changes[0][0])].count("\n") + 1
    for old, new in changes:
        assert text.count(old) >= 1
        text = text.replace(old, new, 1)
    Path("mine.yaml").write_text(text)
    return line


def told(items: list[Item], vehicle: str = "quadplane", more: str = "") -> list[str]:
    mission_file(Path("flown.waypoints"), items)
    return refused(BENCH.format(vehicle) + more)


def test_a_weight_that_the_lifters_do_not_carry() -> None:
    line = write_vtol(("mass_kg: 5.025", "mass_kg: 19"), ("cruise_mps: 18", "cruise_mps: 31"))
    problem = next(text for text in refused("vehicle: mine.yaml\n") if "hover" in text)
    assert f"mine.yaml:{line}: mass_kg makes it hover at 1.02 of full command" in problem


def test_a_cruise_below_the_stall() -> None:
    line = write_vtol(("cruise_mps: 18", "cruise_mps: 11"))
    problem = next(text for text in refused("vehicle: mine.yaml\n") if "stalls" in text)
    assert f"mine.yaml:{line}: cruise_mps is 11 m/s, and the vehicle stalls at 11.5 m/s" in problem


def test_an_autopilot_that_flies_no_vtol(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PROFILES, "mock", replace(PROFILES["mock"], flies_vtols=False))
    problem = next(text for text in refused("vehicle: quadplane\nmission: null\n") if "VTOL" in text)
    assert "b.yaml:1: vehicle 'quadplane' is a VTOL, which an autopilot of kind 'mock' cannot fly here" in problem
    assert "kinds that fly VTOLs: " in problem


def test_a_transition_too_near_to_the_ground() -> None:
    items: list[Item] = [(84, FLAT, (0.0, 0.0), 6.0), (16, FLAT, (300.0, 0.0), 40.0), (85, FLAT, (0.0, 0.0), 0.0)]
    assert any(
        "flown.waypoints:3: item 1 (VTOL take-off) begins a transition at 6 m over the start, and one needs 10 m"
        in text
        for text in told(items)
    )
    items[0] = (84, FLAT, (0.0, 0.0), 20.0)
    more = "autopilot: {params: {VT_FW_MIN_ALT: 25}}\n"
    assert any("at 20 m over the start, and one needs 25 m" in text for text in told(items, more=more))


def test_a_transition_to_no_known_state_and_a_circle_in_hover() -> None:
    items: list[Item] = [
        (84, FLAT, (0.0, 0.0), 30.0),
        (3000, (7.0, 0.0, 0.0, 0.0), None, 0.0),
        (18, (2.0, 0.0, 80.0, 0.0), (300.0, 0.0), 40.0),
        (85, FLAT, (0.0, 0.0), 0.0),
    ]
    problems = told(items)
    assert any("item 2 (transition) leads to state 7 (take 3, hover, or 4" in text for text in problems)
    assert any("item 3 (loiter turns) is a circle, flown on the wings" in text for text in problems)


def test_waypoints_closer_than_a_turn_on_the_wings_but_not_in_hover() -> None:
    near: list[Item] = [(16, FLAT, (30.0, 0.0), 30.0), (16, FLAT, (30.0, 20.0), 30.0), (85, FLAT, (0.0, 0.0), 0.0)]
    problems = told([(84, FLAT, (0.0, 0.0), 30.0), *near])
    assert any("item 3 lies 20 m from the one before, within one turn of 47 m radius" in text for text in problems)
    mission_file(Path("flown.waypoints"), [(22, FLAT, (0.0, 0.0), 30.0), *near])
    Path("hover.params").write_text("NAV_FORCE_VT 0\n")
    for given in ("params: {NAV_FORCE_VT: 0}", "params_file: hover.params"):
        load(BENCH.format("quadplane") + f"autopilot: {{{given}}}\n")


def test_a_vtol_without_a_pusher() -> None:
    pusher = "  - {position_m: [-0.22, 0.0, 0.0], axis: [1.0, 0.0, 0.0], spin: cw, set: pusher}\n"
    text = (VEHICLE_DIR / "quadplane.yaml").read_text().replace(pusher, "")
    start, end = text.index("rotor_sets:"), text.index("# The wing's drag is in the table.")
    Path("mine.yaml").write_text(text[:start] + text[end:])
    problems = told([(84, FLAT, (0.0, 0.0), 30.0), (16, FLAT, (300.0, 0.0), 40.0)], "mine.yaml")
    assert any(
        "item 1 (VTOL take-off) is flown by VTOLs alone, and the vehicle 'mine.yaml' has no pusher" in text
        for text in problems
    )


@pytest.mark.parametrize(("vehicle", "what"), [("x500", "is a multirotor"), ("skywalker_x8", "is a plane")])
def test_vtol_items_for_other_vehicles(vehicle: str, what: str) -> None:
    problems = told([(84, FLAT, (0.0, 0.0), 30.0), (16, FLAT, (300.0, 0.0), 40.0)], vehicle)
    assert any("item 1" in text and what in text for text in problems)


def test_facts_of_the_quadplane() -> None:
    facts = vtol_facts(load_vehicle("quadplane"))
    assert (facts.lifters, facts.pushers) == ((0, 1, 2, 3), (4,))
    # Four lifters of 2e-5 N s2 at 1500 rad/s, thrust quadratic in the command.
    full_n = 4 * 2.0e-05 * 1500.0**2
    assert facts.hover.hover_control == pytest.approx(np.sqrt(5.025 * 9.80665 / full_n))
    assert [rotor.axis for rotor in facts.wing.rotors] == [(1.0, 0.0, 0.0)]
    assert [surface.name for surface in facts.wing.surfaces] == ["elevon_left", "elevon_right"]
    # The X8 stalls at 9.4 m/s with its own mass: here by the root of the ratio, but for the trim of the pitch.
    assert facts.wing.stall_mps == pytest.approx(9.4 * np.sqrt(5.025 / 3.364), rel=0.01)
