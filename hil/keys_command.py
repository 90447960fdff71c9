"""`hil keys`: CURVE key pairs of the bench and of the clients that may connect to it from other machines."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from firmware_bridge.companion.keys import BENCH, make_keys


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
