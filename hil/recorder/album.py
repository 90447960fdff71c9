"""A few frames of each sensor for the report: enough to show one from the middle of the flight, however long it is."""

from __future__ import annotations

from hil.signals.samples import FrameSample


class Album:
    """Keeps frames 0, 1, 2, 4, 8, ... of each port, the three newest of them."""

    def __init__(self) -> None:
        self._kept: dict[str, list[FrameSample]] = {}
        self._last: dict[str, int] = {}

    def add(self, port: str, sample: FrameSample) -> None:
        """Look at one frame."""
        seq = sample.seq
        self._last[port] = seq
        if seq & (seq - 1) == 0:
            kept = self._kept.setdefault(port, [])
            kept.append(sample)
            del kept[:-3]

    def middle(self) -> dict[str, FrameSample]:
        """Of each port the kept frame that is nearest to the middle of the flight, by port in alphabetical order."""
        return {
            port: min(kept, key=lambda sample, half=self._last[port] / 2: abs(sample.seq - half))  # type: ignore[misc]
            for port, kept in sorted(self._kept.items())
        }
