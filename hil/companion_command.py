"""`hil companion` and `hil keys`: a client under test on this machine, and key pairs of the bench and its clients.

The client lives in `rigs/jetson`, as a package of its own that knows nothing of the bench, so that it can be copied to
a companion computer, where `python -m hil_companion` is the same. From here it is found by that path.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from firmware_bridge.companion.keys import BENCH, make_keys
from hil.companion.started import use_client


def run_companion(cut: str, address: str, *, topics: Sequence[str], **options: Any) -> int:
    """Run it until the bench ends; the exit status is the client's own, its errors are told by itself. `options`: of
    `hil_companion.command.start`."""
    use_client()
    from hil_companion.command import start, topic_list

    status: int = start(cut, address, topics=topic_list(topics), **options)
    return status


def make_key_pairs(folder: Path, names: Sequence[str], console: Console) -> None:
    """Make the pairs that are missing and say what goes where. ConfigError if one is there already."""
    for file in make_keys(folder, names):
        console.print(str(file), markup=False)
    for name in names:
        console.print(
            f"{name}: take {name}.key and {BENCH}.pub to its machine, then remove {name}.key here; "
            f"whoever's .pub stays here may connect",
            markup=False,
        )
