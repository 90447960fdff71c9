"""Which frames train, validate and test: by segments of the trajectory, never by single frames.

Neighbouring frames show nearly the same, so a split frame by frame tests on what was trained. Here whole segments go to
one set, and where two sets meet, the first `guard_frames` of the later segment belong to none. The frames of all sets
are counted without the guards.

Of every five segments in a row the second validates, the fourth tests and the others train.
"""

from __future__ import annotations

from dataclasses import dataclass

from hil.signals.errors import RecordingError

SETS = ("train", "validation", "test")
GUARD = "guard"
_SEGMENTS = 20  # of a trajectory
_LEAST_FRAMES = 10  # of such a segment
_FIFTHS = ("train", "validation", "train", "test", "train")
_FEWER = ("train", "validation", "test", "train")


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
    if count > len(_FIFTHS):
        count -= count % len(_FIFTHS)  # three, one and one of them make the shares
    count = min(max(1, min(count, frames // (guard_frames + 1))), frames)
    return [(i + 1) * frames // count - i * frames // count for i in range(count)]


def split_frames(frames: int, *, guard_frames: int = 2) -> Split:
    """By equal segments. With fewer than three of them some set stays empty. RecordingError for no frames."""
    lengths = equal_segments(frames, guard_frames=guard_frames)
    sets = _FEWER if len(lengths) < len(_FIFTHS) else _FIFTHS * (len(lengths) // len(_FIFTHS))
    of_frame: list[str] = []
    for length, chosen in zip(lengths, sets, strict=False):
        guard = guard_frames if of_frame and of_frame[-1] != chosen else 0
        of_frame += [GUARD] * guard + [chosen] * (length - guard)
    return Split(tuple(of_frame))


def split_text(split: Split) -> str:
    """A table of the frames: number and set."""
    return "".join(["#frame,set\n", *(f"{i},{name}\n" for i, name in enumerate(split.of_frame))])
