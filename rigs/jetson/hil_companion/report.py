"""What a CUT reports of itself: a small flat map that the bench notes in run.json. Checked before it is sent."""

from __future__ import annotations

import math
import re
from typing import Any, Mapping

from hil_companion.errors import CutError

MOST_ENTRIES, LONGEST_TEXT = 32, 200
_NAME = re.compile(r"[A-Za-z0-9_]{1,64}\Z")


def checked_report(report: Mapping[str, Any]) -> dict[str, Any]:
    """The same with plain values. CutError for what the bench would refuse."""
    if len(report) > MOST_ENTRIES:
        raise CutError(f"a report of {len(report)} entries; the bench takes {MOST_ENTRIES}")
    made: dict[str, Any] = {}
    for name, value in report.items():
        if not isinstance(name, str) or not _NAME.match(name):
            raise CutError(f"report {name!r}: names are 1 to 64 letters, digits and _")
        if isinstance(value, str):
            made[name] = value[:LONGEST_TEXT]
        elif isinstance(value, (bool, int)) and abs(value) < 2**53:
            made[name] = value
        elif isinstance(value, float) and math.isfinite(value):
            made[name] = float(value)
        else:
            raise CutError(f"report {name} {value!r}: a text, a boolean or a finite number is needed")
    return made
