"""Reader of GPS almanacs: YUMA (`key: value`, radians) and SEM (lines of numbers, semicircles).

Both formats are those of the U.S. Coast Guard's Navigation Center, "GPS NANUs, Almanacs & Ops Advisories". A SEM file
has its week and reference time once, at the top, and the inclination as the difference from 0.30 semicircles
(IS-GPS-200, 20.3.3.5.2.1). Satellites whose health is not 0 are left out.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pydantic

from signals.documents.document import read_text, shown_path
from signals.documents.validate import shown
from signals.errors import ConfigError, Problem
from sim.gnss.orbit import Orbit

_LIMIT_BYTES = 1 << 20
_MOST_SATELLITES = 63
_MOST_WEEKS_APART = 8  # of the satellites of a file: their elements are of the same days
_SEMICIRCLE = math.pi
_NOMINAL_INCLINATION = 0.30  # semicircles

# Beginning of a YUMA key -> element; the words behind it differ between writers.
_YUMA = {
    "id": "number",
    "health": "health",
    "eccentricity": "eccentricity",
    "time of applicability": "toa_s",
    "orbital inclination": "inclination_rad",
    "rate of right ascen": "node_rate_radps",
    "sqrt(a)": "sqrt_semi_major_rtm",
    "right ascen at week": "node_rad",
    "argument of perigee": "perigee_rad",
    "mean anom": "anomaly_rad",
    "af0": "clock_s",
    "af1": "clock_rate",
    "week": "week",
}
_WHOLE = ("number", "health", "week")


def read_almanac(path: Path) -> tuple[Orbit, ...]:
    """Return the healthy satellites of a YUMA or SEM file. Raises ConfigError with every problem and its line."""
    source = shown_path(path)
    lines = read_text(path, limit_bytes=_LIMIT_BYTES).splitlines()
    head = next((line for line in lines if line.strip()), "")
    problems: list[Problem] = []
    is_yuma = head.lstrip().startswith("*") or head.strip().lower().startswith("id:")
    entries = list((_yuma if is_yuma else _sem)(lines, source, problems))
    orbits: dict[int, Orbit] = {}
    for line, values in entries:
        healthy = values.pop("health", 0) == 0
        values.pop("clock_s", None), values.pop("clock_rate", None)
        try:
            orbit = Orbit(system="gps", **values)
        except pydantic.ValidationError as error:
            for item in error.errors(include_url=False):
                name = str(item["loc"][0]) if item["loc"] else "satellite"
                text = "is missing" if item["type"] == "missing" else f"is {item['input']!r}: {item['msg'].lower()}"
                problems.append(Problem(f"{source}:{line}", f"satellite {values.get('number', '?')}: {name} {text}"))
            continue
        if orbit.number in orbits:
            problems.append(Problem(f"{source}:{line}", f"satellite {orbit.number} is there twice"))
        if healthy:
            orbits[orbit.number] = orbit
            first = next(iter(orbits.values()))
            if abs(orbit.week - first.week) > _MOST_WEEKS_APART:
                message = f"satellite {orbit.number} has week {orbit.week}, and satellite {first.number} {first.week}"
                problems.append(Problem(f"{source}:{line}", message, "the file may be cut off or put together"))
    if not problems and not orbits:
        hint = "YUMA and SEM files of the U.S. Coast Guard are read"
        problems.append(Problem(source, "has no healthy satellite", hint))
    if problems:
        raise ConfigError(problems)
    return tuple(orbits[number] for number in sorted(orbits))


def _number(text: str, name: str, where: str, problems: list[Problem]) -> float | int | None:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or (name in _WHOLE and value != int(value)):
        kind = "a whole number" if name in _WHOLE else "a number"
        problems.append(Problem(where, f"{name} must be {kind}, not {shown(text)}"))
        return None
    return int(value) if name in _WHOLE else value


def _yuma(lines: list[str], source: str, problems: list[Problem]) -> Iterator[tuple[int, dict[str, Any]]]:
    values: dict[str, Any] = {}
    begin = 0
    for at, line in enumerate(lines, 1):
        text = line.strip()
        if not text or text.startswith("*"):
            continue
        key, colon, value = text.partition(":")
        name = next((name for start, name in _YUMA.items() if key.strip().lower().startswith(start)), None)
        if not colon or name is None:
            problems.append(Problem(f"{source}:{at}", f"is no line of a YUMA almanac: {text[:40]!r}"))
            continue
        if name == "number":
            if values:
                yield begin, values
            values, begin = {}, at
        elif name in values:
            problems.append(Problem(f"{source}:{at}", f"{name} is there twice in one satellite"))
        number = _number(value.strip(), name, f"{source}:{at}", problems)
        if number is not None:
            values[name] = number
    if values:
        yield begin, values


def _sem(lines: list[str], source: str, problems: list[Problem]) -> Iterator[tuple[int, dict[str, Any]]]:
    rows = [(at, line.split()) for at, line in enumerate(lines, 1) if line.strip()]
    if len(rows) < 2 or not rows[0][1][0].isdecimal() or len(rows[1][1]) != 2:
        hint = "the first line of a SEM file is its number of satellites, the second week and reference time"
        problems.append(Problem(f"{source}:1", "is neither a YUMA nor a SEM almanac", hint))
        return
    declared = int(rows[0][1][0][:5])  # five digits are beyond the limit
    week = _number(rows[1][1][0], "week", f"{source}:{rows[1][0]}", problems)
    toa = _number(rows[1][1][1], "toa_s", f"{source}:{rows[1][0]}", problems)
    if declared > _MOST_SATELLITES or week is None or toa is None:
        if declared > _MOST_SATELLITES:
            problems.append(Problem(f"{source}:{rows[0][0]}", f"declares more than {_MOST_SATELLITES} satellites"))
        return
    # Of each satellite: number; SVN; URA; e, i, dO/dt; sqrt(A), O, w; M, af0, af1; health; configuration.
    shape = (
        ("number",),
        ("",),
        ("",),
        ("eccentricity", "inclination", "node_rate"),
        ("sqrt_semi_major_rtm", "node", "perigee"),
        ("anomaly", "", ""),
        ("health",),
        ("",),
    )
    body = rows[2:]
    if len(body) != declared * len(shape):
        last = body[-1][0] if body else rows[1][0]
        message = f"ends after {len(body)} lines of satellites, and {declared} of them have {declared * len(shape)}"
        problems.append(Problem(f"{source}:{last}", message))
        return
    for begin in range(0, len(body), len(shape)):
        values: dict[str, Any] = {"week": week, "toa_s": toa}
        for (at, words), names in zip(body[begin : begin + len(shape)], shape, strict=True):
            if len(words) != len(names):
                problems.append(Problem(f"{source}:{at}", f"must have {len(names)} numbers, not {len(words)}"))
                continue
            for word, name in zip(words, names, strict=True):
                if not name:
                    continue
                number = _number(re.sub(r"[dD]", "e", word), name, f"{source}:{at}", problems)
                if number is not None:
                    values[name] = number
        yield body[begin][0], _in_radians(values)


def _in_radians(values: dict[str, Any]) -> dict[str, Any]:
    turned = {name: value for name, value in values.items() if name in (*_WHOLE, "toa_s", "eccentricity")}
    if "sqrt_semi_major_rtm" in values:
        turned["sqrt_semi_major_rtm"] = values["sqrt_semi_major_rtm"]
    if "inclination" in values:
        turned["inclination_rad"] = (_NOMINAL_INCLINATION + values["inclination"]) * _SEMICIRCLE
    for name, end in (("node_rate", "radps"), ("node", "rad"), ("perigee", "rad"), ("anomaly", "rad")):
        if name in values:
            turned[f"{name}_{end}"] = values[name] * _SEMICIRCLE
    return turned
