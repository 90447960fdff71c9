"""Trace of the answers of a run, from which the run can be repeated bit for bit without the clients.

`companion.jsonl`: the first line has the clients in control and their topics. Then follows one line per answer in the
order in which the bench applied them: client, frame, t2_ns, link_ns, desired, finished, `report` if it changed, and
`detections`. Other lines are `lost` (a client in control is lost for good), `joined` (a client came later), `demoted`
(a client reconnected without control), `looked_on` (detections of an observer, a client without control, and the
simulated time of their arrival) and at the end `missing` (clients that the flight needed and lost: a replay has no
clients to lose, and takes this part of the verdict from here).
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
from hil.run.companion.answers import Answer, Client
from signals.detections import Detections
from signals.errors import LockstepLost, RecordingError, file_errors

_FORMAT = 1
_INVALID = (ValueError, KeyError, TypeError, IndexError, RecursionError, CodecError)


class TraceWriter:
    """Writes the trace line by line, so that the trace of a killed run is usable."""

    def __init__(self, path: Path, clients: Sequence[Client], topics: Sequence[str]) -> None:
        self._path = path
        with file_errors(path):
            self._file: TextIO = path.open("w", encoding="utf-8")
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

    def observer_detected(self, client: str, t_ns: int, answer: Answer) -> None:
        """Write the detections of a client without control, received at simulated time `t_ns`."""
        assert answer.detections is not None
        values = {"looked_on": client, "frame": answer.frame, "t_ns": t_ns}
        self._line(values | {"detections": detections_map(answer.detections)})

    def joined(self, client: Client, frame: int) -> None:
        """Write that a client is connected from this frame on: it came late, or came back after it was given up."""
        self._line({"joined": _client_map(client), "frame": frame})

    def demoted(self, client: str, frame: int) -> None:
        """Write that a client reconnected without control before this frame."""
        self._line({"demoted": client, "frame": frame})

    def lost(self, client: str, frame: int) -> None:
        """Write that a client is lost for good because it did not answer this frame."""
        self._line({"client": client, "frame": frame, "lost": True})

    def missing(self, reasons: Sequence[str]) -> None:
        """Write which clients the flight needed and lost, as in its verdict."""
        self._line({"missing": list(reasons)})

    def close(self) -> None:
        self._file.close()

    def _line(self, values: dict[str, Any]) -> None:
        with file_errors(self._path):
            self._file.write(json.dumps(values) + "\n")
            self._file.flush()


class TracedAnswers:
    """Answers from a trace.

    Raises RecordingError if the file is not a trace, LockstepLost if it has no answer to a frame of the run.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.missing: list[str] | None = None  # None: the recorded run did not get as far as its verdict
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise RecordingError(f"{path}: cannot be read ({error})") from error
        lines, complete = text.split("\n"), text.endswith("\n")
        if complete:
            lines.pop()
        self.topics: frozenset[str] = frozenset()
        self._clients: list[Client] = []
        self._joins: list[tuple[int, Client]] = []  # with the frame; not reached yet
        self._demotions: list[tuple[int, str]] = []
        self._answers: dict[tuple[str, int], Answer | None] = {}
        self._observer_detections: deque[tuple[int, str, Detections]] = deque()  # not reached yet
        try:
            head = json.loads(lines[0])
            if head["format"] != _FORMAT:
                raise ValueError(f"format {head['format']!r}, not {_FORMAT}")
            self.topics = _topics(head["topics"])
            self._clients = [_client(values) for values in head["clients"]]
        except _INVALID as error:
            raise RecordingError(f"{path}:1: not a trace of companions ({_problem(error)})") from error
        for number, line in enumerate(lines[1:], start=2):
            try:
                self._read(json.loads(line))
            except _INVALID as error:
                if number == len(lines) and not complete:
                    break  # the run was killed
                raise RecordingError(f"{path}:{number}: invalid line in the trace ({_problem(error)})") from error

    def _read(self, values: dict[str, Any]) -> None:
        if "missing" in values:
            self.missing = [str(reason) for reason in values["missing"]]
            return
        frame = _natural_number(values, "frame")
        if "joined" in values:
            self._joins.append((frame, _client(values["joined"])))
            return
        if "demoted" in values:
            self._demotions.append((frame, str(values["demoted"])))
            return
        if "looked_on" in values:
            detections = detections_from_map(values["detections"])
            self._observer_detections.append((_natural_number(values, "t_ns"), str(values["looked_on"]), detections))
            return
        key = str(values["client"]), frame
        if key in self._answers:
            raise ValueError(f"a second answer of {key[0]} to frame {frame}")
        self._answers[key] = _answer(values, frame)

    def observer_detections(self, t_ns: int) -> list[tuple[str, Detections]]:
        due: list[tuple[str, Detections]] = []
        while self._observer_detections and self._observer_detections[0][0] <= t_ns:
            _, client, detections = self._observer_detections.popleft()
            due.append((client, detections))
        return due

    def clients(self, frame: int) -> list[Client]:
        while self._joins and self._joins[0][0] <= frame:
            self._clients.append(self._joins.pop(0)[1])
        connected = self._clients
        while self._demotions and self._demotions[0][0] <= frame:
            _, name = self._demotions.pop(0)
            # CompanionStage must see the client once without control, as in the recorded run. Then it has no effect.
            connected = [replace(c, control=False) if c.name == name else c for c in connected]
            self._clients = [c for c in self._clients if c.name != name]
        return sorted(connected, key=lambda c: c.name)

    def loss_reason(self, client: str) -> str | None:
        return None if any(c.name == client for c in self._clients) else "it was lost in the recorded run"

    def send(self, client: str, frame: CompanionFrame, dropped: int) -> bool:  # noqa: ARG002
        return True

    def wait(self, client: str, frame: int, limit_s: float) -> Answer | None:  # noqa: ARG002
        try:
            return self._answers[client, frame]
        except KeyError:
            raise LockstepLost(
                str(self._path),
                f"has no answer of {client} to frame {frame}: this trace is from another run",
                cause="trace",
            ) from None

    def receive(self, limit_s: float = 0.0) -> list[tuple[str, Answer]]:
        time.sleep(limit_s)
        return []

    def disconnect(self, client: str, reason: str, reconnect_s: float) -> bool:  # noqa: ARG002
        self._clients = [c for c in self._clients if c.name != client]
        return False


def _answer(values: dict[str, Any], frame: int) -> Answer | None:
    if values.get("lost"):
        return None
    desired = None if values["desired"] is None else desired_from_map(values["desired"])
    if not isinstance(values["finished"], bool):
        raise ValueError(f"finished is {values['finished']!r}")
    report = None if values.get("report") is None else report_from_map(values["report"])
    detections = None if values.get("detections") is None else detections_from_map(values["detections"])
    times = _natural_number(values, "t2_ns"), _natural_number(values, "link_ns")
    return Answer(frame, desired, values["finished"], *times, report, detections)


def _natural_number(values: dict[str, Any], key: str) -> int:
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


def _problem(error: Exception) -> str:
    return f"{error} is missing" if isinstance(error, KeyError) else str(error)
