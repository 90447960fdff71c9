"""Which frames train, validate and test: by segments of the trajectory, never by single frames.

Neighbouring frames show nearly the same, so a split frame by frame tests on what was trained. Here whole segments go to
one set, and where two sets meet, the first `guard_frames` of the later segment belong to none. The frames of all sets
are counted without the guards.

Segments go, along the trajectory, to the set that lags most behind its share; then single segments move or change
places while that brings the counts nearer to the shares. No set stays empty that could have frames. The same input
always gives the same split.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

from hil.signals.errors import RecordingError

SETS = ("train", "validation", "test")
SHARES = (0.6, 0.2, 0.2)
GUARD = "guard"
_SEGMENTS = 20  # of a trajectory that has none of its own
_LEAST_FRAMES = 10  # of such a segment
_FIFTHS = 5
_ALL_TRIED = 7  # segments: 2187 ways


@dataclass(frozen=True)
class Split:
    """`of_frame`: train, validation, test or guard, for each frame."""

    of_frame: tuple[str, ...]

    def frames(self, name: str) -> list[int]:
        """Of one set, in order."""
        return [i for i, of in enumerate(self.of_frame) if of == name]

    @property
    def counts(self) -> dict[str, int]:
        return {name: self.of_frame.count(name) for name in (*SETS, GUARD)}

    @property
    def shares(self) -> dict[str, float]:
        """Of the frames outside guards."""
        counts = self.counts
        used = sum(counts[name] for name in SETS)
        return {name: counts[name] / used if used else 0.0 for name in SETS}


def equal_segments(frames: int, *, guard_frames: int = 0) -> list[int]:
    """Lengths of segments as long as one another, of a sensible number of them, longer than the guard."""
    if frames < 1:
        raise RecordingError("split: there are no frames")
    count = min(_SEGMENTS, max(len(SETS), frames // _LEAST_FRAMES))
    if count > _FIFTHS:
        count -= count % _FIFTHS  # of fifths three, one and one make the shares
    count = min(max(1, min(count, frames // (guard_frames + 1))), frames)
    return [(i + 1) * frames // count - i * frames // count for i in range(count)]


def split_frames(frames: int, *, guard_frames: int = 2) -> Split:
    """By equal segments. RecordingError for no frames."""
    return split_segments(equal_segments(frames, guard_frames=guard_frames), guard_frames=guard_frames)


def split_segments(lengths: Sequence[int], *, guard_frames: int) -> Split:
    """By segments of these lengths, each longer than the guard. With fewer than three some set stays empty."""
    sets = _nearest(lengths, _assigned(lengths), guard_frames)
    of_frame: list[str] = []
    for index, (length, chosen) in enumerate(zip(lengths, sets, strict=True)):
        guard = guard_frames if index and sets[index - 1] != chosen else 0
        of_frame += [GUARD] * guard + [SETS[chosen]] * (length - guard)
    return Split(tuple(of_frame))


def split_text(split: Split) -> str:
    """A table of the frames: number and set."""
    return "".join(["#frame,set\n", *(f"{i},{name}\n" for i, name in enumerate(split.of_frame))])


def _assigned(lengths: Sequence[int]) -> list[int]:
    """Each segment to the set that lags most; of equals the first."""
    given = [0] * len(SETS)
    so_far = 0
    sets = []
    for length in lengths:
        so_far += length
        lag = [share * so_far - count for share, count in zip(SHARES, given, strict=True)]
        chosen = lag.index(max(lag))
        given[chosen] += length
        sets.append(chosen)
    return sets


def _error(lengths: Sequence[int], sets: Sequence[int], guard: int) -> float:
    counts = [0] * len(SETS)
    for index, (length, chosen) in enumerate(zip(lengths, sets, strict=True)):
        counts[chosen] += length - (guard if index and sets[index - 1] != chosen else 0)
    used = sum(counts)
    empty = sum(count == 0 and share > 0.0 for count, share in zip(counts, SHARES, strict=True))
    return empty + sum(abs(count - share * used) for count, share in zip(counts, SHARES, strict=True)) / used


def _nearest(lengths: Sequence[int], sets: list[int], guard: int) -> list[int]:
    """The best of all where there are few segments; else the best change of one or of two, again and again."""
    best, best_error = sets, _error(lengths, sets, guard)
    if len(lengths) <= _ALL_TRIED:
        for tried in product(range(len(SETS)), repeat=len(lengths)):
            error = _error(lengths, tried, guard)
            if error < best_error - 1e-12:
                best, best_error = list(tried), error
        return best
    while True:
        now = best
        for changed in _changes(now):
            error = _error(lengths, changed, guard)
            if error < best_error - 1e-12:
                best, best_error = changed, error
        if best is now:
            return best


def _changes(sets: list[int]) -> list[list[int]]:
    changes = []
    for i, old in enumerate(sets):
        for new in range(len(SETS)):
            if new != old:
                changes.append([*sets[:i], new, *sets[i + 1 :]])
        for j in range(i + 1, len(sets)):
            if sets[j] != old:
                changes.append([*sets[:i], sets[j], *sets[i + 1 : j], old, *sets[j + 1 :]])
    return changes
