"""Writes frames to a folder: one .npy file per array, and `frames.jsonl` with the rest of each frame on a line.

The first frames are written, up to a number of frames and a total size.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import IO, Any

import numpy as np

from hil_companion.errors import CutError, OptionError, file_errors
from hil_companion.frame import Frame, Sample
from hil_companion.link.protocol import Welcome

INDEX_NAME, WELCOME_NAME, ARRAYS_NAME = "frames.jsonl", "welcome.json", "arrays"
NPY_HEADER_BYTES = 128  # for an array of few dimensions
_OF_WELCOME = ("schema", "session", "mode", "tick_ns", "rate_hz", "topics", "sensors", "waypoints_W")
_OF_FRAME = ("frame", "tick", "t_ns", "t_sent_ns", "t_received_ns", "dropped")
_OF_SAMPLE = ("topic", "seq", "t_capture_ns", "t_available_ns", "values")


class Record:
    """The CUT `record`: keeps at most `keep_frames` frames and `keep_mb` megabytes (10^6 bytes) in the folder `out`.

    With `stop`, the client ends as soon as one of these limits is reached.
    """

    topics = ("*",)
    control = False

    def __init__(
        self, *, out: str = "companion-frames", keep_frames: int = 10_000, keep_mb: float = 1000.0, stop: bool = False
    ) -> None:
        if keep_frames < 0 or not keep_mb >= 0:
            raise OptionError("keep_frames and keep_mb cannot be below 0")
        self.frames = 0  # written
        self.bytes = 0  # written
        self.full = False
        self._out = Path(out)
        self._keep_frames = keep_frames
        self._keep_bytes = keep_mb * 1e6
        self._finish_when_full = stop
        self._index: IO[str] | None = None

    @property
    def finished(self) -> bool:
        return self._finish_when_full and self.full

    def start(self, welcome: Welcome) -> None:
        """Make the folder. Raises CutError if it holds an earlier recording."""
        if self._index is not None:
            raise CutError(f"{self._out}: the bench began another session; each is recorded in a folder of its own")
        description = {name: getattr(welcome, name) for name in _OF_WELCOME}
        try:
            (self._out / ARRAYS_NAME).mkdir(parents=True, exist_ok=True)
            self._index = (self._out / INDEX_NAME).open("x", encoding="utf-8")
            (self._out / WELCOME_NAME).write_text(_json(description) + "\n", encoding="utf-8")
        except FileExistsError as error:
            raise CutError(f"{self._out}: a recording is there already; name another folder (--set out=DIR)") from error
        except OSError as error:
            raise CutError(f"{self._out}: cannot be written ({error.strerror or error})") from error

    def __call__(self, frame: Frame) -> None:
        if self._index is None:
            raise CutError("record: a frame came before the session began")
        if self.full:
            return
        line = _json(_described(frame)) + "\n"
        arrays = {_file(frame, s, name): a for s in frame.samples.values() for name, a in s.arrays.items()}
        size = len(line.encode()) + sum(a.nbytes + NPY_HEADER_BYTES for a in arrays.values())
        if self.frames >= self._keep_frames or self.bytes + size > self._keep_bytes:
            self.full = True
            return
        with file_errors(f"{self._out}: cannot be written"):
            for name, array in arrays.items():
                np.save(self._out / ARRAYS_NAME / name, array, allow_pickle=False)
            self._index.write(line)  # after the arrays, so that a line implies complete arrays
            self._index.flush()
        self.frames += 1
        self.bytes += size
        self.full = self.frames >= self._keep_frames

    def stop(self) -> None:
        if self._index is not None:
            self._index.close()


def _file(frame: Frame, sample: Sample, array: str) -> str:
    # A topic comes from the bench and must not name a path outside the folder.
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", f"{frame.frame:08d}_{sample.topic}_{array}")[:200] + ".npy"


def _described(frame: Frame) -> dict[str, Any]:
    samples = [
        {
            **{name: getattr(s, name) for name in _OF_SAMPLE},
            "arrays": {name: f"{ARRAYS_NAME}/{_file(frame, s, name)}" for name in s.arrays},
        }
        for s in frame.samples.values()
    ]
    return {**{name: getattr(frame, name) for name in _OF_FRAME}, "samples": samples}


def _json(entries: Any) -> str:
    return json.dumps(entries, separators=(",", ":"), default=repr)
