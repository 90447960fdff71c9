"""The answers of a run as a file, so that the run can be repeated bit for bit without the clients.

`companion.jsonl`: first a line with the clients that controlled and their topics, then one line per answer in the order
in which the bench took them: client, frame, t2_ns, link_ns, desired, finished; `lost` where one was given up.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TextIO

from firmware_bridge.codecs.companion import desired_from_map, desired_map
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.companion.frames import CompanionFrame
from hil.companion.answers import Answer, Client
from hil.companion.trace_name import TRACE_NAME as TRACE_NAME
from hil.signals.errors import LockstepLost, RecordingError

_FORMAT = 1


class TraceWriter:
    """Line by line, so that what a killed run has seen is there."""

    def __init__(self, path: Path, clients: Sequence[Client], topics: Sequence[str]) -> None:
        self._path = path
        try:
            self._file: TextIO = path.open("w", encoding="utf-8")
        except OSError as error:
            raise RecordingError(f"{path}: cannot be written ({error.strerror or error})") from error
        them = [{"name": c.name, "topics": sorted(c.topics), "control": c.control} for c in clients]
        self._line({"format": _FORMAT, "clients": them, "topics": sorted(topics)})

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
            }
        )

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
            lines = path.read_text(encoding="utf-8").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise RecordingError(f"{path}: cannot be read ({error})") from error
        self.topics: frozenset[str] = frozenset()
        self._clients: list[Client] = []
        self._answers: dict[tuple[str, int], Answer | None] = {}
        try:
            head = json.loads(lines[0])
            if head["format"] != _FORMAT:
                raise ValueError(f"format {head['format']!r}, not {_FORMAT}")
            self.topics = frozenset(head["topics"])
            for one in head["clients"]:
                self._clients.append(Client(str(one["name"]), frozenset(one["topics"]), bool(one["control"])))
        except (ValueError, KeyError, TypeError, IndexError) as error:
            raise RecordingError(f"{path}:1: is no trace of companions ({error})") from error
        for number, line in enumerate(lines[1:], start=2):
            try:
                values = json.loads(line)
                self._answers[str(values["client"]), int(values["frame"])] = _answer(values)
            except (ValueError, KeyError, TypeError, CodecError) as error:
                if number == len(lines):
                    break  # of a run that was killed
                raise RecordingError(f"{path}:{number}: is no answer of a companion ({error})") from error

    def clients(self) -> list[Client]:
        return sorted(self._clients, key=lambda c: c.name)

    def send(self, client: str, frame: CompanionFrame, dropped: int) -> bool:  # noqa: ARG002
        return True

    def wait(self, client: str, frame: int, limit_s: float) -> Answer | None:  # noqa: ARG002
        try:
            return self._answers[client, frame]
        except KeyError:
            raise LockstepLost(
                str(self._path), f"holds no answer of {client} to frame {frame}: it is of another run", cause="trace"
            ) from None

    def take(self, limit_s: float = 0.0) -> list[tuple[str, Answer]]:  # noqa: ARG002
        return []

    def lose(self, client: str, why: str, back_within_s: float) -> bool:  # noqa: ARG002
        self._clients = [c for c in self._clients if c.name != client]
        return False


def _answer(values: dict[str, Any]) -> Answer | None:
    if values.get("lost"):
        return None
    desired = None if values["desired"] is None else desired_from_map(values["desired"])
    t2_ns = int(values["t2_ns"])
    link_ns = int(values["link_ns"])
    if t2_ns < 0 or link_ns < 0:
        raise ValueError(f"t2_ns is {t2_ns}, link_ns {link_ns}")
    return Answer(int(values["frame"]), desired, bool(values["finished"]), t2_ns, link_ns)
