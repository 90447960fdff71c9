"""Objects: the tracks of one object joined, reported if the evidence for the object suffices.

Two groups of tracks, A and B, are of the same object rather than of two with the log-likelihood ratio

    s(A, B) = ln p(difference of looks | same) / p(difference of looks | two)
            + max over neighbours a, b in time of ln p(place of b | a stayed or walked on) / p(place of b | anyone)
            + prior

An object that walks on for dt reaches a disc of radius R = v dt, so its place gives ln(area / (pi R^2)); that of one
that stays has a normal distribution. Groups with sightings in one picture, and places that cannot be reached, exclude
each other. The pair with the greatest positive s is joined until there is none (agglomerative clustering; Jain, Murty
and Flynn 1999, Data Clustering: A Review), so each sighting belongs to one object and an object has at most one
sighting in a picture.
"""

from __future__ import annotations

import math
from typing import Sequence, Tuple

import numpy as np

from hil_companion.detections import Found
from hil_companion.locate.existence import object_odds
from hil_companion.locate.looks import look_difference, median_look
from hil_companion.locate.tracks import FIX_SIGMA_M, Track

_PRIOR = -1.5  # about ten people may be the one who appears
# ln of the densities' ratio of a difference of looks [CIE units], a line through those of people seen twice and of
# different people, and its lowest value; the look of too small a box says nothing.
_SAME_LOOK, _PER_UNIT, _LOWEST_LOOK, _NO_LOOK = 5.0, 0.15, -3.0, -1.0
_AREA_M2, _WALK_MPS = 3600.0, 1.7
_STAYS_M2 = 0.15  # variance of the place of an object that stays, besides that of the tracks
_SITS_DOWN = -4.0  # ln of the chance that one track stands and the other walks
_LEAST_JOINED = 2  # sightings of a track that can be joined and reported
_ONE_PLACE_M = 1.5
_LONG = 0.5  # of the sightings of the longest track: those of a shorter one may be of another object

Key = Tuple[Tuple[int, int], ...]


def place_ratio(a: Track, b: Track) -> float:
    """Return the log-likelihood ratio of the place where the later track b begins; -inf if a cannot have come there."""
    dt = (b.first.t_ns - a.t_ns) * 1e-9
    if dt <= 0.0:
        return -math.inf
    away_m = float(np.hypot(*(b.first.state[:2] - a.state[:2])))
    variance = a.sigma_m**2 + b.first.sigma_m**2 + _STAYS_M2
    stays = math.log(_AREA_M2 / (2.0 * math.pi * variance)) - 0.5 * away_m**2 / variance
    reach_m = _WALK_MPS * dt + 2.0 * math.sqrt(variance)
    walks = -math.inf if away_m > reach_m else max(0.0, math.log(_AREA_M2 / (math.pi * reach_m**2)))
    if a.stands and b.stands:
        return max(stays, walks + 2.0 * _SITS_DOWN)
    if a.stands or b.stands:
        other = b if a.stands else a
        return max(walks, -math.inf if other.walks else stays) + _SITS_DOWN
    return walks


class Group:
    """Tracks of one object, in the order of time. `key`: their numbers and sightings."""

    def __init__(self, key: Key, tracks: Sequence[Track]) -> None:
        self.key = key
        self.tracks = sorted(tracks, key=lambda t: (t.first_ns, t.number))
        self.pictures = frozenset().union(*(t.pictures for t in tracks))
        looks = [look for track in self.tracks for look in track.looks]
        self.look = median_look(looks) if looks else None

    @property
    def evidence(self) -> float:
        return sum(track.evidence for track in self.tracks)

    @property
    def walks(self) -> bool:
        return any(track.walks for track in self.tracks)

    @property
    def stands(self) -> bool:
        return any(track.stands for track in self.tracks)

    def ratio(self, other: Group) -> float:
        """Return s of this group and another; -inf if they cannot be one object."""
        if self.tracks[0].label != other.tracks[0].label or self.pictures & other.pictures:
            return -math.inf
        difference = look_difference(self.look, other.look)
        look = _NO_LOOK if difference is None else max(_LOWEST_LOOK, _SAME_LOOK - _PER_UNIT * difference)
        mine = {track.number for track in self.tracks}
        ordered = sorted([*self.tracks, *other.tracks], key=lambda t: (t.first_ns, t.number))
        best = -math.inf
        for a, b in zip(ordered, ordered[1:]):
            if (a.number in mine) != (b.number in mine):
                place = place_ratio(a, b)
                if place == -math.inf:
                    return -math.inf
                best = max(best, place)
        return look + best + _PRIOR

    def found(self) -> Found | None:
        """Return the object; None without enough evidence."""
        first, sightings = self.tracks[0], sum(track.sightings for track in self.tracks)
        if object_odds(self.evidence, sightings) < 0.0:
            return None
        most = max(track.sightings for track in self.tracks)
        long = [track for track in self.tracks if track.sightings >= _LONG * most]
        last = max(long, key=lambda t: (min(0.0, FIX_SIGMA_M - t.fix.sigma_m), t.fix.t_ns))
        x, y, vx, vy = last.fix.state.tolist()
        place = (x, y, last.z_m)
        return Found(first.number, first.label, last.fix.t_ns, place, (vx, vy, 0.0), sightings, last.fix.sigma_m)


def _repeats(group: Group, obj: Found, known: Sequence[tuple[Group, Found]]) -> bool:
    """Return True if another still object with more evidence is at the same place: two boxes on one person."""
    return not group.walks and any(
        other.stands
        and other.evidence > group.evidence
        and other_obj.label == obj.label
        and math.dist(obj.p_W[:2], other_obj.p_W[:2]) < _ONE_PLACE_M
        for other, other_obj in known
    )


class Objects:
    """All objects. The ratios of unchanged groups are kept from picture to picture."""

    def __init__(self) -> None:
        self._groups: dict[Key, Group] = {}
        self._ratios: dict[tuple[Key, Key], float] = {}

    def found(self, tracks: Sequence[Track]) -> list[Found]:
        """Return the objects to report, by number."""
        reported = [(group, group.found()) for group in self.groups(tracks)]
        known = [(group, obj) for group, obj in reported if obj is not None]
        return sorted((obj for group, obj in known if not _repeats(group, obj, known)), key=lambda obj: obj.number)

    def groups(self, tracks: Sequence[Track]) -> list[Group]:
        """Return the tracks joined to objects."""
        known_groups, known_ratios = self._groups, self._ratios
        self._groups, self._ratios = {}, {}

        def group(members: Sequence[Track]) -> Group:
            key = tuple(sorted((track.number, track.sightings) for track in members))
            self._groups[key] = known_groups.get(key) or Group(key, members)
            return self._groups[key]

        def ratio(a: Group, b: Group) -> float:
            pair = (a.key, b.key)
            known = known_ratios.get(pair)
            self._ratios[pair] = a.ratio(b) if known is None else known
            return self._ratios[pair]

        left = [group([track]) for track in tracks if track.sightings >= _LEAST_JOINED]
        ratios = {(a, b): ratio(a, b) for i, a in enumerate(left) for b in left[i + 1 :]}
        ratios = {pair: s for pair, s in ratios.items() if s > 0.0}
        while ratios:
            a, b = max(ratios, key=lambda pair: ratios[pair])
            joined = group([*a.tracks, *b.tracks])
            left = [one for one in left if one is not a and one is not b]
            ratios = {pair: s for pair, s in ratios.items() if a not in pair and b not in pair}
            ratios.update({(one, joined): s for one in left for s in [ratio(one, joined)] if s > 0.0})
            left.append(joined)
        return left
