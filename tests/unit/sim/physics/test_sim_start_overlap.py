"""Starts inside each other are found, with yaw, in a scene of boxes and in a map."""

from __future__ import annotations

import math

import pytest

from sim.physics.flight_start import FlightStart
from sim.physics.start_overlap import overlapping_starts
from sim.physics.vehicle import load_vehicle
from sim.scene.scene import load_scene


@pytest.mark.parametrize("scene", ["airfield", "city_park"])
def test_only_pairs_that_touch_are_named(scene: str) -> None:
    x500, racer = load_vehicle("x500"), load_vehicle("racer")
    starts = {
        "lead": (x500, FlightStart()),
        "inside": (racer, FlightStart(ground_W=(0.05, 0.0, 0.0))),
        "beside": (x500, FlightStart(ground_W=(0.62, 0.0, 0.0))),
        "turned": (x500, FlightStart(ground_W=(1.2225, 0.0, 0.0), yaw_rad=0.25 * math.pi)),
        "above": (x500, FlightStart(p_WB=(0.0, 0.0, 0.6))),
        "far": (x500, FlightStart(ground_W=(50.0, 0.0, 0.0))),
    }
    # The discs of "beside" and "turned", 0.254 m wide, are 0.252 m apart; unturned they would pass by 0.5 mm.
    assert overlapping_starts(load_scene(scene), starts) == [("lead", "inside"), ("beside", "turned")]
