"""The split: shares, guards, no frame in two sets, and segments whole."""

from __future__ import annotations

from itertools import pairwise, product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.dataset.formats.split import GUARD, SETS, SHARES, equal_segments, split_frames, split_segments, split_text
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
    split = split_segments(lengths, guard_frames=guard)
    for i, length in enumerate(lengths):
        held = split.of_frame[sum(lengths[:i]) : sum(lengths[: i + 1])]
        skipped, name = held.count(GUARD), held[-1]
        assert held == (GUARD,) * skipped + (name,) * (length - skipped)
    # Frames of two sets are always more than the guard apart.
    used = [(i, name) for i, name in enumerate(split.of_frame) if name != GUARD]
    assert all(b - a > guard for (a, x), (b, y) in pairwise(used) if x != y)
    assert sorted(i for name in (*SETS, GUARD) for i in split.frames(name)) == list(range(sum(lengths)))


@settings(max_examples=12)
@given(st.lists(st.integers(6, 60), min_size=3, max_size=8))
def test_shares_are_about_as_near_as_the_segments_allow(lengths: list[int]) -> None:
    """Against every way there is. The search of many segments is not exhaustive: a tenth may lie between."""
    total = sum(lengths)

    def error(counts: list[float]) -> float:
        return counts.count(0) + sum(abs(c - s * total) for c, s in zip(counts, SHARES, strict=True)) / total

    best = min(
        error([sum(n for n, of in zip(lengths, sets, strict=True) if of == k) for k in range(3)])
        for sets in product(range(3), repeat=len(lengths))
    )
    counts = split_segments(lengths, guard_frames=0).counts
    assert error([counts[name] for name in SETS]) <= best + 0.1


def test_same_input_same_split() -> None:
    assert split_frames(500) == split_frames(500)
    assert split_text(split_frames(3, guard_frames=0)).splitlines()[0] == "#frame,set"


def test_few_frames_make_few_sets() -> None:
    assert split_frames(1).of_frame == ("train",)
    assert equal_segments(2) == [1, 1]
    for frames in range(1, 40):  # never an error, whatever is asked for
        split = split_frames(frames)
        assert len(split.of_frame) == frames
        assert frames < 12 or min(split.counts[name] for name in SETS) > 0


def test_no_frames_are_refused() -> None:
    with pytest.raises(RecordingError, match="no frames"):
        split_frames(0)
