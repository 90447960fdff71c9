"""What run.json says about the radars of a run: what they left out, why, and under which bound."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sim.sensors.radar import Radar


def radar_counts(radar: Radar) -> dict[str, Any]:
    """The section `radar` of a sensor."""
    counts = radar.counts
    return {
        "pixels": counts.pixels,
        "pixels_dropped": dict(counts.pixels_dropped),
        "echoes": counts.echoes,
        "echoes_dropped": counts.echoes_dropped,
        "dropped_bound": counts.dropped_bound,
        "terms": counts.terms,
        "shared_pictures": counts.shared,
    }


def radar_rows(radars: Mapping[str, Radar]) -> list[dict[str, Any]]:
    """Rows for the list of what was skipped."""
    rows: list[dict[str, Any]] = []
    for name, radar in radars.items():
        counts = radar.counts
        for reason, dropped in counts.pixels_dropped.items():
            if dropped:
                rows.append({"what": f"{name}: pixels", "why": reason, "saved": f"{dropped} of {counts.pixels} pixels"})
        if counts.echoes_dropped:
            why = f"too weak to matter: at most {counts.dropped_bound:.1e} of a frame"
            saved = f"{counts.echoes_dropped} of {counts.echoes} echoes"
            rows.append({"what": f"{name}: echoes", "why": why, "saved": saved})
        if counts.shared:
            saved = f"{counts.shared} of {counts.frames} drawings"
            rows.append({"what": f"{name}: drawing", "why": "its camera has just drawn the same", "saved": saved})
    return rows
