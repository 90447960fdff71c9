"""Python's collector of cycles, kept quiet while frames come and go.

What a frame is made of is freed when nobody refers to it any more; there are no cycles in it. But at its usual setting
the collector looks through what is alive every few frames, which costs a tenth of a frame's way over shared memory, and
now and then through everything that was ever loaded, which costs many frames.
"""

from __future__ import annotations

import gc

_OBJECTS = 20_000  # made and not freed, before it looks again; a frame is some hundred


class QuietCollector:
    """From `begin` to `end`: what is there at the beginning is left alone."""

    def __init__(self) -> None:
        self._before: tuple[int, int, int] | None = None

    def begin(self) -> None:
        if self._before is None:
            self._before = gc.get_threshold()
            gc.collect()
            gc.freeze()
            gc.set_threshold(_OBJECTS, *self._before[1:])

    def end(self) -> None:
        """As it was. May be called twice."""
        if self._before is not None:
            gc.set_threshold(*self._before)
            gc.unfreeze()
            self._before = None
