"""Objects: the tracks of one object joined, reported if the evidence for the object suffices.

Which tracks belong together is decided over the whole flight (`partition`), each time a track begins, and every
`_AGAIN` pictures for the tracks that grow. An object has at most one sighting in a picture.
"""

from __future__ import annotations

import math
from typing import Sequence

import numpy as np

from hil_companion.detections import Found
from hil_companion.locate.existence import Evidences
from hil_companion.locate.partition import Partition
from hil_companion.locate.tracks import FIX_SIGMA_M, Track
from hil_companion.locate.views import Views

_LEAST_JOINED, _LEAST_SURETY = 2, 2.0  # sightings and evidence of a track that can be joined and reported
_ONE_PLACE_M = 1.5
# Log-odds from which an object so near to another one may be a second person, and the share of its pictures that show
# both up to which it is the same one.
_TWO_SURE, _SELDOM = 8.0, 0.25
# ln of the chances to see a person and something else walk: few things do, with wrong ranges.
_WALKER, _WALKED_SEEN = 1.7, 6
_STILL = 0.8  # share of the sightings at one place, of an object that is still
_LONG = 0.5  # of the evidence of the surest track: one with less may be of another object
_ONE_BODY_M = 0.4  # the mean places of two people are farther from each other
_AGAIN = 4


class Group:
    """Tracks of one object, in the order of time."""

    def __init__(self, tracks: Sequence[Track], views: Views | None = None) -> None:
        self.tracks = list(tracks)
        self.pictures = frozenset().union(*(track.pictures for track in self.tracks))
        nearest = min(self.tracks, key=lambda t: t.closest_m)
        still = self.share_at(nearest.fix.state[:2].tolist(), unsure=True) >= _STILL
        hits, misses, in_view = 0, 0, 0.0
        if views is not None:
            total = sum(track.sightings for track in self.tracks)
            in_view = sum(t.sightings * len(_showing(t, views)) for t in self.tracks) / total
            if still and any(t.stands for t in self.tracks) and not any(t.walks for t in self.tracks):
                hits, misses = self._looked(_showing(nearest, views))
        evidences = sum((track.evidence for track in self.tracks), Evidences())
        self.odds = evidences.odds(hits, misses, in_view=in_view, still=still)
        walked = sum(track.sightings for track in self.tracks if track.walks)
        self.odds += _WALKER if self.walks and walked >= _WALKED_SEEN else 0.0

    def _looked(self, showing: Sequence[int]) -> tuple[int, int]:
        """Return how many of the pictures that show a still object's place, between its first and its last sighting,
        have it, and have not."""
        first, last = min(self.pictures), max(self.pictures)
        between = [n for n in showing if first <= n <= last]
        hits = sum(n in self.pictures for n in between)
        return hits, len(between) - hits

    @property
    def walks(self) -> bool:
        """Return True if most sightings are of tracks that walk."""
        return sum(t.sightings * (1 if t.walks else -1) for t in self.tracks) > 0

    def share_at(self, p_W: Sequence[float], *, unsure: bool = False) -> float:
        """Return the share of the sightings in tracks that begin or end at a place. `unsure`: or may do so."""

        def near(track: Track) -> bool:
            ends = (track.first.state, track.state)
            within_m = _ONE_PLACE_M + (track.closest_m if unsure else 0.0)
            return any(math.dist((x, y), p_W[:2]) < within_m for x, y in (state[:2].tolist() for state in ends))

        total = sum(track.sightings for track in self.tracks)
        return sum(track.sightings for track in self.tracks if near(track)) / total

    @property
    def place_m(self) -> tuple[float, float]:
        """Return the mean x, y of the tracks' places, weighted by their precision: the place of one that is still."""
        weights = np.array([track.closest_m**-2 for track in self.tracks])
        x, y = (weights @ np.array([track.fix.state[:2] for track in self.tracks]) / weights.sum()).tolist()
        return x, y

    def share_with(self, other: Group) -> float:
        """Return the share of this object's pictures that show the other one too."""
        return len(self.pictures & other.pictures) / len(self.pictures)

    def found(self) -> Found | None:
        """Return the object; None without enough evidence."""
        first, sightings = self.tracks[0], sum(track.sightings for track in self.tracks)
        if self.odds < 0.0:
            return None
        most = max(track.surety for track in self.tracks)
        long = [track for track in self.tracks if track.surety >= most - (1.0 - _LONG) * abs(most)]
        if self.walks:
            last = max(long, key=lambda t: (min(0.0, FIX_SIGMA_M - t.fix.sigma_m), t.fix.t_ns))
        else:
            last = min(long, key=lambda t: t.closest_m)
        x, y, vx, vy = last.fix.state.tolist()
        place = (x, y, last.z_m)
        return Found(first.number, first.label, last.fix.t_ns, place, (vx, vy, 0.0), sightings, last.fix.sigma_m)


def _showing(track: Track, views: Views) -> list[int]:
    """Return the numbers of the pictures that show a track's place."""
    x, y = track.fix.state[:2].tolist()
    return views.showing(track.number, (x, y, track.z_m))


def _repeats(group: Group, obj: Found, known: Sequence[tuple[Group, Found]]) -> bool:
    """Return True if it is a second box on somebody: mostly at the place of a surer still object, and doubtful or
    seldom seen beside it, or no farther away than a body is wide."""
    return any(
        other.odds > group.odds
        and (
            group.odds < _TWO_SURE
            or group.share_with(other) <= _SELDOM
            or math.dist(group.place_m, other.place_m) < _ONE_BODY_M
        )
        and other_obj.label == obj.label
        and other.share_at(other_obj.p_W) > 0.5
        and group.share_at(other_obj.p_W) >= 0.5
        for other, other_obj in known
    )


class Objects:
    """All objects."""

    def __init__(self) -> None:
        self._partition = Partition()
        self._numbers: list[list[int]] = []  # of the tracks of each object
        self._known: set[int] = set()
        self._calls = 0

    def found(self, tracks: Sequence[Track], views: Views | None = None) -> list[Found]:
        """Return the objects to report, by number. `views`: of the pictures so far; None: misses do not count."""
        reported = [(group, group.found()) for group in self.groups(tracks, views)]
        known = [(group, obj) for group, obj in reported if obj is not None]
        return sorted((obj for group, obj in known if not _repeats(group, obj, known)), key=lambda obj: obj.number)

    def groups(self, tracks: Sequence[Track], views: Views | None = None) -> list[Group]:
        """Return the tracks joined to objects."""
        joinable = {
            track.number: track
            for track in tracks
            if track.sightings >= _LEAST_JOINED and track.surety >= _LEAST_SURETY
        }
        self._calls += 1
        if self._known != set(joinable) or self._calls % _AGAIN == 0:
            self._known = set(joinable)
            groups = self._partition.groups(list(joinable.values()))
            self._numbers = [[track.number for track in group] for group in groups]
        return [Group([joinable[n] for n in numbers], views) for numbers in self._numbers]
