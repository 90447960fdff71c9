"""Split of the frames into train, validation and test sets, by segments of the trajectory.

Neighbouring frames show nearly the same, so a split by single frames would test on pictures seen in training. Here a
whole segment belongs to one set, and where two sets meet, the first `guard_frames` frames of the later segment belong
to none. Shares are counted without guards.

Of every five consecutive segments the second is for validation, the fourth for test, the others for training.
"""

from __future__ import annotations

from dataclasses import dataclass

from signals.errors import RecordingError

SETS = ("train", "validation", "test")
GUARD = "guard"
_MAX_SEGMENTS = 20
_MIN_SEGMENT_FRAMES = 10
_FIVE_SETS = ("train", "validation", "train", "test", "train")
_FOUR_SETS = ("train", "validation", "test", "train")


@dataclass(frozen=True)
class Split:
    """Set of each frame: `set_by_frame[i]` is train, validation, test or guard."""

    set_by_frame: tuple[str, ...]

    def frames(self, name: str) -> list[int]:
        """Return the frame numbers of one set, in order."""
        return [i for i, set_name in enumerate(self.set_by_frame) if set_name == name]

    @property
    def counts(self) -> dict[str, int]:
        """Number of frames of each set and of the guards."""
        return {name: self.set_by_frame.count(name) for name in (*SETS, GUARD)}

    @property
    def shares(self) -> dict[str, float]:
        """Share of each set in the frames outside guards."""
        counts = self.counts
        used = sum(counts[name] for name in SETS)
        return {name: counts[name] / used if used else 0.0 for name in SETS}


def equal_segments(frames: int, *, guard_frames: int = 0) -> list[int]:
    """Return the lengths of up to 20 nearly equal segments, each longer than the guard.

    Raises RecordingError if there are no frames.
    """
    if frames < 1:
        raise RecordingError("split: there are no frames")
    count = min(_MAX_SEGMENTS, max(len(SETS), frames // _MIN_SEGMENT_FRAMES))
    if count > len(_FIVE_SETS):
        count -= count % len(_FIVE_SETS)  # only whole groups of five give shares of 60/20/20
    count = min(max(1, min(count, frames // (guard_frames + 1))), frames)
    return [(i + 1) * frames // count - i * frames // count for i in range(count)]


def split_frames(frames: int, *, guard_frames: int = 2) -> Split:
    """Split by equal segments; with fewer than three of them a set stays empty. Raises RecordingError for no frames."""
    lengths = equal_segments(frames, guard_frames=guard_frames)
    sets = _FOUR_SETS if len(lengths) < len(_FIVE_SETS) else _FIVE_SETS * (len(lengths) // len(_FIVE_SETS))
    set_by_frame: list[str] = []
    for length, name in zip(lengths, sets, strict=False):
        guard = guard_frames if set_by_frame and set_by_frame[-1] != name else 0
        set_by_frame += [GUARD] * guard + [name] * (length - guard)
    return Split(tuple(set_by_frame))


def split_text(split: Split) -> str:
    """Return split.csv: number and set of each frame."""
    return "".join(["#frame,set\n", *(f"{i},{name}\n" for i, name in enumerate(split.set_by_frame))])
