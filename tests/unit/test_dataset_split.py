"""The split: shares, guards, no frame in two sets, and segments whole."""

from __future__ import annotations

from itertools import pairwise, product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.dataset.formats.split import GUARD, SETS, SHARES, equal_segments, split_frames, split_text
from hil.signals.errors import RecordingError


@pytest.mark.parametrize("frames", [100, 200, 500, 1000, 5000])
def test_shares_are_sixty_twenty_twenty(frames: int) -> None:
    split = split_frames(frames)
    for name, share in zip(SETS, SHARES, strict=True):
        assert split.shares[name] == pytest.approx(share, abs=0.03)
    assert sum(split.counts.values()) == frames
    assert split.counts[GUARD] <= 0.2 * frames


@settings(max_examples=80)
@given(st.lists(st.integers(6, 60), min_size=1, max_size=14), st.integers(0, 5))
def test_segments_are_whole_and_guarded(lengths: list[int], guard: int) -> None:
    starts = [sum(lengths[:i]) for i in range(len(lengths))]
    split = split_frames(sum(lengths), starts, guard_frames=guard)
    assert [first for first, _ in split.segments] == starts
    for (first, name), length in zip(split.segments, lengths, strict=True):
        held = split.of_frame[first : first + length]
        skipped = held.count(GUARD)
        assert held == (GUARD,) * skipped + (name,) * (length - skipped)
    # Frames of two sets are always more than the guard apart.
    used = [(i, name) for i, name in enumerate(split.of_frame) if name != GUARD]
    assert all(b - a > guard for (a, x), (b, y) in pairwise(used) if x != y)
    assert sorted(i for name in (*SETS, GUARD) for i in split.frames(name)) == list(range(sum(lengths)))


@settings(max_examples=12)
@given(st.lists(st.integers(6, 60), min_size=3, max_size=8))
def test_shares_are_about_as_near_as_the_segments_allow(lengths: list[int]) -> None:
    """Against every way there is. The search of many segments is not exhaustive: a tenth may lie between."""
    starts = [sum(lengths[:i]) for i in range(len(lengths))]
    total = sum(lengths)

    def error(counts: list[float]) -> float:
        return counts.count(0) + sum(abs(c - s * total) for c, s in zip(counts, SHARES, strict=True)) / total

    best = min(
        error([sum(n for n, of in zip(lengths, sets, strict=True) if of == k) for k in range(3)])
        for sets in product(range(3), repeat=len(lengths))
    )
    counts = split_frames(total, starts, guard_frames=0).counts
    assert error([counts[name] for name in SETS]) <= best + 0.1


def test_same_input_same_split() -> None:
    assert split_frames(500) == split_frames(500)
    assert split_text(split_frames(3, [0, 1, 2], guard_frames=0)).splitlines()[0] == "#frame,set"


def test_few_frames_make_few_sets() -> None:
    assert split_frames(1).of_frame == ("train",)
    assert equal_segments(2) == [0, 1]
    for frames in range(1, 40):  # never an error, whatever is asked for
        split = split_frames(frames)
        assert len(split.of_frame) == frames
        assert frames < 12 or min(split.counts[name] for name in SETS) > 0


@pytest.mark.parametrize(
    ("frames", "starts", "guard", "what"),
    [
        (0, None, 0, "no frames"),
        (0, [0], 0, "no frames"),
        (10, [1, 5], 0, "begin at 0"),
        (10, [0, 5, 5], 0, "begin at 0"),
        (10, [0, 10], 0, "begin at 0"),
        (10, [], 0, "begin at 0"),
        (10, [0, 8], 2, "no longer than the guard"),
        (10, [0, 5], -1, "0 frames or more"),
    ],
)
def test_refusals(frames: int, starts: list[int] | None, guard: int, what: str) -> None:
    with pytest.raises(RecordingError, match=what):
        split_frames(frames, starts, guard_frames=guard)


def test_shares_must_add_up() -> None:
    with pytest.raises(RecordingError, match="add up to 1"):
        split_frames(10, shares=(0.5, 0.2, 0.2))
