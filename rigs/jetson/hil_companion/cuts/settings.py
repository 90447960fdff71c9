"""Checks and defaults that the settings of the shipped CUTs share."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

from hil_companion.errors import OptionError

OUT_VARIABLE = "HIL_COMPANION_OUT"  # folder for a client's files; the bench sets it for clients that it starts


def number(cut: str, name: str, value: Any, *, above: float = -math.inf) -> float:
    """Return a setting as a float. Raises OptionError unless it is a finite number greater than `above`."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value) or value <= above:
        limit = f" above {above:g}" if math.isfinite(above) else ""
        raise OptionError(f"{cut}: {name} {value!r}: a number{limit} is needed")
    return float(value)


def is_list(values: Any, kind: Any, count: int | None = None) -> bool:
    """Return True for a list or tuple of `count` values of the type `kind`, no booleans; `count` None: any number."""
    has_kind = isinstance(values, (list, tuple)) and all(
        isinstance(v, kind) and not isinstance(v, bool) for v in values
    )
    return has_kind and (count is None or len(values) == count)


def output_folder(setting: str | None) -> Path | None:
    """Return the folder for a CUT's files: the setting, or else the bench's; None if there is neither."""
    folder = setting if setting is not None else os.environ.get(OUT_VARIABLE, "")
    return Path(folder) if folder else None
