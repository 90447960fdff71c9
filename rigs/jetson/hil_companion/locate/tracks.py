"""What all sightings add up to: things of the world, each with a place, a motion and a number of its own.

A thing that walks moves with a velocity that changes at random, x'' = white noise of `_ACCEL` [m/s2 / sqrt(Hz)]; one
that was seen to stay where it is stays there, give or take `_STROLL` [m / sqrt(s)]. Its state (x, y, vx, vy) is a
Kalman filter's, the height a mean. Of the ways to give the sightings of one picture to things the cheapest pairs are
taken first, one each, with

    cost = d^2 + ln det S + look^2        d: distance in standard deviations of S, at most `_GATE`

`look` compares colours, in units of `_LOOK`. Somebody who was out of sight for a while is known again by them: without
colours that fit, only near to where he has to be. What fits nothing is a new thing; it counts once `least` of its
sightings were sure ones: weak ones keep a thing going, and make none. Two things that come to be at one place, and were
never in one picture, were one all the while.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Sequence

import cv2
import numpy as np

from hil_companion.detections import Found

_ACCEL, _STROLL = 0.35, 0.12
_FIRST_SPEED_MPS, _MOST_SPEED_MPS = 0.9, 2.5
_STANDS_MPS, _STANDS_S, _STANDS_SEEN = 0.35, 1.5, 6
_GATE, _NEAR_M = 3.2, 5.0
_AWAY_S, _REACH_MPS, _MOST_AWAY_S = 1.6, 2.2, 60.0
_LOOK, _MOST_LOOK = 5.0, 2.2  # CIE units to one, and how many may be between two looks of one thing
# After so long away only so many: who is told twice has been found, who is taken for another is lost.
_LONG_S, _SURE_LOOK = 8.0, 1.0
_LOOKS_KEPT = 12.0  # sightings that a mean look is worth at most
_ONE_PLACE_M = 1.0
_UNCONFIRMED_S = 12.0  # what was seen too seldom is forgotten after so long

# Of a look, shares of the box.
_LEAST_HEIGHT_PX = 14.0
_ACROSS = (0.36, 0.64)  # of the box
_UPPER, _LOWER = (0.2, 0.42), (0.55, 0.82)
_WEIGHTS = np.array([0.33, 1.0, 1.0] * 2)


@dataclass(frozen=True)
class Sighting:
    """One box that was given a place."""

    label: str
    p_W: tuple[float, float, float]
    sigma_m: float
    look: np.ndarray | None = None  # its colours, where it is large enough to tell
    sure: bool = True


class Track:
    """One thing."""

    def __init__(self, number: int, t_ns: int, picture: int, seen: Sighting) -> None:
        self.number, self.label = number, seen.label
        self.first_ns = self.t_ns = t_ns
        self.pictures = {picture}
        self.sightings, self.sure = 1, int(seen.sure)
        self.z_m = seen.p_W[2]
        self.state = np.array([seen.p_W[0], seen.p_W[1], 0.0, 0.0])
        self.cov = np.diag([seen.sigma_m**2] * 2 + [_FIRST_SPEED_MPS**2] * 2)
        self.look = seen.look
        self._looks = 0.0 if seen.look is None else 1.0

    @property
    def stands(self) -> bool:
        """Whether it was watched for a while and stayed where it was."""
        watched = self.sightings >= _STANDS_SEEN and (self.t_ns - self.first_ns) * 1e-9 >= _STANDS_S
        return watched and float(np.hypot(*self.state[2:])) < _STANDS_MPS

    def at(self, t_ns: int) -> tuple[np.ndarray, np.ndarray]:
        """State and covariance by then."""
        dt = (t_ns - self.t_ns) * 1e-9
        a = abs(dt)
        if self.stands and a > _AWAY_S:
            state, cov = self.state.copy(), self.cov.copy()
            state[2:] = 0.0
            cov[:2, :2] += np.eye(2) * _STROLL * _STROLL * a
            cov[:2, 2:] = cov[2:, :2] = 0.0
            return state, cov
        F = np.eye(4)
        F[0, 2] = F[1, 3] = dt
        q = _ACCEL * _ACCEL
        Q = np.zeros((4, 4))
        for i in (0, 1):
            Q[i, i], Q[i + 2, i + 2] = q * a**3 / 3.0, q * a
            Q[i, i + 2] = Q[i + 2, i] = q * dt * a / 2.0
        return F @ self.state, F @ self.cov @ F.T + Q

    def cost(self, t_ns: int, seen: Sighting) -> float:
        """Of taking this sighting; infinite where it cannot be this one."""
        if seen.label != self.label:
            return math.inf
        state, cov = self.at(t_ns)
        off = np.array(seen.p_W[:2]) - state[:2]
        S = cov[:2, :2] + np.eye(2) * seen.sigma_m**2
        squared = float(off @ np.linalg.solve(S, off))
        if squared > _GATE * _GATE:
            return math.inf
        away_s = (t_ns - self.t_ns) * 1e-9
        look = None if self.look is None or seen.look is None else difference(self.look, seen.look) / _LOOK
        if away_s > _AWAY_S:
            moved_m = float(np.hypot(*(np.array(seen.p_W[:2]) - self.state[:2])))
            alike = _MOST_LOOK if away_s < _LONG_S else _SURE_LOOK
            known = look is not None and look < alike and away_s < _MOST_AWAY_S
            limit_m = _NEAR_M + _REACH_MPS * away_s if known and not self.stands else _NEAR_M
            if moved_m > limit_m or (look is not None and look > _MOST_LOOK and not self.stands):
                return math.inf
        return squared + math.log(float(np.linalg.det(S))) + (0.0 if look is None else look * look)

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
        self.sure += seen.sure
        self.z_m += (seen.p_W[2] - self.z_m) / self.sightings
        self.pictures.add(picture)
        if seen.look is not None:
            self._looks = min(self._looks + 1.0, _LOOKS_KEPT)
            before = seen.look if self.look is None else self.look
            self.look = before + (seen.look - before) / self._looks

    def become(self, late: Track) -> None:
        """The other one was this one: what it knows is newer."""
        self.state, self.cov, self.t_ns = late.state, late.cov, late.t_ns
        self.sightings += late.sightings
        self.sure += late.sure
        self.pictures |= late.pictures

    def found(self) -> Found:
        x, y, vx, vy = self.state.tolist()
        sigma_m = math.sqrt(max(0.0, float(max(self.cov[0, 0], self.cov[1, 1]))))
        return Found(self.number, self.label, self.t_ns, (x, y, self.z_m), (vx, vy, 0.0), self.sightings, sigma_m)


class Tracks:
    """All things so far. `least`: sure sightings from which one counts."""

    def __init__(self, least: int = 3) -> None:
        self._least = least
        self._tracks: list[Track] = []
        self._numbers = 0
        self._pictures = 0

    def add(self, t_ns: int, sightings: Sequence[Sighting]) -> None:
        """Those of one picture; pictures come in the order of time."""
        self._pictures += 1
        pairs = [
            (track.cost(t_ns, seen), i, k) for i, track in enumerate(self._tracks) for k, seen in enumerate(sightings)
        ]
        taken_i: set[int] = set()
        taken_k: set[int] = set()
        for cost, i, k in sorted(pairs):
            if cost < math.inf and i not in taken_i and k not in taken_k:
                taken_i.add(i)
                taken_k.add(k)
                self._tracks[i].take(t_ns, self._pictures, sightings[k])
        for k, seen in enumerate(sightings):
            if k not in taken_k:
                self._tracks.append(Track(self._numbers, t_ns, self._pictures, seen))
                self._numbers += 1
        self._join(t_ns)
        self._tracks = [t for t in self._tracks if t.sure >= self._least or (t_ns - t.t_ns) * 1e-9 < _UNCONFIRMED_S]

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
                early.become(late)
                self._tracks.remove(late)
                break

    @property
    def found(self) -> list[Found]:
        """Those that count, by number."""
        return [track.found() for track in self._tracks if track.sure >= self._least]


def look_of(rgb: np.ndarray, box_px: Sequence[float]) -> np.ndarray | None:
    """What somebody looks like from afar: the colours of the upper and the lower half of a box's middle.

    Six numbers in CIE L*a*b*, medians, so that what is behind counts little. None where the box is too small to tell.
    """
    x0, y0, x1, y1 = box_px
    if y1 - y0 < _LEAST_HEIGHT_PX:
        return None
    parts = []
    for top, bottom in (_UPPER, _LOWER):
        columns = slice(max(0, int(x0 + _ACROSS[0] * (x1 - x0))), int(np.ceil(x0 + _ACROSS[1] * (x1 - x0))))
        rows = slice(max(0, int(y0 + top * (y1 - y0))), int(np.ceil(y0 + bottom * (y1 - y0))))
        patch = rgb[rows, columns]
        if patch.size == 0:
            return None
        lab = cv2.cvtColor((patch[np.newaxis].reshape(1, -1, 3) / 255.0).astype(np.float32), cv2.COLOR_RGB2LAB)
        parts.append(np.median(lab[0], axis=0))
    return np.concatenate(parts).astype(float)


def difference(a: np.ndarray, b: np.ndarray) -> float:
    """0: the same colours; above about 20 other clothes. Lightness counts a third: it changes with shade and sun."""
    return float(np.sqrt(np.mean((_WEIGHTS * (a - b)) ** 2)))
