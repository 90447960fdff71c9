"""One frame: what the bench's sensors delivered since the frame before, as read-only views on the received bytes.

Nothing is copied. Arrays that came by socket keep their bytes alive for as long as they are held. Those in the shared
ring (`Frame.in_ring`) are overwritten after the frame has been answered: `Frame.copy()` what is to outlive that.
"""

from __future__ import annotations

import mmap
import re
from pathlib import Path
from typing import Any, Iterator, Sequence

import numpy as np

from hil_companion.checks import Fields
from hil_companion.errors import BadMessage, CompanionError
from hil_companion.protocol import MAX_TOPICS, Header, Ring

MAX_DIMENSIONS = 8
MAX_TOPIC = 200  # characters
MAX_ARRAYS = 64  # of one sample
FOLDER = Path("/dev/shm")  # noqa: S108 (where Linux keeps POSIX shared memory; nothing is made there)
_DTYPE = re.compile(r"(?:\|b1|[|<][iu]1|<[iu][248]|<f[248]|<c(?:8|16))\Z")


class Sample:
    """What one topic delivered: `sample["rgb"]` is an array or a value."""

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
        self.t_capture_ns = t_capture_ns  # simulated time at which it was taken
        self.t_available_ns = t_available_ns  # and at which it left the sensor
        self.values = values
        self.arrays = arrays

    def __getitem__(self, name: str) -> Any:
        if name in self.arrays:
            return self.arrays[name]
        if name in self.values:
            return self.values[name]
        there = ", ".join([*self.arrays, *self.values]) or "nothing"
        raise KeyError(f"{self.topic} has no {name!r}; it has {there}")

    def __contains__(self, name: object) -> bool:
        return name in self.arrays or name in self.values

    def latest(self, name: str) -> Any:
        """The newest row of a field of a topic whose samples are stacked one a row; a single value as it is."""
        value = self[name]
        stacked = name in self.arrays or isinstance(self.values.get("seq"), list)
        return value[-1] if stacked else value

    @property
    def array(self) -> np.ndarray:
        """The one array of a sample that has one."""
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
        at = Fields(header, "frame")
        self.frame = at.integer("frame")
        self.tick = at.integer("tick")
        self.t_ns = at.integer("t_ns")
        self.t_sent_ns = at.integer("t_sent_ns")  # the bench's clock
        self.dropped = at.integer("dropped")  # frames that this client did not get since the one before
        release = header.get("release")
        self.release: int | None = None if release is None else at.integer("release")
        self.samples = samples
        self.in_ring = in_ring
        self.t_received_ns = t_received_ns
        self.latency_ns = 0  # of the frame before: both ways on the wire and the CUT's own time; 0: not known yet

    def __getitem__(self, topic: str) -> Sample:
        try:
            return self.samples[topic]
        except KeyError:
            there = ", ".join(self.samples) or "nothing"
            raise KeyError(f"frame {self.frame} has no {topic!r}; it has {there}") from None

    def __contains__(self, topic: object) -> bool:
        return topic in self.samples

    def __iter__(self) -> Iterator[str]:
        return iter(self.samples)

    def __len__(self) -> int:
        return len(self.samples)

    def copy(self) -> Frame:
        """The same with arrays of its own, which stay when the ring's slot has been given back."""
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
    """Whether this system shows shared memory as files."""
    return FOLDER.is_dir()


class RingView:
    """The bench's shared memory, mapped read-only: it copies a frame's arrays there once, and they are read in place.

    Mapped by its file and not by multiprocessing.shared_memory: before Python 3.13 that one hands the memory to a
    resource tracker, which would remove it under the bench when this process ends; and it maps for writing.
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
    """The samples of a header, their arrays laid over `parts` (all of the message) or the ring. BadMessage."""
    at = Fields(header, "frame")
    if ring is not None:
        memory, base = ring.memory, at.integer("release")
    else:
        memory, base = getattr(parts[1], "buffer", parts[1]) if len(parts) > 1 else b"", 0
    samples: dict[str, Sample] = {}
    for number, entries in enumerate(at.sequence("samples", MAX_TOPICS)):
        sample = _sample(Fields(entries, f"{at.place}.samples[{number}]"), memory, base)
        if sample.topic in samples:
            raise BadMessage(f"frame {header.get('frame')}: {sample.topic!r} comes twice")
        samples[sample.topic] = sample
    return samples


def _sample(at: Fields, memory: Any, base: int) -> Sample:
    topic, values = at.text("topic", MAX_TOPIC), at.mapping("values")
    arrays: dict[str, np.ndarray] = {}
    for number, entries in enumerate(at.sequence("arrays", MAX_ARRAYS)):
        name, array = _array(Fields(entries, f"{at.place}.arrays[{number}]"), memory, base)
        if name in arrays or name in values:
            raise BadMessage(f"{topic}: {name!r} comes twice")
        arrays[name] = array
    times = at.integer("seq"), at.integer("t_capture_ns"), at.integer("t_available_ns")
    return Sample(topic, *times, values, arrays)


def _array(at: Fields, memory: Any, base: int) -> tuple[str, np.ndarray]:
    """Name and array, read-only, in this memory; its offset is counted from `base`."""
    name, kind = at.text("name", 100), at.text("dtype", 8)
    if not _DTYPE.match(kind):
        raise at.wrong("dtype", "the name of a little-endian number type, such as <f4,")
    dtype, shape = np.dtype(kind), at.sequence("shape", MAX_DIMENSIONS)
    size = dtype.itemsize
    for n in shape:
        if type(n) is not int or not 0 <= n < 2**31:
            raise at.wrong("shape", "whole numbers, not negative,")
        size *= n
    begin = base + at.integer("offset")
    if begin + size > len(memory):
        raise BadMessage(f"{name}: {size} bytes at {begin}, where there are {len(memory)}")
    array: np.ndarray = np.ndarray(shape, dtype, memory, begin) if size else np.empty(shape, dtype)
    array.flags.writeable = False
    return name, array
