"""One frame: the samples of the bench's sensors since the previous frame, as read-only views on the received bytes.

Nothing is copied. Arrays that came by socket keep their bytes alive. Arrays in the shared ring (`Frame.in_ring`) are
overwritten after the frame has been answered; use `Frame.copy()` to keep them.
"""

from __future__ import annotations

import mmap
import re
from pathlib import Path
from typing import Any, Iterator, Sequence

import numpy as np

from hil_companion.errors import BadMessage, CompanionError
from hil_companion.link.checks import Fields
from hil_companion.link.protocol import MAX_TOPICS, Header, Ring

MAX_DIMENSIONS = 8
MAX_TOPIC = 200  # characters
MAX_ARRAYS = 64  # in one sample
FOLDER = Path("/dev/shm")  # noqa: S108 (Linux shows POSIX shared memory here; no file is created)
_DTYPE = re.compile(r"(?:\|b1|[|<][iu]1|<[iu][248]|<f[248]|<c(?:8|16))\Z")


class Sample:
    """The data of one topic: `sample["rgb"]` is an array or a value."""

    __slots__ = ("arrays", "seq", "t_available_ns", "t_capture_ns", "topic", "values")

    def __init__(
        self,
        topic: str,
        seq: int,
        t_capture_ns: int,
        t_available_ns: int,
        values: dict[str, Any],
        arrays: dict[str, np.ndarray],
    ) -> None:
        self.topic = topic
        self.seq = seq
        self.t_capture_ns = t_capture_ns  # simulated time of the measurement
        self.t_available_ns = t_available_ns  # simulated time at which the sensor delivered it
        self.values = values
        self.arrays = arrays

    def __getitem__(self, name: str) -> Any:
        if name in self.arrays:
            return self.arrays[name]
        if name in self.values:
            return self.values[name]
        names = ", ".join([*self.arrays, *self.values]) or "nothing"
        raise KeyError(f"{self.topic} has no {name!r}; it has {names}")

    def __contains__(self, name: object) -> bool:
        return name in self.arrays or name in self.values

    def latest(self, name: str) -> Any:
        """Return the newest row of a field whose samples are stacked by row; a single value unchanged."""
        value = self[name]
        stacked = name in self.arrays or isinstance(self.values.get("seq"), list)
        return value[-1] if stacked else value

    @property
    def array(self) -> np.ndarray:
        """Return the array of a sample with exactly one. Raises KeyError."""
        if len(self.arrays) != 1:
            raise KeyError(f"{self.topic} has {len(self.arrays)} arrays, not one: {', '.join(self.arrays)}")
        return next(iter(self.arrays.values()))


class Frame:
    """Samples by topic: `frame["front/rgb"]`. Simulated times in ns; `t_received_ns` is this machine's clock."""

    __slots__ = (
        "dropped",
        "frame",
        "in_ring",
        "latency_ns",
        "release",
        "samples",
        "t_ns",
        "t_received_ns",
        "t_sent_ns",
        "tick",
    )

    def __init__(self, header: Header, samples: dict[str, Sample], *, in_ring: bool, t_received_ns: int) -> None:
        fields = Fields(header, "frame")
        self.frame = fields.integer("frame")
        self.tick = fields.integer("tick")
        self.t_ns = fields.integer("t_ns")
        self.t_sent_ns = fields.integer("t_sent_ns")  # the bench's clock
        self.dropped = fields.integer("dropped")  # frames not sent to this client since the previous one
        release = header.get("release")
        self.release: int | None = None if release is None else fields.integer("release")
        self.samples = samples
        self.in_ring = in_ring
        self.t_received_ns = t_received_ns
        self.latency_ns = 0  # round trip plus computing time of the previous frame; 0: not known yet

    def __getitem__(self, topic: str) -> Sample:
        try:
            return self.samples[topic]
        except KeyError:
            names = ", ".join(self.samples) or "nothing"
            raise KeyError(f"frame {self.frame} has no {topic!r}; it has {names}") from None

    def __contains__(self, topic: object) -> bool:
        return topic in self.samples

    def __iter__(self) -> Iterator[str]:
        return iter(self.samples)

    def __len__(self) -> int:
        return len(self.samples)

    def copy(self) -> Frame:
        """Return a frame with copied arrays, which stay valid after this frame has been answered."""
        other: Frame = object.__new__(Frame)
        for name in Frame.__slots__:
            setattr(other, name, getattr(self, name))
        other.in_ring = False
        other.samples = {
            s.topic: Sample(s.topic, s.seq, s.t_capture_ns, s.t_available_ns, s.values, _copies(s.arrays))
            for s in self.samples.values()
        }
        return other


