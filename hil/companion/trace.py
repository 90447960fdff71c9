"""The answers of a run as a file, so that the run can be repeated bit for bit without the clients.

`companion.jsonl`: first a line with the clients that controlled and their topics, then one line per answer in the order
in which the bench took them: client, frame, t2_ns, link_ns, desired, finished, and `report` where it is new; `lost`
where one was given up, `joined` where one came later. What it detected goes with its answer (`detections`); of clients
that control nothing there is a line of that alone, with the time at which it came (`looked_on`).
"""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TextIO

from firmware_bridge.codecs.companion import desired_from_map, desired_map, report_from_map
from firmware_bridge.codecs.companion_detections import detections_from_map, detections_map
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.companion.frames import CompanionFrame
from hil.companion.answers import Answer, Client
from hil.companion.trace_name import TRACE_NAME as TRACE_NAME
from hil.signals.detections import Detections
from hil.signals.errors import LockstepLost, RecordingError

_FORMAT = 1
_NO_TRACE = (ValueError, KeyError, TypeError, IndexError, RecursionError, CodecError)


class TraceWriter:
    """Line by line, so that what a killed run has seen is there."""

    def __init__(self, path: Path, clients: Sequence[Client], topics: Sequence[str]) -> None:
        self._path = path
        try:
            self._file: TextIO = path.open("w", encoding="utf-8")
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written ({error.strerror or error})") from error
        self._line({"format": _FORMAT, "clients": [_client_map(c) for c in clients], "topics": sorted(topics)})

    def answer(self, client: str, answer: Answer) -> None:
        desired = None if answer.desired is None else desired_map(answer.desired)
        self._line(
            {
                "client": client,
                "frame": answer.frame,
                "t2_ns": answer.t2_ns,
                "link_ns": answer.link_ns,
                "desired": desired,
                "finished": answer.finished,
                **({} if answer.report is None else {"report": dict(answer.report)}),
                **({} if answer.detections is None else {"detections": detections_map(answer.detections)}),
            }
        )

    def looked_on(self, client: str, t_ns: int, answer: Answer) -> None:
        """What one that controls nothing has detected; it came at `t_ns`, simulated."""
        assert answer.detections is not None
        values = {"looked_on": client, "frame": answer.frame, "t_ns": t_ns}
        self._line(values | {"detections": detections_map(answer.detections)})

    def joined(self, client: Client, frame: int) -> None:
        """Later than the others, or again after it was given up: there from this frame on."""
        self._line({"joined": _client_map(client), "frame": frame})

    def demoted(self, client: str, frame: int) -> None:
        """Back without control, noticed before this frame."""
        self._line({"demoted": client, "frame": frame})

    def lost(self, client: str, frame: int) -> None:
        """Given up over this frame."""
        self._line({"client": client, "frame": frame, "lost": True})

    def close(self) -> None:
        self._file.close()

    def _line(self, values: dict[str, Any]) -> None:
        try:
            self._file.write(json.dumps(values) + "\n")
            self._file.flush()
        except OSError as error:
            raise RecordingError(f"{self._path}: cannot be written ({error.strerror or error})") from error


