"""Partition of the tracks of a whole flight into objects: the likeliest one that a search of pairs and moves finds.

    score = sum over the objects of [ ln ratio of appearance of all its tracks
            + sum over neighbours in time of their transit and their prior + posture - `_OBJECT` ]

The prior of two neighbours is the `rhythm` of the survey, which sees everybody again after about the same time. It is
that of the best chains below with `_PRIOR`; until there are enough of them, `_PRIOR` is all that is known.

A track alone scores 0: it may be of nobody. In a survey with a rhythm, every object of more tracks costs `_OBJECT`, the
ln of the odds that tracks are of people who are there anyway or of nobody, and not of one more (the density of new
targets in Reid 1979, An Algorithm for Tracking Multiple Targets). Without this cost a false track gathers two or three
tracks of somebody with about its look, and because that one cannot be at the false track's place, the halves cannot be
joined. Where people are seen once or twice only, there is no such cost: two tracks are all that there is of somebody.

Who was at two places does not sit, so there the boxes are of somebody upright, or of nobody. An object that is at two
places loses what its boxes say more for a sitter than for somebody upright, the posture; boxes of one object are not
independent (`existence`).

Two tracks in more than one picture are two objects, and so are two of which the later one is out of reach of the
earlier one. With the appearance of neighbours in time alone, the best partition is a path cover with the least cost,
which an assignment of successors to tracks finds (Zhang, Li and Nevatia 2008, Global Data Association for Multi-Object
Tracking Using Network Flows; without false tracks, which have no cost here). The search begins with it. The appearance
of an object is that of all its tracks, which no flow can express. So groups are joined next, best pair first, and then
the best of these moves is taken until none gains: a track to another group or to one of its own; two groups joined; one
that takes all tracks of another that are possible beside its own; two groups that swap all tracks after some time (Oh,
Russell and Sastry 2009, Markov Chain Monte Carlo Data Association, whose moves these are, here without chance so that a
flight repeats).

No such move divides an object made of two halves of two people, because each track alone is worse off elsewhere. So the
same search also begins with the groups of the call before, and then `_TAKEN_APART` objects a call, in turn, are taken
apart and their tracks joined anew; the best of all is kept (Schrimpf et al. 2000, Record Breaking Optimization Results
Using the Ruin and Recreate Principle).
"""

from __future__ import annotations

import math
from typing import FrozenSet, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from hil_companion.locate.appearance import Appearance, appearance_ratio
from hil_companion.locate.existence import Evidences
from hil_companion.locate.rhythm import Rhythm
from hil_companion.locate.tracks import Track
from hil_companion.locate.transit import transit_ratio

_OBJECT = 6.0  # ln of the odds against one more person; by the number of errors on the maps for tuning
_PRIOR = 1.0  # ln of the odds that two tracks are of one object, before it is known how often a survey sees each one
_SHARED = 1  # pictures with a box of both tracks: two boxes on one person may begin a second track
_LEAST_GAIN = 1e-9
_ROUNDS = 200
_TAKEN_APART = 2
_ONE_PLACE_M = 1.5

Members = FrozenSet[int]  # numbers of tracks


