"""Look of wet surfaces: darker, because water traps light in what it soaks, and shinier, because a film of water
mirrors.

Light that a soaked surface of albedo A scatters into the water leaves it only within the critical angle; the rest
comes back to the surface. The albedo becomes (Angstrom, Geografiska Annaler 7, 1925; Lekner and Dorf, Applied Optics
27, 1988)

    A_w = A / (n^2 (1 - A) + A),   n = 1.33

in each colour of linear light, so that colours also become more saturated. A film of water has the reflectance 0.02
head on and is smoother than what it covers: specular at least 0.25, shininess at least 0.5
(sim/native/frame/resolve.hpp; a choice). At a wetness w the look is the mean of dry and wet, by w = R / 2 for a rain
rate R up to 2 mm/h.

What soaks is what is rougher than 0.1 mm: not glass, metal, paint and plastic, and neither plants nor skin. Nothing
is sheltered from the rain.
"""

from __future__ import annotations

from collections.abc import Sequence

from sim.scene.scene_map import Surface
from sim.scene.srgb import linear, srgb
from sim.scene.surfaces import GRASS, HAIR, LEAVES, SKIN

_INDEX_2 = 1.33 * 1.33
_LEAST_ROUGHNESS_M = 1e-4
_WET_FROM_MM_PER_H = 2.0
_SPECULAR, _SHININESS = 0.25, 0.5
Triple = tuple[float, float, float]


def wetness(rain_mm_per_h: float) -> float:
    """Return the share of the wet look at a rain rate."""
    return min(rain_mm_per_h / _WET_FROM_MM_PER_H, 1.0)


def soaks(surface: Surface) -> bool:
    """Return True if a surface becomes darker when it is wet."""
    return surface.roughness_m > _LEAST_ROUGHNESS_M and surface not in (GRASS, LEAVES, SKIN, HAIR)


def wet_albedo(albedo: float) -> float:
    """Return the albedo of a soaked surface, in linear light."""
    return albedo / (_INDEX_2 * (1.0 - albedo) + albedo)


def wet_colour(rgb: Triple, mean_texel: Sequence[float], share: float) -> Triple:
    """Return the colour that a wet geom's texture is multiplied by; colours are sRGB codes / 255."""
    wet = []
    for code, texel in zip(rgb, mean_texel, strict=True):
        light, albedo = linear(code), linear(code) * linear(texel)
        factor = 1.0 if albedo <= 0.0 else 1.0 + share * (wet_albedo(albedo) / albedo - 1.0)
        wet.append(srgb(light * factor) if factor < 1.0 else code)
    return (wet[0], wet[1], wet[2])


def wet_gloss(gloss: Triple, share: float) -> Triple:
    """Return specular, shininess and metallic of a wet surface."""
    specular, shininess, metallic = gloss
    return (
        specular + share * max(_SPECULAR - specular, 0.0),
        shininess + share * max(_SHININESS - shininess, 0.0),
        metallic,
    )
