"""The journal: which batches are done, what files they made and how to tell that those are whole.

One entry a batch, in their order: the letters HILB, bytes of the head and of the body (uint32), where the batch's
chunk stands in the recording (uint64), CRC-32 of head and body (uint32; all little endian), the head as JSON, the body
as text. An entry that was cut off or damaged ends the journal. The body holds what the batch adds to the COCO files,
one line a picture or annotation.

An entry says nothing of when or by whom a batch was made, so the journal of a data set is the same bytes however often
it was interrupted.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hil.dataset.formats.coco import CocoPicture
from hil.dataset.tree import Written, unwritable
from hil.signals.errors import RecordingError

_HEAD = struct.Struct("<4sIIQI")
_MAGIC = b"HILB"


@dataclass(frozen=True)
class StoredChunk:
    """The chunk of the recording with the batch's frames: its checksum, and what the file's summary says of it."""

    size: int
    crc32: int
    chunk_bytes: int
    plain_size: int
    first_ns: int
    last_ns: int
    index_offsets: dict[int, int]
    counts: dict[int, int]
    channels: tuple[tuple[int, str, str], ...]  # number, topic, type


@dataclass(frozen=True)
class BatchRecord:
    """What became of one batch."""

    index: int
    first_frame: int
    frames: int
    flight_crc32: int  # of the moments that it was made of
    files: tuple[Written, ...]
    samples: dict[str, int]  # by sensor
    frame_t_ns: tuple[int, ...]  # of its frames
    objects: tuple[dict[int, int], ...]  # by frame: class to number of objects
    class_pixels: dict[int, int]
    chunk: StoredChunk
    pictures: tuple[CocoPicture, ...] = ()

    def to_bytes(self, offset: int) -> bytes:
        """`offset`: of its chunk in the recording."""
        # Not dataclasses.asdict: it copies every number, and this is done by the process that the others wait for.
        head = {**self.__dict__, "chunk": self.chunk.__dict__}
        head["pictures"] = [(p.image_id, len(p.annotations)) for p in self.pictures]
        body = [text for p in self.pictures for text in (p.image, *p.annotations)]
        head_bytes = json.dumps(head, separators=(",", ":")).encode()
        body_bytes = "\n".join(body).encode()
        crc = zlib.crc32(body_bytes, zlib.crc32(head_bytes))
        return _HEAD.pack(_MAGIC, len(head_bytes), len(body_bytes), offset, crc) + head_bytes + body_bytes

    @classmethod
    def from_parts(cls, head_bytes: bytes, body_bytes: bytes) -> BatchRecord:
        head: dict[str, Any] = json.loads(head_bytes)
        lines = body_bytes.decode().split("\n")
        pictures, at = [], 0
        for image_id, count in head["pictures"]:
            pictures.append(CocoPicture(image_id, lines[at], tuple(lines[at + 1 : at + 1 + count])))
            at += 1 + count
        chunk = head["chunk"]
        chunk["index_offsets"], chunk["counts"] = _by_number(chunk["index_offsets"]), _by_number(chunk["counts"])
        chunk["channels"] = tuple((number, topic, kind) for number, topic, kind in chunk["channels"])
        return cls(
            index=head["index"],
            first_frame=head["first_frame"],
            frames=head["frames"],
            flight_crc32=head["flight_crc32"],
            files=tuple(Written(*file) for file in head["files"]),
            samples=head["samples"],
            frame_t_ns=tuple(head["frame_t_ns"]),
            objects=tuple(_by_number(counts) for counts in head["objects"]),
            class_pixels=_by_number(head["class_pixels"]),
            chunk=StoredChunk(**chunk),
            pictures=tuple(pictures),
        )


def _by_number(texts: dict[str, int]) -> dict[int, int]:
    return {int(key): value for key, value in texts.items()}


def read_journal(path: Path) -> list[tuple[BatchRecord, int]]:
    """The entries up to the first damaged one, each with the offset of its chunk; none where there is no journal."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return []
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror or error})") from error
    found: list[tuple[BatchRecord, int]] = []
    at = 0
    while at + _HEAD.size <= len(data):
        magic, head, body, offset, crc = _HEAD.unpack_from(data, at)
        first, middle, last = at + _HEAD.size, at + _HEAD.size + head, at + _HEAD.size + head + body
        if magic != _MAGIC or last > len(data) or zlib.crc32(data[first:last]) != crc:
            break
        record = BatchRecord.from_parts(data[first:middle], data[middle:last])
        if record.index != len(found):
            break
        found.append((record, offset))
        at = last
    return found


def read_pictures(path: Path) -> Iterator[CocoPicture]:
    """What a whole journal holds for the COCO files, one batch in memory at a time."""
    try:
        with open(path, "rb") as file:
            while head := file.read(_HEAD.size):
                _, head_size, body_size, _, _ = _HEAD.unpack(head)
                yield from BatchRecord.from_parts(file.read(head_size), file.read(body_size)).pictures
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror or error})") from error


class JournalWriter:
    """Appends entries. Those that are there already, from an earlier attempt, are left as they are."""

    def __init__(self, path: Path, kept: Sequence[tuple[BatchRecord, int]] = ()) -> None:
        self._path = path
        self._kept_bytes = sum(len(record.to_bytes(offset)) for record, offset in kept)
        self.crc32 = 0
        self.size = 0
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
            os.ftruncate(self._file, self._kept_bytes)
        except OSError as error:
            raise unwritable(path, error) from error

    def append(self, record: BatchRecord, offset: int) -> None:
        data = record.to_bytes(offset)
        try:
            if self.size >= self._kept_bytes or os.pread(self._file, len(data), self.size) != data:
                if self.size < self._kept_bytes:  # another entry than before: those after it follow anew
                    os.ftruncate(self._file, self.size)
                    self._kept_bytes = 0
                if os.pwrite(self._file, data, self.size) != len(data):
                    raise OSError("the file system took no more bytes")
        except OSError as error:
            os.ftruncate(self._file, self.size)
            raise unwritable(self._path, error) from error
        self.size += len(data)
        self.crc32 = zlib.crc32(data, self.crc32)

    def close(self) -> None:
        """Idempotent."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def finish(self) -> None:
        """Leave nothing behind the last entry that was appended."""
        os.ftruncate(self._file, self.size)
