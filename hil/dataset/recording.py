"""run.mcap of a data set: after each batch's part of the flight stands the chunk with the batch's frames.

Written from the front to the back under a temporary name. What is there from an earlier attempt is written over with
the same bytes, but for chunks of frames that were found whole, which are passed over.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import BinaryIO

from hil.dataset.flight import FlightPart
from hil.dataset.frame_chunk import records_of
from hil.dataset.journal import StoredChunk
from hil.dataset.tree import PART, RECORDING, unwritable
from hil.recorder.mcap_file import McapFile, SafeFile
from hil.recorder.mcap_sink import EventSeries, TopicWriters
from hil.recorder.topics import SAMPLE_TOPICS, TRUTH_TOPICS
from hil.signals.errors import RecordingError


def part_path(root: Path) -> Path:
    """Where the recording is until it is finished."""
    return root / f"{RECORDING}{PART}"


class DatasetRecording:
    """Raises RecordingError from any method where the file cannot be written."""

    def __init__(
        self, root: Path, *, tick_ns: int, metadata: Mapping[str, str], attachments: Mapping[str, bytes]
    ) -> None:
        self._root = root
        self._path = part_path(root)
        final = root / RECORDING
        if final.exists() and not self._path.exists():
            os.rename(final, self._path)
        self._safe = SafeFile(self._path, _open_kept)
        self._mcap = McapFile(self._safe)
        self._tick_ns = tick_ns
        self._truth = TopicWriters(TRUTH_TOPICS, "")
        self._samples: dict[str, TopicWriters] = {}
        self._events = EventSeries(self._mcap)
        self._mcap.metadata("hil_dataset", dict(metadata), 0)
        for name, data in attachments.items():
            self._mcap.attach(name, "text/yaml" if name.endswith(".yaml") else "text/plain", data, 0)

    def add_flight(self, part: FlightPart) -> None:
        """What the flight gave during a batch."""
        blocks = self._truth.blocks(self._mcap, self._tick_ns, part.truths, part.truths["stamp_ns"])
        for port, samples in sorted(part.samples.items()):
            writers = self._samples.get(port)
            if writers is None:
                writers = self._samples[port] = TopicWriters(SAMPLE_TOPICS[samples.kind], port)
            blocks += writers.blocks(self._mcap, self._tick_ns, samples.columns, samples.released_ns)
        for t_ns, what, text in part.events:
            self._events.add(t_ns, what, text)
        blocks.append(self._events.waiting.block())
        self._mcap.chunk(blocks, 0)

    @property
    def size(self) -> int:
        """Bytes so far: where the next chunk will stand."""
        return self._safe.size

    def add_frames(self, chunk: StoredChunk, data: bytes | None) -> None:
        """The chunk of a batch: `data`, or, None, what already stands there."""
        start = self._safe.size
        if data is not None:
            try:
                self._safe.write(data, 0)
            except RecordingError as error:
                raise unwritable(self._path, error.__cause__ or error) from error
        else:
            self._safe.skip(chunk.size)
        for declared in chunk.channels:
            self._mcap.know(*records_of(declared))
        self._mcap.adopt(chunk.facts, start)

    def finish(self, metadata: Mapping[str, str]) -> None:
        """Write the summary and give the file its name."""
        self._mcap.metadata("hil_result", dict(metadata), 0)
        self._mcap.finish(0)
        self._safe.cut()
        self.close()
        try:
            os.rename(self._path, self._root / RECORDING)
        except OSError as error:
            raise unwritable(self._path, error) from error

    def close(self) -> None:
        """Idempotent."""
        self._safe.close()


def _open_kept(path: Path) -> BinaryIO:
    """For writing from the front, with what is there kept."""
    return open(os.open(path, os.O_RDWR | os.O_CREAT, 0o644), "r+b", buffering=0)
