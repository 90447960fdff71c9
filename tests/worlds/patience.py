"""Time limits of tests: none fails because the machine is busy.

What must come (an answer, a connection, the end of a process) is awaited for PATIENCE_S: only a test that fails waits
so long. What must not come is awaited for SILENCE_S, and nothing that must come is measured with that limit: a link
gets it when the fault begins (`expect_silence`), and what the far side still sends is let in before (`let_arrive`).
"""

from __future__ import annotations

import dataclasses
import select
import threading
import time
from collections.abc import Callable
from typing import Any

from firmware_bridge.links.autopilot_link import LinkTimeouts
from signals.time import NS_PER_S

PATIENCE_S = 300.0
SILENCE_S = 0.3
PATIENT = LinkTimeouts(PATIENCE_S, PATIENCE_S, PATIENCE_S)


def until(condition: Callable[[], Any], what: str = "what was waited for", limit_s: float = PATIENCE_S) -> Any:
    """Wait for `condition` and return its first true value."""
    end_s = time.monotonic() + limit_s
    while not (found := condition()):
        assert time.monotonic() < end_s, f"{what} did not come within {limit_s:g} s"
        time.sleep(0.02)
    return found


def raised_by(act: Callable[[], object]) -> BaseException | None:
    """Call a function that might hang, in a thread that does not outlive the tests, and return what it raises."""
    raised: list[BaseException | None] = []

    def run() -> None:
        try:
            act()
        except BaseException as error:  # noqa: BLE001 (returned)
            raised.append(error)
        else:
            raised.append(None)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(PATIENCE_S)
    assert not thread.is_alive(), f"it did not end within {PATIENCE_S:g} s"
    return raised[0]


def expect_silence(link: Any, limit_s: float = SILENCE_S) -> None:
    """Limit, from now on, how long a link waits for an answer."""
    link._timeouts = dataclasses.replace(link._timeouts, reply_s=limit_s)
    link._silence_limit_ns = int(limit_s * NS_PER_S)  # of links in real time


def let_arrive(link: Any) -> None:
    """Wait until there is something to read for a link."""
    handle = link._transport.fileno()
    assert handle is None or select.select([handle], [], [], PATIENCE_S)[0], "the far side sent nothing"
