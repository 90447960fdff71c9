"""Says what a command waits for, at once and again while that lasts.

Ray's calls block, on a loaded machine for minutes, so a thread repeats it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console

Say = Callable[[str], None]
AGAIN_S = 15.0  # between two lines about the same thing


def said_on(console: Console, *, quiet: bool) -> Say:
    """Return a function that prints lines on a console; with `quiet` it prints nothing."""

    def say(text: str) -> None:
        if not quiet:
            console.print(text, markup=False, highlight=False)

    return say


@contextmanager
def waiting_for(what: str, say: Say) -> Iterator[None]:
    """Say what the block waits for, and again every AGAIN_S with the time so far."""
    ended, began_s = threading.Event(), time.monotonic()

    def repeat() -> None:
        while not ended.wait(AGAIN_S):
            say(f"{what}, for {time.monotonic() - began_s:.0f} s now")

    say(what)
    repeating = threading.Thread(target=repeat, daemon=True)
    repeating.start()
    try:
        yield
    finally:
        ended.set()
        repeating.join()
