"""A clock that only the test moves."""

from __future__ import annotations


class SimulatedTime:
    """A source of nanoseconds: `now_ns`."""

    def __init__(self) -> None:
        self.now_ns = 0

    def __call__(self) -> int:
        return self.now_ns
