"""The companions of a run on the report page and in the summary on the console."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from hil.run.report.html import table

HEAD = ("client", "frames", "dropped", "t1 [ms]", "render", "link to client", "t2 [ms]", "t3 [ms]")
_TIMES = ("t1_ms", "render_ms", "link_ms", "t2_ms", "t3_ms")


def section(companion: Mapping[str, Any]) -> tuple[str, str]:
    """Return heading and HTML of the clients' frames and latencies. `companion`: this key of run.json."""
    refused = "".join(f"<p class='error'>{escape(text)}</p>" for text in companion["refused"])
    rows = companion_rows(companion)
    html = (
        f"<p>{escape(companion_line(companion))}. "
        "Wall time as p50 / p99 / max; t1: render and link to the client, t2: the client's computing, "
        "t3: from its answer to the command at the autopilot.</p>"
        f"{table(rows, HEAD) if rows else '<p>No client connected.</p>'}{refused}"
    )
    return "Companions", html


def companion_rows(companion: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return one row per client under `HEAD`, times as p50 / p99 / max. `companion`: this key of run.json."""
    return [
        (
            name + (" (in control)" if client.get("control") else ""),
            str(client.get("frames", 0)),
            str(client.get("dropped", 0)),
            *(_quantiles_text(client.get(key)) for key in _TIMES),
        )
        for name, client in companion["clients"].items()
    ]


def companion_line(companion: Mapping[str, Any]) -> str:
    """Return frames, rate, time mode and arrangement of the companions in one line."""
    text = f"{companion['frames']} frames at {companion['rate_hz']:g} Hz, {companion['time']}"
    return f"{text}, {companion['arrangement'].replace('_', ' ')}"


def console_rows(companion: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return label and text of each line of the console summary."""
    rows = [("companions", companion_line(companion))]
    for name, client in companion["clients"].items():
        rows.append((f"  {name}", f"{client.get('frames', 0)} frames, {client.get('dropped', 0)} dropped"))
        times = [(key[:2], client.get(key) or {}) for key in ("t1_ms", "t2_ms", "t3_ms")]
        texts = [f"{key} {ms['p50']:.2f} (p99 {ms['p99']:.2f})" for key, ms in times if ms.get("p50") is not None]
        if texts:
            rows.append(("", ", ".join(texts) + " ms"))
    return rows


def _quantiles_text(times_ms: Mapping[str, float | None] | None) -> str:
    if not times_ms or times_ms["p50"] is None:
        return "\N{EN DASH}"
    return " / ".join(f"{times_ms[key]:.2f}" for key in ("p50", "p99", "max"))
