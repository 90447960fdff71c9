"""Total energy control on a point mass with the linear energy model that its parameters describe."""

import math

import pytest

from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.plane.tecs import Demand, Tecs, VerticalState

G = 9.80665
TRIM, CLIMB, SINK, TRIM_MPS = 0.5, 5.0, 2.0, 15.0


def params(**changes):
    table = ParamTable.of_firmware(plane=True)
    values = {"FW_THR_TRIM": TRIM, "FW_T_CLMB_MAX": CLIMB, "FW_T_SINK_MIN": SINK, **changes}
    for name, value in values.items():
        assert table.set(name, value) is None
    return table


class PointMass:
    """Energy rate proportional to throttle off trim; pitch (path angle) at once; more speed costs more."""

    def __init__(self, *, height=0.0, speed=TRIM_MPS, drag_per_mps=0.05, offset=0.0):
        self.h, self.v, self.climb, self.rate = height, speed, 0.0, 0.0
        self._drag, self._offset = drag_per_mps, offset

    def step(self, pitch, throttle, dt):
        share = throttle - TRIM
        energy = (CLIMB * share / (1.0 - TRIM) if share > 0.0 else SINK * share / TRIM) + self._offset
        energy -= self._drag * (self.v - TRIM_MPS)
        self.climb = self.v * math.sin(pitch)
        self.rate = G * (energy - self.climb) / self.v
        self.v += self.rate * dt
        self.h += self.climb * dt


def flown(plant, tecs, seconds, dt=0.02, **demand):
    pitch = throttle = 0.0
    for _ in range(int(seconds / dt)):
        state = VerticalState(plant.h, plant.climb, plant.v, plant.rate)
        wanted = Demand(**({"height_m": 0.0, "airspeed_mps": TRIM_MPS, "least_airspeed_mps": 10.0} | demand))
        pitch, throttle = tecs.step(state, wanted, dt)
        plant.step(pitch, throttle, dt)
    return pitch, throttle


def test_level_flight_at_trim_needs_the_trim_throttle():
    plant, tecs = PointMass(), Tecs(params())
    pitch, throttle = flown(plant, tecs, 60.0)
    assert throttle == pytest.approx(TRIM, abs=1e-6)
    assert pitch == pytest.approx(0.0, abs=1e-6)


def test_a_height_and_a_speed_are_reached_and_kept():
    plant, tecs = PointMass(drag_per_mps=0.1), Tecs(params())
    flown(plant, tecs, 200.0, height_m=40.0, airspeed_mps=18.0)
    assert plant.h == pytest.approx(40.0, abs=0.1)
    assert plant.v == pytest.approx(18.0, abs=0.05)


def test_a_steady_climb_has_the_throttle_and_pitch_of_its_energy():
    """E' = g h': throttle = trim + climb / limit (1 - trim); pitch = asin(climb / V)."""
    plant, tecs = PointMass(), Tecs(params())
    pitch, throttle = flown(plant, tecs, 60.0, climb_mps=2.0)
    assert throttle == pytest.approx(TRIM + 2.0 / CLIMB * (1.0 - TRIM), abs=0.005)
    assert pitch == pytest.approx(math.asin(2.0 / TRIM_MPS), abs=0.003)
    assert plant.climb == pytest.approx(2.0, abs=0.02)


def test_the_integrals_take_out_an_engine_that_is_weaker_than_its_parameters():
    plant, tecs = PointMass(offset=-0.5), Tecs(params())
    _, throttle = flown(plant, tecs, 300.0)
    assert plant.h == pytest.approx(0.0, abs=0.3)
    assert plant.v == pytest.approx(TRIM_MPS, abs=0.1)
    assert throttle == pytest.approx(TRIM + 0.5 / CLIMB * (1.0 - TRIM), abs=0.01)


def test_below_the_least_airspeed_speed_is_all_that_counts():
    plant, tecs = PointMass(speed=8.0), Tecs(params())
    pitch, throttle = flown(plant, tecs, 0.1, height_m=50.0)
    assert throttle == 1.0
    assert pitch < 0.0  # down, though the height lies above
    assert tecs.underspeed == 1.0


def test_without_engine_pitch_keeps_the_speed():
    plant, tecs = PointMass(), Tecs(params())
    flown(plant, tecs, 60.0, climb_mps=-1.0, throttle_max=0.0, speed_weight=2.0)
    assert plant.v == pytest.approx(TRIM_MPS, abs=0.2)
    assert plant.climb == pytest.approx(-SINK, abs=0.1)


def test_pitch_keeps_its_limits_and_rate():
    plant, tecs = PointMass(), Tecs(params(FW_T_VERT_ACC=7))
    before = 0.0
    for _ in range(500):
        pitch, _ = tecs.step(
            VerticalState(plant.h, plant.climb, plant.v, plant.rate),
            Demand(500.0, TRIM_MPS, 10.0, pitch_min_rad=-0.2, pitch_max_rad=0.1),
            0.02,
        )
        assert -0.2 <= pitch <= 0.1
        assert abs(pitch - before) <= 7.0 / plant.v * 0.02 + 1e-12
        before = pitch
        plant.step(pitch, 0.5, 0.02)
