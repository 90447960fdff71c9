"""Reads a file of parameters as ground stations save it, `autopilot.params_file`.

    QGroundControl    vehicle id, component id, name, value, type (9: a real number): "1	1	MPC_XY_CRUISE	5.0	9"
    Mission Planner   name, value: "WPNAV_SPEED,500", or with blanks

Lines that begin with # are comments. Parameters of other components than the autopilot (1) are left out.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import NamedTuple

from signals.documents.document import shown_path
from signals.errors import ConfigError, Problem

_AUTOPILOT = "1"  # MAV_COMP_ID_AUTOPILOT1
_NAME = re.compile(r"[A-Z0-9_]{1,16}")
_MOST_BYTES = 1_000_000  # a firmware has about a thousand parameters, of 40 bytes each


class FileParameter(NamedTuple):
    """One parameter of a file; `where` is 'file:line'."""

    name: str
    value: float
    where: str


def read_params_file(path: Path) -> list[FileParameter]:
    """Return the parameters of a file in its order. Raises ConfigError with every problem."""
    shown = shown_path(path)
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise ConfigError.at(shown, "is too large to be a file of parameters")
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError.at(shown, f"cannot be read as a file of parameters ({error})") from None
    found: dict[str, FileParameter] = {}
    vehicles: set[str] = set()
    problems: list[Problem] = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        where = f"{shown}:{number}"
        if len(words) == 5:
            if words[1] != _AUTOPILOT:
                continue
            vehicles.add(words[0])
        elif len(words) != 2:
            hint = "QGroundControl writes `1 1 NAME VALUE TYPE`, Mission Planner `NAME,VALUE`"
            problems.append(Problem(where, f"is not a parameter: {line.strip()[:60]!r}", hint))
            continue
        name, word = words[2:4] if len(words) == 5 else words
        if not _NAME.fullmatch(name):
            problems.append(Problem(where, f"{name!r} cannot be a parameter", "1 to 16 of A-Z, 0-9 and _"))
        elif (value := _number(word)) is None:
            problems.append(Problem(where, f"{name} must be a number, not {word!r}"))
        elif name in found:
            problems.append(Problem(where, f"{name} is given a second time", f"first at {found[name].where}"))
        else:
            found[name] = FileParameter(name, value, where)
    if len(vehicles) > 1:
        problems.append(Problem(shown, f"has parameters of several vehicles: {', '.join(sorted(vehicles))}"))
    if not found and not problems:
        problems.append(Problem(shown, "has no parameters"))
    if problems:
        raise ConfigError(problems)
    return list(found.values())


def _number(word: str) -> float | None:
    try:
        value = float(word)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
