"""Tracks of sighted objects in the world, each with a position, a velocity and a number.

A moving object has a velocity that changes at random, x'' = white noise of `_ACCEL` [m/s2 / sqrt(Hz)]. An object that
was seen to stand still has a random walk of its position, `_STROLL` [m / sqrt(s)]. A Kalman filter estimates the state
(x, y, vx, vy); the height is a mean. The sightings of one picture are assigned to tracks one to one, cheapest pair
first, with

    cost = d^2 + ln det S + colour^2      d: distance in standard deviations of S, at most `_GATE`

`colour` is the colour difference in units of `_COLOUR`. After a track was out of sight for a while, a sighting
continues it only if the colours match or the sighting is near the track. A sighting that fits no track starts a new
one, which is reported after `least` sightings above the detection threshold; weaker sightings only extend a track. Two
tracks at the same position that were never in one picture are merged.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Sequence

import cv2
import numpy as np

from hil_companion.detections import Found

_ACCEL, _STROLL = 0.35, 0.12
_FIRST_SPEED_MPS, _MAX_SPEED_MPS = 0.9, 2.5
_STANDS_MPS, _STANDS_S, _STANDS_SEEN = 0.35, 1.5, 6
_GATE, _NEAR_M = 3.2, 5.0
_AWAY_S, _REACH_MPS, _MOST_AWAY_S = 1.6, 2.2, 60.0
_COLOUR, _MAX_COLOUR = 5.0, 2.2  # CIE units per unit of cost, and the largest difference within one track
# After a long absence colours must fit better: a person reported twice is a smaller error than two taken for one.
_LONG_S, _SURE_COLOUR = 8.0, 1.0
_COLOURS_KEPT = 12.0  # largest weight of the mean colours, in sightings
_ONE_PLACE_M = 1.0
_UNCONFIRMED_S = 12.0  # an unreported track is dropped after this time without a sighting

# Parts of the box whose colours are compared, as shares of its sides.
_LEAST_HEIGHT_PX = 14.0
_ACROSS = (0.36, 0.64)
_UPPER, _LOWER = (0.2, 0.42), (0.55, 0.82)
_WEIGHTS = np.array([0.33, 1.0, 1.0] * 2)


@dataclass(frozen=True)
class Sighting:
    """One box with a position in the world."""

    label: str
    p_W: tuple[float, float, float]
    sigma_m: float
    colours: np.ndarray | None = None  # by `box_colours`
    sure: bool = True  # its score reaches the detection threshold


class Track:
    """One object."""

    def __init__(self, number: int, t_ns: int, picture: int, seen: Sighting) -> None:
        self.number, self.label = number, seen.label
        self.first_ns = self.t_ns = t_ns
        self.pictures = {picture}
        self.sightings, self.sure = 1, int(seen.sure)
        self.z_m = seen.p_W[2]
        self.state = np.array([seen.p_W[0], seen.p_W[1], 0.0, 0.0])
        self.cov = np.diag([seen.sigma_m**2] * 2 + [_FIRST_SPEED_MPS**2] * 2)
        self.colours = seen.colours
        self._colours_weight = 0.0 if seen.colours is None else 1.0

    @property
    def stands(self) -> bool:
        """Return True if the object was watched for a while and stood still."""
        watched = self.sightings >= _STANDS_SEEN and (self.t_ns - self.first_ns) * 1e-9 >= _STANDS_S
        return watched and float(np.hypot(*self.state[2:])) < _STANDS_MPS

    def at(self, t_ns: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the predicted state (4,) and covariance (4, 4) at a time."""
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
        """Return the cost of assigning a sighting to this track; infinite if it cannot be the same object."""
        if seen.label != self.label:
            return math.inf
        state, cov = self.at(t_ns)
        off = np.array(seen.p_W[:2]) - state[:2]
        S = cov[:2, :2] + np.eye(2) * seen.sigma_m**2
        squared = float(off @ np.linalg.solve(S, off))
        if squared > _GATE * _GATE:
            return math.inf
        away_s = (t_ns - self.t_ns) * 1e-9
        colour = None
        if self.colours is not None and seen.colours is not None:
            colour = colour_difference(self.colours, seen.colours) / _COLOUR
        if away_s > _AWAY_S:
            moved_m = float(np.hypot(*(np.array(seen.p_W[:2]) - self.state[:2])))
            max_colour = _MAX_COLOUR if away_s < _LONG_S else _SURE_COLOUR
            recognised = colour is not None and colour < max_colour and away_s < _MOST_AWAY_S
            limit_m = _NEAR_M + _REACH_MPS * away_s if recognised and not self.stands else _NEAR_M
            if moved_m > limit_m or (colour is not None and colour > _MAX_COLOUR and not self.stands):
                return math.inf
        return squared + math.log(float(np.linalg.det(S))) + (0.0 if colour is None else colour * colour)

    def update(self, t_ns: int, picture: int, seen: Sighting) -> None:
        """Correct the track by a sighting."""
        state, cov = self.at(t_ns)
        S = cov[:2, :2] + np.eye(2) * seen.sigma_m**2
        K = np.linalg.solve(S, cov[:2]).T
        self.state = state + K @ (np.array(seen.p_W[:2]) - state[:2])
        A = np.eye(4)
        A[:, :2] -= K
        self.cov = A @ cov @ A.T + K @ K.T * seen.sigma_m**2
        speed = float(np.hypot(*self.state[2:]))
        if speed > _MAX_SPEED_MPS:
            self.state[2:] *= _MAX_SPEED_MPS / speed
        self.t_ns = t_ns
        self.sightings += 1
        self.sure += seen.sure
        self.z_m += (seen.p_W[2] - self.z_m) / self.sightings
        self.pictures.add(picture)
        if seen.colours is not None:
            self._colours_weight = min(self._colours_weight + 1.0, _COLOURS_KEPT)
            before = seen.colours if self.colours is None else self.colours
            self.colours = before + (seen.colours - before) / self._colours_weight

    def merge(self, late: Track) -> None:
        """Continue this track with the newer state of another track of the same object."""
        self.state, self.cov, self.t_ns = late.state, late.cov, late.t_ns
        self.sightings += late.sightings
        self.sure += late.sure
        self.pictures |= late.pictures

    def found(self) -> Found:
        x, y, vx, vy = self.state.tolist()
        sigma_m = math.sqrt(max(0.0, float(max(self.cov[0, 0], self.cov[1, 1]))))
        return Found(self.number, self.label, self.t_ns, (x, y, self.z_m), (vx, vy, 0.0), self.sightings, sigma_m)


