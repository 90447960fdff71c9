"""The flown track for the report, decimated to a bounded size for any length of run."""

from __future__ import annotations

from array import array
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signals.samples import ActuatorFrame, TruthState
from signals.time import NS_PER_S

_RATE_HZ = 25
_MAX_ROWS = 30_000  # 20 minutes at 25 Hz; then every second row is removed and the spacing doubles


class TrackArrays(NamedTuple):
    """One row per kept tick. World frame ENU, SI units."""

    t_s: NDArray[np.float64]  # (n,)
    p_WB: NDArray[np.float64]  # (n, 3) [m]
    q_WB: NDArray[np.float64]  # (n, 4) w-x-y-z
    v_WB_W: NDArray[np.float64]  # (n, 3) [m/s]
    rotor_speed_radps: NDArray[np.float64]  # (n, rotors)
    controls: NDArray[np.float64]  # (n, rotors) 0..1, commanded in the previous tick
    armed: NDArray[np.bool_]  # (n,)
    in_contact: NDArray[np.bool_]  # (n,)


class Track:
    """Keeps every k-th tick, at most 25 per second of flight and 30,000 in all."""

    def __init__(self, tick_ns: int, *, limit: int = _MAX_ROWS) -> None:
        self._stride = max(1, NS_PER_S // _RATE_HZ // tick_ns)
        self._limit = limit
        self._next_tick = 0
        self._rotors = 0
        self._rows = array("d")
        self._row_length = 0
        self._controls: tuple[float, ...] = ()
        self._armed = False

    def truth(self, truth: TruthState) -> None:
        """Keep this tick if it is due."""
        if truth.tick < self._next_tick:
            return
        n = len(truth.rotor_speed_radps)
        if not self._row_length:
            self._rotors, self._row_length = n, 13 + 2 * n
        self._next_tick = truth.tick + self._stride
        controls = (self._controls + (0.0,) * n)[:n]
        self._rows.extend(
            (
                truth.t_ns / NS_PER_S,
                *truth.p_WB,
                *truth.q_WB,
                *truth.v_WB_W,
                self._armed,
                truth.in_contact,
                *truth.rotor_speed_radps,
                *controls,
            )
        )
        if len(self._rows) >= self._limit * self._row_length:
            self._decimate()

    def actuators(self, frame: ActuatorFrame) -> None:
        """Store the latest command."""
        self._controls = frame.controls
        self._armed = frame.armed

    def _decimate(self) -> None:
        rows = np.frombuffer(self._rows, np.float64).reshape(-1, self._row_length)[::2]
        self._rows = array("d", rows.tobytes())
        self._stride *= 2

    def arrays(self) -> TrackArrays:
        """Return copies of the kept ticks."""
        rows = np.array(self._rows, np.float64).reshape(-1, self._row_length or 13)
        n = self._rotors
        return TrackArrays(
            t_s=rows[:, 0],
            p_WB=rows[:, 1:4],
            q_WB=rows[:, 4:8],
            v_WB_W=rows[:, 8:11],
            rotor_speed_radps=rows[:, 13 : 13 + n],
            controls=rows[:, 13 + n : 13 + 2 * n],
            armed=rows[:, 11] > 0.5,
            in_contact=rows[:, 12] > 0.5,
        )
