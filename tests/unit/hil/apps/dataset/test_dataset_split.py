"""The split: shares, guards, no frame in two sets, and segments whole."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hil.apps.dataset.formats.split import GUARD, SETS, equal_segments, split_frames
from signals.errors import RecordingError


@pytest.mark.parametrize("frames", [100, 200, 500, 1000, 5000])
def test_shares_are_sixty_twenty_twenty(frames: int) -> None:
    split = split_frames(frames)
    for name, share in zip(SETS, (0.6, 0.2, 0.2), strict=True):
        assert split.shares[name] == pytest.approx(share, abs=0.03)
    assert sum(split.counts.values()) == frames
    assert split.counts[GUARD] <= 0.2 * frames


@settings(max_examples=80)
@given(st.integers(1, 2000), st.integers(0, 5))
def test_segments_are_whole_and_guarded(frames: int, guard: int) -> None:
    split = split_frames(frames, guard_frames=guard)
    at = 0
    for length in equal_segments(frames, guard_frames=guard):
        held = split.set_by_frame[at : at + length]
        skipped, name = held.count(GUARD), held[-1]
        assert held == (GUARD,) * skipped + (name,) * (length - skipped)
        at += length
    # Frames of two sets are always more than the guard apart.
    used = [(i, name) for i, name in enumerate(split.set_by_frame) if name != GUARD]
    assert all(b - a > guard for (a, x), (b, y) in pairwise(used) if x != y)
    assert sorted(i for name in (*SETS, GUARD) for i in split.frames(name)) == list(range(frames))


def test_few_frames_make_few_sets() -> None:
    assert split_frames(1).set_by_frame == ("train",)
    assert equal_segments(2) == [1, 1]
    for frames in range(1, 40):  # any number of frames can be split
        split = split_frames(frames)
        assert len(split.set_by_frame) == frames
        assert frames < 12 or min(split.counts[name] for name in SETS) > 0


def test_no_frames_are_refused() -> None:
    with pytest.raises(RecordingError, match="no frames"):
        split_frames(0)
