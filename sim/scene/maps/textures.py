"""Procedural textures, as PNG bytes: sRGB, without seams, 256 pixels square unless stated otherwise.

Only + - * / and comparisons make the pixels: the same bits on every machine. Each is made once per process.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from signals.noise import NoiseStream

SIDE_PX = 256
Image = NDArray[np.float64]
Rgb = tuple[float, float, float]


def _uniform(name: str, count: int) -> NDArray[np.float64]:
    stream = NoiseStream(0, f"texture.{name}")
    blocks = [stream.uniform_block(b)[:, 0] for b in range(-(-count // 256))]
    return np.concatenate(blocks)[:count]


def _clouds(name: str, cells_x: int, cells_y: int | None = None) -> Image:
    """Return smooth noise on (0, 1): random values on a torus of cells, blended by the smoothstep 3u^2 - 2u^3."""
    cells_y = cells_y or cells_x
    lattice = _uniform(f"{name}.{cells_x}.{cells_y}", cells_x * cells_y).reshape(cells_y, cells_x)

    def weights(cells: int) -> tuple[NDArray[np.int64], NDArray[np.int64], Image]:
        position = np.arange(SIDE_PX) * (cells / SIDE_PX)
        low = position.astype(np.int64)
        u = position - low
        return low, (low + 1) % cells, u * u * (3.0 - 2.0 * u)

    y0, y1, v = weights(cells_y)
    x0, x1, u = weights(cells_x)
    rows = lattice[y0] * (1.0 - v)[:, None] + lattice[y1] * v[:, None]
    return rows[:, x0] * (1.0 - u) + rows[:, x1] * u


def _grain(name: str) -> Image:
    return _uniform(f"{name}.grain", SIDE_PX * SIDE_PX).reshape(SIDE_PX, SIDE_PX)


def _mix(a: Rgb, b: Rgb, t: Image) -> Image:
    """Return a where t = 0 and b where t = 1; (H, W, 3)."""
    t = np.clip(t, 0.0, 1.0)[:, :, None]
    return np.asarray(a) * (1.0 - t) + np.asarray(b) * t


def _png(image: Image) -> bytes:
    bgr = np.clip(image[:, :, ::-1] * 255.0 + 0.5, 0.0, 255.0).astype(np.uint8)
    return bytes(cv2.imencode(".png", np.ascontiguousarray(bgr))[1].tobytes())


def _grid() -> tuple[Image, Image]:
    """Return u, to the right, and v, downwards, on [0, 1)."""
    line = (np.arange(SIDE_PX) + 0.5) / SIDE_PX
    return np.broadcast_to(line, (SIDE_PX, SIDE_PX)), np.broadcast_to(line[:, None], (SIDE_PX, SIDE_PX))


def _grass() -> Image:
    t = 0.22 * _clouds("grass", 7) + 0.38 * _clouds("grass", 40) + 0.4 * _grain("grass")
    return _mix((0.17, 0.29, 0.09), (0.42, 0.53, 0.21), t)


def _dry_ground() -> Image:
    t = 0.2 * _clouds("earth", 7) + 0.4 * _clouds("earth", 36) + 0.4 * _grain("earth")
    return _mix((0.40, 0.34, 0.25), (0.66, 0.58, 0.45), t)


def _gravel() -> Image:
    t = 0.25 * _clouds("gravel", 8) + 0.35 * _clouds("gravel", 64) + 0.4 * _grain("gravel")
    return _mix((0.47, 0.42, 0.34), (0.80, 0.75, 0.65), t)


def _asphalt() -> Image:
    t = 0.35 * _clouds("asphalt", 4) + 0.65 * _grain("asphalt")
    return _mix((0.17, 0.17, 0.18), (0.34, 0.34, 0.35), t)


def _paving() -> Image:
    """Return 4 x 4 slabs."""
    u, v = _grid()
    tone = 0.6 * _uniform("paving.slab", 16).reshape(4, 4).repeat(SIDE_PX // 4, 0).repeat(SIDE_PX // 4, 1)
    image = _mix((0.52, 0.51, 0.48), (0.72, 0.70, 0.66), tone + 0.4 * _grain("paving"))
    joint = ((u * 4) % 1.0 < 0.04) | ((v * 4) % 1.0 < 0.04)
    image[joint] *= 0.6
    return image


def _concrete() -> Image:
    t = 0.2 * _clouds("concrete", 5) + 0.25 * _clouds("concrete", 32, 6) + 0.55 * _grain("concrete")
    image = _mix((0.52, 0.51, 0.48), (0.70, 0.69, 0.66), t)
    _, v = _grid()
    image[(v * 2) % 1.0 < 0.012] *= 0.75  # marks of the formwork
    return image


def _blockwork() -> Image:
    """Return concrete blocks: 4 courses of 2 blocks."""
    return _courses("block", 4, 2, (0.55, 0.54, 0.50), (0.70, 0.68, 0.63), (0.45, 0.44, 0.42), joint=0.05)


def _courses(name: str, courses: int, stones: int, dark: Rgb, light: Rgb, mortar: Rgb, *, joint: float) -> Image:
    """Return stones in running bond: every other course is shifted by half a stone."""
    u, v = _grid()
    course = (v * courses).astype(np.int64)
    along = u * stones + 0.5 * (course % 2)
    tones = _uniform(f"{name}.tone", courses * stones).reshape(courses, stones)
    tone = tones[course, along.astype(np.int64) % stones]
    image = _mix(dark, light, 0.7 * tone + 0.3 * _grain(name))
    aspect = courses / stones
    gaps = ((v * courses) % 1.0 < joint) | (along % 1.0 < joint / aspect)
    image[gaps] = (np.asarray(mortar) * (0.9 + 0.2 * _grain(name + ".mortar"))[:, :, None])[gaps]
    return image


def _brick() -> Image:
    """Return 16 courses of 4 bricks, 1 m of wall."""
    return _courses("brick", 16, 4, (0.47, 0.20, 0.14), (0.67, 0.34, 0.25), (0.72, 0.69, 0.64), joint=0.14)


def _plaster() -> Image:
    t = 0.5 * _clouds("plaster", 5) + 0.2 * _clouds("plaster", 40) + 0.3 * _grain("plaster")
    return _mix((0.86, 0.84, 0.80), (1.0, 0.99, 0.96), t)


def _roof_tiles() -> Image:
    """Return 8 rows of 8 tiles, darker at the overlaps."""
    u, v = _grid()
    row = (v * 8).astype(np.int64)
    along = u * 8 + 0.5 * (row % 2)
    tones = _uniform("tiles.tone", 64).reshape(8, 8)[row, along.astype(np.int64) % 8]
    image = _mix((0.46, 0.19, 0.13), (0.66, 0.32, 0.22), 0.7 * tones + 0.3 * _grain("tiles"))
    depth = (v * 8) % 1.0
    image *= (0.62 + 0.38 * np.clip(depth * 3.0, 0.0, 1.0))[:, :, None]
    image[along % 1.0 < 0.08] *= 0.7
    return image


def _sheet_metal() -> Image:
    """Return ribbed sheet metal, as on a container: 8 ribs."""
    u, _ = _grid()
    phase = (u * 8) % 1.0
    rib = np.clip(np.minimum(phase, 1.0 - phase) * 6.0 - 0.6, 0.0, 1.0)
    return _mix((0.66, 0.66, 0.66), (1.0, 1.0, 1.0), 0.8 * rib + 0.2 * _clouds("sheet", 8))


def _bark() -> Image:
    t = 0.5 * _clouds("bark", 24, 4) + 0.25 * _clouds("bark", 48, 12) + 0.25 * _grain("bark")
    return _mix((0.20, 0.14, 0.10), (0.49, 0.39, 0.30), t)


def _leaves() -> Image:
    """Return leaves in grey-white; the material gives the colour."""
    t = 0.35 * _clouds("leaves", 10) + 0.4 * _clouds("leaves", 40) + 0.25 * _grain("leaves")
    return _mix((0.38, 0.40, 0.34), (1.0, 1.0, 0.92), 1.6 * t - 0.3)


def _wood() -> Image:
    """Return 4 boards along u."""
    _, v = _grid()
    t = 0.6 * _clouds("wood", 3, 32) + 0.2 * _clouds("wood", 8, 64) + 0.2 * _grain("wood")
    image = _mix((0.42, 0.27, 0.15), (0.68, 0.49, 0.30), t)
    image[(v * 4) % 1.0 < 0.05] *= 0.5
    return image


def _water() -> Image:
    t = 0.6 * _clouds("water", 6, 18) + 0.4 * _clouds("water", 20, 48)
    return _mix((0.10, 0.20, 0.25), (0.30, 0.46, 0.52), t)


def _sandbags() -> Image:
    """Return 4 courses of 2 bags, rounded towards their seams."""
    image = _courses("sandbag", 4, 2, (0.56, 0.49, 0.36), (0.72, 0.64, 0.48), (0.24, 0.20, 0.15), joint=0.10)
    _, v = _grid()
    h = (v * 4) % 1.0
    return image * (0.55 + 1.8 * h * (1.0 - h))[:, :, None]


def _windows(wall: Rgb, *, width: float, top: float, bottom: float, band: bool) -> Image:
    """Return one bay of one storey: a window with frame and sill in a wall; with `band`, a floor slab below."""
    u, v = _grid()
    image = np.asarray(wall) * (0.90 + 0.10 * _clouds("facade", 6) + 0.06 * _grain("facade"))[:, :, None]
    left, right = 0.5 - width / 2, 0.5 + width / 2
    frame = 0.022
    outer = (u > left - frame) & (u < right + frame) & (v > top - frame) & (v < bottom + frame)
    inner = (u > left) & (u < right) & (v > top) & (v < bottom)
    image[outer] = (0.88, 0.87, 0.84)
    # The glass reflects a sky that is paler towards the horizon.
    shade = np.clip((v - top) / (bottom - top), 0.0, 1.0)
    glass = _mix((0.44, 0.55, 0.66), (0.13, 0.17, 0.21), shade + 0.25 * (_clouds("glass", 5) - 0.5))
    image[inner] = glass[inner]
    mullion = inner & (np.abs(u - 0.5) < 0.011)
    transom = inner & (np.abs(v - (top + 0.3 * (bottom - top))) < 0.010)
    image[mullion | transom] = (0.86, 0.85, 0.82)
    sill = (u > left - 0.05) & (u < right + 0.05) & (v > bottom + frame) & (v < bottom + frame + 0.03)
    image[sill] = (0.62, 0.60, 0.57)
    if band:
        image[v > 0.955] *= 0.72
    return image


_MAKERS: dict[str, Callable[[], Image]] = {
    "grass": _grass,
    "earth": _dry_ground,
    "gravel": _gravel,
    "asphalt": _asphalt,
    "paving": _paving,
    "concrete": _concrete,
    "blockwork": _blockwork,
    "brick": _brick,
    "plaster": _plaster,
    "roof_tiles": _roof_tiles,
    "sheet_metal": _sheet_metal,
    "bark": _bark,
    "leaves": _leaves,
    "wood": _wood,
    "water": _water,
    "sandbags": _sandbags,
    "facade_sand": lambda: _windows((0.80, 0.71, 0.56), width=0.42, top=0.20, bottom=0.70, band=True),
    "facade_red": lambda: _windows((0.62, 0.33, 0.26), width=0.38, top=0.18, bottom=0.72, band=False),
    "facade_white": lambda: _windows((0.88, 0.87, 0.83), width=0.50, top=0.22, bottom=0.70, band=True),
    "facade_office": lambda: _windows((0.48, 0.52, 0.56), width=0.86, top=0.16, bottom=0.80, band=True),
}
NAMES = tuple(_MAKERS)


@cache
def png(name: str) -> bytes:
    """Return the texture `name` of NAMES as PNG."""
    return _png(_MAKERS[name]())
