"""Where the answers to frames come from: clients on the wire, or the trace of an earlier run."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from firmware_bridge.codecs.companion import ReportValue
from firmware_bridge.companion.frames import CompanionFrame, Reply
from firmware_bridge.companion.server import CompanionServer
from hil.signals.desired import DesiredState
from hil.signals.detections import Detections


@dataclass(frozen=True)
class Client:
    """One who is there to be sent frames."""

    name: str
    topics: frozenset[str]
    control: bool
    returned: int = 0  # how often it came back: another number, another connection


@dataclass(frozen=True)
class Answer:
    """What a client made of a frame, and how long it took by its own clock."""

    frame: int
    desired: DesiredState | None
    finished: bool
    t2_ns: int
    link_ns: int = 0  # what else it took, from the frame sent to the answer here
    report: Mapping[str, ReportValue] | None = None  # what it says of itself; None: nothing new
    detections: Detections | None = None  # in a picture of this frame


class Answers(Protocol):
    """The far side of the link, as the stage sees it."""

    def clients(self, frame: int) -> Sequence[Client]:
        """Those there now, by name, as this frame is made."""
        ...

    def gone(self, client: str) -> str | None:
        """Why it is not there any more; None of one that is."""
        ...

    def send(self, client: str, frame: CompanionFrame, dropped: int) -> bool:
        """Give it a frame, `dropped` others having passed it by; False where it cannot take one now."""
        ...

    def wait(self, client: str, frame: int, limit_s: float) -> Answer | None:
        """Its answer to this frame; None if it is gone, or another since, or silent for so long [wall clock]."""
        ...

    def take(self, limit_s: float = 0.0) -> list[tuple[str, Answer]]:
        """What has come in, or comes first within the limit [wall clock]; who came and went is known afterwards."""
        ...

    def lose(self, client: str, why: str, back_within_s: float) -> bool:
        """Let it go; whether it was back within the time given [wall clock]."""
        ...


class LiveAnswers:
    """Clients on the wire."""

    def __init__(
        self,
        server: CompanionServer,
        *,
        on_sending: Callable[[str, CompanionFrame], None] = lambda _client, _frame: None,
        on_reply: Callable[[Reply], None] = lambda _reply: None,
        ended: Callable[[str], str | None] = lambda _client: None,
    ) -> None:
        """`ended` tells of a client that the bench started how its process ended; None of all others."""
        self._server, self._on_sending, self._on_reply, self._ended = server, on_sending, on_reply, ended
        self._come: list[tuple[str, Answer]] = []
        self._sent_to: dict[str, int] = {}  # which of its connections, counted by its returns

    def clients(self, frame: int = 0) -> list[Client]:  # noqa: ARG002
        there = sorted(self._server.clients, key=lambda c: c.name)
        return [Client(c.name, c.topics, c.control, c.returned) for c in there]

    def gone(self, client: str) -> str | None:
        if self._connection(client) is not None:
            return None
        why, words = self._server.lost.get(client, "it is gone"), self._ended(client)
        return why if words is None else f"{why}; {words}"

    def send(self, client: str, frame: CompanionFrame, dropped: int) -> bool:
        connection = self._connection(client)
        if connection is not None:
            self._sent_to[client] = connection
        self._on_sending(client, frame)
        return client in self._server.send(frame, to=[client], dropped=dropped)

    def wait(self, client: str, frame: int, limit_s: float) -> Answer | None:
        deadline = time.monotonic() + limit_s
        while True:
            for i, (name, answer) in enumerate(self._come):
                if name == client and answer.frame == frame:
                    del self._come[i]
                    return answer
            left_s = deadline - time.monotonic()
            if left_s <= 0.0 or self._connection(client) != self._sent_to.get(client):
                return None
            self._poll(min(left_s, 0.25))

    def take(self, limit_s: float = 0.0) -> list[tuple[str, Answer]]:
        self._poll(0.0 if self._come else limit_s)
        come, self._come = self._come, []
        return come

    def lose(self, client: str, why: str, back_within_s: float) -> bool:
        if self._connection(client) == self._sent_to.get(client):
            self._server.drop(client, why)
        deadline = time.monotonic() + back_within_s
        while True:
            if self._connection(client) is not None:
                return True
            left_s = deadline - time.monotonic()
            if left_s <= 0.0 or self._ended(client) is not None:
                return False
            self._poll(min(left_s, 0.25))

    def _connection(self, client: str) -> int | None:
        return next((c.returned for c in self._server.clients if c.name == client), None)

    def _poll(self, limit_s: float) -> None:
        for reply in self._server.poll(limit_s):
            self._on_reply(reply)
            link_ns = max(reply.t_arrived_ns - reply.t_frame_sent_ns - reply.t2_ns, 0)
            said = reply.report, reply.detections
            answer = Answer(reply.frame, reply.desired, reply.finished, reply.t2_ns, link_ns, *said)
            self._come.append((reply.client, answer))
