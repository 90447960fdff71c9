"""The signals that end a command."""

from __future__ import annotations

import signal


def stop_signals() -> list[signal.Signals]:
    """Return SIGINT, SIGTERM and SIGHUP; without SIGHUP if it is ignored, as under nohup.

    SIGINT counts though it is ignored: a shell makes the commands ignore it that a script starts in the background.
    """
    found = [signal.SIGINT, signal.SIGTERM]
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        found.append(signal.SIGHUP)
    return found
