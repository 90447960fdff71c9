"""Textures of dogs' fur: coat patterns under hair along the body, 256 pixels square, sRGB.

Rows are laid out by `dog_coat.RANGES`; the columns run round the part. Only + - * /, square roots and comparisons make
the pixels: the same bits on every machine.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim.scene.maps.objects.dog_coat import RANGES
from sim.scene.maps.texture_tools import SIDE_PX, Image, Rgb, clouds, grain
from tools.art.textures.layers import over, step

_SIZE = (SIDE_PX, SIDE_PX)


def coat(name: str) -> NDArray[np.uint8]:
    """Return the fur of a coat of `dog_coat.COATS`, (256, 256, 3)."""
    image = _PATTERNS[name]()
    # Hair lies along the body: streaks longer than wide, and locks.
    hair = (
        0.35 * clouds(f"fur.{name}", 120, 60) + 0.30 * grain(f"fur.{name}") + 0.35 * clouds(f"fur.lock.{name}", 14, 20)
    )
    image *= 0.80 + 0.40 * hair
    # Less light arrives below.
    image *= 1.0 - 0.22 * step(0.35, 0.05, _height())
    return np.clip(image * 255.0 + 0.5, 0.0, 255.0).astype(np.uint8).transpose(1, 2, 0)


def _plain(rgb: Rgb) -> Image:
    image = np.empty((3, *_SIZE), np.float32)
    image[:] = np.array(rgb, np.float32)[:, None, None]
    return image


def _height() -> Image:
    """Return the height within a section: 0 at the belly, 1 on the back."""
    u = (np.arange(SIDE_PX, dtype=np.float32) + 0.5) / SIDE_PX
    return np.broadcast_to(1.0 - np.abs(2.0 * u - 1.0), _SIZE)


def _along(part: str) -> tuple[Image, Image]:
    """Return where a part lies (0 or 1), and the share of its length, from its first ring."""
    v = np.broadcast_to((1.0 - (np.arange(SIDE_PX, dtype=np.float32) + 0.5) / SIDE_PX)[:, None], _SIZE)
    low, high = RANGES[part]
    margin = 0.01
    inside = ((v >= low - margin) & (v < high + margin)).astype(np.float32)
    return inside, np.clip((v - low) / (high - low), 0.0, 1.0)


def _uneven(name: str, amount: float) -> Image:
    return amount * (clouds(f"fur.edge.{name}", 16, 24) - 0.5)


def _golden() -> Image:
    image = _plain((0.68, 0.52, 0.34))
    height = _height()
    over(image, (0.82, 0.70, 0.52), step(0.40, 0.12, height + _uneven("belly", 0.3)))
    over(image, (0.57, 0.41, 0.24), 0.7 * step(0.72, 0.95, height + _uneven("back", 0.3)))
    over(image, (0.50, 0.34, 0.19), 0.8 * _along("ear")[0])
    leg, along = _along("leg")
    over(image, (0.80, 0.68, 0.50), 0.5 * leg * step(0.3, 1.0, along))
    head, nose = _along("head")
    over(image, (0.76, 0.62, 0.44), head * step(0.55, 0.75, nose))
    return image


def _black() -> Image:
    """Return a black coat with white muzzle, blaze, collar, breast, feet and tip of the tail, as of a collie."""
    white = (0.84, 0.82, 0.78)
    image = _plain((0.21, 0.20, 0.195))
    height = _height()
    over(image, (0.30, 0.29, 0.285), 0.7 * step(0.80, 0.97, height + _uneven("shine", 0.3)))  # shine of the back
    trunk, along = _along("trunk")
    over(image, white, trunk * step(0.66, 0.82, along) * step(0.62, 0.46, height + _uneven("breast", 0.2)))
    over(image, white, trunk * step(0.30, 0.18, height + _uneven("belly", 0.15)))
    neck, up = _along("neck")
    over(image, white, neck * step(0.62, 0.46, height))
    over(image, white, neck * step(0.30, 0.42, up) * step(0.92, 0.80, up + _uneven("ruff", 0.2)))
    head, nose = _along("head")
    over(image, white, head * step(0.30, 0.50, nose) * step(0.84, 0.92, height))
    over(image, white, head * step(0.58, 0.70, nose))
    leg, down = _along("leg")
    over(image, white, leg * step(0.58, 0.72, down + _uneven("leg", 0.2)))
    over(image, white, _along("paw")[0])
    tail, out = _along("tail")
    over(image, white, tail * step(0.70, 0.82, out))
    return image


def _brown() -> Image:
    """Return a tan coat with a dark saddle, ears, muzzle and upper side of the tail, as of a shepherd dog."""
    dark = (0.19, 0.16, 0.14)
    image = _plain((0.58, 0.42, 0.25))
    height = _height()
    over(image, (0.74, 0.60, 0.42), step(0.35, 0.12, height))
    trunk, along = _along("trunk")
    saddle = trunk * step(0.42, 0.58, height + _uneven("saddle", 0.35)) * step(0.98, 0.80, along)
    over(image, dark, saddle)
    neck, _ = _along("neck")
    over(image, dark, 0.8 * neck * step(0.60, 0.80, height + _uneven("neck", 0.3)))
    head, nose = _along("head")
    over(image, dark, 0.9 * head * step(0.60, 0.74, nose))
    over(image, dark, 0.6 * head * step(0.80, 0.95, height))
    over(image, dark, 0.85 * _along("ear")[0])
    tail, _ = _along("tail")
    over(image, dark, 0.9 * tail * step(0.45, 0.65, height))
    return image


_PATTERNS = {"golden": _golden, "black": _black, "brown": _brown}
