"""Sources of answers to frames: connected clients, or (trace.py) the trace of an earlier run."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from firmware_bridge.codecs.companion import ReportValue
from firmware_bridge.companion.frames import CompanionFrame, Reply
from firmware_bridge.companion.server import CompanionServer
from signals.desired import DesiredState
from signals.detections import Detections


@dataclass(frozen=True)
class Client:
    """A connected client."""

    name: str
    topics: frozenset[str]
    control: bool
    reconnections: int = 0  # counts them; a change means a new connection


@dataclass(frozen=True)
class Answer:
    """Answer of a client to a frame, with its compute time by its own clock."""

    frame: int
    desired: DesiredState | None
    finished: bool
    t2_ns: int
    link_ns: int = 0  # time from sending the frame to receiving the answer, without t2
    report: Mapping[str, ReportValue] | None = None  # status values of the client; None: unchanged
    detections: Detections | None = None  # in a picture of this frame; None: it examined no picture


class Answers(Protocol):
    """Interface through which the stage talks to the clients. Limits are wall clock [s]."""

    def clients(self, frame: int) -> Sequence[Client]:
        """Return the clients connected when this frame is made, sorted by name."""
        ...

    def loss_reason(self, client: str) -> str | None:
        """Return why a client is not connected any more, or None if it is connected."""
        ...

    def send(self, client: str, frame: CompanionFrame, dropped: int) -> bool:
        """Send a frame after `dropped` frames were skipped. Return False if the client cannot receive one now."""
        ...

    def wait(self, client: str, frame: int, limit_s: float) -> Answer | None:
        """Return the answer to this frame; None if the client disconnected or reconnected, or the limit passed."""
        ...

    def receive(self, limit_s: float = 0.0) -> list[tuple[str, Answer]]:
        """Return the answers received, or the first within the limit. Updates which clients are connected."""
        ...

    def disconnect(self, client: str, reason: str, reconnect_s: float) -> bool:
        """Close the connection of a client. Return True if it reconnected within the limit."""
        ...

    def observer_detections(self, t_ns: int) -> Sequence[tuple[str, Detections]]:
        """Return recorded detections of clients without control up to this simulated time, each once."""
        ...


class LiveAnswers:
    """Answers of connected clients."""

    def __init__(
        self,
        server: CompanionServer,
        *,
        on_sending: Callable[[str, CompanionFrame], None] = lambda _client, _frame: None,
        on_reply: Callable[[Reply], None] = lambda _reply: None,
        process_end: Callable[[str], str | None] = lambda _client: None,
    ) -> None:
        """`process_end` describes how the process of a client ended; None: it runs, or the bench did not start it."""
        self._server, self._on_sending, self._on_reply, self._process_end = server, on_sending, on_reply, process_end
        self._received: list[tuple[str, Answer]] = []
        self._last_connection: dict[str, int] = {}  # by client: the connection that the last frame was sent on

    def clients(self, frame: int = 0) -> list[Client]:  # noqa: ARG002
        connected = sorted(self._server.clients, key=lambda c: c.name)
        return [Client(c.name, c.topics, c.control, c.returned) for c in connected]

    def loss_reason(self, client: str) -> str | None:
        if self._connection(client) is not None:
            return None
        reason, end = self._server.lost.get(client, "it is not connected"), self._process_end(client)
        return reason if end is None else f"{reason}; {end}"

    def send(self, client: str, frame: CompanionFrame, dropped: int) -> bool:
        connection = self._connection(client)
        if connection is not None:
            self._last_connection[client] = connection
        self._on_sending(client, frame)
        return client in self._server.send(frame, to=[client], dropped=dropped)

    def wait(self, client: str, frame: int, limit_s: float) -> Answer | None:
        deadline = time.monotonic() + limit_s
        while True:
            for i, (name, answer) in enumerate(self._received):
                if name == client and answer.frame == frame:
                    del self._received[i]
                    return answer
            left_s = deadline - time.monotonic()
            if left_s <= 0.0 or self._connection(client) != self._last_connection.get(client):
                return None
            self._poll(min(left_s, 0.25))

    def receive(self, limit_s: float = 0.0) -> list[tuple[str, Answer]]:
        self._poll(0.0 if self._received else limit_s)
        received, self._received = self._received, []
        return received

    def disconnect(self, client: str, reason: str, reconnect_s: float) -> bool:
        if self._connection(client) == self._last_connection.get(client):
            self._server.drop(client, reason)
        deadline = time.monotonic() + reconnect_s
        while True:
            if self._connection(client) is not None:
                return True
            left_s = deadline - time.monotonic()
            if left_s <= 0.0 or self._process_end(client) is not None:
                return False
            self._poll(min(left_s, 0.25))

    def observer_detections(self, t_ns: int) -> Sequence[tuple[str, Detections]]:  # noqa: ARG002
        return ()  # live detections arrive in the answers

    def _connection(self, client: str) -> int | None:
        return next((c.returned for c in self._server.clients if c.name == client), None)

    def _poll(self, limit_s: float) -> None:
        for reply in self._server.poll(limit_s):
            self._on_reply(reply)
            link_ns = max(reply.t_arrived_ns - reply.t_frame_sent_ns - reply.t2_ns, 0)
            values = reply.desired, reply.finished, reply.t2_ns, link_ns, reply.report, reply.detections
            answer = Answer(reply.frame, *values)
            self._received.append((reply.client, answer))
