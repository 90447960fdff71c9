"""Textures of people: faces, folds of cloth, stripes, checks, denim, camouflage.

A material's colour multiplies them. Only + - * / and comparisons make the pixels: the same bits on every machine.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.noise import NoiseStream

Image = NDArray[np.floating[Any]]
_SIDE_PX = 128
_FACE_PX = (128, 256)  # the face's front is in the middle of the columns


def _noise(name: str, rows: int, columns: int, side: tuple[int, int] = (_SIDE_PX, _SIDE_PX)) -> Image:
    """Return smooth noise on (0, 1) that repeats at the edges, with so many cells."""
    stream = NoiseStream(0, f"cloth.{name}.{rows}.{columns}")
    count = rows * columns
    values = np.concatenate([stream.uniform_block(b)[:, 0] for b in range(-(-count // 256))])[:count]
    lattice = values.reshape(rows, columns)

    def cells(pixels: int, number: int) -> tuple[NDArray[np.int64], NDArray[np.int64], Image]:
        position = np.arange(pixels) * (number / pixels)
        low = position.astype(np.int64)
        t = position - low
        return low, (low + 1) % number, t * t * (3.0 - 2.0 * t)

    y0, y1, v = cells(side[0], rows)
    x0, x1, u = cells(side[1], columns)
    across = lattice[y0] * (1.0 - v)[:, None] + lattice[y1] * v[:, None]
    mixed: Image = across[:, x0] * (1.0 - u) + across[:, x1] * u
    return mixed


def _grid(side: tuple[int, int]) -> tuple[Image, Image]:
    """Return u to the right and v downwards, on [0, 1)."""
    u = np.broadcast_to((np.arange(side[1]) + 0.5) / side[1], side)
    v = np.broadcast_to(((np.arange(side[0]) + 0.5) / side[0])[:, None], side)
    return u, v


def _grey(value: Image) -> Image:
    return np.stack([value] * 3, axis=-1)


def _folds() -> Image:
    """Return the light on creased cloth: slanting folds of several widths, and creases between them."""
    wide, fine, small = _noise("folds", 5, 4), _noise("folds", 9, 14), _noise("creases", 11, 7)
    sheared, slanted = (np.stack([np.roll(a[i], i // 2) for i in range(_SIDE_PX)]) for a in (wide, small))
    ridge, crease = np.abs(2.0 * sheared - 1.0), np.abs(2.0 * slanted - 1.0)
    light = 0.70 + 0.24 * np.minimum(1.0, 1.6 * ridge) + 0.12 * fine - 0.02 * _noise("weave", 64, 64)
    return light - 0.16 * np.maximum(0.0, 1.0 - 9.0 * crease) * fine


def _plain() -> Image:
    return _grey(_folds())


def _denim() -> Image:
    worn = _noise("denim", 3, 3)
    grain = _noise("denim", 64, 40)
    light = _folds() * (0.80 + 0.28 * worn) + 0.10 * (grain - 0.5)
    return np.stack([light, light, light * 0.97 + 0.02], axis=-1)


def _stripes() -> Image:
    _, v = _grid((_SIDE_PX, _SIDE_PX))
    is_dark = ((v * 14.0) % 1.0 < 0.45)[:, :, None]
    return np.where(is_dark, (0.20, 0.24, 0.34), (1.0, 1.0, 1.0)) * _grey(_folds())


def _check() -> Image:
    u, v = _grid((_SIDE_PX, _SIDE_PX))
    across, down = (u * 16.0) % 1.0 < 0.42, (v * 9.0) % 1.0 < 0.42
    light = 1.0 - 0.33 * across - 0.33 * down
    thin = ((u * 16.0 + 0.3) % 1.0 < 0.08) | ((v * 9.0 + 0.3) % 1.0 < 0.08)
    return _grey(np.where(thin, 0.25, light) * _folds())


def _camouflage() -> Image:
    """Return small dark spots of greens and browns: large light ones dissolve a body's outline for detectors."""
    a, b, c = _noise("camo_a", 14, 18), _noise("camo_b", 18, 24), _noise("camo_c", 30, 36)
    image = np.empty((_SIDE_PX, _SIDE_PX, 3))
    image[:] = (0.34, 0.36, 0.26)
    for mask, rgb in (
        (0.7 * a + 0.3 * c > 0.52, (0.24, 0.28, 0.18)),
        (0.7 * b + 0.3 * c > 0.57, (0.26, 0.20, 0.15)),
        (0.6 * a + 0.4 * c < 0.36, (0.12, 0.13, 0.11)),
    ):
        image[mask] = rgb
    return image * _grey(_folds() + 0.14)


