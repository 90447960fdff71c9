"""A thread that sends the messages of each tick, while the run computes the next one.

A call of the network takes 30 to 200 us. The thread makes it without Python's lock, so that a tick costs the run only
the encoding. Annotations are not texts in this file: `c_call` reads those of a C function.
"""

import ctypes as ct
from collections.abc import Sequence
from queue import SimpleQueue
from threading import Event, Thread

from cyclonedds.internal import DDS, c_call, dds_c_t
from cyclonedds.topic import Sample

_MOST_BATCHES = 50  # ticks that the thread may be behind; then the run waits for it

Batch = Sequence[tuple[int, str, bytes]]  # DDS writer, topic, CDR bytes


class _Write(DDS):
    def __init__(self) -> None:
        super().__init__(0)

    @c_call("dds_write")
    def write(self, writer: dds_c_t.entity, data: ct.c_void_p) -> dds_c_t.returnv: ...


class Sender:
    """Sends batches of messages in their order."""

    def __init__(self) -> None:
        self.failed: str | None = None  # topic of the first message that could not be sent
        self._queue: SimpleQueue[Batch | Event | None] = SimpleQueue()
        self._thread = Thread(target=self._run, name="ros2-sender", daemon=True)
        self._thread.start()

    def send(self, batch: Batch) -> None:
        """Send a batch soon."""
        self._queue.put(batch)
        if self._queue.qsize() > _MOST_BATCHES:
            self.drain()

    def drain(self) -> None:
        """Wait until everything was sent."""
        sent = Event()
        self._queue.put(sent)
        while not sent.wait(0.25):
            if not self._thread.is_alive():
                return

    def close(self) -> None:
        """End the thread after what is left."""
        self._queue.put(None)
        self._thread.join(5.0)

    def _run(self) -> None:
        write = _Write().write
        while (item := self._queue.get()) is not None:
            if isinstance(item, Event):
                item.set()
                continue
            for writer, topic, data in item:
                sample = Sample(ct.cast(ct.c_char_p(data), ct.c_void_p), len(data))
                if write(writer, ct.byref(sample)) < 0 and self.failed is None:
                    self.failed = topic
