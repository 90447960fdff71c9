"""Parts of a camera's colour beside geometry, textures and shadows, and its response to light.

White balance. The scene's light has the white of sRGB (6504 K). A camera balanced for T divides by the colour of
daylight of that temperature, relative to its green; the chromaticity of daylight is that of CIE 15:2018, equations 4.1
and 4.2, and the matrix from XYZ that of IEC 61966-2-1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from sim import _kernels

SRGB_WHITE_K = 6504.0
ToneCurve = Literal["linear", "filmic"]
_XYZ_TO_RGB = ((3.2406, -1.5372, -0.4986), (-0.9689, 1.8758, 0.0415), (0.0557, -0.2040, 1.0570))


@dataclass(frozen=True)
class Shading:
    """Settings of the native raster's colour; equations: sim/native/frame/resolve.hpp."""

    textures: bool = True  # false: each surface has its mean colour
    filtering: bool = False  # textures are interpolated between texels and levels, else the nearest texel
    highlights: bool = False  # surfaces mirror sun, sky and ground
    relief: bool = False  # textures of normals
    ambient_occlusion: bool = False  # static things keep the ambient light from what is near them
    # Pixels on outlines of things have the mean of what covers them (sim/native/frame/outlines.hpp). Of no effect where
    # every pixel takes several samples.
    smooth_edges: bool = False
    surroundings: bool = False  # clouds in the sky, hills at the horizon, fields on a distant plane
    tone: ToneCurve = "linear"
    exposure_ev: float = 0.0  # doublings of the light
    white_balance_k: float = SRGB_WHITE_K

    def gain(self) -> tuple[float, float, float]:
        """Return the factors of red, green and blue by exposure and white balance."""
        factor = 2.0**self.exposure_ev
        neutral, seen = daylight_rgb(SRGB_WHITE_K), daylight_rgb(self.white_balance_k)
        red, green, blue = (factor * n / s for n, s in zip(neutral, seen, strict=True))
        return red, green, blue

    def native(self) -> _kernels.Shading:
        """Return the settings for the kernels."""
        return _kernels.Shading(self.filtering, self.highlights, self.relief, self.tone == "filmic", self.gain())


PLAIN = Shading()
MEAN_COLOURS = Shading(textures=False)
# Half a stop up: cameras meter scenes of grass, asphalt and brick, which are darker than a grey card.
FULL = Shading(
    filtering=True, highlights=True, relief=True, smooth_edges=True, surroundings=True, tone="filmic", exposure_ev=0.5
)
OCCLUDED = replace(FULL, ambient_occlusion=True)
# Settings that belong to a level of quality.
LEVELLED = (
    "textures",
    "filtering",
    "highlights",
    "relief",
    "ambient_occlusion",
    "smooth_edges",
    "surroundings",
    "tone",
    "exposure_ev",
)


def daylight_rgb(temperature_k: float) -> tuple[float, float, float]:
    """Return the linear colour of daylight of a temperature from 4000 to 25,000 K, of green 1."""
    t = 1000.0 / temperature_k
    if temperature_k <= 7000.0:
        x = 0.244063 + t * (0.09911 + t * (2.9678 - t * 4.6070))
    else:
        x = 0.237040 + t * (0.24748 + t * (1.9018 - t * 2.0064))
    y = -3.0 * x * x + 2.870 * x - 0.275
    xyz = (x / y, 1.0, (1.0 - x - y) / y)
    red, green, blue = (sum(m * c for m, c in zip(row, xyz, strict=True)) for row in _XYZ_TO_RGB)
    return red / green, 1.0, blue / green
