"""Tracks of sighted objects in the world, each with a position, a velocity and a number.

A moving object has a velocity that changes at random, x'' = white noise of `_ACCEL` [m/s2 / sqrt(Hz)]. For one that was
seen to stand still the noise is smaller, and after `_ABSENT_S` out of sight its position has a random walk instead,
`_STROLL` [m / sqrt(s)]. A Kalman filter estimates the state
(x, y, vx, vy); the height is a mean. The sightings of one picture are assigned to tracks one to one, cheapest pair
first, with

    cost = d^2 + ln det S - 2 look      d: distance in standard deviations of S, at most `_GATE`

`look` is the log-likelihood ratio of the appearance (`appearance`). The assignment with the least sum is taken (Kuhn
1955, The Hungarian Method), among those that continue as many tracks as possible. A sighting whose look fits no track,
but which is where one without a sighting should be a moment after its last one, is of that object: a part of somebody
else would have to be there while he is not. Any other sighting that fits no track starts a new one, and a track ends
`_AWAY_S` after its last sighting. `objects` joins the tracks of one object.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from hil_companion.locate.appearance import Appearance, appearance_ratio
from hil_companion.locate.existence import Evidence, Evidences
from hil_companion.locate.looks import look_difference, median_look

_ACCEL, _STANDING_ACCEL, _STROLL = 0.35, 0.12, 0.08
_BEGINS_SEEN = 4  # sightings that say where a track begins
FIRST_SPEED_MPS, _MAX_SPEED_MPS = 0.9, 2.5  # the first is the deviation of a velocity before it is measured
_STANDS_MPS, _STANDS_S, _STANDS_SEEN = 0.35, 1.5, 6
_STAYS_MPS, _STAYS_M, _STANDS_M = 0.3, 1.0, 2.5  # an object that moved less than this since its first sighting stands
_WALKS_MPS, _WALKED_M, _WALKED_SIGMAS = 0.5, 1.5, 2.0
_GATE = 3.3
_ABSENT_S, _AWAY_S = 1.6, 4.0
_AT_ONCE_S, _AT_ONCE_GATE = (
    1.1,
    2.5,
)  # a sighting so soon after the last one and so near is of the track, whatever its look
_LEAST_ALIKE = -2.5  # ln ratio of the appearance of a sighting and its track, one object against two
_LOOKS_KEPT = 30  # sightings whose median look is the track's
_OTHER_LOOK = 60.0  # more than the cost of all sightings whose look fits: such a sighting is assigned last
_ALONE = 200.0  # more than any cost within the gates: as many sightings as possible continue tracks
FIX_SIGMA_M = 0.35  # a position at least as sure as this is reported rather than an older, surer one
_FIX_LOOK = 17.0  # a sighting with a greater difference of looks does not change the reported position
_WEAK_S = 12.0  # a track of one sighting, or of unsure ones only, is dropped after this time

_SURE = Evidence(1.0)


@dataclass(frozen=True)
class Sighting:
    """One box with a position in the world."""

    label: str
    p_W: tuple[float, float, float]
    cov: np.ndarray  # (2, 2) of x and y [m2]
    look: np.ndarray | None = None  # by `look_of`
    evidence: Evidence = _SURE  # by `sighting_evidence`

    @property
    def sure(self) -> bool:
        """Return True if the box is rather of an object than of something else."""
        return self.evidence.best >= 0.0


@dataclass(frozen=True)
class Fix:
    """A track's state (x, y, vx, vy) at one time."""

    t_ns: int
    state: np.ndarray
    sigma_m: float
    speed_sigma_mps: float = FIRST_SPEED_MPS  # of the velocity, per axis


