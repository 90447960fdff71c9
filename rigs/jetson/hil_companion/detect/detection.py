"""One thing found in a picture."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Detection:
    """What and where. `box_px`: x0, y0, x1, y1 in pixels of the picture given; x1 - x0 is the width."""

    label: str
    box_px: tuple[float, float, float, float]
    score: float  # 0 to 1
    range_m: float | None = None  # from depth, where there is any
    radial_speed_mps: float | None = None  # from a radar; positive: going away
    p_W: tuple[float, float, float] | None = None  # where it stands, once somebody has worked that out
