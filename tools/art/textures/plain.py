"""Procedural textures: sRGB, without seams, 256 pixels square unless stated otherwise.

Only + - * /, square roots and comparisons make the pixels: the same bits on every machine. Colours are albedos of real
materials (linear): grass 0.1 to 0.2, asphalt 0.06 to 0.12, concrete 0.3, brick 0.15 to 0.2, light render 0.5, white
paint 0.75. Textures of the ground are in ground.py, those of buildings in facades.py.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sim.scene.maps.texture_tools import Image, clouds, grain, grid, mix
from tools.art.textures import facades, ground


def _sheet_metal() -> Image:
    """Return ribbed sheet metal, as on a container: 8 ribs."""
    u, _ = grid()
    phase = (u * 8) % 1.0
    rib = np.clip(np.minimum(phase, 1.0 - phase) * 6.0 - 0.6, 0.0, 1.0)
    return mix((0.62, 0.62, 0.61), (0.92, 0.92, 0.91), 0.8 * rib + 0.2 * clouds("sheet", 8))


def _bark() -> Image:
    t = 0.55 * clouds("bark", 22, 4) + 0.25 * clouds("bark", 48, 12) + 0.2 * grain("bark")
    return mix((0.17, 0.14, 0.11), (0.62, 0.55, 0.47), 1.5 * t - 0.25)


def _birch_bark() -> Image:
    """Return white bark with dark bands across, blackish fissures, and a warm tint."""
    bands = clouds("birch.bands", 5, 44)
    t = 0.5 * clouds("birch", 8, 6) + 0.5 * grain("birch")
    image = mix((0.62, 0.58, 0.53), (0.86, 0.84, 0.80), 0.3 + 0.7 * t)
    image[:, (bands > 0.70) & (clouds("birch.gaps", 9, 40) > 0.45)] *= 0.42
    image[:, clouds("birch.fissures", 5, 9) > 0.82] = np.array([[0.15], [0.13], [0.12]])
    return image


def _leaves() -> Image:
    """Return leaves in grey-white; the material gives the colour."""
    t = 0.35 * clouds("leaves", 10) + 0.4 * clouds("leaves", 40) + 0.25 * grain("leaves")
    return mix((0.38, 0.40, 0.34), (1.0, 1.0, 0.92), 1.6 * t - 0.3)


def _wood() -> Image:
    """Return 4 boards along u."""
    _, v = grid()
    t = 0.6 * clouds("wood", 3, 32) + 0.2 * clouds("wood", 8, 64) + 0.2 * grain("wood")
    image = mix((0.42, 0.27, 0.15), (0.68, 0.49, 0.30), t)
    image[:, (v[:, 0] * 4) % 1.0 < 0.05] *= 0.5
    return image


def _water() -> Image:
    t = 0.6 * clouds("water", 6, 18) + 0.4 * clouds("water", 20, 48)
    return mix((0.10, 0.13, 0.115), (0.21, 0.25, 0.225), t)


def _sandbags() -> Image:
    """Return 4 courses of 2 bags, rounded towards their seams."""
    image = facades.courses("sandbag", (4, 2), ((0.47, 0.41, 0.31), (0.62, 0.555, 0.43), (0.22, 0.19, 0.145)), 0.10)
    _, v = grid()
    h = (v * 4) % 1.0
    return image * (0.55 + 1.8 * h * (1.0 - h))


def _rock() -> Image:
    stone = 0.6 * clouds("landscape.stone", 9) + 0.4 * grain("landscape.stone")
    return mix((0.24, 0.23, 0.22), (0.52, 0.50, 0.47), stone)


MAKERS: dict[str, Callable[[], Image]] = {
    **ground.MAKERS,
    **facades.MAKERS,
    "sheet_metal": _sheet_metal,
    "bark": _bark,
    "birch_bark": _birch_bark,
    "leaves": _leaves,
    "wood": _wood,
    "water": _water,
    "sandbags": _sandbags,
    "rock": _rock,
}