class Track:
    """One object, seen without a long interruption."""

    def __init__(self, number: int, t_ns: int, picture: int, seen: Sighting) -> None:
        self.number, self.label = number, seen.label
        self.first_ns = self.t_ns = t_ns
        self.pictures = {picture}
        self.sightings, self.sure = 1, int(seen.sure)
        self.evidence = Evidences()
        self.evidence.add(seen.evidence)
        self.z_m = seen.p_W[2]
        self.state = np.array([seen.p_W[0], seen.p_W[1], 0.0, 0.0])
        self.cov = np.zeros((4, 4))
        self.cov[:2, :2], self.cov[2:, 2:] = seen.cov, np.eye(2) * FIRST_SPEED_MPS**2
        self.looks = [] if seen.look is None else [seen.look]
        self.look = seen.look
        self.appearance = Appearance.of_track(seen.look, 1)
        self.extent_m = 0.0
        self.closest_m = self.sigma_m  # deviation of the surest sighting
        self.first = self.fix = Fix(t_ns, self.state, self.sigma_m)

    @property
    def sigma_m(self) -> float:
        return math.sqrt(max(0.0, float(np.linalg.eigvalsh(self.cov[:2, :2])[-1])))

    @property
    def surety(self) -> float:
        """Return the evidence of all sightings, for the likelier posture."""
        return max(self.evidence.upright, self.evidence.seated)

    @property
    def speed_mps(self) -> float:
        return float(np.hypot(*self.state[2:]))

    @property
    def walks(self) -> bool:
        """Return True if the object has moved and still moves."""
        return self.extent_m > _WALKED_M + _WALKED_SIGMAS * self.first.sigma_m and self.speed_mps > _WALKS_MPS

    @property
    def stands(self) -> bool:
        """Return True if the object was watched for a while and stood still."""
        watched_s = (self.t_ns - self.first_ns) * 1e-9
        if self.sightings < _STANDS_SEEN or watched_s < _STANDS_S:
            return False
        return self.speed_mps < _STANDS_MPS or self.extent_m < min(_STAYS_MPS * watched_s - _STAYS_M, _STANDS_M)

    def at(self, t_ns: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the predicted state (4,) and covariance (4, 4) at a time."""
        dt = (t_ns - self.t_ns) * 1e-9
        a = abs(dt)
        if self.stands and a > _ABSENT_S:
            state, cov = self.state.copy(), self.cov.copy()
            state[2:] = 0.0
            cov[:2, :2] += np.eye(2) * _STROLL * _STROLL * a
            cov[:2, 2:] = cov[2:, :2] = 0.0
            return state, cov
        F = np.eye(4)
        F[0, 2] = F[1, 3] = dt
        q = (_STANDING_ACCEL if self.stands else _ACCEL) ** 2
        Q = np.zeros((4, 4))
        for i in (0, 1):
            Q[i, i], Q[i + 2, i + 2] = q * a**3 / 3.0, q * a
            Q[i, i + 2] = Q[i + 2, i] = q * dt * a / 2.0
        return F @ self.state, F @ self.cov @ F.T + Q

    def cost(self, t_ns: int, seen: Sighting) -> float:
        """Return the cost of assigning a sighting to this track; infinite if it cannot be the same object."""
        if seen.label != self.label or (not self.stands and (t_ns - self.t_ns) * 1e-9 > _AWAY_S):
            return math.inf
        state, cov = self.at(t_ns)
        off = np.array(seen.p_W[:2]) - state[:2]
        S = cov[:2, :2] + seen.cov
        squared = float(off @ np.linalg.solve(S, off))
        if squared > _GATE * _GATE:
            return math.inf
        look = appearance_ratio([self.appearance, Appearance.of_track(seen.look, 1)])
        if look < _LEAST_ALIKE:
            at_once = (t_ns - self.t_ns) * 1e-9 <= _AT_ONCE_S and squared <= _AT_ONCE_GATE**2
            return _OTHER_LOOK + squared if at_once else math.inf
        return squared + math.log(float(np.linalg.det(S))) - 2.0 * look

    def update(self, t_ns: int, picture: int, seen: Sighting) -> None:
        """Correct the track by a sighting."""
        state, cov = self.at(t_ns)
        S = cov[:2, :2] + seen.cov
        K = np.linalg.solve(S, cov[:2]).T
        self.state = state + K @ (np.array(seen.p_W[:2]) - state[:2])
        A = np.eye(4)
        A[:, :2] -= K
        self.cov = A @ cov @ A.T + K @ seen.cov @ K.T
        if self.speed_mps > _MAX_SPEED_MPS:
            self.state[2:] *= _MAX_SPEED_MPS / self.speed_mps
        self.extent_m = max(self.extent_m, float(np.hypot(*(self.state[:2] - self.first.state[:2]))))
        if self.sightings < _BEGINS_SEEN:  # the first sighting alone may have a wrong range
            begun = self.state[:2] - self.state[2:] * ((t_ns - self.first_ns) * 1e-9)
            speed_sigma_mps = math.sqrt(0.5 * float(self.cov[2, 2] + self.cov[3, 3]))
            self.first = Fix(self.first_ns, np.concatenate([begun, self.state[2:]]), self.sigma_m, speed_sigma_mps)
        self.t_ns = t_ns
        self.closest_m = min(self.closest_m, math.sqrt(float(np.linalg.eigvalsh(seen.cov)[-1])))
        self.sightings += 1
        self.sure += seen.sure
        self.evidence.add(seen.evidence)
        self.z_m += (seen.p_W[2] - self.z_m) / self.sightings
        self.pictures.add(picture)
        self._add_looks([] if seen.look is None else [seen.look])
        difference = look_difference(self.look, seen.look)
        trusted = seen.sure and (difference is None or difference < _FIX_LOOK)
        if trusted and self.sigma_m <= max(FIX_SIGMA_M, self.fix.sigma_m):
            self.fix = Fix(t_ns, self.state, self.sigma_m)

    def _add_looks(self, looks: Sequence[np.ndarray]) -> None:
        if looks:
            self.looks = [*self.looks, *looks][-_LOOKS_KEPT:]
            self.look = median_look(self.looks)
        self.appearance = Appearance.of_track(self.look, self.sightings)


class Tracks:
    """All tracks."""

    def __init__(self) -> None:
        self.tracks: list[Track] = []
        self._numbers = 0
        self._pictures = 0

    def add(self, t_ns: int, sightings: Sequence[Sighting]) -> None:
        """Add the sightings of one picture; pictures come in the order of time."""
        self._pictures += 1
        assigned: set[int] = set()
        for i, k in self._assignment(t_ns, sightings):
            self.tracks[i].update(t_ns, self._pictures, sightings[k])
            assigned.add(k)
        for k, seen in enumerate(sightings):
            if k not in assigned:
                self.tracks.append(Track(self._numbers, t_ns, self._pictures, seen))
                self._numbers += 1
        self.tracks = [t for t in self.tracks if (t.sure and t.sightings > 1) or (t_ns - t.t_ns) * 1e-9 < _WEAK_S]

    def _assignment(self, t_ns: int, sightings: Sequence[Sighting]) -> list[tuple[int, int]]:
        """Return (track, sighting) of the assignment with the least sum of costs."""
        recent = [i for i, track in enumerate(self.tracks) if (t_ns - track.t_ns) * 1e-9 <= _AWAY_S]
        if not recent or not sightings:
            return []
        costs = np.array([[self.tracks[i].cost(t_ns, seen) for seen in sightings] for i in recent])
        costs = np.where(np.isfinite(costs), costs - _ALONE, 0.0)
        rows, columns = linear_sum_assignment(np.minimum(costs, 0.0))
        return [(recent[i], k) for i, k in zip(rows.tolist(), columns.tolist()) if costs[i, k] < 0.0]
