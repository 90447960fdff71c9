"""Textures of buildings: walls with wear, window panes, roofs, doors, and swatches of trim."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from sim.scene.maps.facade_layout import OFFICE_WINDOW_M, PANES, STOREY_M, TRIM_ROWS, WALL_M, WINDOW_M
from sim.scene.maps.texture_tools import Image, Rgb, Size, clouds, grain, grid, mix, uniform
from tools.art.textures.dot_font import write
from tools.art.textures.layers import cracks, over, step

_MEDIUM = (512, 512)
_TRIM_RGB: tuple[Rgb, ...] = (
    (0.80, 0.80, 0.78), (0.20, 0.205, 0.215), (0.33, 0.23, 0.16), (0.60, 0.57, 0.51), (0.56, 0.555, 0.54),
    (0.74, 0.70, 0.61), (0.13, 0.23, 0.18), (0.38, 0.11, 0.10), (0.13, 0.20, 0.33), (0.42, 0.30, 0.20),
    (0.60, 0.17, 0.14), (0.16, 0.34, 0.24), (0.25, 0.12, 0.10), (0.10, 0.28, 0.20), (0.14, 0.16, 0.24),
    (0.47, 0.30, 0.24),
)  # fmt: skip
_BAND_RGB: tuple[Rgb, ...] = ((0.40, 0.385, 0.36), (0.66, 0.63, 0.58), (0.76, 0.74, 0.69), (0.23, 0.235, 0.24))


def _worn(image: Image, bays: int, soot: Rgb) -> Image:
    """Return 12 m of wall, `bays` of 3 m wide, with dirt, with wet streaks below the sills and with the BANDS."""
    size = (image.shape[1], image.shape[2])
    u, v = grid(size)
    z = ((1.0 - v) * WALL_M) % STOREY_M  # height above the storey's floor [m]
    off = np.abs((u * bays) % 1.0 - 0.5)  # from the middle of the bay
    thin = clouds("wear.streak", 45 * bays, 5, size)
    low = step(0.92, 0.75, z)
    below_sill = (
        0.35 * step(0.30, 0.16, off) * step(0.35, 0.8, thin) + 0.55 * step(0.05, 0.0, np.abs(off - 0.225)) * thin
    )
    below_band = 0.4 * step(2.2, 2.95, z - 0.5 * thin) * step(0.4, 0.9, thin)
    wide = 0.6 * clouds("wear.wide", 3, 3, size) + 0.4 * clouds("wear.mid", 14, 14, size)
    image = over(image, soot, 0.22 * step(0.5, 0.85, wide) + 0.5 * np.maximum(below_sill * low, below_band))
    tone = 0.88 + 0.24 * (0.6 * grain("band", size) + 0.4 * clouds("band.mid", 40, 40, size))
    for line, rgb in enumerate(_BAND_RGB):
        height = (1.0 - v[:, 0]) * WALL_M - STOREY_M * line
        near = np.minimum(np.abs(height), np.abs(height - WALL_M)) < 0.125
        image[:, near] = mix(rgb, rgb, tone[near]) * tone[near]
    return image


def _plain_bands(image: Image) -> Image:
    """Return a wall whose bands are all of stone but the lowest."""
    rows = image.shape[1]
    quarter, half = rows // 4, round(0.125 / WALL_M * rows)
    image = image.copy()
    stone = image[:, 3 * quarter - half : 3 * quarter + half].copy()
    for line in (1, 2):
        image[:, line * quarter - half : line * quarter + half] = stone
    return image


def _pierced(image: Image, bays: int, window: tuple[float, float, float]) -> Image:
    """Return the picture of a wall with a fourth channel, 0 where the windows of its bays and storeys are."""
    size = (image.shape[1], image.shape[2])
    u, v = grid(size)
    z = ((1.0 - v) * WALL_M) % STOREY_M
    off = np.abs((u * bays) % 1.0 - 0.5) * STOREY_M
    width, sill, head = window
    hole = (off < 0.5 * width) & (z > sill) & (z < head)
    return np.concatenate([image, np.where(hole, 0.0, 1.0).astype(np.float32)[None]])


@cache
def _wall_render() -> Image:
    """Return 12 m of rendered wall in off-white; the material gives the colour."""
    size = _MEDIUM
    t = (
        0.35 * clouds("render.wide", 5, 5, size)
        + 0.25 * clouds("render.mid", 40, 30, size)
        + 0.4 * grain("render", size)
    )
    image = mix((0.735, 0.725, 0.70), (0.825, 0.82, 0.80), t)
    image = _worn(image, 4, (0.36, 0.345, 0.32))
    image *= 1.0 - 0.16 * cracks("render.crack", 5, size, 0.006) * step(0.5, 0.7, clouds("render.where", 4, 4, size))
    return image


def courses(
    name: str, counts: tuple[int, int], tones: tuple[Rgb, Rgb, Rgb], joint: float, size: Size = (256, 256)
) -> Image:
    """Return stones in running bond: every other course is shifted by half a stone.

    `counts`: courses and stones in a course; `tones`: dark, light, mortar; `joint`: as a share of a course.
    """
    courses, stones = counts
    u, v = grid(size)
    course = (v * courses).astype(np.int64)
    along = u * stones + 0.5 * (course % 2)
    tone = uniform(f"{name}.tone", courses * stones).reshape(courses, stones)[course, along.astype(np.int64) % stones]
    image = mix(tones[0], tones[1], 0.65 * tone + 0.35 * grain(name, size))
    aspect = size[1] * courses / (size[0] * stones)
    gaps = ((v * courses) % 1.0 < joint) | (along % 1.0 < joint / aspect)
    mortar = mix(tones[2], tones[2], tone) * (0.88 + 0.24 * grain(name + ".mortar", size))
    return np.where(gaps, mortar, image)


@cache
def _wall_brick() -> Image:
    """Return 6 m of brick wall, 12 m high: 160 courses of 24 bricks, with soot, bleached and newer bricks."""
    size = (1024, 512)
    image = courses("brick", (160, 24), ((0.36, 0.215, 0.17), (0.575, 0.385, 0.305), (0.50, 0.475, 0.44)), 0.16, size)
    wide = 0.5 * clouds("brick.wide", 4, 4, size) + 0.5 * clouds("brick.mid", 16, 16, size)
    image *= 0.84 + 0.32 * wide
    image = over(image, (0.62, 0.58, 0.54), 0.16 * step(0.6, 0.9, clouds("brick.salt", 5, 8, size)))
    return _worn(image, 2, (0.21, 0.185, 0.165))


@cache
def _wall_panel() -> Image:
    """Return 12 m of concrete panels, 3 x 1.5 m, with washed-out runs below their joints."""
    size = _MEDIUM
    u, v = grid(size)
    panel = uniform("panel.tone", 32).reshape(8, 4).repeat(64, 0).repeat(128, 1)
    t = 0.3 * panel + 0.25 * clouds("panel.mid", 30, 24, size) + 0.45 * grain("panel", size)
    image = mix((0.50, 0.495, 0.48), (0.635, 0.625, 0.605), t)
    image = _worn(image, 4, (0.31, 0.30, 0.285))
    seam = ((u * 4) % 1.0 < 0.008) | ((v * 8) % 1.0 < 0.016)
    image[:, seam] *= 0.5
    return image


def _concrete() -> Image:
    """Return 5 m of cast concrete: marks and holes of the formwork, blotches, runs of water."""
    size = _MEDIUM
    u, v = grid(size)
    board = uniform("concrete.board", 8).repeat(64)[:, None]
    t = (
        0.22 * clouds("concrete", 5, 5, size)
        + 0.2 * clouds("concrete.run", 60, 8, size)
        + 0.4 * grain("concrete", size)
        + 0.18 * board
    )
    image = mix((0.44, 0.435, 0.42), (0.625, 0.615, 0.59), t)
    image = over(image, (0.33, 0.32, 0.30), 0.16 * step(0.5, 0.9, clouds("concrete.blotch", 7, 5, size)))
    image = over(image, (0.30, 0.285, 0.265), 0.20 * step(0.6, 0.95, clouds("concrete.streak", 70, 3, size)))
    image[:, (v[:, 0] * 4) % 1.0 < 0.010] *= 0.72
    image[:, :, (u[0] * 2) % 1.0 < 0.006] *= 0.80
    holes = (((u * 4) % 1.0 - 0.5) ** 2 * 1.0 + ((v * 4) % 1.0 - 0.5) ** 2) < 0.0007
    image[:, holes] *= 0.45
    return image


def _blockwork() -> Image:
    """Return 3.2 m of concrete blocks: 16 courses of 8 blocks, with mortar smeared over them."""
    size = _MEDIUM
    image = courses("block", (16, 8), ((0.45, 0.445, 0.42), (0.60, 0.585, 0.555), (0.36, 0.35, 0.33)), 0.07, size)
    image = over(image, (0.58, 0.565, 0.535), 0.22 * step(0.6, 0.9, clouds("block.smear", 26, 14, size)))
    image = over(image, (0.30, 0.285, 0.26), 0.15 * step(0.5, 0.9, clouds("block.dirt", 5, 4, size)))
    return image * (0.94 + 0.12 * clouds("block.mid", 40, 40, size))


def _brick() -> Image:
    """Return 16 courses of 4 bricks, 1 m of wall."""
    return courses("brick", (16, 4), ((0.36, 0.215, 0.17), (0.575, 0.385, 0.305), (0.50, 0.475, 0.44)), 0.14)


def _plaster() -> Image:
    """Return 3 m of plaster in off-white, blotched; the material gives the colour."""
    size = _MEDIUM
    t = 0.4 * clouds("plaster", 5, 5, size) + 0.25 * clouds("plaster.mid", 40, 40, size) + 0.35 * grain("plaster", size)
    image = mix((0.70, 0.69, 0.665), (0.84, 0.83, 0.805), t)
    image = over(image, (0.50, 0.47, 0.42), 0.35 * step(0.58, 0.85, clouds("plaster.stain", 4, 3, size)))
    return image * (1.0 - 0.22 * cracks("plaster.crack", 3, size, 0.008))


def _spall() -> Image:
    """Return blocks that show where plaster has come off, between holes; its square is 0.7 to 1.8 m wide."""
    size = (256, 256)
    u, v = grid(size)
    image = courses("block", (4, 2), ((0.36, 0.34, 0.31), (0.52, 0.50, 0.46), (0.43, 0.415, 0.385)), 0.08, size)
    x, y = 2.0 * u - 1.0, 2.0 * v - 1.0
    ragged = 0.7 * (clouds("spall", 6) - 0.5) + 0.4 * (clouds("spall.fine", 24) - 0.5)
    r = np.sqrt(x * x + y * y) + ragged
    image = over(image, (0.70, 0.69, 0.66), 0.8 * step(0.66, 0.70, r))  # broken edge of the plaster
    return np.concatenate([image, ((r < 0.74) & (x * x + y * y < 0.96)).astype(np.float32)[None]])


def _roof_tiles() -> Image:
    """Return 4.8 m of pantiles: 16 rows of 16, rounded, darker at the overlaps, with lichen and soot."""
    size = _MEDIUM
    u, v = grid(size)
    row = (v * 16).astype(np.int64)
    along = u * 16
    tones = uniform("tiles.tone", 256).reshape(16, 16)[row, along.astype(np.int64) % 16]
    image = mix((0.365, 0.225, 0.17), (0.545, 0.365, 0.285), 0.6 * tones + 0.4 * grain("tiles", size))
    down, across = (v * 16) % 1.0, along % 1.0
    image *= 0.55 + 0.45 * step(0.0, 0.22, down)
    image *= 0.66 + 1.30 * across * (1.0 - across)
    wide = 0.5 * clouds("tiles.wide", 3, 3, size) + 0.5 * clouds("tiles.mid", 12, 12, size)
    image = over(image, (0.23, 0.20, 0.175), 0.5 * step(0.5, 0.8, wide))
    return over(
        image, (0.47, 0.46, 0.37), 0.6 * step(0.74, 0.85, clouds("tiles.lichen", 60, 60, size)) * step(0.6, 0.3, wide)
    )


def _roof_felt() -> Image:
    """Return 6 m of bitumen felt: sheets of 1 m with seams, puddle marks, patches."""
    u, v = grid()
    t = 0.5 * grain("felt") + 0.5 * clouds("felt", 12)
    image = mix((0.27, 0.27, 0.272), (0.40, 0.395, 0.385), t)
    image[:, :, (u[0] * 6) % 1.0 < 0.03] *= 0.75
    image[:, (v[:, 0] * 2) % 1.0 < 0.012] *= 0.78
    pond = clouds("felt.pond", 4)
    image = over(image, (0.46, 0.445, 0.41), 0.45 * step(0.55, 0.65, pond) * step(0.85, 0.7, pond))
    return over(image, (0.20, 0.20, 0.20), 0.5 * step(0.75, 0.8, clouds("felt.patch", 6)))


@cache
def _panes() -> Image:
    """Return 16 windows from outside: dark rooms with curtains, blinds, plants, lamps."""
    size = _MEDIUM
    u, v = grid(size)
    image = mix(
        (0.105, 0.115, 0.125),
        (0.215, 0.235, 0.25),
        0.55 * step(1.0, 0.0, (v * PANES) % 1.0) + 0.45 * (clouds("pane.sky", 9, 7, size) - 0.2),
    )
    image *= 0.75 + 0.5 * step(0.15, 0.9, clouds("pane.room", 13, 11, size))
    folds, leaves = clouds("pane.folds", 150, 3, size), clouds("pane.plant", 60, 60, size)
    side = size[0] // PANES
    for field in range(PANES * PANES):
        row, column = divmod(field, PANES)
        here = slice(row * side, (row + 1) * side), slice(column * side, (column + 1) * side)
        pane = image[:, *here]
        x, y = (u[:, here[1]] * PANES) % 1.0, (v[here[0]] * PANES) % 1.0
        a, b, c, d = (float(value) for value in uniform(f"pane.{field}", 4))
        cloth = ((0.62, 0.60, 0.555), (0.56, 0.49, 0.40), (0.42, 0.45, 0.47), (0.50, 0.33, 0.27))[int(c * 4.0)]
        kind = field % 6
        if kind in (0, 3):  # curtains at both sides
            sides = (x < 0.10 + 0.16 * a) | (x > 0.90 - 0.16 * b)
            over(pane, cloth, sides * (0.35 + 0.45 * folds[here]))
        elif kind == 1:  # blind, half down
            lamellae = 0.72 + 0.28 * ((y * 24.0) % 1.0 > 0.35)
            over(pane, (0.55, 0.54, 0.52), (y < 0.25 + 0.5 * a) * 0.75 * lamellae)
        elif kind == 2:  # net curtain over the lower or the whole window
            over(pane, (0.50, 0.50, 0.49), (y > 0.5 * (a > 0.5)) * (0.30 + 0.35 * folds[here]))
        elif kind == 4:  # plants on the sill
            green = leaves[here]
            share = (green > 0.45) * step(0.62, 0.80, y + 0.25 * (green - 0.5)) * 0.8
            over(pane, (0.13, 0.19, 0.09), share)
        if d > 0.8:  # a lamp in the room
            spot = step(0.004, 0.0, (x - 0.3 - 0.4 * a) ** 2 + (y - 0.25) ** 2)
            over(pane, (0.80, 0.66, 0.42), 0.6 * spot)
    # Frames: white, dark or wooden, with a mullion; the upper light of some opens.
    x, y = (u * PANES) % 1.0, (v * PANES) % 1.0
    number_of = (v * PANES).astype(np.int64) * PANES + (u * PANES).astype(np.int64)
    edge = np.minimum(np.minimum(x, 1.0 - x), np.minimum(y, 1.0 - y))
    bar = np.maximum(step(0.085, 0.075, edge), step(0.030, 0.022, np.abs(x - 0.5)))
    bar = np.maximum(bar, step(0.024, 0.016, np.abs(y - 0.30)) * (number_of % 4 == 2))
    image *= 1.0 - 0.45 * step(0.125, 0.08, edge)  # shadow of the frame and of the reveal
    for number, rgb in enumerate(
        ((0.74, 0.735, 0.715), (0.74, 0.735, 0.715), (0.20, 0.205, 0.21), (0.30, 0.21, 0.145))
    ):
        image = over(image, rgb, bar * ((number_of * 7 // 3) % 4 == number))
    return image


@cache
def _windows(size_m: tuple[float, float, float]) -> Image:
    """Return 12 x 12 m of windows of this size, one of the fields of `panes` in every bay and storey."""
    side = 1024
    panes, field = _panes(), 512 // PANES
    width, sill, head = size_m
    pixels_per_m = side / WALL_M
    image = np.full((3, side, side), 0.1, np.float32)
    wide, high = round((width + 0.04) * pixels_per_m), round((head - sill + 0.04) * pixels_per_m)
    columns, rows = (np.arange(wide) * field) // wide, (np.arange(high) * field) // high
    for level in range(4):
        for bay in range(4):
            row, column = divmod((7 * level + 3 * bay) % (PANES * PANES), PANES)
            picture = panes[:, row * field : (row + 1) * field, column * field : (column + 1) * field]
            picture = picture[:, rows][:, :, columns[::-1] if (level + bay) % 2 else columns]
            left = round((STOREY_M * (bay + 0.5) - width / 2 - 0.02) * pixels_per_m)
            top = side - round((STOREY_M * level + head + 0.02) * pixels_per_m)
            image[:, top : top + high, left : left + wide] = picture
    return image


def _shops() -> Image:
    """Return two shop windows: shelves and goods in the lower half, a bright ceiling, a dark frame."""
    size = (256, 512)
    u, y = grid(size)
    image = mix((0.15, 0.16, 0.17), (0.33, 0.35, 0.37), step(1.0, 0.0, y) * (0.4 + clouds("shop.sky", 7, 4, size)))
    goods = 0.6 + 0.8 * (0.6 * clouds("shop.hue", 46, 12, size) + 0.4 * clouds("shop.fine", 120, 40, size))
    shelf = mix((0.22, 0.19, 0.16), (0.66, 0.58, 0.48), clouds("shop.goods", 60, 22, size)) * goods
    shown = (y > 0.42) & ((y * 7.0) % 1.0 > 0.14) & (clouds("shop.where", 9, 5, size) > 0.35)
    image = np.where(shown, 0.75 * shelf, image)
    image = over(image, (0.62, 0.60, 0.54), 0.5 * step(0.05, 0.03, np.abs(y - 0.12)) * ((u * 14.0) % 1.0 < 0.5))
    return over(image, (0.17, 0.175, 0.18), 1.0 * ((y < 0.05) | (y > 0.94) | (np.abs((u * 6.0) % 1.0 - 0.02) < 0.02)))


def _glazed(wall: Image, size_m: tuple[float, float, float]) -> Image:
    """Return 12 x 12 m of wall with windows, their reveals and sills painted on."""
    side = 1024
    if wall.shape[1] != wall.shape[2]:
        image = np.tile(wall, (1, side // wall.shape[1], 2))
    else:
        enlarged = np.empty((3, wall.shape[1], side // wall.shape[1], wall.shape[2], side // wall.shape[2]), np.float32)
        enlarged[:] = wall[:, :, None, :, None]
        image = enlarged.reshape(3, side, side)
    u, v = grid((side, side))
    width, sill, head = size_m
    z = ((1.0 - v) * WALL_M) % STOREY_M
    off = np.abs((u * 4) % 1.0 - 0.5) * STOREY_M
    inside = np.ix_(np.arange(3), ((z > sill) & (z < head))[:, 0], (off < 0.5 * width)[0])
    # Shade of the reveal: below the head, and at both jambs.
    shade = 1.0 - 0.55 * step(0.17, 0.02, head - z) - 0.25 * step(0.07, 0.0, 0.5 * width - off)
    image[inside] = _windows(size_m)[inside] * shade[inside[1:]]
    near = off < 0.5 * width + 0.06
    for rgb, share, low, high in (((0.66, 0.64, 0.60), 0.9, 0.07, 0.0), ((0.12, 0.12, 0.12), 0.35, 0.13, 0.07)):
        rows = ((z > sill - low) & (z <= sill - high))[:, 0]
        image[:, rows] = over(image[:, rows], rgb, share * near)
    return image


def _trim() -> Image:
    """Return the rows TRIM_ROWS, and below them two shop windows."""
    size = (512, 512)
    u, _ = grid(size)
    height = size[0] // len(TRIM_ROWS)
    image = np.array(_TRIM_RGB, np.float32).T.repeat(height, 1)[:, :, None].repeat(size[1], 2)
    image = image * (0.88 + 0.14 * grain("trim", size) + 0.10 * clouds("trim.mid", 24, 64, size))
    for name in ("awning_red", "awning_green"):
        at = TRIM_ROWS.index(name) * height
        image[:, at : at + height, (u[0] * 5.0) % 1.0 < 0.5] = 0.70
    picture = np.ascontiguousarray((np.clip(image, 0.0, 1.0) * 255.0).astype(np.uint8).transpose(1, 2, 0))
    for name, text in (("sign_bakery", "BAKERY"), ("sign_pharmacy", "PHARMACY"), ("sign_books", "BOOKS")):
        at = TRIM_ROWS.index(name) * height
        write(picture, text, (at + 6, 256 - 9 * len(text)), (3, 3), 18, (225, 215, 190))
    brick = TRIM_ROWS.index("brick") * height
    bond = np.tile(_brick()[:, : 2 * height : 2], (1, 1, 2)).transpose(1, 2, 0)
    picture[brick : brick + height] = (np.clip(bond, 0.0, 1.0) * 255.0).astype(np.uint8)
    rows = (picture.transpose(2, 0, 1) / np.float32(255.0)).astype(np.float32)
    return np.concatenate([0.5 * (rows[:, ::2] + rows[:, 1::2]), _shops()], 1)


def _door() -> Image:
    """Return a panelled door in grey-white, with handle and letter box; the material gives the colour."""
    size = (256, 128)
    u, v = grid(size)
    image = mix(
        (0.80, 0.80, 0.80), (1.0, 1.0, 1.0), 0.5 * grain("door", (256, 256))[:, :128] + 0.5 * clouds("door", 4, 6, size)
    )
    for x0, x1, y0, y1 in (
        (0.14, 0.46, 0.08, 0.42),
        (0.54, 0.86, 0.08, 0.42),
        (0.14, 0.46, 0.54, 0.92),
        (0.54, 0.86, 0.54, 0.92),
    ):
        edge = np.minimum(np.minimum(u - x0, x1 - u), 2.0 * np.minimum(v - y0, y1 - v))
        image *= 1.0 - 0.40 * step(0.022, 0.008, np.abs(edge))
    image[:, (np.abs(u - 0.5) < 0.11) & (np.abs(v - 0.475) < 0.012)] = 0.72
    image[:, (np.abs(u - 0.91) < 0.02) & (np.abs(v - 0.53) < 0.03)] = 0.86
    return image * (0.86 + 0.14 * step(0.0, 0.02, np.minimum(np.minimum(u, 1.0 - u), np.minimum(v, 1.0 - v))))


MAKERS: dict[str, Callable[[], Image]] = {
    "wall_render": _wall_render,
    "wall_brick": _wall_brick,
    "wall_panel": _wall_panel,
    "flats_render_holes": lambda: _pierced(_plain_bands(_wall_render()), 4, WINDOW_M),
    "flats_brick_holes": lambda: _pierced(_plain_bands(_wall_brick()), 2, WINDOW_M),
    "flats_office_holes": lambda: _pierced(_plain_bands(_wall_panel()), 4, OFFICE_WINDOW_M),
    "flats_render": lambda: _glazed(_plain_bands(_wall_render()), WINDOW_M),
    "flats_brick": lambda: _glazed(_plain_bands(_wall_brick()), WINDOW_M),
    "flats_office": lambda: _glazed(_plain_bands(_wall_panel()), OFFICE_WINDOW_M),
    "flats_windows": lambda: _windows(WINDOW_M),
    "office_windows": lambda: _windows(OFFICE_WINDOW_M),
    "concrete": _concrete,
    "blockwork": _blockwork,
    "plaster": _plaster,
    "spall": _spall,
    "roof_tiles": _roof_tiles,
    "roof_felt": _roof_felt,
    "panes": _panes,
    "trim": _trim,
    "door": _door,
}
