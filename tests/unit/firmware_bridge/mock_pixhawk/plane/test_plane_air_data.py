"""Airspeed and wind of a plane from pitot, velocity over ground and heading."""

import math

import pytest

from firmware_bridge.mock_pixhawk.plane.air_data import AirData, Pitot, WindEstimate, true_over_calibrated

STEP_US = 20_000


def flown(air, *, wind, seconds, speed=15.0, turn_radps=0.15, pitot=True, start_us=0):
    """Fly circles in wind; return the time after it."""
    now = start_us
    yaw = 0.0
    for k in range(int(seconds * 50)):
        now += STEP_US
        yaw += turn_radps * 0.02
        if pitot:
            pressure = 0.5 * 1.225 * (speed / air.ratio) ** 2 / 100.0
            air.pitot.take(now, pressure * (1.0 + 1e-9 * (k % 7)))  # a live sensor's samples differ
        ground = (speed * math.cos(yaw) + wind[0], speed * math.sin(yaw) + wind[1], 0.0)
        air.step(
            now,
            ground_NED_mps=ground,
            acceleration_NED_mps2=(0.0, 0.0, 0.0),
            yaw_rad=math.remainder(yaw, math.tau),
            altitude_m=500.0,
            flying=True,
        )
    return now


def test_true_over_calibrated_airspeed_of_the_standard_atmosphere():
    # ISA: rho = 1.1673 kg/m3 at 500 m, 0.7361 kg/m3 at 5000 m
    assert true_over_calibrated(0.0) == pytest.approx(1.0)
    assert true_over_calibrated(500.0) == pytest.approx(math.sqrt(1.225 / 1.1673), abs=1e-4)
    assert true_over_calibrated(5000.0) == pytest.approx(math.sqrt(1.225 / 0.7361), abs=1e-4)


@pytest.mark.parametrize("pitot", [True, False])
def test_the_wind_is_found_in_turns_with_and_without_pitot(pitot):
    air = AirData(pitot=True)
    flown(air, wind=(4.0, -6.0), seconds=120.0, pitot=pitot)
    assert air.wind_mps == pytest.approx((4.0, -6.0), abs=0.2)
    assert air.source == ("pitot" if pitot else "wind")
    assert air.true_mps == pytest.approx(15.0, abs=0.2)
    assert air.airspeed_mps == pytest.approx(15.0 / air.ratio, abs=0.2)


def test_without_knowledge_of_the_wind_the_speed_over_ground_counts():
    air = AirData(pitot=True)
    flown(air, wind=(4.0, 0.0), seconds=0.5, pitot=False, turn_radps=0.0)
    assert air.source == "ground"
    assert air.true_mps == pytest.approx(19.0)
    assert air.wind_mps == (0.0, 0.0)


def test_a_pitot_that_freezes_or_falls_silent_is_given_up():
    air = AirData(pitot=True)
    now = flown(air, wind=(3.0, 3.0), seconds=60.0)
    for _ in range(200):
        now += STEP_US
        air.pitot.take(now, 1.3)
    assert not air.pitot.healthy(now)
    flown(air, wind=(3.0, 3.0), seconds=2.0, pitot=False, start_us=now)
    assert air.source == "wind"
    silent = Pitot()
    silent.take(1, 0.5)
    assert silent.healthy(500_000)
    assert not silent.healthy(2_000_000)


def test_use_of_the_pitot_can_be_forbidden():
    air = AirData(pitot=False)
    flown(air, wind=(0.0, 0.0), seconds=1.0)
    assert air.source == "ground"


def test_on_the_ground_no_wind_is_learnt():
    wind = WindEstimate()
    wind.step(ground_mps=(10.0, 0.0), yaw_rad=0.0, airspeed_mps=5.0, dt_s=0.02)
    wind.reset()
    assert (wind.n_mps, wind.e_mps, wind.known) == (0.0, 0.0, False)
