"""Light of a scene in plain numbers, for the path tracer's process (sim/frame/path_traced/sky.py)."""

from __future__ import annotations

from dataclasses import dataclass

from sim.scene.light import Light, light_in_haze
from sim.scene.weather import CONTRAST_EXPONENT

_CLEAR_TURBIDITY, _MAX_TURBIDITY = 2.6, 9.0


@dataclass(frozen=True)
class SkyRequest:
    """Light of a scene in plain numbers."""

    to_sun: tuple[float, float, float]
    sun_rgb: tuple[float, float, float]  # relative to the default light
    ambient_rgb: tuple[float, float, float]
    turbidity: float
    extinction_per_m: float
    haze_sun: tuple[float, float, float]  # share of the sun's light that haze leaves
    haze_sky: float  # share of the sun's light that haze sends down from the whole sky


def sky_request(light: Light, extinction_per_m: float) -> SkyRequest:
    """Return what the tracer needs of a scene's light."""
    default = Light()
    hazy = light_in_haze(light, extinction_per_m)
    sun = tuple(a / max(b, 1e-6) for a, b in zip(light.sun_rgb, default.sun_rgb, strict=True))
    kept = tuple(a / max(b, 1e-6) for a, b in zip(hazy.sun_rgb, light.sun_rgb, strict=True))
    added = (hazy.ambient_rgb[1] - light.ambient_rgb[1]) / max(light.sun_rgb[1], 1e-6)
    visibility_km = CONTRAST_EXPONENT / max(extinction_per_m, 1e-6) / 1000.0
    turbidity = _CLEAR_TURBIDITY + (_MAX_TURBIDITY - _CLEAR_TURBIDITY) * min(1.0, 8.0 / max(visibility_km, 8.0))
    return SkyRequest(
        light.to_sun_W,
        sun,  # type: ignore[arg-type]
        tuple(a / max(b, 1e-6) for a, b in zip(light.ambient_rgb, default.ambient_rgb, strict=True)),  # type: ignore[arg-type]
        _CLEAR_TURBIDITY if extinction_per_m == 0.0 else turbidity,
        extinction_per_m,
        kept,  # type: ignore[arg-type]
        added,
    )