class TracedAnswers:
    """Answers as they were given. RecordingError: the file is no trace. LockstepLost: the run asks for others."""

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise RecordingError(f"{path}: cannot be read ({error})") from error
        lines, complete = text.split("\n"), text.endswith("\n")
        if complete:
            lines.pop()
        self.topics: frozenset[str] = frozenset()
        self._clients: list[Client] = []
        self._joins: list[tuple[int, Client]] = []  # still to come
        self._demotions: list[tuple[int, str]] = []
        self._answers: dict[tuple[str, int], Answer | None] = {}
        self._looked_on: deque[tuple[int, str, Detections]] = deque()  # still to come
        try:
            head = json.loads(lines[0])
            if head["format"] != _FORMAT:
                raise ValueError(f"format {head['format']!r}, not {_FORMAT}")
            self.topics = _topics(head["topics"])
            self._clients = [_client(one) for one in head["clients"]]
        except _NO_TRACE as error:
            raise RecordingError(f"{path}:1: is no trace of companions ({_words(error)})") from error
        for number, line in enumerate(lines[1:], start=2):
            try:
                self._read(json.loads(line))
            except _NO_TRACE as error:
                if number == len(lines) and not complete:
                    break  # of a run that was killed
                raise RecordingError(f"{path}:{number}: is no answer of a companion ({_words(error)})") from error

    def _read(self, values: dict[str, Any]) -> None:
        frame = _count(values, "frame")
        if "joined" in values:
            self._joins.append((frame, _client(values["joined"])))
            return
        if "demoted" in values:
            self._demotions.append((frame, str(values["demoted"])))
            return
        if "looked_on" in values:
            detections = detections_from_map(values["detections"])
            self._looked_on.append((_count(values, "t_ns"), str(values["looked_on"]), detections))
            return
        place = str(values["client"]), frame
        if place in self._answers:
            raise ValueError(f"a second answer of {place[0]} to frame {frame}")
        self._answers[place] = _answer(values, frame)

    def detected_then(self, t_ns: int) -> list[tuple[str, Detections]]:
        """What lookers-on had detected by this time of the run, and has not been asked for yet."""
        come: list[tuple[str, Detections]] = []
        while self._looked_on and self._looked_on[0][0] <= t_ns:
            _, client, detections = self._looked_on.popleft()
            come.append((client, detections))
        return come

    def clients(self, frame: int) -> list[Client]:
        while self._joins and self._joins[0][0] <= frame:
            self._clients.append(self._joins.pop(0)[1])
        there = self._clients
        while self._demotions and self._demotions[0][0] <= frame:
            _, name = self._demotions.pop(0)
            # Seen once without control, as in the recorded run; what it looked on at afterwards changes nothing.
            there = [replace(c, control=False) if c.name == name else c for c in there]
            self._clients = [c for c in self._clients if c.name != name]
        return sorted(there, key=lambda c: c.name)

    def gone(self, client: str) -> str | None:
        return None if any(c.name == client for c in self._clients) else "it was given up in the recorded run"

    def send(self, client: str, frame: CompanionFrame, dropped: int) -> bool:  # noqa: ARG002
        return True

    def wait(self, client: str, frame: int, limit_s: float) -> Answer | None:  # noqa: ARG002
        try:
            return self._answers[client, frame]
        except KeyError:
            raise LockstepLost(
                str(self._path), f"holds no answer of {client} to frame {frame}: it is of another run", cause="trace"
            ) from None

    def take(self, limit_s: float = 0.0) -> list[tuple[str, Answer]]:
        time.sleep(limit_s)
        return []

    def lose(self, client: str, why: str, back_within_s: float) -> bool:  # noqa: ARG002
        self._clients = [c for c in self._clients if c.name != client]
        return False


def _answer(values: dict[str, Any], frame: int) -> Answer | None:
    if values.get("lost"):
        return None
    desired = None if values["desired"] is None else desired_from_map(values["desired"])
    if not isinstance(values["finished"], bool):
        raise ValueError(f"finished is {values['finished']!r}")
    report = None if values.get("report") is None else report_from_map(values["report"])
    seen = None if values.get("detections") is None else detections_from_map(values["detections"])
    times = _count(values, "t2_ns"), _count(values, "link_ns")
    return Answer(frame, desired, values["finished"], *times, report, seen)


def _count(values: dict[str, Any], key: str) -> int:
    value = values[key]
    if type(value) is not int or value < 0:
        raise ValueError(f"{key} is {value!r}")
    return value


def _client_map(client: Client) -> dict[str, Any]:
    return {"name": client.name, "topics": sorted(client.topics), "control": client.control}


def _client(values: dict[str, Any]) -> Client:
    return Client(str(values["name"]), _topics(values["topics"]), bool(values["control"]))


def _topics(values: Any) -> frozenset[str]:
    if not isinstance(values, list) or not all(isinstance(topic, str) for topic in values):
        raise ValueError(f"topics are {values!r}")
    return frozenset(values)


def _words(error: Exception) -> str:
    return f"without {error}" if isinstance(error, KeyError) else str(error)
