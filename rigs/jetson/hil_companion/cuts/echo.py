"""Answers every frame at once and commands nothing: what the link itself costs."""

from __future__ import annotations

from hil_companion.frame import Frame


class Echo:
    """Says nothing but done."""

    topics = ("*",)
    control = False

    def __call__(self, frame: Frame) -> None:
        """Nothing is desired."""
