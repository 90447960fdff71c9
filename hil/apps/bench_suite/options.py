"""Options of `hil bench NAME --set KEY=VALUE[,VALUE...]`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from signals.errors import ConfigError, Problem


def split_settings(settings: Sequence[str]) -> dict[str, str]:
    """Return the texts `KEY=VALUE` by key. Raises ConfigError."""
    values: dict[str, str] = {}
    for text in settings:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise ConfigError.at("--set", f"must be KEY=VALUE, not {text!r}")
        values[key.strip()] = value.strip()
    return values


def read_lists(options: Mapping[str, str], allowed: Mapping[str, Sequence[str] | None]) -> dict[str, tuple[str, ...]]:
    """Return the values of each option, which are separated by commas.

    `allowed`: the values that an option may have, None for any. Raises ConfigError with every problem.
    """
    problems, values = [], {}
    for key, text in options.items():
        if key not in allowed:
            problems.append(Problem("--set", f"{key} is unknown", f"use one of: {', '.join(allowed)}"))
            continue
        values[key] = tuple(part.strip() for part in text.split(",") if part.strip())
        known = allowed[key]
        wrong = [part for part in values[key] if known is not None and part not in known]
        if known is not None and (wrong or not values[key]):
            problems.append(Problem("--set", f"{key} must not be {', '.join(wrong) or 'empty'}", ", ".join(known)))
    if problems:
        raise ConfigError(problems)
    return values