def _face(*, female: bool = False, beard: bool = False) -> Image:
    """Return the face on white skin: brows, eyes, nostrils, lips, and a beard. The nose is in the mesh."""
    side = _FACE_PX
    u, v = _grid(side)
    x = np.abs(u - 0.5) * 360.0  # degrees from the middle
    z = (1.0 - v) * 0.132 - 0.066  # as in the mesh of the head
    image = np.ones((*side, 3))

    def paint(share: Image, rgb: tuple[float, float, float]) -> None:
        share = np.clip(share, 0.0, 1.0)[:, :, None]
        image[:] = image * (1.0 - share) + np.asarray(rgb) * share

    def spot(middle: float, height: float, half: float, tall: float, soft: float = 0.5) -> Image:
        """Return an ellipse, half width in degrees: 1 inside, falling to 0 over the share `soft` of its radius."""
        dx, dz = (x - middle) / half, (z - height) / tall
        return (1.0 - (dx * dx + dz * dz)) / soft

    image *= (0.97 + 0.05 * _noise("skin", 16, 24, side))[:, :, None]
    paint(0.30 * spot(31.0, -0.022, 16.0, 0.014, 1.0), (0.95, 0.62, 0.56))  # cheeks
    paint(0.55 * spot(22.0, 0.0045, 13.0, 0.0075, 0.8), (0.62, 0.50, 0.46))  # sockets
    paint(0.45 * spot(0.0, -0.0245, 12.0, 0.004, 0.8), (0.50, 0.36, 0.32))  # under the nose
    paint(0.8 * spot(6.5, -0.0215, 3.2, 0.0016), (0.22, 0.13, 0.11))  # nostrils
    if beard:
        jaw = (z < -0.016 - 0.00035 * (60.0 - np.minimum(x, 60.0))) & (x < 92.0) | ((z < 0.0) & (x > 60) & (x < 92))
        paint(0.78 * jaw, (0.16, 0.11, 0.08))
    elif not female:
        shade = (z < -0.026) & (x < 85.0)
        paint(0.16 * shade, (0.35, 0.33, 0.34))
    lips = (0.78, 0.36, 0.36) if female else (0.76, 0.50, 0.46)
    paint(0.9 * spot(0.0, -0.0372, 15.5 if female else 17.0, 0.0042), lips)
    paint(0.9 * spot(0.0, -0.0368, 17.0, 0.0009), (0.32, 0.16, 0.15))
    paint(spot(22.0, 0.0025, 8.2, 0.0034), (0.93, 0.91, 0.89))  # eyes
    paint(spot(21.5, 0.0025, 4.2, 0.0037), (0.14, 0.10, 0.08))
    paint(0.9 * spot(22.0, 0.0058, 9.5, 0.0014), (0.20, 0.14, 0.12))  # lids
    arch = 0.0135 - 0.000022 * (x - 22.0) * (x - 22.0)
    brow = (np.abs(z - arch) < (0.0016 if female else 0.0024)) & (np.abs(x - 22.0) < 12.5)
    paint(0.85 * brow, (0.17, 0.12, 0.09))
    return image


MAKERS: dict[str, Callable[[], Image]] = {
    "cloth_plain": _plain, "cloth_denim": _denim, "cloth_stripes": _stripes, "cloth_check": _check,
    "cloth_camouflage": _camouflage, "face_m": _face, "face_f": lambda: _face(female=True),
    "face_beard": lambda: _face(beard=True),
}  # fmt: skip


def pixels(name: str) -> NDArray[np.uint8]:
    """Return one of MAKERS, (H, W, 3)."""
    return np.clip(MAKERS[name]() * 255.0 + 0.5, 0.0, 255.0).astype(np.uint8)
