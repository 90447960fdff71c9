"""Assembly of frames that travel over several ports.

The bench sends the same header on each port, with that port's topics only and the list of all topics of the frame. A
frame is delivered once all its parts have arrived. A frame that is incomplete when a newer one is complete is dropped
and counted.
"""

from __future__ import annotations

from hil_companion.errors import BadMessage
from hil_companion.frame import Frame

MAX_WAITING = 128  # incomplete frames kept; more than the credits that a client can give


class Barrier:
    """Joins parts of frames to whole frames and delivers these in rising order."""

    def __init__(self) -> None:
        self._waiting: dict[int, tuple[Frame, list[str]]] = {}
        self._newest = -1  # number of the newest delivered frame
        self.incomplete = 0  # frames dropped because a newer one was complete first
        self.late = 0  # parts of frames that had already been dropped or delivered

    def add(self, part: Frame, topics: list[str] | None) -> tuple[Frame | None, int]:
        """Add a part; return the frame that it completes, if any, and how many older frames are dropped for it.

        `topics`: all topics of the frame; None for a frame that came whole. Raises BadMessage.
        """
        if part.frame <= self._newest:
            self.late += 1
            return None, 0
        if topics is None:
            return part, self._deliver(part.frame)
        unexpected = [topic for topic in part.samples if topic not in topics]
        if unexpected:
            raise BadMessage(f"frame {part.frame}: {unexpected[0]!r} came, but is not among ports_of_frame")
        whole, wanted = self._waiting.get(part.frame, (part, topics))
        if whole is not part:
            _join(whole, part, wanted, topics)
        if len(whole.samples) == len(wanted):
            return whole, self._deliver(whole.frame)
        self._waiting[whole.frame] = (whole, wanted)
        if len(self._waiting) > MAX_WAITING:
            del self._waiting[min(self._waiting)]
            self.incomplete += 1
            return None, 1
        return None, 0

    def _deliver(self, frame: int) -> int:
        self._newest = frame
        lost = [n for n in self._waiting if n < frame]
        for n in lost:
            del self._waiting[n]
        self._waiting.pop(frame, None)
        self.incomplete += len(lost)
        return len(lost)


def _join(whole: Frame, part: Frame, wanted: list[str], topics: list[str]) -> None:
    if (part.tick, part.t_ns) != (whole.tick, whole.t_ns) or sorted(topics) != sorted(wanted):
        raise BadMessage(f"frame {part.frame}: its parts differ in tick, time or topics")
    for topic, sample in part.samples.items():
        if topic in whole.samples:
            raise BadMessage(f"frame {part.frame}: {topic!r} came on two ports")
        whole.samples[topic] = sample
    whole.dropped = max(whole.dropped, part.dropped)
    whole.t_received_ns = max(whole.t_received_ns, part.t_received_ns)
