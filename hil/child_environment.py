"""The environment of a process of our own that runs `python -m hil...`, from whatever folder."""

from __future__ import annotations

import os
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[1]


def child_environment() -> dict[str, str]:
    """Ours, and a module path that finds this very package first."""
    path = os.pathsep.join(filter(None, (str(_ROOT), os.environ.get("PYTHONPATH"))))
    return os.environ | {"PYTHONPATH": path}
