"""Answers every frame at once and commands nothing, to measure the latency of the link alone."""

from __future__ import annotations

from hil_companion.frame import Frame


class Echo:
    """The CUT `echo`."""

    topics = ("*",)
    control = False

    def __call__(self, frame: Frame) -> None:
        """Return None: no desired state."""
