"""All that one session listens on: ZeroMQ's sockets, the ring and its doors, streams; opened and let go of together."""

from __future__ import annotations

import select
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any

import zmq

from firmware_bridge.codecs.companion import Hello
from firmware_bridge.companion.bench_socket import BenchSocket
from firmware_bridge.companion.doorkeeper import Doorkeeper
from firmware_bridge.companion.doors import Doors
from firmware_bridge.companion.groups import CONTROL, group_of
from firmware_bridge.companion.keys import read_allowed, read_bench_keys
from firmware_bridge.companion.newcomers import Way
from firmware_bridge.companion.sentry import Sentry
from firmware_bridge.companion.settings import CompanionSettings
from firmware_bridge.companion.shared_ring import SharedRing
from firmware_bridge.companion.streams import Streams
from firmware_bridge.companion.unreachable import Unreachable

_NAP_S = 0.002


class Wires:
    """Sockets, doors and streams by group; the group "" is what clients knock at, the others are sensors' ports.

    `doors` and `streams` are the ways beside ZeroMQ: doors with shared memory, streams on the loopback without keys.
    """

    def __init__(self, settings: CompanionSettings) -> None:
        self._settings = settings
        self.sockets: dict[str, BenchSocket] = {}
        self.ring: SharedRing | None = None
        self.doors: Doors | None = None
        self.streams: dict[str, Streams] = {}
        self._poller: Any = zmq.Poller()
        self._zmq_files: set[int] = set()  # descriptors of ZeroMQ, where the poller is the kernel's
        self._knocked_at: set[int] = set()  # descriptors of what clients come to beside ZeroMQ
        self._entries: Any = select.poll()  # both of them
        self._doorkeeper: Doorkeeper | None = None
        self._sentry: Sentry | None = None
        self._context: zmq.Context[zmq.Socket[bytes]] | None = None

    @property
    def entrances(self) -> dict[str, Doors | Streams]:
        """Of the ways beside ZeroMQ, by group."""
        return dict(self.streams) if self.doors is None else {CONTROL: self.doors}

    @property
    def endpoint(self) -> str:
        """Where clients connect to, with the port that was given."""
        return self.sockets[CONTROL].endpoint

    def open(self, topics: Iterable[str]) -> None:
        """Bind. ConfigError (keys), PortBusy, PortNotFound."""
        try:
            self._bind(sorted({group_of(topic) for topic in topics}))
            self._listen()
            self._sentry = Sentry(list(self.sockets.values()))
        except BaseException:
            self.close(0)
            raise

    def _bind(self, groups: Sequence[str]) -> None:
        s = self._settings
        keys = None if s.keys is None or s.bind.startswith("ipc://") else read_bench_keys(s.keys)
        self._context = zmq.Context(io_threads=1)
        if keys is not None and s.keys is not None:
            self._doorkeeper = Doorkeeper(self._context, read_allowed(s.keys))
        self.sockets[CONTROL] = BenchSocket(self._context, s.bind, s, keys)
        if s.arrangement == "ports":
            for i, group in enumerate(groups):
                port = "*" if s.first_port is None else str(s.first_port + i)
                self.sockets[group] = BenchSocket(
                    self._context, f"tcp://{s.host}:{port}", s, keys, any_free="companion.sensor_port=null"
                )
        if s.arrangement == "shared_memory":
            self.ring = SharedRing(s.ring_bytes)
            self.doors = Doors(self.endpoint.removeprefix("ipc://"))
        elif keys is None and s.loopback and s.bind.startswith("tcp://"):
            host = self.endpoint.removeprefix("tcp://").rpartition(":")[0].strip("[]")
            for group in self.sockets:
                self.streams[group] = Streams(host)

    def _listen(self) -> None:
        entrances = self.entrances
        if not entrances:
            for bound in self.sockets.values():
                bound.register(self._poller)
            return
        # Of descriptors: ZeroMQ's own poller takes as long as a frame is on its way.
        self._poller = select.poll()
        self._zmq_files = {bound.fileno() for bound in self.sockets.values()}
        self._knocked_at = {entrance.fileno() for entrance in entrances.values()}
        for fd in self._zmq_files | self._knocked_at:
            self._poller.register(fd, select.POLLIN)
            self._entries.register(fd, select.POLLIN)

    def ways_of(self, hello: Hello, groups: frozenset[str]) -> frozenset[str]:
        """The groups in which a newcomer is to have a way beside ZeroMQ; `groups`: of the sensors' ports it needs."""
        if self.doors is not None:
            return frozenset((CONTROL,)) if hello.shared_memory else frozenset()
        return groups | {CONTROL} if hello.stream and self.streams else frozenset()

    def add(self, way: Way) -> None:
        """One that is waited for from now on."""
        self._poller.register(way, select.POLLIN)

    def remove(self, way: Way) -> None:
        """It is closed too."""
        self._poller.unregister(way)
        way.close()

    def wait(self, limit_ms: int, unsent: Sequence[Way]) -> bool:
        """Until something comes, or one of these can be flushed. Whether something may have come over ZeroMQ, or
        somebody to the doors; where there are no other ways, not known."""
        for way in unsent:
            self._poller.modify(way, select.POLLIN | select.POLLOUT)
        ready = self._poller.poll(limit_ms)
        for way in unsent:
            self._poller.modify(way, select.POLLIN)
        return any(fd in self._zmq_files or fd in self._knocked_at for fd, _ in ready)

    def stirred(self) -> bool:
        """Whether something may have come over ZeroMQ, or somebody to the doors. It has been told once, seldom never:
        ZeroMQ may take notice of what comes while it sends."""
        return bool(self._entries.poll(0))

    def close(self, linger_ms: int) -> None:
        """Let go of everything. May be called twice."""
        if self._sentry is not None:
            self._sentry.close()
            self._sentry = None
        for entrance in self.entrances.values():
            entrance.close()
        self.doors = None
        self.streams.clear()
        for bound in self.sockets.values():
            bound.close(linger_ms)
        self.sockets.clear()
        self._poller, self._entries = zmq.Poller(), select.poll()
        if self._doorkeeper is not None:
            self._doorkeeper.close()
            self._doorkeeper = None
        if self._context is not None:
            self._context.term()  # waits for what lingers, no longer
            self._context = None
        if self.ring is not None:
            self.ring.close()
            self.ring = None


def flush_all(ways: Iterable[Way], limit_ms: int) -> None:
    """What they still hold, as far as it goes within the limit."""
    end_s = time.monotonic() + limit_ms * 1e-3
    left = [way for way in ways if way.unsent_bytes]
    while left and time.monotonic() < end_s:
        for way in list(left):
            with suppress(Unreachable):
                way.flush()
                if way.unsent_bytes:
                    continue
            left.remove(way)
        time.sleep(_NAP_S if left else 0.0)
