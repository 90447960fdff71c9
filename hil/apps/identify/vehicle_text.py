"""The text of a fitted vehicle's file: every fitted number with its 1 sigma and the logs that it comes from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hil.apps.identify.fit_result import Estimated, Fit
from signals.documents.yaml_lines import dump_yaml

_WIDTH = 118
_DIGITS = 8  # of a fitted number: well below its sigma, and readable


def vehicle_text(fit: Fit, *, began_with: str, logs: Sequence[str], fixed: Mapping[str, float]) -> str:
    """Return a vehicle file; numbers that the fit did not touch stand as in the file `began_with`."""
    data = fit.vehicle.model_dump(mode="json", exclude_defaults=True)
    source = ", ".join(logs)
    notes = {estimate.key: _note(estimate, source) for estimate in fit.parameters if estimate.of_vehicle}
    notes |= dict.fromkeys(fixed, "as given by --fix")
    found = {e.key for e in fit.parameters if e.of_vehicle and e.identified and e.key not in fixed}
    head = _comment(
        f"Fitted by `hil identify` to {source}. Each fitted number has its standard deviation (1 sigma) and its logs;"
        f" numbers without a remark are those of {began_with}."
    )
    return head + "".join(_mapping(data, "", notes, found, 0))


def _note(estimate: Estimated, source: str) -> str:
    if estimate.identified:
        unit = f" {estimate.unit}" if estimate.unit and estimate.unit != "-" else ""
        return f"+- {estimate.sigma:.2g}{unit} (1 sigma), from {source}"
    return "not identified, kept" + (f": {estimate.why}" if estimate.why else "")


def _comment(text: str) -> str:
    lines, line = [], "#"
    for word in text.split():
        if len(line) + 1 + len(word) > _WIDTH:
            lines.append(line)
            line = "#"
        line += f" {word}"
    return "\n".join([*lines, line]) + "\n"


def _mapping(data: Mapping[str, Any], path: str, notes: Mapping[str, str], found: set[str], depth: int) -> list[str]:
    """Return the lines of a mapping. A list with a remark on one of its numbers has a line for each."""
    lines: list[str] = []
    indent = "  " * depth
    for key, value in data.items():
        here = f"{path}{key}"
        below = [name for name in notes if name.startswith(f"{here}.")]
        if isinstance(value, dict):
            lines += [f"{indent}{key}:\n", *_mapping(value, f"{here}.", notes, found, depth + 1)]
        elif isinstance(value, list) and below:
            lines.append(f"{indent}{key}:\n")
            for i, item in enumerate(value):
                lines.append(f"{indent}  - {_value(item, f'{here}.{i}', found)}{_remark(notes, f'{here}.{i}')}\n")
        elif isinstance(value, list) and any(isinstance(item, dict) for item in value):
            lines.append(f"{indent}{key}:\n")
            lines += [f"{indent}  - {_flow(item)}\n" for item in value]
        else:
            lines.append(f"{indent}{key}: {_value(value, here, found)}{_remark(notes, here)}\n")
    return lines


def _remark(notes: Mapping[str, str], key: str) -> str:
    return f"  # {notes[key]}" if key in notes else ""


def _value(value: Any, key: str, found: set[str]) -> str:
    if key in found and isinstance(value, float):
        value = float(f"{value:.{_DIGITS}g}")
    return _flow(value)


def _flow(value: Any) -> str:
    """Return plain data on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(_flow(item) for item in value) + "]"
    if isinstance(value, str):
        return str(dump_yaml([value])).strip()[1:-1] if "\n" not in value else repr(value)
    return str(dump_yaml([value])).strip()[1:-1]
