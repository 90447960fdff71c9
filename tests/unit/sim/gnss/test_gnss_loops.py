"""Loops of a receiver: multipath against the discriminator itself, locks, kinds of fix, jamming."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim.gnss.decibel import decibel, power
from sim.gnss.interference import Emitter, jammed_dbhz, received_dbw, tolerated_js_db
from sim.gnss.multipath import code_error_chips, loop_errors, reflection_amplitude
from sim.gnss.parameters import ReceiverParameters
from sim.gnss.solution import DGPS, FIX_2D, FIX_3D, FIXED, FLOAT, NO_FIX, SolutionState
from sim.gnss.tracking import Tracking

S = 1_000_000_000


def triangle(t: float) -> float:
    return max(0.0, 1.0 - abs(t))


def zero_of_discriminator(a: float, delay: float, d: float) -> float:
    """The root next to 0 of the early-minus-late correlator with a reflection, by bisection."""

    def early_minus_late(e: float) -> float:
        direct = triangle(e + d / 2) - triangle(e - d / 2)
        return direct + a * (triangle(e - delay + d / 2) - triangle(e - delay - d / 2))

    low, high = -0.7, 0.7
    grid = np.linspace(low, high, 4001)
    values = [early_minus_late(float(e)) for e in grid]
    crossings = [i for i in range(4000) if values[i] > 0.0 >= values[i + 1]]
    i = min(crossings, key=lambda i: abs(grid[i]))
    low, high = float(grid[i]), float(grid[i + 1])
    for _ in range(60):
        middle = 0.5 * (low + high)
        if early_minus_late(middle) > 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@pytest.mark.parametrize("d", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("a", [0.5, 0.2, -0.2, -0.5])
def test_the_code_error_is_the_zero_of_the_discriminator(a: float, d: float) -> None:
    for delay in np.linspace(0.01, 1.6, 40).tolist():
        assert code_error_chips(a, delay, d) == pytest.approx(zero_of_discriminator(a, delay, d), abs=1e-6)


def test_the_envelope_has_the_published_corners() -> None:
    # Narrow correlator, half the amplitude: the error is at most a d / 2 chips, 7.3 m for 0.1 chip.
    a, d, chip_m = 0.5, 0.1, 293.05
    errors = [code_error_chips(a, float(delay), d) * chip_m for delay in np.linspace(0.0, 1.2, 500)]
    assert max(errors) == pytest.approx(a * d / 2 * chip_m, rel=1e-6)
    assert code_error_chips(a, 1.0 + d / 2, d) == 0.0
    assert code_error_chips(a, (1.0 + a) * d / 2, d) == pytest.approx(a * d / 2)


def test_the_carrier_error_is_the_angle_of_the_sum() -> None:
    for phase in np.linspace(-3.0, 3.0, 13).tolist():
        for delay in (0.01, 0.3, 0.8):
            a = 0.4
            whole = 1.0 + a * triangle(delay) * complex(math.cos(phase), math.sin(phase))
            errors = loop_errors(a, delay, phase, spacing_chips=0.1)
            assert errors.phase_rad == pytest.approx(math.atan2(whole.imag, whole.real), abs=1e-12)
            assert errors.amplitude == pytest.approx(abs(whole))
    assert loop_errors(1.0, 0.0, 2.0, spacing_chips=0.1).phase_rad < math.pi / 2  # a quarter of a wave at most


def test_fading_that_is_fast_averages_the_code_error_out() -> None:
    slow, fast = (loop_errors(0.4, 0.2, 0.3, spacing_chips=0.1, fading_hz=hz).code_chips for hz in (0.0, 100.0))
    assert abs(fast) < 0.011 * abs(slow)


def test_reflections_obey_fresnel() -> None:
    # Straight on, a dielectric of 4 reflects a third, all of it left-handed.
    assert reflection_amplitude(1.0, 4.0, conducts=False, cross_polar=1.0) == pytest.approx(1.0 / 3.0)
    assert reflection_amplitude(1.0, 4.0, conducts=False, cross_polar=0.0) == pytest.approx(0.0)
    # At grazing incidence everything is reflected, right-handed as it came.
    assert reflection_amplitude(1e-6, 4.0, conducts=False, cross_polar=0.0) == pytest.approx(1.0, abs=1e-4)
    # At Brewster's angle the parallel part vanishes: both circular parts are equal.
    brewster = math.cos(math.atan(2.0))
    right = reflection_amplitude(brewster, 4.0, conducts=False, cross_polar=0.0)
    both = reflection_amplitude(brewster, 4.0, conducts=False, cross_polar=1.0)
    assert both == pytest.approx(math.sqrt(2.0) * right)
    assert reflection_amplitude(0.5, 4.0, conducts=True, cross_polar=0.3) == pytest.approx(0.3)


def test_a_jammer_weakens_by_its_power_and_distance() -> None:
    emitter = Emitter((0.0, 0.0, 0.0), 0.0, "wide", 25.0)
    near, far = (received_dbw(emitter, d, gain_db=0.0, hidden=False) for d in (100.0, 1000.0))
    assert near - far == pytest.approx(20.0)
    wavelength = 299_792_458.0 / 1575.42e6
    assert near == pytest.approx(20.0 * math.log10(wavelength / (4.0 * math.pi * 100.0)))
    assert received_dbw(emitter, 100.0, gain_db=-5.0, hidden=True) == pytest.approx(near - 30.0)


def test_the_tolerated_jamming_is_where_the_signal_is_lost() -> None:
    limit = tolerated_js_db(45.0, 22.0, 2.22, 1.023e6)
    assert jammed_dbhz(45.0, ((limit, 2.22),), 1.023e6) == pytest.approx(22.0)
    assert limit == pytest.approx(10.0 * math.log10(2.22 * 1.023e6 * (10.0**-2.2 - 10.0**-4.5)))
    assert jammed_dbhz(45.0, (), 1.023e6) == pytest.approx(45.0)
    assert power(0.0) == 1.0
    assert decibel(power(13.0)) == pytest.approx(13.0)


def receiver(**changes: float) -> ReceiverParameters:
    return ReceiverParameters(tracking_dbhz=22.0, acquisition_dbhz=28.0, reacquisition_s=2.0, **changes)  # type: ignore[arg-type]


def test_a_lost_signal_comes_back_after_its_reacquisition() -> None:
    tracking = Tracking(receiver(), 6, start="tracking")
    good = [40.0] * 6
    assert all(tracking.update(0, good))
    weak = [25.0, *good[1:]]
    assert all(tracking.update(1 * S, weak))  # below the level to be found, above that to be kept
    assert tracking.update(2 * S, [20.0, *good[1:]])[0] is False
    assert tracking.update(3 * S, weak)[0] is False  # too weak to be found
    assert tracking.update(4 * S, good)[0] is False
    assert tracking.update(5 * S, good)[0] is False
    assert tracking.update(6 * S, good)[0] is True


@pytest.mark.parametrize(("start", "after_s"), [("cold", 26), ("warm", 25), ("hot", 1), ("tracking", 0)])
def test_the_first_fix_takes_the_time_of_its_start(start: str, after_s: int) -> None:
    tracking = Tracking(receiver(), 5, start=start)
    first = next(t for t in range(60) if any(tracking.update(t * S, [40.0] * 5)))
    assert first == after_s


def test_a_cold_start_waits_for_four_signals() -> None:
    tracking = Tracking(receiver(), 5, start="cold")
    few = [40.0, 40.0, 40.0, float("-inf"), float("-inf")]
    assert not any(any(tracking.update(t * S, few)) for t in range(60))


def test_after_a_long_loss_a_receiver_starts_hot() -> None:
    tracking = Tracking(receiver(hot_start_s=5.0), 5, start="tracking")
    nothing, good = [float("-inf")] * 5, [40.0] * 5
    tracking.update(0, good)
    for t in range(1, 20):
        assert not any(tracking.update(t * S, nothing))
    back = next(t for t in range(20, 60) if all(tracking.update(t * S, good)))
    assert back == 24  # the time since the last sample counts


def update(state: SolutionState, t_s: float, **changes: float) -> int:
    values = {"used": 10, "solved": True, "pdop": 2.0, "common": 10, "phase_rms_m": 0.002, **changes}
    return state.update(round(t_s * S), **values)  # type: ignore[arg-type]


def test_kinds_of_fix_follow_the_satellites() -> None:
    state = SolutionState(FIX_3D, 10.0, started=True)
    assert update(state, 0) == FIX_3D
    assert update(state, 1, used=3) == FIX_2D
    assert update(state, 2, used=2) == NO_FIX
    assert update(state, 3, pdop=25.0) == NO_FIX
    assert update(state, 4, solved=False) == NO_FIX
    assert update(SolutionState(DGPS, 10.0, started=True), 0) == DGPS


def test_rtk_has_hysteresis_and_takes_its_time() -> None:
    state = SolutionState(FIXED, 10.0, started=False)
    assert update(state, 0) == FLOAT
    assert update(state, 9.9) == FLOAT
    assert update(state, 10.0) == FIXED
    assert update(state, 11.0, common=5, phase_rms_m=0.018) == FIXED  # kept
    assert update(state, 12.0, common=5, phase_rms_m=0.021) == FLOAT
    assert update(state, 13.0, common=5) == FLOAT  # six are needed to become fixed
    assert update(state, 14.0) == FLOAT
    assert update(state, 23.9) == FLOAT
    assert update(state, 24.0) == FIXED
    assert update(state, 25.0, common=4) == DGPS
    assert update(SolutionState(FIXED, 10.0, started=True), 0) == FIXED
