"""Companion clients by name: the shipped ones, and MODULE:NAME of a user's own."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

import rigs

CLIENT_PATH = Path(rigs.__file__).resolve().parent / "jetson"  # the folder of the package `hil_companion`


def client_name(cut: str) -> str:
    """Return the name under which a client registers: 'echo' for 'echo', 'fly' for 'my.module:fly'."""
    return cut.rpartition(":")[2]


def make_client_importable() -> None:
    """Make the package `hil_companion` importable."""
    if str(CLIENT_PATH) not in sys.path:
        sys.path.insert(0, str(CLIENT_PATH))


def known_clients() -> tuple[str, ...]:
    """Return the names of the shipped clients."""
    make_client_importable()
    from hil_companion.catalog import SHIPPED

    return tuple(SHIPPED)


def unknown_clients(names: Iterable[str]) -> list[str]:
    """Return the names that are neither a shipped client nor MODULE:NAME."""
    return [name for name in names if name not in known_clients() and ":" not in name]
