"""HTML of the report page: values as text, rows as tables."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any


def text(value: Any, unit: str = "") -> str:
    """Return a value for people: four digits, yes or no, and "not measured" for None."""
    if value is None:
        return "not measured"
    if isinstance(value, bool):
        return "yes" if value else "no"
    number = f"{value:.4g}" if isinstance(value, float) else str(value)
    return f"{number} {unit}".rstrip()


def table(rows: Sequence[Sequence[str]], head: Sequence[str] = ()) -> str:
    """Return a table of escaped cells."""

    def row(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    return f"<table>{row(head, 'th') if head else ''}{''.join(row(cells, 'td') for cells in rows)}</table>"
