"""How a scene is lit: one sun, light from everywhere, a sky of two colours, fog.

Colours are linear RGB, 1 = what turns a white surface white. The sun stands at an azimuth clockwise from north and an
elevation above the horizon:

    to_sun_W = (sin a cos e, cos a cos e, sin e)

`fog_per_m` is the extinction of haze, for those who have that number and not the visibility (sim/scene/weather.py);
where both are given they add up.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from hil.signals._kernel import det_cos, det_sin
from hil.signals.documents.validate import StrictModel
from hil.signals.units import RAD_PER_DEG

Intensity = Annotated[float, Field(ge=0.0, le=10.0)]
Rgb = tuple[Intensity, Intensity, Intensity]


class Light(StrictModel):
    """Light of a scene; the defaults are a clear mid-morning."""

    sun_azimuth_deg: Annotated[float, Field(ge=-360.0, le=360.0)] = 130.0
    sun_elevation_deg: Annotated[float, Field(ge=-90.0, le=90.0)] = 45.0  # below 0 it does not shine
    sun_rgb: Rgb = (1.0, 0.96, 0.88)
    ambient_rgb: Rgb = (0.36, 0.40, 0.46)
    sky_zenith_rgb: Rgb = (0.16, 0.34, 0.70)
    sky_horizon_rgb: Rgb = (0.62, 0.74, 0.88)
    fog_per_m: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0

    @property
    def to_sun_W(self) -> tuple[float, float, float]:
        """Unit vector towards the sun."""
        azimuth, elevation = self.sun_azimuth_deg * RAD_PER_DEG, self.sun_elevation_deg * RAD_PER_DEG
        level = det_cos(elevation)
        return (det_sin(azimuth) * level, det_cos(azimuth) * level, det_sin(elevation))
