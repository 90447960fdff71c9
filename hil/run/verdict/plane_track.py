"""Series that a plane's report shows beside the flown path: airspeeds, angles of the flow, energy, surfaces."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.run.verdict.air_data import air_data
from hil.run.verdict.plane_flight import bank_rad, stall_at
from signals.detections import Detections
from signals.samples import DifferentialPressureSample, Sample, TruthState, Vec3
from signals.time import NS_PER_S
from signals.units import DEG_PER_RAD, STANDARD_GRAVITY_MPS2
from sim.physics.forces.surface import Surface
from sim.physics.forces.tilt import Tilt
from sim.scene.atmosphere import SEA_LEVEL_KGPM3

_RATE_HZ = 10
_LEAST_MPS = 3.0  # airspeed below which the angles of the flow mean nothing
_MAX_ROWS = 36_000  # an hour
_FIXED = 9  # columns before those of the surfaces


class PlaneTrackArrays(NamedTuple):
    """One row per kept tick."""

    t_s: NDArray[np.float64]
    airspeed_mps: NDArray[np.float64]  # true
    indicated_mps: NDArray[np.float64]  # of the newest sample of the pitot tube; NaN without one
    stall_mps: NDArray[np.float64]  # at the load of the bank; NaN while a tailsitter's nose is up
    attack_deg: NDArray[np.float64]  # NaN while slow or on the ground
    sideslip_deg: NDArray[np.float64]
    bank_deg: NDArray[np.float64]  # NaN while a tailsitter's nose is up
    height_m: NDArray[np.float64]  # over the start
    energy_m: NDArray[np.float64]  # height and speed together: h + V^2 / 2g
    surface_deg: NDArray[np.float64]  # (n, surfaces)
    command_deg: NDArray[np.float64]  # (n, surfaces), of the tick before

    @property
    def energy_rate_mps(self) -> NDArray[np.float64]:
        """Change of the energy, over one second."""
        if len(self.t_s) < 2:
            return np.zeros(len(self.t_s))
        ends = np.interp([self.t_s - 0.5, self.t_s + 0.5], self.t_s, self.energy_m)
        times = np.clip([self.t_s - 0.5, self.t_s + 0.5], self.t_s[0], self.t_s[-1])
        rate: NDArray[np.float64] = (ends[1] - ends[0]) / (times[1] - times[0])
        return rate


class PlaneTrack:
    """Keeps ten rows a second, at most an hour. A tap: it takes the pitot tube's samples."""

    def __init__(
        self,
        stall_mps: float,
        servos: Sequence[Tilt | Surface],
        tick_ns: int,
        *,
        wind_at: Callable[[], Vec3],
        commands: Callable[[], Sequence[float]],
        level: Callable[[TruthState], bool] = lambda _: True,
    ) -> None:
        """`commands` returns the present commands of the servos, -1..1. `level`: a bank means something."""
        self._level = level
        self._stall_mps, self._wind_at, self._commands = stall_mps, wind_at, commands
        self._servos = servos
        self._indicated_mps = math.nan
        self._stride = max(1, NS_PER_S // _RATE_HZ // tick_ns)
        self._rows = array("d")
        self._columns = _FIXED + 2 * len(servos)
        self._home_up: float | None = None

    def add(self, truth: TruthState) -> None:
        """Keep this tick if it is due."""
        if truth.tick % self._stride or len(self._rows) >= _MAX_ROWS * self._columns:
            return
        if self._home_up is None:
            self._home_up = truth.p_WB[2]
        airspeed, attack, sideslip = air_data(truth, self._wind_at())
        level = self._level(truth)
        fast = airspeed >= _LEAST_MPS and not truth.in_contact and level
        bank = bank_rad(truth) if level else math.nan
        height = truth.p_WB[2] - self._home_up
        commands = (tuple(self._commands()) + (0.0,) * len(self._servos))[: len(self._servos)]
        self._rows.extend(
            (
                truth.t_ns / NS_PER_S,
                airspeed,
                self._indicated_mps,
                stall_at(self._stall_mps, bank) if level else math.nan,
                attack * DEG_PER_RAD if fast else math.nan,
                sideslip * DEG_PER_RAD if fast else math.nan,
                bank * DEG_PER_RAD,
                height,
                height + airspeed * airspeed / (2.0 * STANDARD_GRAVITY_MPS2),
                *(angle * DEG_PER_RAD for angle in truth.surface_rad),
                *(s.deflection_rad(u) * DEG_PER_RAD for s, u in zip(self._servos, commands, strict=True)),
            )
        )

    def arrays(self) -> PlaneTrackArrays:
        """Return copies of the kept ticks."""
        rows = np.array(self._rows, np.float64).reshape(-1, self._columns)
        n = len(self._servos)
        columns = [*rows[:, :_FIXED].T, rows[:, _FIXED : _FIXED + n], rows[:, _FIXED + n :]]
        return PlaneTrackArrays(*columns)

    def sample(self, port: str, sample: Sample) -> None:  # noqa: ARG002 (any pitot tube's)
        if isinstance(sample, DifferentialPressureSample):
            pressure = sample.differential_pressure_pa
            self._indicated_mps = math.copysign(math.sqrt(2.0 * abs(pressure) / SEA_LEVEL_KGPM3), pressure)

    def event(self, t_ns: int, kind: str, text: str) -> None: ...

    def detected(self, client: str, detections: Detections) -> None: ...
