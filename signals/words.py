"""Numbers of things in sentences for people."""

from __future__ import annotations


def counted(number: int, thing: str) -> str:
    """Return a number with its thing, in the plural unless it is 1: '1 case', '12,000 cases'."""
    return f"{number:,} {thing}{'' if number == 1 else 's'}"
