"""Channels that are computed from others: one file each, found by the channel's name, with a function

    def fill(pictures, classes, out): ...

that writes `out`, rows of the picture, from the same rows of the channels that the table names (`Channel.of`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from numpy.typing import NDArray

from signals.classes import Classes

Fill = Callable[[Mapping[str, NDArray[Any]], Classes, NDArray[Any]], None]


def fill_of(channel: str) -> Fill:
    """Return the function that computes a channel."""
    fill: Fill = import_module(f"{__name__}.{channel}").fill
    return fill