class Tracks:
    """All tracks. `least`: sightings above the threshold from which a track is reported."""

    def __init__(self, least: int = 3) -> None:
        self._least = least
        self._tracks: list[Track] = []
        self._numbers = 0
        self._pictures = 0

    def add(self, t_ns: int, sightings: Sequence[Sighting]) -> None:
        """Add the sightings of one picture; pictures come in the order of time."""
        self._pictures += 1
        pairs = [
            (track.cost(t_ns, seen), i, k) for i, track in enumerate(self._tracks) for k, seen in enumerate(sightings)
        ]
        assigned_tracks: set[int] = set()
        assigned: set[int] = set()
        for cost, i, k in sorted(pairs):
            if cost < math.inf and i not in assigned_tracks and k not in assigned:
                assigned_tracks.add(i)
                assigned.add(k)
                self._tracks[i].update(t_ns, self._pictures, sightings[k])
        for k, seen in enumerate(sightings):
            if k not in assigned:
                self._tracks.append(Track(self._numbers, t_ns, self._pictures, seen))
                self._numbers += 1
        self._merge(t_ns)
        self._tracks = [t for t in self._tracks if t.sure >= self._least or (t_ns - t.t_ns) * 1e-9 < _UNCONFIRMED_S]

    def _merge(self, t_ns: int) -> None:
        """Merge each track seen in this picture into an older one that is predicted at the same place."""
        for late in [t for t in self._tracks if t.t_ns == t_ns]:
            for early in self._tracks:
                if early is late or early.label != late.label or early.number > late.number:
                    continue
                state, cov = early.at(t_ns)
                near_m = float(np.hypot(*(state[:2] - late.state[:2])))
                if near_m > _ONE_PLACE_M or cov[0, 0] > 4.0 or early.pictures & late.pictures:
                    continue
                early.merge(late)
                self._tracks.remove(late)
                break

    @property
    def found(self) -> list[Found]:
        """Return the reported tracks, by number."""
        return [track.found() for track in self._tracks if track.sure >= self._least]


def box_colours(rgb: np.ndarray, box_px: Sequence[float]) -> np.ndarray | None:
    """Return the median colours of the upper and the lower part of a box's middle: six numbers, CIE L*a*b*.

    Medians suppress the background. The result is None if the box is too small.
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


def colour_difference(a: np.ndarray, b: np.ndarray) -> float:
    """Return the difference of two `box_colours` in CIE units; above about 20 for different clothes.

    Lightness counts a third, since it changes between shade and sun.
    """
    return float(np.sqrt(np.mean((_WEIGHTS * (a - b)) ** 2)))
