"""Settings of a radar's paths with more than one bounce; null: single bounces only.

What is traced, and how, is in sim/radar/ghost_echoes.py; its equations are in sim/radar/bistatic.py.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from signals.documents.validate import StrictModel


class Bounces(StrictModel):
    """Paths by one mirror: out by it, back by it, or both ways."""

    # Between the rays that look for mirrors' images. Objects of few rays get nine times as many.
    spacing_deg: Annotated[float, Field(ge=0.2, le=5.0)] = 1.0
    # Mirrors below this share of the power are left out: reflectance of the smooth and rough surface, times the
    # antenna's gain towards it relative to the axis.
    floor_db: Annotated[float, Field(ge=-80.0, le=-3.0)] = -30.0
