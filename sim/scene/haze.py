"""What haze does to a scene's light, before any picture is drawn.

With tau = beta HAZE_M, the optical thickness of the layer, the sun at elevation e loses the share 1 - exp(-tau / sin e)
of its light. Most of that is scattered forwards and arrives from the whole sky instead: the ambient light gains
`_FORWARD` of what the level ground lost. So shadows fade as haze thickens, and are gone in fog.

The colour of the air itself is that of the horizon's sky, which is looked at through a long way of it; the thicker the
layer, the more often light was scattered, and the greyer it is.
"""

from __future__ import annotations

from dataclasses import dataclass

from hil.signals._kernel import det_exp
from sim.scene.light import Light, Rgb
from sim.scene.weather import HAZE_M

_FORWARD = 0.75  # of scattered light comes down; the rest goes back up
_LOWEST_SINE = 0.05  # the sun's way through the layer on a round Earth is never longer than 20 times the layer


@dataclass(frozen=True)
class HazyLight:
    """Light below and within haze; colours linear."""

    sun_rgb: Rgb
    ambient_rgb: Rgb
    air_rgb: Rgb


def light_in_haze(light: Light, extinction_per_m: float) -> HazyLight:
    """Without haze: the light as it is."""
    sine = light.to_sun_W[2]
    sun = light.sun_rgb if light.sun_elevation_deg > 0.0 else (0.0, 0.0, 0.0)
    if extinction_per_m == 0.0:
        return HazyLight(sun, light.ambient_rgb, light.sky_horizon_rgb)
    thickness = extinction_per_m * HAZE_M
    through = det_exp(-thickness / max(sine, _LOWEST_SINE))
    gain = _FORWARD * max(sine, 0.0) * (1.0 - through)
    r, g, b = light.sky_horizon_rgb
    grey = 0.2126 * r + 0.7152 * g + 0.0722 * b
    colour = det_exp(-thickness)  # of the sky's own is left
    return HazyLight(
        _sum(sun, through, (0.0, 0.0, 0.0)),
        _sum(sun, gain, light.ambient_rgb),
        _sum((r - grey, g - grey, b - grey), colour, (grey, grey, grey)),
    )


def _sum(a: Rgb, factor: float, b: Rgb) -> Rgb:
    return factor * a[0] + b[0], factor * a[1] + b[1], factor * a[2] + b[2]
