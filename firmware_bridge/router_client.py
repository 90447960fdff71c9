"""One client of the router: what it has said, from which systems, and what of it still waits for the autopilot."""

from __future__ import annotations

from collections import deque

from firmware_bridge.codecs.mavlink_frame import Frame, FrameParser

# Of one client towards the autopilot: a flood costs its sender, and nobody else.
_QUEUE_LIMIT = 16384
_SYSTEMS_LIMIT = 32


class Client:
    """Made when the first bytes come; counts as one (`spoken`) from its first admitted frame on."""

    __slots__ = ("_queue", "_queued_bytes", "heard_ns", "name", "parser", "refused", "spoken", "systems")

    def __init__(self, name: str) -> None:
        self.name = name
        # A parser each: half a frame of one must not meet half a frame of another.
        self.parser = FrameParser()
        self.systems: dict[int, set[int]] = {}  # system -> its components heard here
        self.heard_ns = 0  # wall clock
        self.spoken = False
        self.refused: set[str] = set()  # reasons of which an event has told
        self._queue: deque[bytes] = deque()
        self._queued_bytes = 0

    @property
    def queued_bytes(self) -> int:
        return self._queued_bytes

    def learn(self, frame: Frame) -> None:
        """A system speaks here. Past a bound the oldest knowledge goes: nobody has that many systems."""
        components = self.systems.get(frame.sysid)
        if components is None:
            if len(self.systems) >= _SYSTEMS_LIMIT:
                del self.systems[next(iter(self.systems))]
            components = self.systems[frame.sysid] = set()
        components.add(frame.compid)

    def wants(self, system: int, component: int) -> bool:
        """Whether a message addressed like this belongs here: everybody's, or that of a system heard here."""
        if not system:
            return True
        components = self.systems.get(system)
        return components is not None and (not component or component in components)

    def enqueue(self, raw: bytes) -> bool:
        """Keep for the autopilot; False where there is no room."""
        if self._queued_bytes + len(raw) > _QUEUE_LIMIT:
            return False
        self._queue.append(raw)
        self._queued_bytes += len(raw)
        return True

    def take(self, room: int) -> bytes | None:
        """The next frame for the autopilot, if there is one and it fits."""
        if not self._queue or len(self._queue[0]) > room:
            return None
        raw = self._queue.popleft()
        self._queued_bytes -= len(raw)
        return raw
