"""Multi-step prediction of logged flights: state from the past, motion from the model and what the motors did.

From each instant k of a log the state that the filter has from readings up to k is advanced to k + horizon with the
motors' readings up to there, and compared with what was measured then: mean norms of the errors of position, velocity,
rotation angle and rate. No reading of a sensor after k is used; of the motors none after the horizon. The filter knows
neither the log's delay of the motors nor its biases beforehand: it learns them while the log goes by, and the first
`LEARNING_S` of a log are not begun from.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil.apps.identify.fit import flight_model as fm
from hil.apps.identify.fit import parameters as at
from hil.apps.identify.fit.flight_model import FlightModel, make_model
from hil.apps.identify.fit.state_filter import FilterNoise, Track, track
from hil.apps.identify.fit.windows import Motors
from hil.apps.identify.fit_result import Prediction
from hil.run.flight_logs.flight_log import FlightLog, Series
from sim.physics.vehicle import Vehicle

Array = NDArray[np.float64]

HORIZONS_S = (0.01, 0.1, 0.5)
LEARNING_S = 1.0
LAG = 1  # samples of telemetry after an instant that its speed is made of
# Before the filter has learnt it. The mean of what it found in eight flights of one telemetry is -0.0137 s.
FIRST_DELAY_S = {"speed_radps": -0.0125, "command": 0.0}
POSE_DELAY_S = 0.0
_MOST_COLUMNS = 4000  # predictions at a time: bounds the memory


@dataclass(frozen=True)
class Grid:
    """Logs side by side on grids of their own times: readings [n, 13, L] = p, q, v, w, and where they are known."""

    logs: Sequence[FlightLog]
    t_s: Array  # [n, L]
    measured: Array
    known: NDArray[np.bool_]
    motors: Sequence[Motors]
    volts: Array  # [n, L] over the nominal voltage

    @staticmethod
    def of(logs: Sequence[FlightLog], step_s: float, nominal_v: float) -> Grid:
        n = max(int(log.duration_s / step_s + 1e-6) + 1 for log in logs)
        shape = (n, len(logs))
        t, known, volts = np.zeros(shape), np.zeros(shape, bool), np.ones(shape)
        measured = np.zeros((n, 13, len(logs)))
        for j, log in enumerate(logs):
            if log.pose is None:
                raise ValueError(f"{log.name}: predictions need poses")
            first = log.pose.t_s[min(int(np.searchsorted(log.pose.t_s, log.start_s)), len(log.pose) - 1)]
            t[:, j] = first + np.arange(n) * step_s
            known[:, j] = t[:, j] <= log.end_s + 1e-9
            measured[:, :7, j] = _latest(log.pose, t[:, j], step_s)
            speed = log.velocity or Series(log.pose.t_s, _slope(log.pose))
            measured[:, 7:10, j] = _latest(speed, t[:, j], step_s)
            if log.rate is not None:
                measured[:, 10:, j] = _latest(log.rate, t[:, j], step_s)
            if log.voltage is not None:
                volts[:, j] = np.interp(t[:, j], log.voltage.t_s, log.voltage.values[:, 0]) / nominal_v
        return Grid(logs, t, measured, known, [Motors.of(log, lag=LAG) for log in logs], volts)


def _latest(series: Series, t_s: Array, step_s: float) -> Array:
    """Return the latest reading at each instant; one within a hundredth of a step later counts as of the instant."""
    i = np.searchsorted(series.t_s, t_s + 0.01 * step_s, "right") - 1
    return series.values[np.clip(i, 0, len(series) - 1)]


def _slope(pose: Series) -> Array:
    """Velocity from the last two positions."""
    change = np.diff(pose.values[:, :3], axis=0) / np.diff(pose.t_s)[:, None]
    return np.vstack([change[:1], change])


def _inputs(grid: Grid, delay_s: float, step_s: float) -> Array:
    parts = []
    for j, motors in enumerate(grid.motors):
        t = grid.t_s[:, j]
        known_s = t + (1 - LAG) * step_s
        ground = np.full(len(t), grid.logs[j].ground_or_far_below_m)
        parts.append(np.vstack([motors.inputs(t + delay_s, step_s, latest_s=known_s), grid.volts[:, j], ground]))
    return np.stack(parts, axis=-1).transpose(1, 0, 2)


class Predictor:
    """A vehicle's model with its filter, for logs of one kind."""

    def __init__(self, vehicle: Vehicle, kind: str, *, step_s: float = 0.01) -> None:
        unknowns = at.vehicle_unknowns(vehicle)
        # `delayed`: the filter learns the delay.
        self.model: FlightModel = make_model(vehicle, unknowns, kind=kind, step_s=step_s, delayed=True)  # type: ignore[arg-type]
        self.noise = FilterNoise()
        self.nominal_v = vehicle.battery.nominal_voltage_v if vehicle.battery else 1.0
        self._s = np.zeros(at.VEHICLE_COUNT + at.LOG_COUNT)
        self._first_delay_s = FIRST_DELAY_S[kind]

    def track(self, grid: Grid) -> Track:
        """Return the filtered states of the logs."""
        step_s = self.model.step_s
        return track(
            self.model, self._s, _inputs(grid, self._first_delay_s, step_s), grid.measured, grid.known,
            pose_delay_s=POSE_DELAY_S, first_delay_s=self._first_delay_s, noise=self.noise,
        )  # fmt: skip

    def errors(
        self, grid: Grid, found: Track, log: int, *, horizons: Sequence[int], every: int = 1,
        part: Callable[[Array], NDArray[np.bool_]] | None = None,
    ) -> dict[int, Array]:  # fmt: skip
        """Return the errors [4, starts] at each horizon, in steps: position, velocity, rotation, rate.

        `part` takes the starts' times and says which belong to the part to be predicted.
        """
        step_s, longest = self.model.step_s, max(horizons)
        last = int(grid.known[:, log].sum()) - longest
        starts = np.arange(round(LEARNING_S / step_s), max(last, 0), every)
        if part is not None:
            starts = starts[part(grid.t_s[starts, log])]
        chunks = [starts[i : i + _MOST_COLUMNS] for i in range(0, len(starts), _MOST_COLUMNS)]
        parts = [self._errors(grid, found, log, k, horizons) for k in chunks]
        return {h: np.concatenate([p[h] for p in parts], axis=1) if parts else np.zeros((4, 0)) for h in horizons}

    def _errors(
        self, grid: Grid, found: Track, log: int, k: NDArray[np.int64], horizons: Sequence[int]
    ) -> dict[int, Array]:
        step_s, longest, noise = self.model.step_s, max(horizons), self.noise
        keep = np.ones((self.model.states, len(k)))
        keep[10:13] = np.exp(-step_s * found.decay_per_s[k, :, log].T)
        trust = found.trust[k, :, log].T
        rho = found.rho[k, log]
        keep[-6:-3], keep[-3:] = np.exp(-step_s / noise.push_bias_s), np.exp(-step_s / noise.turn_bias_s)
        z, delay = found.z[k, :, log].T.copy(), found.delay_s[k, log]
        t0 = grid.t_s[k, log]
        S = np.repeat(self._s[:, None], len(k), axis=1)
        step = self.model.step.map(len(k))
        ground = np.full(len(k), grid.logs[log].ground_or_far_below_m)
        out = {}
        for h in range(longest):
            u = grid.motors[log].inputs(t0 + h * step_s + delay, step_s, latest_s=t0 + (h + 1 - LAG) * step_s)
            before, p0 = z[10:13], z[:2]
            z = step(z, S, np.vstack([u, grid.volts[k, log], ground])).full()
            z[10:13] = before + trust * (z[10:13] - before)
            z *= keep
            z[:2] = p0 + rho * (z[:2] - p0)
            if h + 1 in horizons:
                y = grid.measured[k + h + 1, :, log].T
                q = np.abs((z[fm.Q] * y[fm.Q]).sum(axis=0)) / np.linalg.norm(y[fm.Q], axis=0)
                out[h + 1] = np.array(
                    [
                        np.linalg.norm(z[fm.P] - y[fm.P], axis=0),
                        np.linalg.norm(z[fm.V] - y[fm.V], axis=0),
                        2.0 * np.arccos(np.clip(q, 0.0, 1.0)),
                        np.linalg.norm(z[fm.W] - y[fm.W], axis=0),
                    ]
                )
        return out


def predictions(
    predictor: Predictor, logs: Sequence[FlightLog], *, every: int = 1,
    part: Callable[[FlightLog, Array], NDArray[np.bool_]] | None = None,
) -> list[Prediction]:  # fmt: skip
    """Return the mean errors of each log at each horizon."""
    grid = Grid.of(logs, predictor.model.step_s, predictor.nominal_v)
    found = predictor.track(grid)
    steps = [max(1, round(h / predictor.model.step_s)) for h in HORIZONS_S]
    out = []
    for j, log in enumerate(logs):
        chosen = None if part is None else (lambda t, log=log: part(log, t))
        errors = predictor.errors(grid, found, j, horizons=steps, every=every, part=chosen)
        for horizon_s, h in zip(HORIZONS_S, steps, strict=True):
            e = errors[h]
            mean = e.mean(axis=1) if e.shape[1] else np.full(4, np.nan)
            rate = float(mean[3]) if log.rate is not None else float("nan")
            out.append(Prediction(log.name, horizon_s, float(mean[0]), float(mean[1]), float(mean[2]), rate))
    return out