def _copies(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    copies = {name: array.copy() for name, array in arrays.items()}
    for array in copies.values():
        array.flags.writeable = False
    return copies


def can_map() -> bool:
    """Return True if this system has its shared memory as files in /dev/shm."""
    return FOLDER.is_dir()


class RingView:
    """The bench's shared memory, mapped read-only; the arrays of a frame are read in place. Raises CompanionError.

    The memory is mapped by its file, because multiprocessing.shared_memory maps for writing. Before Python 3.13 that
    module also registers the memory with a resource tracker, which removes it at the end of this process.
    """

    def __init__(self, ring: Ring) -> None:
        path = FOLDER / ring.name
        try:
            with path.open("rb") as file:
                self._map = mmap.mmap(file.fileno(), ring.bytes, access=mmap.ACCESS_READ)
        except (OSError, ValueError) as error:
            raise CompanionError(
                f"{path}: the bench's shared memory cannot be mapped ({error}); on another machine, or another user's,"
                " connect without it (--no-shared-memory)"
            ) from error
        self.memory = memoryview(self._map)


def read_samples(header: Header, parts: Sequence[Any], ring: RingView | None = None) -> dict[str, Sample]:
    """Return the samples of a header by topic, with arrays over the message's parts or the ring. Raises BadMessage."""
    fields = Fields(header, "frame")
    if ring is not None:
        memory, base = ring.memory, fields.integer("release")
    else:
        memory, base = getattr(parts[1], "buffer", parts[1]) if len(parts) > 1 else b"", 0
    samples: dict[str, Sample] = {}
    for number, entries in enumerate(fields.sequence("samples", MAX_TOPICS)):
        sample = _sample(Fields(entries, f"{fields.path}.samples[{number}]"), memory, base)
        if sample.topic in samples:
            raise BadMessage(f"frame {header.get('frame')}: {sample.topic!r} comes twice")
        samples[sample.topic] = sample
    return samples


def _sample(fields: Fields, memory: Any, base: int) -> Sample:
    topic, values = fields.text("topic", MAX_TOPIC), fields.mapping("values")
    arrays: dict[str, np.ndarray] = {}
    for number, entries in enumerate(fields.sequence("arrays", MAX_ARRAYS)):
        name, array = _array(Fields(entries, f"{fields.path}.arrays[{number}]"), memory, base)
        if name in arrays or name in values:
            raise BadMessage(f"{topic}: {name!r} comes twice")
        arrays[name] = array
    times = fields.integer("seq"), fields.integer("t_capture_ns"), fields.integer("t_available_ns")
    return Sample(topic, *times, values, arrays)


def _array(fields: Fields, memory: Any, base: int) -> tuple[str, np.ndarray]:
    """Return name and read-only array; its offset in the memory is counted from `base`. Raises BadMessage."""
    name, kind = fields.text("name", 100), fields.text("dtype", 8)
    if not _DTYPE.match(kind):
        raise fields.type_error("dtype", "the name of a little-endian number type, such as <f4,")
    dtype, shape = np.dtype(kind), fields.sequence("shape", MAX_DIMENSIONS)
    size = dtype.itemsize
    for n in shape:
        if type(n) is not int or not 0 <= n < 2**31:
            raise fields.type_error("shape", "whole numbers, not negative,")
        size *= n
    begin = base + fields.integer("offset")
    if begin + size > len(memory):
        raise BadMessage(f"{name}: {size} bytes at {begin} reach beyond the end of the message, {len(memory)}")
    array: np.ndarray = np.ndarray(shape, dtype, memory, begin) if size else np.empty(shape, dtype)
    array.flags.writeable = False
    return name, array
