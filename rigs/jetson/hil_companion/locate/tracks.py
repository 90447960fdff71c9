"""What all sightings add up to: things of the world, each with a place, a motion and a number of its own.

A thing moves with a velocity that changes at random, x'' = white noise of `_ACCEL` [m/s2 / sqrt(Hz)]; people stop, turn
and go on. Its state (x, y, vx, vy) is a Kalman filter's; the height is a mean. The sightings of one picture go to the
things they fit best, nearest first, one each, within `_GATE` standard deviations and `_FARTHEST_M`. What fits none is a
new thing; it counts once it has been seen `least` times.

Two things that come to be at one place, and were never in one picture, were one all the while: the first has it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Sequence

import numpy as np

from hil_companion.detections import Found

_ACCEL = 0.35
_FIRST_SPEED_MPS, _MOST_SPEED_MPS = 0.9, 3.5
_GATE, _FARTHEST_M = 3.2, 5.0
_ONE_PLACE_M = 1.0
_LOOSE_M = 12.0  # sigma from which nothing is known any more of where it has got to
_UNCONFIRMED_S = 12.0  # what was seen too seldom is forgotten after so long


@dataclass(frozen=True)
class Sighting:
    """One box that was given a place."""

    label: str
    p_W: tuple[float, float, float]
    sigma_m: float


class Track:
    """One thing."""

    def __init__(self, number: int, t_ns: int, picture: int, seen: Sighting) -> None:
        self.number, self.label = number, seen.label
        self.first_ns = self.t_ns = t_ns
        self.pictures = {picture}
        self.sightings = 1
        self.z_m = seen.p_W[2]
        self.state = np.array([seen.p_W[0], seen.p_W[1], 0.0, 0.0])
        self.cov = np.diag([seen.sigma_m**2] * 2 + [_FIRST_SPEED_MPS**2] * 2)

    def at(self, t_ns: int) -> tuple[np.ndarray, np.ndarray]:
        """State and covariance by then."""
        dt = (t_ns - self.t_ns) * 1e-9
        F = np.eye(4)
        F[0, 2] = F[1, 3] = dt
        q, a = _ACCEL * _ACCEL, abs(dt)
        Q = np.zeros((4, 4))
        for i in (0, 1):
            Q[i, i], Q[i + 2, i + 2] = q * a**3 / 3.0, q * a
            Q[i, i + 2] = Q[i + 2, i] = q * dt * a / 2.0
        return F @ self.state, F @ self.cov @ F.T + Q

    def distance(self, t_ns: int, seen: Sighting) -> float:
        """In standard deviations; infinite where it cannot be this one."""
        if seen.label != self.label:
            return math.inf
        state, cov = self.at(t_ns)
        off = np.array(seen.p_W[:2]) - state[:2]
        S = cov[:2, :2] + np.eye(2) * seen.sigma_m**2
        if S[0, 0] > _LOOSE_M**2 or float(np.hypot(off[0], off[1])) > _FARTHEST_M:
            return math.inf
        return math.sqrt(float(off @ np.linalg.solve(S, off)))

    def take(self, t_ns: int, picture: int, seen: Sighting) -> None:
        state, cov = self.at(t_ns)
        S = cov[:2, :2] + np.eye(2) * seen.sigma_m**2
        K = np.linalg.solve(S, cov[:2]).T
        self.state = state + K @ (np.array(seen.p_W[:2]) - state[:2])
        A = np.eye(4)
        A[:, :2] -= K
        self.cov = A @ cov @ A.T + K @ K.T * seen.sigma_m**2
        speed = float(np.hypot(*self.state[2:]))
        if speed > _MOST_SPEED_MPS:
            self.state[2:] *= _MOST_SPEED_MPS / speed
        self.t_ns = t_ns
        self.sightings += 1
        self.z_m += (seen.p_W[2] - self.z_m) / self.sightings
        self.pictures.add(picture)

    def found(self) -> Found:
        x, y, vx, vy = self.state.tolist()
        sigma_m = math.sqrt(max(0.0, float(max(self.cov[0, 0], self.cov[1, 1]))))
        return Found(self.number, self.label, self.t_ns, (x, y, self.z_m), (vx, vy, 0.0), self.sightings, sigma_m)


class Tracks:
    """All things so far. `least`: sightings from which one counts."""

    def __init__(self, least: int = 3) -> None:
        self._least = least
        self._tracks: list[Track] = []
        self._numbers = 0
        self._pictures = 0

    def add(self, t_ns: int, sightings: Sequence[Sighting]) -> None:
        """Those of one picture; pictures come in the order of time."""
        self._pictures += 1
        pairs = [
            (track.distance(t_ns, seen), i, k)
            for i, track in enumerate(self._tracks)
            for k, seen in enumerate(sightings)
        ]
        taken_i, taken_k = set(), set()
        for distance, i, k in sorted(pairs):
            if distance > _GATE:
                break
            if i not in taken_i and k not in taken_k:
                taken_i.add(i)
                taken_k.add(k)
                self._tracks[i].take(t_ns, self._pictures, sightings[k])
        for k, seen in enumerate(sightings):
            if k not in taken_k:
                self._tracks.append(Track(self._numbers, t_ns, self._pictures, seen))
                self._numbers += 1
        self._join(t_ns)
        self._tracks = [
            t for t in self._tracks if t.sightings >= self._least or (t_ns - t.t_ns) * 1e-9 < _UNCONFIRMED_S
        ]

    def _join(self, t_ns: int) -> None:
        """Of those seen just now, whoever stands where an older one has to be."""
        for late in [t for t in self._tracks if t.t_ns == t_ns]:
            for early in self._tracks:
                if early is late or early.label != late.label or early.number > late.number:
                    continue
                state, cov = early.at(t_ns)
                near_m = float(np.hypot(*(state[:2] - late.state[:2])))
                if near_m > _ONE_PLACE_M or cov[0, 0] > 4.0 or early.pictures & late.pictures:
                    continue
                early.state, early.cov, early.t_ns = late.state, late.cov, late.t_ns
                early.sightings += late.sightings
                early.pictures |= late.pictures
                self._tracks.remove(late)
                break

    @property
    def found(self) -> list[Found]:
        """Those that count, by number."""
        return [track.found() for track in self._tracks if track.sightings >= self._least]
