"""Light of a scene: one sun, ambient light, a sky of two colours, fog.

Colours are linear RGB; light of 1 makes a white surface white. The sun has an azimuth, clockwise from north, and an
elevation above the horizon:

    to_sun_W = (sin a cos e, cos a cos e, sin e)

With `utc`, a scene takes both from this time and its site.

`fog_per_m` gives haze by its extinction instead of by the visibility (sim/scene/weather.py); if both are given, they
add up.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Annotated

from pydantic import AfterValidator, Field

from signals._kernel import det_cos, det_exp, det_sin
from signals.documents.validate import StrictModel
from signals.units import RAD_PER_DEG
from sim.scene.weather import HAZE_M

Intensity = Annotated[float, Field(ge=0.0, le=10.0)]
Rgb = tuple[Intensity, Intensity, Intensity]


_YEARS = range(1981, 2137)  # GPS weeks have 13 bits, and begin in January 1980


def time_of(utc: str) -> datetime:
    """Return a time in ISO 8601. Raises ValueError if it is none, has no time zone, or is out of reach of GPS weeks."""
    try:
        time = datetime.fromisoformat(utc)
    except ValueError:
        time = None
    if time is None or time.tzinfo is None:
        raise ValueError(f"must be a time such as 2026-06-21T10:00:00Z, not {utc!r}")
    if time.year not in _YEARS:
        raise ValueError(f"must be in the years {_YEARS[0]} to {_YEARS[-1]}, not {utc!r}")
    return time


def _checked(utc: str) -> str:
    time_of(utc)
    return utc


Utc = Annotated[str, AfterValidator(_checked)]  # ISO 8601 with a time zone


class Light(StrictModel):
    """Light of a scene; the defaults are a clear mid-morning."""

    utc: Utc | None = None  # sets the sun's direction, with the site (sim/scene/scene.py)
    sun_azimuth_deg: Annotated[float, Field(ge=-360.0, le=360.0)] = 130.0
    sun_elevation_deg: Annotated[float, Field(ge=-90.0, le=90.0)] = 45.0  # below 0: no sunlight
    sun_rgb: Rgb = (1.0, 0.96, 0.88)
    ambient_rgb: Rgb = (0.36, 0.40, 0.46)
    sky_zenith_rgb: Rgb = (0.16, 0.34, 0.70)
    sky_horizon_rgb: Rgb = (0.62, 0.74, 0.88)
    fog_per_m: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    clouds: Annotated[float, Field(ge=0.0, le=1.0)] = 0.4  # share of the sky that they cover; cast no shadows

    @property
    def to_sun_W(self) -> tuple[float, float, float]:
        """Unit vector towards the sun."""
        azimuth, elevation = self.sun_azimuth_deg * RAD_PER_DEG, self.sun_elevation_deg * RAD_PER_DEG
        horizontal = det_cos(elevation)
        return (det_sin(azimuth) * horizontal, det_cos(azimuth) * horizontal, det_sin(elevation))


_FORWARD = 0.75  # share of scattered light that comes down; the rest goes back up
_MIN_SINE = 0.05  # on a round Earth sunlight crosses at most 20 times the thickness of the layer


@dataclass(frozen=True)
class HazyLight:
    """Light below and within haze, in linear RGB."""

    sun_rgb: Rgb
    ambient_rgb: Rgb
    air_rgb: Rgb


def light_in_haze(light: Light, extinction_per_m: float) -> HazyLight:
    """Return a scene's light in haze of this extinction; an extinction of 0 changes nothing.

    With tau = beta HAZE_M, the optical thickness of the layer, the sun at elevation e loses the share
    1 - exp(-tau / sin e) of its light. Most of this light is scattered forwards and arrives from the whole sky: the
    ambient light gains the share `_FORWARD` of the loss on level ground. So shadows fade in haze and vanish in fog.

    The air has the colour of the sky at the horizon, which is seen through a long path of air. A thicker layer scatters
    light more often, which makes it greyer.
    """
    sine = light.to_sun_W[2]
    sun = light.sun_rgb if light.sun_elevation_deg > 0.0 else (0.0, 0.0, 0.0)
    if extinction_per_m == 0.0:
        return HazyLight(sun, light.ambient_rgb, light.sky_horizon_rgb)
    thickness = extinction_per_m * HAZE_M
    sun_share = det_exp(-thickness / max(sine, _MIN_SINE))
    sky_share = _FORWARD * max(sine, 0.0) * (1.0 - sun_share)
    r, g, b = light.sky_horizon_rgb
    grey = 0.2126 * r + 0.7152 * g + 0.0722 * b
    colour_share = det_exp(-thickness)  # of the sky's own colour; the rest is grey
    return HazyLight(
        _scaled_sum(sun, sun_share, (0.0, 0.0, 0.0)),
        _scaled_sum(sun, sky_share, light.ambient_rgb),
        _scaled_sum((r - grey, g - grey, b - grey), colour_share, (grey, grey, grey)),
    )


def _scaled_sum(a: Rgb, factor: float, b: Rgb) -> Rgb:
    return factor * a[0] + b[0], factor * a[1] + b[1], factor * a[2] + b[2]
