"""Commands that fly a case of a campaign again."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path


def run_command(bench: Path | None, texts: Sequence[str]) -> str:
    """Return the line of `hil run` that flies a case. `bench`: file of the base bench."""
    words = ["hil", "run"] + ([] if bench is None else [str(bench)])
    for text in texts:
        words += ["--set", text]
    return shlex.join(words)


def replay_command(folder: Path) -> str:
    """Return the line of `hil replay` for a recorded case in `folder`."""
    return shlex.join(["hil", "replay", str(folder)])