class Partition:
    """Objects as sets of tracks. What is known of unchanged tracks is kept from call to call."""

    def __init__(self) -> None:
        self._sightings: dict[int, int] = {}
        self._appearance: dict[int, Appearance] = {}
        self._transits: dict[tuple[int, int], float] = {}
        self._scores: dict[Members, float] = {}
        self._totals: dict[Members, float] = {}  # scores with the prior, which changes from call to call
        self._links: dict[tuple[int, int], float] = {}
        self._tracks: dict[int, Track] = {}
        self._rhythm = Rhythm([])
        self._best: list[Members] = []  # the groups of the call before
        self._turn = 0

    def groups(self, tracks: Sequence[Track]) -> list[list[Track]]:
        """Return the tracks of each object in the order of time; objects by their first track."""
        self._forget(tracks)
        self._rhythm = Rhythm([])
        self._rhythm = self._rhythm_of(self._chains())
        self._totals = {}
        best = max((self._searched(start) for start in (self._chains(), self._before())), key=self._total)
        for _ in range(min(_TAKEN_APART, len(best))):
            best = max((best, self._remade(best)), key=self._total)
        self._best = best
        return [self._ordered(group) for group in sorted(best, key=min)]

    def _before(self) -> list[Members]:
        """Return the groups of the call before that are still possible, and all other tracks alone."""
        numbers = frozenset(self._tracks)
        kept = [group & numbers for group in self._best]
        kept = [group for group in kept if group and self.score(group) > -math.inf]
        return [*kept, *(frozenset([n]) for n in sorted(numbers.difference(*kept)))]

    def _searched(self, groups: Sequence[Members]) -> list[Members]:
        """Return the groups after all joins and moves that gain."""
        found = self._joined(list(groups))
        for _ in range(_ROUNDS):
            better = self._moved(found)
            if better is None:
                break
            found = better
        return found

    def _remade(self, groups: Sequence[Members]) -> list[Members]:
        """Return the groups after the next object in turn was taken apart and its tracks joined anew."""
        ordered = sorted(groups, key=min)
        self._turn += 1
        apart = ordered[self._turn % len(ordered)]
        return self._searched([*(one for one in ordered if one is not apart), *(frozenset([n]) for n in sorted(apart))])

    def _total(self, groups: Sequence[Members]) -> float:
        return sum(self.score(group) for group in sorted(groups, key=min))

    def _forget(self, tracks: Sequence[Track]) -> None:
        """Drop what is known of tracks that have changed or gone."""
        self._tracks = {track.number: track for track in tracks}
        counts = {track.number: track.sightings for track in tracks}
        changed = {n for n in {**self._sightings, **counts} if self._sightings.get(n) != counts.get(n)}
        self._sightings = counts
        self._appearance = {n: a for n, a in self._appearance.items() if n not in changed}
        self._transits = {pair: s for pair, s in self._transits.items() if not changed.intersection(pair)}
        self._links = {pair: s for pair, s in self._links.items() if not changed.intersection(pair)}
        self._scores = {group: s for group, s in self._scores.items() if not changed & group}

    def _ordered(self, group: Members) -> list[Track]:
        return sorted((self._tracks[n] for n in group), key=lambda t: (t.first_ns, t.number))

    def _appears(self, number: int) -> Appearance:
        if number not in self._appearance:
            self._appearance[number] = self._tracks[number].appearance
        return self._appearance[number]

    def _transit(self, a: Track, b: Track) -> float:
        pair = (a.number, b.number)
        if pair not in self._transits:
            apart = a.label != b.label or len(a.pictures & b.pictures) > _SHARED
            self._transits[pair] = -math.inf if apart else transit_ratio(a, b)
        return self._transits[pair]

    def _link(self, a: Track, b: Track) -> float:
        """Return what it gains that b is a's successor."""
        pair = (a.number, b.number)
        if pair not in self._links:
            transit = self._transit(a, b)
            alike = 0.0 if transit == -math.inf else appearance_ratio([self._appears(n) for n in pair])
            self._links[pair] = transit + alike
        known = self._links[pair]
        return known if known == -math.inf else known + self._prior(a, b)

    def _prior(self, a: Track, b: Track) -> float:
        """Return the ln of the odds that b is a's successor, before their places and looks are known."""
        return self._rhythm.odds((b.first_ns - a.t_ns) * 1e-9) if self._rhythm.known else _PRIOR

    def _rhythm_of(self, chains: Sequence[Members]) -> Rhythm:
        ordered = [self._ordered(chain) for chain in chains]
        return Rhythm([(b.first_ns - a.t_ns) * 1e-9 for chain in ordered for a, b in zip(chain, chain[1:])])

    def _chains(self) -> list[Members]:
        """Return the groups of the best path cover."""
        ordered = self._ordered(frozenset(self._tracks))
        if len(ordered) < 2:
            return [frozenset([track.number]) for track in ordered]
        gains = np.zeros((len(ordered), len(ordered)))
        for i, a in enumerate(ordered):
            for k in range(i + 1, len(ordered)):
                gains[i, k] = max(0.0, self._link(a, ordered[k]))
        chain = {track.number: [track.number] for track in ordered}
        # In the order of the successors, so that a chain is whole before its end is continued.
        for i, k in sorted(zip(*(index.tolist() for index in linear_sum_assignment(-gains))), key=lambda ik: ik[1]):
            if gains[i, k] > _LEAST_GAIN:
                chain[ordered[k].number] = chain[ordered[i].number]
                chain[ordered[k].number].append(ordered[k].number)
        return sorted({frozenset(numbers) for numbers in chain.values()}, key=min)

    def score(self, group: Members) -> float:
        """Return the score of one object with these tracks; -inf if they cannot be one, 0 for one track or none."""
        if len(group) < 2:
            return 0.0
        total = self._totals.get(group)
        if total is None:
            known = self._scores.get(group)
            if known is None:
                known = self._scores[group] = self._score(group)
            total = self._totals[group] = known if known == -math.inf else known + self._priors(group)
        return total

    def _priors(self, group: Members) -> float:
        ordered = self._ordered(group)
        one_more = _OBJECT if self._rhythm.known else 0.0
        return sum(self._prior(a, b) for a, b in zip(ordered, ordered[1:])) - one_more

    def _score(self, group: Members) -> float:
        """Return the score without the prior."""
        ordered = self._ordered(group)
        total = 0.0
        for a, b in zip(ordered, ordered[1:]):
            total += self._transit(a, b)
        if total == -math.inf:
            return total
        for i, a in enumerate(ordered):
            for b in ordered[i + 2 :]:
                if self._transit(a, b) == -math.inf:
                    return -math.inf
        return total + appearance_ratio([self._appears(track.number) for track in ordered]) - _sat(ordered)

    def _joined(self, groups: list[Members]) -> list[Members]:
        gains: dict[tuple[Members, Members], float] = {}
        for i, a in enumerate(groups):
            for b in groups[i + 1 :]:
                self._note(gains, a, b)
        while gains:
            a, b = max(gains, key=lambda pair: (gains[pair], sorted(pair[0]), sorted(pair[1])))
            groups = [one for one in groups if one not in (a, b)]
            gains = {pair: gain for pair, gain in gains.items() if a not in pair and b not in pair}
            for one in groups:
                self._note(gains, one, a | b)
            groups.append(a | b)
        return groups

    def _note(self, gains: dict[tuple[Members, Members], float], a: Members, b: Members) -> None:
        gain = self.score(a | b) - self.score(a) - self.score(b)
        if gain > _LEAST_GAIN:
            gains[(a, b)] = gain

    def _moved(self, groups: list[Members]) -> list[Members] | None:
        """Return the groups after the best move; None if none gains."""
        best, choice = _LEAST_GAIN, None
        for i, a in enumerate(groups):
            alone: list[Members] = [frozenset()] if len(a) > 1 else []
            for k, b in enumerate([*groups, *alone]):
                if k == i:
                    continue
                before = self.score(a) + self.score(b)
                for new in self._exchanges(a, b, whole=k > i):
                    gain = self.score(new[0]) + self.score(new[1]) - before
                    if gain > best:
                        best, choice = gain, (a, b, new)
        if choice is None:
            return None
        a, b, new = choice
        return [one for one in [*(one for one in groups if one not in (a, b)), *new] if one]

    def _gathered(self, a: Members, b: Members) -> tuple[Members, Members]:
        """Return a with all tracks of b that can be of one object with those of a, and the rest of b."""
        fitting = frozenset(n for n in b if all(self._possible(n, other) for other in a))
        return a | fitting, b - fitting

    def _possible(self, m: int, n: int) -> bool:
        a, b = self._tracks[m], self._tracks[n]
        if (b.first_ns, b.number) < (a.first_ns, a.number):
            a, b = b, a
        return self._transit(a, b) > -math.inf

    def _exchanges(self, a: Members, b: Members, *, whole: bool) -> list[tuple[Members, Members]]:
        """Return pairs of groups made of the tracks of two. `whole`: those too that do not tell a from b."""
        pairs = [(a - {n}, b | {n}) for n in sorted(a)]
        if not whole:
            return pairs
        if b:
            pairs.append((a | b, frozenset()))
            pairs += [self._gathered(a, b), self._gathered(b, a)]
        times = sorted({self._tracks[n].first_ns for n in a | b})[1:]
        for t_ns in times:
            late_a, late_b = (frozenset(n for n in g if self._tracks[n].first_ns >= t_ns) for g in (a, b))
            pairs.append(((a - late_a) | late_b, (b - late_b) | late_a))
        return pairs


def _sat(tracks: Sequence[Track]) -> float:
    """Return how much more the boxes of tracks at two places say for a sitter than for somebody upright; 0 at one."""
    nearest = min(tracks, key=lambda t: t.closest_m)
    x, y = nearest.fix.state[:2].tolist()
    if all(math.dist((x, y), t.fix.state[:2].tolist()) < _ONE_PLACE_M + t.closest_m for t in tracks):
        return 0.0
    return sum((track.evidence for track in tracks), Evidences()).seated_more
