"""Parts of the estimator: derivatives, telemetry, windows, what a prediction may know, the fitted vehicle."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hil.apps.identify.fit import estimate
from hil.apps.identify.fit import parameters as at
from hil.apps.identify.fit.estimate import step_of, windows_of
from hil.apps.identify.fit.fitted_vehicle import fitted_vehicle
from hil.apps.identify.fit.flight_model import halving_error, make_model
from hil.apps.identify.fit.integration import Step
from hil.apps.identify.fit.motor_telemetry import smoothed, without_spikes
from hil.apps.identify.fit.prediction import Grid, Predictor
from hil.apps.identify.fit.shooting import first_states, sums
from hil.apps.identify.fit.windows import Motors, Windows, within_steps
from hil.run.flight_logs.flight_log import FlightLog, Series
from signals.errors import ConfigError
from sim.physics.vehicle import load_vehicle
from tests.worlds.excited_flight import Sensing, excited_log, hidden_vehicle, nominal_vehicle


@pytest.fixture(scope="module")
def log() -> FlightLog:
    return excited_log(hidden_vehicle(nominal_vehicle(), 5), seed=5, duration_s=6.0, sensing=Sensing(imu_delay_s=0.005))


def speeds_of(log: FlightLog) -> FlightLog:
    """The log with telemetry of speeds in place of commands."""
    c = nominal_vehicle().rotor_constants
    return replace(log, motors=Series(log.motors.t_s, log.motors.values * c.max_speed_radps), motors_kind="speed_radps")


@pytest.mark.parametrize("kind", ["command", "speed_radps"])
def test_gradient_is_that_of_the_cost(kind: str, log: FlightLog) -> None:
    """Central differences of the cost, to every unknown and to the states at the start."""
    vehicle = nominal_vehicle()
    log = log if kind == "command" else speeds_of(log)
    unknowns = at.vehicle_unknowns(vehicle) + at.log_unknowns("a")
    model = make_model(vehicle, unknowns, kind=kind, step_s=0.008)  # type: ignore[arg-type]
    windows = Windows(log, 0, np.array([2.0, 3.1]), 12, 0.008, Motors.of(log), 1.0)
    group = first_states(model, windows)
    if kind == "command":
        group.z0[13:17] = 700.0
        group.prior_mean[13:17] = 700.0
    s = np.array([0.02 * u.prior for u in unknowns])
    found = sums(model, group, s)
    for i, unknown in enumerate(unknowns):
        if i == at.VOLTAGE:
            continue  # no voltage is logged
        step = 1e-5 * unknown.prior
        costs = [sums(model, group, s + sign * step * np.eye(len(s))[i]).cost for sign in (1.0, -1.0)]
        slope = (costs[0] - costs[1]) / (2.0 * step)
        size = max(abs(slope), 1e-6 * abs(found.cost) / unknown.prior)
        assert found.gs[:, i].sum() == pytest.approx(slope, abs=2e-4 * size), unknown.key


def test_a_step_is_accurate(log: FlightLog) -> None:
    vehicle = nominal_vehicle()
    unknowns = at.vehicle_unknowns(vehicle) + at.log_unknowns("a")
    whole, half = (make_model(vehicle, unknowns, kind="command", step_s=h) for h in (0.008, 0.004))
    z = np.zeros(whole.states)
    z[3], z[7:13], z[13:17] = 1.0, (3.0, -2.0, 1.0, 2.0, -3.0, 1.0), 650.0
    u = Motors.of(log).inputs(np.array([2.0]), 0.008)[:, 0]
    assert halving_error(whole, half, z, np.zeros(len(unknowns)), np.r_[u, 1.0, -1e4]) < 5e-4


@pytest.mark.parametrize(("period_s", "step_s"), [(0.004, 0.004), (0.005, 0.005), (0.0025, 0.005), (0.01, 0.008)])
def test_steps_begin_where_fast_commands_change(log: FlightLog, period_s: float, step_s: float) -> None:
    t = 0.0013 + np.arange(0.0, 6.0, period_s)
    held = replace(log, motors=Series(t, np.full((len(t), 4), 0.5)))
    assert step_of([held]) == pytest.approx(step_s, abs=1e-9)
    windows = windows_of(held, 0, step_s, parts=lambda share: True, nominal_v=1.0, window_s=0.5)
    if period_s <= step_s:
        phase = ((windows.instants() - t[0]) / period_s + 0.5) % 1.0 - 0.5
        assert np.abs(phase).max() < 1e-6
    assert windows.starts_s[0] >= held.start_s


def test_the_state_within_a_step_is_that_of_a_shorter_step(log: FlightLog) -> None:
    """Third order: where the step is halved the difference is a tenth of what it was, or less."""
    vehicle = nominal_vehicle()
    unknowns = at.vehicle_unknowns(vehicle) + at.log_unknowns("a")
    command, share = np.array([0.45, 0.62, 0.5, 0.7]), 0.3
    u = np.r_[np.tile(np.r_[command, np.zeros(8)], 3), 1.0, -1e4][:, None]
    off = []
    for h in (0.008, 0.004):
        whole, part = (make_model(vehicle, unknowns, kind="command", step_s=x) for x in (h, share * h))
        z = np.zeros((whole.states, 1))
        z[3], z[7:13, 0], z[13:17] = 1.0, (3.0, -2.0, 1.0, 2.0, -3.0, 1.0), 650.0
        step = Step(whole, 1)
        step.start(z, np.zeros((len(unknowns), 1)), u)
        there = step.within(np.array([share]), slice(10, 17))
        off.append(np.abs(there.z - part.step(z, np.zeros(len(unknowns)), u[:, 0]).full())[10:17].max())
        end, F, B = step.end()
        last = step.within(np.ones(1), slice(0, whole.states))
        np.testing.assert_allclose(last.z, end, rtol=1e-14)
        np.testing.assert_allclose(last.F, F, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(last.B, B, rtol=0.0, atol=1e-12)
    assert off[0] < 0.5  # rad/s, of speeds that change by 40
    assert off[1] < 0.1 * off[0]


def test_every_reading_is_used_once_in_its_own_step() -> None:
    h, n = 0.004, 400
    grid_s = 0.1 + h * np.arange(n)
    random = np.random.default_rng(4)
    for t_s in (grid_s[3:-3], grid_s[3:-3] + 0.5 * h, grid_s[3:-3] + 0.2 * h + 0.3 * h * random.random(n - 6)):
        index, known = within_steps(t_s, grid_s, h)
        assert known.sum() == len(t_s)
        np.testing.assert_array_equal(index[known], np.arange(len(t_s)))
        assert np.all(np.abs(t_s - grid_s[known] - 0.5 * h) <= 0.5 * h)
    index, known = within_steps(np.arange(0.0, 2.0, 0.25 * h) + 1e-5, grid_s, h)  # several in a step: the first
    assert known.all()
    assert np.unique(index).size == n


def test_a_delay_moves_the_readings_and_not_the_commands(log: FlightLog) -> None:
    windows = Windows(log, 0, np.array([2.0, 3.1]), 12, 0.004, Motors.of(log), 1.0)
    (y, _, share), (moved, _, later) = windows.readings(0.0, 0.0), windows.readings(0.001, 0.0)
    np.testing.assert_allclose(later[:, 0], share[:, 0] + 0.25, atol=1e-9)
    np.testing.assert_array_equal(moved[:, :3], y[:, :3])
    _, _, pose = windows.readings(0.001, 0.001)
    np.testing.assert_array_equal(pose[:, 2:], share[:, 2:])


def test_spikes_of_telemetry_are_taken_out_by_the_past_alone() -> None:
    y = np.full((50, 2), 1700.0) + 20.0 * np.random.default_rng(1).standard_normal((50, 2))
    spiked = y.copy()
    spiked[20, 1] = 104_730.0
    clean = without_spikes(spiked)
    assert clean[20, 1] == y[19, 1]
    clean[20, 1] = y[20, 1]
    np.testing.assert_array_equal(clean, y)
    start = np.r_[np.full(5, 500.0), np.full(5, 1700.0)][:, None]  # a true leap is believed in the end
    assert without_spikes(start)[-1, 0] == 1700.0


def test_smoothing_takes_noise_out_and_looks_no_further_than_its_lag() -> None:
    t = np.arange(0.0, 12.0, 0.01)
    true = 1700.0 + 120.0 * np.sin(2 * np.pi * 1.3 * t)[:, None]
    noisy = true + 15.0 * np.random.default_rng(2).standard_normal(true.shape)
    found, slopes = smoothed(Series(t, noisy))
    assert np.std(found - true) < 0.6 * 15.0
    assert np.std(slopes[:, 0] - 120.0 * 2 * np.pi * 1.3 * np.cos(2 * np.pi * 1.3 * t)) < 400.0
    later = noisy.copy()
    later[900:] += 300.0
    lagged = [smoothed(Series(t, x), lag=1)[0] for x in (noisy, later)]
    np.testing.assert_array_equal(lagged[0][:899], lagged[1][:899])


def test_predictions_know_no_sensor_of_the_future_and_no_motor_beyond_the_horizon(log: FlightLog) -> None:
    """Readings after the start of a prediction, and telemetry after its horizon, change nothing."""
    log = speeds_of(log)
    predictor = Predictor(nominal_vehicle(), "speed_radps")
    cut_s = 4.0

    def states(changed: FlightLog) -> np.ndarray:
        grid = Grid.of([changed], 0.01, 1.0)
        found = predictor.track(grid)
        k = np.flatnonzero(grid.t_s[:, 0] <= cut_s - 0.1)[-1:]
        kept = replace(grid, measured=np.zeros_like(grid.measured))
        kept.measured[:, 3] = 1.0
        return predictor._errors(kept, found, 0, k, [10])[10]

    def after(series: Series | None, first_s: float) -> Series | None:
        if series is None:
            return None
        values = series.values.copy()
        values[series.t_s > first_s + 1e-9] *= 1.05
        return Series(series.t_s, values)

    start_s = cut_s - 0.1
    moved = replace(
        log,
        pose=after(log.pose, start_s),
        velocity=after(log.velocity, start_s),
        rate=after(log.rate, start_s),
        motors=after(log.motors, cut_s),
    )
    np.testing.assert_array_equal(states(log), states(moved))


def test_fitted_numbers_stand_in_the_vehicle() -> None:
    vehicle = load_vehicle("x500")
    unknowns = at.vehicle_unknowns(vehicle)
    s = np.zeros(at.VEHICLE_COUNT)
    s[at.THRUST], s[at.AIR_MOMENT], s[at.CENTRE], s[at.ROTOR_DRAG] = 0.1, 2e-3, 0.01, -1.0
    found = fitted_vehicle(vehicle, unknowns, s)
    c = vehicle.rotor_constants
    assert found.rotor_constants.thrust_coefficient_n_per_radps2 == pytest.approx(
        c.thrust_coefficient_n_per_radps2 * np.exp(0.1)
    )
    assert found.rotor_constants.drag_kg_per_rad == 0.0  # a file cannot say less
    assert found.rotor_model == vehicle.rotor_model == "blade_element"  # it flies what was fitted
    assert found.rotors[0].position_m[0] == pytest.approx(vehicle.rotors[0].position_m[0] - 0.01)
    assert [force.about_x_ns for force in found.forces if force.kind == "air_moment"] == [2e-3]  # type: ignore[attr-defined]
    again = at.vehicle_unknowns(found)
    assert again[at.AIR_MOMENT].start == 2e-3
    same = fitted_vehicle(vehicle, unknowns, np.zeros(at.VEHICLE_COUNT))
    assert same.inertia_kgm2 == pytest.approx(vehicle.inertia_kgm2)
    assert same.forces == ()


def test_flights_without_poses_are_refused(log: FlightLog) -> None:
    without = replace(log, pose=None, source=Path("blind.ulg"))
    with pytest.raises(ConfigError, match=r"blind.ulg.*poses"):
        estimate([without], nominal_vehicle(), fixed={}, progress=lambda share, what: None)
