"""Textures of the walls of imported buildings: 4 bays by 2 storeys of windows, or 4 bays of a ground floor.

Only + - * / and comparisons make the pixels: the same bits on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signals.noise import NoiseStream
from sim.scene.maps.facade_layout import BAYS, STOREYS, WHITE_WALL_RGB

_PX = 128  # of a bay
Image = NDArray[np.float64]


@dataclass(frozen=True)
class Style:
    """Wall and windows; lengths as a share of a bay."""

    wall: tuple[float, float, float]
    width: float
    sill: float
    head: float
    frame: tuple[float, float, float]
    bricks: bool = False
    band: bool = False


STYLES = {
    "white": Style(WHITE_WALL_RGB, 0.42, 0.30, 0.80, (0.88, 0.87, 0.85)),
    "cream": Style((0.80, 0.74, 0.61), 0.38, 0.29, 0.80, (0.90, 0.89, 0.86), band=True),
    "ochre": Style((0.74, 0.61, 0.42), 0.36, 0.28, 0.82, (0.86, 0.84, 0.80), band=True),
    "rose": Style((0.72, 0.56, 0.49), 0.36, 0.28, 0.82, (0.88, 0.87, 0.84)),
    "grey": Style((0.62, 0.63, 0.63), 0.50, 0.30, 0.79, (0.26, 0.27, 0.28)),
    "brick": Style((0.52, 0.29, 0.22), 0.36, 0.28, 0.82, (0.86, 0.85, 0.81), bricks=True),
    "dark_brick": Style((0.38, 0.25, 0.21), 0.40, 0.29, 0.81, (0.20, 0.20, 0.21), bricks=True),
    "office": Style((0.45, 0.47, 0.49), 0.88, 0.26, 0.86, (0.20, 0.21, 0.22), band=True),
    "metal": Style((0.60, 0.62, 0.63), 0.0, 0.0, 0.0, (0.5, 0.5, 0.5)),
}


def _draws(name: str, count: int) -> Image:
    stream = NoiseStream(0, f"facade.{name}")
    return np.concatenate([stream.uniform_block(b)[:, 0] for b in range(-(-count // 256))])[:count]


def _noise(name: str, rows: int, columns: int, cell: int) -> Image:
    """Return smooth noise on (0, 1) that repeats at the edges."""
    small = _draws(f"{name}.{cell}", (rows // cell) * (columns // cell)).reshape(rows // cell, columns // cell)
    y, x = np.arange(rows) / cell, np.arange(columns) / cell
    i, j = y.astype(int), x.astype(int)
    v, u = (y - i)[:, None], (x - j)[None, :]
    i1, j1 = (i + 1) % small.shape[0], (j + 1) % small.shape[1]
    low = small[i][:, j] * (1 - u) + small[i][:, j1] * u
    high = small[i1][:, j] * (1 - u) + small[i1][:, j1] * u
    return low * (1 - v) + high * v


def _wall(style: Style, name: str, rows: int, columns: int) -> Image:
    tone = 0.90 + 0.12 * _noise(name, rows, columns, 64) + 0.06 * _noise(name, rows, columns, 16)
    tone = tone + 0.05 * (_draws(f"{name}.grain", rows * columns).reshape(rows, columns) - 0.5)
    image = np.asarray(style.wall) * tone[:, :, None]
    if style.bricks:
        y, x = np.arange(rows)[:, None], np.arange(columns)[None, :]
        course = y // 4
        along = x + 5 * (course % 2)
        brick = _draws(f"{name}.brick", 97)[(course * 13 + along // 11 * 7) % 97]
        image *= (0.82 + 0.36 * brick)[:, :, None]
        joint = (y % 4 == 0) | (along % 11 == 0)
        image[np.broadcast_to(joint, (rows, columns))] *= 1.25
    if style.width == 0.0:
        x = np.arange(columns)[None, :] % 16
        image *= np.broadcast_to(np.where(x < 3, 0.80, np.where(x > 12, 1.06, 1.0)), (rows, columns))[:, :, None]
    return image


def _window(image: Image, style: Style, x0: int, y0: int, draw: Image, *, door: bool = False) -> None:
    """Draw a window, or a door, into the bay whose upper left corner is (x0, y0)."""
    width = int(style.width * _PX)
    left = x0 + (_PX - width) // 2
    top, bottom = y0 + int((1.0 - style.head) * _PX), y0 + int((1.0 - style.sill) * _PX)
    if door:
        width = int(0.36 * _PX)
        left, bottom = x0 + (_PX - width) // 2, y0 + _PX
    right = left + width
    image[top - 3 : top, left - 2 : right + 2] *= 0.72  # lintel's shadow
    image[top:bottom, left:right] = style.frame
    inner = np.s_[top + 4 : bottom - 4, left + 4 : right - 4]
    rows, columns = image[inner].shape[:2]
    v = (np.arange(rows) / max(rows - 1, 1))[:, None, None]
    if door:
        image[inner] = np.asarray(((0.20, 0.15, 0.11), (0.14, 0.20, 0.17), (0.16, 0.17, 0.20))[int(draw[0] * 3)])
        image[top + 8 : top + 8 + rows // 3, left + 10 : right - 10] = (0.10, 0.12, 0.14)
        return
    glass = (1.0 - v) * np.asarray((0.36, 0.43, 0.50)) + v * np.asarray((0.09, 0.11, 0.13))
    image[inner] = glass * (0.55 + 0.8 * draw[0])
    if draw[1] < 0.45:  # curtains at the sides
        share = max(2, int(columns * (0.12 + 0.2 * draw[2])))
        for part in (np.s_[:, :share], np.s_[:, columns - share :]):
            image[inner][part] = (0.62, 0.60, 0.56)
    elif draw[1] < 0.65:  # a blind
        image[inner][: int(rows * (0.2 + 0.6 * draw[2]))] = (0.66, 0.64, 0.60)
    image[inner][: max(2, rows // 12)] *= 0.6
    image[inner][:, :2] *= 0.7
    if style.width < 0.8:
        middle = (left + right) // 2
        image[top:bottom, middle - 2 : middle + 2] = style.frame
    else:
        for i in range(1, 3):
            at = left + i * width // 3
            image[top:bottom, at - 1 : at + 2] = style.frame
    image[bottom : bottom + 4, left - 5 : right + 5] = np.asarray((0.66, 0.65, 0.62))
    image[bottom + 4 : bottom + 8, left - 5 : right + 5] *= 0.75


def upper(name: str) -> NDArray[np.uint8]:
    """Return two storeys of four bays."""
    style = STYLES[name]
    image = _wall(style, name, STOREYS * _PX, BAYS * _PX)
    draws = _draws(f"{name}.windows", 3 * BAYS * STOREYS).reshape(STOREYS, BAYS, 3)
    for storey in range(STOREYS):
        for bay in range(BAYS):
            if style.width > 0.0:
                _window(image, style, bay * _PX, storey * _PX, draws[storey, bay])
        if style.band:
            image[(storey + 1) * _PX - 7 : (storey + 1) * _PX - 2] *= 1.10
            image[(storey + 1) * _PX - 2 : (storey + 1) * _PX] *= 0.7
    return _pixels(image)


def ground(name: str, *, shops: bool) -> NDArray[np.uint8]:
    """Return one storey of four bays: shop windows, or windows and a door in every fourth bay."""
    style = STYLES[name]
    image = _wall(style, f"{name}.ground", _PX, BAYS * _PX)
    draws = _draws(f"{name}.ground.windows", 3 * BAYS).reshape(BAYS, 3)
    wide = Style(style.wall, 0.84, 0.14, 0.80, (0.16, 0.16, 0.17))
    for bay in range(BAYS):
        if style.width == 0.0:
            if bay == 1:
                image[int(0.2 * _PX) :, bay * _PX + 16 : bay * _PX + _PX - 16] = (0.42, 0.44, 0.46)
            continue
        if shops and bay != 2:
            _window(image, wide, bay * _PX, 0, draws[bay])
            colour = ((0.42, 0.12, 0.10), (0.10, 0.22, 0.34), (0.14, 0.28, 0.18), (0.50, 0.42, 0.16))[bay]
            image[4:20, bay * _PX + 8 : bay * _PX + _PX - 8] = colour
        else:
            _window(image, style, bay * _PX, 0, draws[bay], door=bay == 2)
    image[_PX - 12 :] *= 0.72  # plinth
    return _pixels(image)


def _pixels(image: Image) -> NDArray[np.uint8]:
    return np.clip(image * 255.0 + 0.5, 0.0, 255.0).astype(np.uint8)
