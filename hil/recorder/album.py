"""A few frames of each sensor for the report: enough to show one of the flight, however long it is.

Of cameras and LiDARs one from the middle. A radar's middle may hold nothing: of it the frame with the most points, then
the most tracks, the first of equals, if there is one with any.
"""

from __future__ import annotations

from hil.signals.samples import FrameSample, RadarSample

_NOTHING = (0, 0)


class Album:
    """Keeps frames 0, 1, 2, 4, 8, ... of each port, the three newest of them, and a radar's fullest."""

    def __init__(self) -> None:
        self._kept: dict[str, list[FrameSample]] = {}
        self._last: dict[str, int] = {}
        self._fullest: dict[str, tuple[tuple[int, int], FrameSample]] = {}

    def add(self, port: str, sample: FrameSample) -> None:
        """Look at one frame."""
        seq = sample.seq
        self._last[port] = seq
        if seq & (seq - 1) == 0:
            kept = self._kept.setdefault(port, [])
            kept.append(sample)
            del kept[:-3]
        if isinstance(sample, RadarSample):
            found = (len(sample.channels.get("points", ())), len(sample.channels.get("tracks", ())))
            if found > (self._fullest[port][0] if port in self._fullest else _NOTHING):
                self._fullest[port] = found, sample

    def shown(self) -> dict[str, FrameSample]:
        """Of each port a radar's fullest frame, else the kept one that is nearest to the middle of the flight; by port
        in alphabetical order."""
        return {
            port: self._fullest[port][1] if port in self._fullest else self._middle(port) for port in sorted(self._kept)
        }

    def _middle(self, port: str) -> FrameSample:
        half = self._last[port] / 2
        return min(self._kept[port], key=lambda sample: abs(sample.seq - half))
