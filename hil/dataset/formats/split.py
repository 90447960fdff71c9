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
from itertools import pairwise, product

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
    """`of_frame`: train, validation, test or guard, for each frame. `segments`: (first frame, set)."""

    of_frame: tuple[str, ...]
    segments: tuple[tuple[int, str], ...]

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


def equal_segments(frames: int, segments: int = 0, *, guard_frames: int = 0) -> list[int]:
    """First frames of segments as long as one another; without a number, of a sensible one, longer than the guard."""
    if frames < 1:
        raise RecordingError("split: there are no frames")
    count = segments or min(_SEGMENTS, max(len(SETS), frames // _LEAST_FRAMES))
    if not segments and count > _FIFTHS:
        count -= count % _FIFTHS  # of fifths three, one and one make the shares
    if not segments:
        count = max(1, min(count, frames // (guard_frames + 1)))
    count = min(count, frames)
    return [i * frames // count for i in range(count)]


def split_frames(
    frames: int, starts: Sequence[int] | None = None, *, guard_frames: int = 2, shares: Sequence[float] = SHARES
) -> Split:
    """`starts`: first frame of each segment of the trajectory, such as its legs; without, equal ones.

    With fewer than three segments some set stays empty. Raises RecordingError for no frames, starts that do not rise
    from 0, and segments that are no longer than the guard.
    """
    firsts = equal_segments(frames, guard_frames=max(guard_frames, 0)) if starts is None else list(starts)
    _check(frames, firsts, guard_frames, shares)
    lengths = [end - first for first, end in zip(firsts, [*firsts[1:], frames], strict=True)]
    sets = _nearest(lengths, _assigned(lengths, shares), guard_frames, shares)
    of_frame: list[str] = []
    for index, (length, chosen) in enumerate(zip(lengths, sets, strict=True)):
        guard = guard_frames if index and sets[index - 1] != chosen else 0
        of_frame += [GUARD] * guard + [SETS[chosen]] * (length - guard)
    return Split(tuple(of_frame), tuple((first, SETS[s]) for first, s in zip(firsts, sets, strict=True)))


def split_text(split: Split) -> str:
    """A table of the frames: number and set."""
    return "".join(["#frame,set\n", *(f"{i},{name}\n" for i, name in enumerate(split.of_frame))])


def _check(frames: int, firsts: Sequence[int], guard_frames: int, shares: Sequence[float]) -> None:
    if frames < 1:
        raise RecordingError("split: there are no frames")
    if len(shares) != len(SETS) or min(shares) < 0.0 or abs(sum(shares) - 1.0) > 1e-9:
        raise RecordingError(f"split: the shares must be {len(SETS)} that add up to 1, not {tuple(shares)}")
    rising = all(a < b for a, b in pairwise(firsts))
    if not firsts or firsts[0] != 0 or not rising or firsts[-1] >= frames:
        raise RecordingError(f"split: segments must begin at 0 and rise within {frames} frames, not {list(firsts)}")
    if guard_frames < 0:
        raise RecordingError(f"split: the guard must be 0 frames or more, not {guard_frames}")
    shortest = min(b - a for a, b in zip(firsts, [*firsts[1:], frames], strict=True))
    if len(firsts) > 1 and shortest <= guard_frames:
        raise RecordingError(
            f"split: a segment of {shortest} frames is no longer than the guard of {guard_frames}; use longer "
            "segments, more frames or a shorter guard"
        )


def _assigned(lengths: Sequence[int], shares: Sequence[float]) -> list[int]:
    """Each segment to the set that lags most; of equals the first."""
    given = [0] * len(SETS)
    so_far = 0
    sets = []
    for length in lengths:
        so_far += length
        lag = [share * so_far - count for share, count in zip(shares, given, strict=True)]
        chosen = lag.index(max(lag))
        given[chosen] += length
        sets.append(chosen)
    return sets


def _error(lengths: Sequence[int], sets: Sequence[int], guard: int, shares: Sequence[float]) -> float:
    counts = [0] * len(SETS)
    for index, (length, chosen) in enumerate(zip(lengths, sets, strict=True)):
        counts[chosen] += length - (guard if index and sets[index - 1] != chosen else 0)
    used = sum(counts)
    empty = sum(count == 0 and share > 0.0 for count, share in zip(counts, shares, strict=True))
    return empty + sum(abs(count - share * used) for count, share in zip(counts, shares, strict=True)) / used


def _nearest(lengths: Sequence[int], sets: list[int], guard: int, shares: Sequence[float]) -> list[int]:
    """The best of all where there are few segments; else the best change of one or of two, again and again."""
    best, best_error = sets, _error(lengths, sets, guard, shares)
    if len(lengths) <= _ALL_TRIED:
        for tried in product(range(len(SETS)), repeat=len(lengths)):
            error = _error(lengths, tried, guard, shares)
            if error < best_error - 1e-12:
                best, best_error = list(tried), error
        return best
    while True:
        now = best
        for changed in _changes(now):
            error = _error(lengths, changed, guard, shares)
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
