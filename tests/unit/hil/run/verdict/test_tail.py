"""Verdicts on flights of a tailsitter whose nose and speed are known in closed form."""

from __future__ import annotations

import math

import numpy as np

from hil.config.schema import Limits, PlaneLimits
from hil.run.verdict.flyable_path import stops_of
from hil.run.verdict.plane_flight import Stall
from hil.run.verdict.plane_track import PlaneTrack
from hil.run.verdict.tail import Tail, nose_is_lowered
from hil.run.verdict.vtol_flight import VtolMeasurement
from signals.samples import Quat, TruthState, Vec3
from sim.physics.vehicle import load_vehicle
from tests.unit.hil.run.verdict.test_vtol_flight import ITEMS, LEGS

STEP_NS = 100_000_000
STALL_MPS = 10.0
STILL: Vec3 = (0.0, 0.0, 0.0)


def nose(elevation_deg: float) -> Quat:
    """Return the attitude with the nose this high over the horizon, headed along x."""
    half = 0.5 * math.radians(elevation_deg)
    return (math.cos(half), 0.0, -math.sin(half), 0.0)


class Flight:
    """A flight in steps of 0.1 s."""

    def __init__(self) -> None:
        def calm() -> Vec3:
            return STILL

        self.measured = VtolMeasurement(
            LEGS,
            stops_of(LEGS, ITEMS),
            (PlaneLimits(), Limits()),
            Tail(1.2 * STALL_MPS, calm),
            wings={1, 2},
            radius_m=48.0,
            stall=Stall(STALL_MPS, math.radians(15.0)),
            wind_at=calm,
        )
        self.tick, self.p = 0, STILL

    def go(self, steps: int, v: Vec3, elevations_deg: tuple[float, float]) -> None:
        """Fly at a velocity while the nose moves from the one elevation to the other."""
        begin, end = elevations_deg
        for step in range(steps):
            x, y, z = (a + 0.1 * b for a, b in zip(self.p, v, strict=True))
            self.p = (x, y, max(z, 0.0))
            contact = self.p[2] == 0.0
            attitude = nose(begin + (end - begin) * (step + 1) / steps)
            moves = STILL if contact else v
            t_ns = self.tick * STEP_NS
            rotors = (700.0,) * 4
            state = TruthState(10 * self.tick, t_ns, self.p, attitude, moves, STILL, STILL, STILL, rotors, contact, ())
            self.measured.add(state)
            self.tick += 1


def flown(
    *,
    hover_deg: float = 80.0,
    loss_mps: float = 0.0,
    slow_mps: float = 15.0,
    pulled_up_mps: float = 12.0,
    landed_deg: float = 90.0,
) -> dict[str, float | None]:
    flight = Flight()
    flight.go(5, STILL, (90.0, 90.0))
    flight.go(100, (0.0, 0.0, 3.0), (hover_deg, hover_deg))
    flight.go(30, (8.0, 0.0, -loss_mps), (90.0, 0.0))
    flight.go(10, (11.0, 0.0, 0.0), (0.0, 0.0))  # less than 1.2 times the stall: not on the wings yet
    flight.go(100, (14.0, 0.0, 0.0), (0.0, 0.0))
    flight.go(40, (slow_mps, 0.0, 0.0), (0.0, 0.0))
    flight.go(380, (15.0, 0.0, 0.0), (0.0, 0.0))
    flight.go(10, (pulled_up_mps, 0.0, 2.0), (0.0, 30.0))
    flight.go(20, (7.0, 0.0, 0.0), (30.0, 90.0))
    flight.go(10, (1.0, 0.0, 0.0), (90.0, 90.0))
    flight.go(400, (0.0, 0.0, -1.0), (landed_deg, landed_deg))
    return flight.measured.values()


def test_the_wings_are_judged_from_an_airspeed_of_1_2_times_the_stall_on() -> None:
    values = flown()
    assert values["airspeed_margin"] == 1.4
    assert values["stalled_s"] == 0.0
    assert values["max_bank_deg"] == 0.0
    assert values["transition_loss_m"] == 0.0
    assert values["landing_speed_mps"] == 1.0


def test_what_a_rising_nose_begins_with_is_of_the_transition() -> None:
    assert flown(pulled_up_mps=8.0)["airspeed_margin"] == 1.4


def test_slow_on_the_wings() -> None:
    assert flown(slow_mps=9.0)["airspeed_margin"] == 0.9


def test_height_is_lost_from_before_the_nose_is_down() -> None:
    """3 s with 0.8 m/s, of which the nose is lowered by 35 degrees only after 1.8 s."""
    assert abs((flown(loss_mps=0.8)["transition_loss_m"] or 0.0) - 2.4) < 1e-9


def test_a_lean_in_hover_is_no_transition() -> None:
    values = flown(hover_deg=46.0)  # PX4 leans by 45 degrees at most
    assert values["hover_cross_track_m"] == 0.0
    assert values["transition_loss_m"] == 0.0


def test_the_tilt_of_one_that_has_landed_is_that_of_its_nose() -> None:
    assert flown()["landed_tilt_deg"] == 0.0
    assert abs((flown(landed_deg=70.0)["landed_tilt_deg"] or 0.0) - 20.0) < 1e-9


def test_the_report_draws_no_bank_and_no_stall_while_the_nose_is_up() -> None:
    vehicle = load_vehicle("tailsitter")
    track = PlaneTrack(
        STALL_MPS, vehicle.servos, STEP_NS, wind_at=lambda: STILL, commands=lambda: (), level=nose_is_lowered
    )
    for tick, elevation in enumerate((90.0, 36.0, 34.0)):
        attitude, v = nose(elevation), (15.0, 0.0, 0.0)
        track.add(
            TruthState(tick, tick * STEP_NS, (0, 0, 9), attitude, v, STILL, STILL, STILL, (700.0,) * 4, False, (0, 0))
        )
    found = track.arrays()
    for column in (found.bank_deg, found.stall_mps, found.attack_deg):
        assert np.isfinite(column).tolist() == [False, False, True]
