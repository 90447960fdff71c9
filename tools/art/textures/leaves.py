"""Textures of leaf cards: leafy twigs with holes around them, drawn leaf by leaf, sRGB and alpha.

A texture has 256 x 256 pixels. That of a broadleaved plant holds two triangular fans of twigs: one grows from the lower
left corner to the diagonal, the other from the upper right corner. That of a conifer holds one twig, along the diagonal
from the lower left corner. Textures of dense foliage have no holes. Only + - * /, square roots, comparisons and the
angle functions of `signals._kernel` make the pixels: the same bits on every machine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_atan2, det_cos, det_sin
from signals.units import TURN_RAD
from sim.scene.maps.plants.species import SPECIES, LeafShape, Leaves, Species
from sim.scene.maps.season import Season
from sim.scene.maps.texture_tools import Rgb
from sim.scene.random_generator import RandomGenerator

TILE_PX = 256

Image = NDArray[np.float32]
Floats = NDArray[np.floating]
Point = tuple[float, float]
# Half the width of a leaf at a share of its length, both in lengths.
Outline = Callable[[Image], Image]


def _heart(a: Image) -> Image:
    return np.float32(1.30) * np.sqrt(a) * (1.0 - a)


def _ovate(a: Image) -> Image:
    return np.float32(1.35) * np.sqrt(a) * (1.0 - a) * (1.0 - a)


def _oval(a: Image) -> Image:
    return np.float32(1.45) * a * (1.0 - a)


def _lobed(a: Image) -> Image:
    wave = 4.5 * a - np.floor(4.5 * a)
    lobe = np.float32(0.72) + np.float32(1.4) * wave * (1.0 - wave)
    return lobe * a * (np.float32(1.1) - a) * np.minimum(1.0, 5.0 * (1.0 - a))


def _pointed(a: Image) -> Image:
    return np.float32(0.42) * np.minimum(2.4 * a, 1.0 - a) + np.float32(0.02)


def _needle(a: Image) -> Image:
    return np.float32(0.055) * np.minimum(1.0, 4.0 * (1.0 - a))


_OUTLINES: dict[LeafShape, Outline] = {
    "heart": _heart,
    "ovate": _ovate,
    "oval": _oval,
    "lobed": _lobed,
    "palmate": _pointed,
    "tuft": _needle,
}


@dataclass(frozen=True)
class Stamp:
    """Leaf of one size and direction, with its shadow: (rows, columns), the first `corner` from its stalk."""

    corner: tuple[int, int]  # x, y [pixels]
    light: Image  # brightness to its colour; 0 beside the leaf
    dim: Image  # what remains of the picture behind it: 0 below the leaf, less than 1 in its shadow
    within: NDArray[np.bool_]


@cache
def _stamp(shape: LeafShape, eighths: int, leaf_px: float, turn: int) -> Stamp:
    """Return a leaf of `eighths` / 8 of the length `leaf_px`, at `turn` / 32 of a turn from the x axis."""
    angle = TURN_RAD * turn / 32
    d, length = (det_cos(angle), det_sin(angle)), eighths * leaf_px / 8.0
    reach = int(1.15 * length) + 2
    line = np.arange(-reach, reach + 1).astype(np.float32)
    x, y = line[None, :], line[:, None]
    light = np.zeros((2 * reach + 1, 2 * reach + 1), np.float32)
    within, near = np.zeros(light.shape, bool), np.zeros(light.shape, bool)
    # A palmate leaf has five pointed lobes.
    lobes = _LOBES if shape == "palmate" else ((1.0, 0.0, 1.0),)
    outline = _OUTLINES[shape]
    for c, s, size in lobes:
        ux, uy = np.float32(d[0] * c - d[1] * s), np.float32(d[0] * s + d[1] * c)
        scale = np.float32(1.0 / (size * length))
        along, across = (x * ux + y * uy) * scale, (y * ux - x * uy) * scale
        wide, off = outline(np.clip(along, 0.0, 1.0)), np.abs(across)
        inside = (off < wide) & (along > 0.0) & (along < 1.0)
        near |= (off < wide + np.float32(0.12)) & (along > -0.1) & (along < 1.1)
        # One half is lighter, the midrib pale.
        tone = np.where(across > 0.0, np.float32(1.08), np.float32(0.90)) * (
            np.float32(0.88) + np.float32(0.22) * along
        )
        light = np.where(inside, np.where(off < 0.03, np.float32(1.22), tone), light)
        within |= inside
    dim = np.where(within, np.float32(0.0), np.where(near, np.float32(0.74), np.float32(1.0)))
    rows, columns = np.flatnonzero(near.any(1)), np.flatnonzero(near.any(0))
    part = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    return Stamp((int(columns[0]) - reach, int(rows[0]) - reach), light[part], dim[part], within[part])


_LOBES = ((-0.17, 0.98, 0.42), (-0.17, -0.98, 0.42), (0.64, 0.77, 0.66), (0.64, -0.77, 0.66), (1.0, 0.0, 0.82))


class _Tile:
    """Picture of one tile, v upwards; things drawn later are in front."""

    def __init__(self, ground: Rgb | None) -> None:
        self.rgb = np.zeros((3, TILE_PX, TILE_PX), np.float32)
        self.opaque = np.zeros((TILE_PX, TILE_PX), bool)
        if ground is not None:
            self.rgb[:] = _column(ground)[:, None]
            self.opaque[:] = True
        self._line = (np.arange(TILE_PX) + 0.5).astype(np.float32)

    def _window(self, at: Point, reach: float) -> tuple[slice, slice, Image, Image] | None:
        x0, x1 = max(int(at[0] - reach), 0), min(int(at[0] + reach) + 1, TILE_PX)
        y0, y1 = max(int(at[1] - reach), 0), min(int(at[1] + reach) + 1, TILE_PX)
        if x0 >= x1 or y0 >= y1:
            return None
        dx = (self._line[x0:x1] - np.float32(at[0]))[None, :]
        dy = (self._line[y0:y1] - np.float32(at[1]))[:, None]
        return slice(y0, y1), slice(x0, x1), dx, dy

    def put(self, stamp: Stamp, at: Point, rgb: Rgb) -> None:
        """Draw a leaf with its stalk at the pixel of `at`, and a shadow on what lies behind it."""
        x, y = int(at[0]) + stamp.corner[0], int(at[1]) + stamp.corner[1]
        high, wide = stamp.light.shape
        x0, y0, x1, y1 = max(x, 0), max(y, 0), min(x + wide, TILE_PX), min(y + high, TILE_PX)
        if x0 >= x1 or y0 >= y1:
            return
        part = slice(y0 - y, y1 - y), slice(x0 - x, x1 - x)
        rows, columns = slice(y0, y1), slice(x0, x1)
        behind = self.rgb[:, rows, columns]
        behind *= stamp.dim[part]
        behind += stamp.light[part] * _column(rgb)[:, None]
        self.opaque[rows, columns] |= stamp.within[part]

    def line(self, a: Point, b: Point, wide: float, rgb: Rgb) -> None:
        """Draw a line of this width [pixels], thinner towards b."""
        ux, uy = b[0] - a[0], b[1] - a[1]
        length = sqrt(ux * ux + uy * uy)
        if length < 1.0:
            return
        window = self._window((0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])), 0.5 * length + wide)
        if window is None:
            return
        rows, columns, dx, dy = window
        ux, uy = ux / length, uy / length
        s = (dx * np.float32(ux) + dy * np.float32(uy)) * np.float32(1.0 / length) + np.float32(0.5)
        off = np.abs(dy * np.float32(ux) - dx * np.float32(uy))
        within = (s > 0.0) & (s < 1.0) & (off < np.float32(0.5 * wide) * (np.float32(1.3) - np.float32(0.6) * s))
        self._put(rows, columns, within, np.float32(1.15) - np.float32(0.3) * off / np.float32(wide), rgb)

    def needles(self, a: Point, b: Point, long: float, rgb: Rgb, other: Rgb) -> None:
        """Draw a twig from a to b with needles on both sides, pointing forward."""
        ux, uy = b[0] - a[0], b[1] - a[1]
        length = sqrt(ux * ux + uy * uy)
        window = self._window((0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])), 0.5 * length + long)
        if window is None or length < 1.0:
            return
        rows, columns, dx, dy = window
        ux, uy = ux / length, uy / length
        s = dx * np.float32(ux) + dy * np.float32(uy) + np.float32(0.5 * length)
        off = np.abs(dy * np.float32(ux) - dx * np.float32(uy))
        comb = (s - np.float32(0.8) * off) * np.float32(1.0 / 3.4)
        comb = comb - np.floor(comb)
        reach = np.float32(long) * np.minimum(
            1.0, (np.float32(length + long) - s) * np.float32(0.05) + np.float32(0.25)
        )
        within = (s > 0.0) & (s < length + 0.6 * long) & (off < reach) & ((comb < 0.72) | (off < 1.6))
        self._shade(rows, columns, (s > 0.0) & (s < length) & (off < reach))
        self._put(rows, columns, within, np.float32(0.75) + np.float32(0.5) * comb, rgb)
        tip = within & (s > 0.8 * length)
        self._put(rows, columns, tip, np.float32(0.85) + np.float32(0.4) * comb, other)

    def _shade(self, rows: slice, columns: slice, where: NDArray[np.bool_]) -> None:
        part = self.rgb[:, rows, columns]
        part[:, where] *= np.float32(0.72)

    def _put(self, rows: slice, columns: slice, where: NDArray[np.bool_], light: Floats, rgb: Rgb) -> None:
        light = np.broadcast_to(light, where.shape)[where]
        self.rgb[:, rows, columns][:, where] = light * _column(rgb)
        self.opaque[rows, columns][where] = True


def _column(rgb: Rgb) -> Image:
    return np.array(rgb, np.float32)[:, None]


def _mixed(a: Rgb, b: Rgb, t: float, tone: float) -> Rgb:
    return (tone * (a[0] + t * (b[0] - a[0])), tone * (a[1] + t * (b[1] - a[1])), tone * (a[2] + t * (b[2] - a[2])))


def _turned(d: Point, by: float) -> Point:
    """Return a unit vector along d turned to the left by an angle of tangent `by`."""
    x, y = d[0] - by * d[1], d[1] + by * d[0]
    length = sqrt(x * x + y * y)
    return (x / length, y / length)


_DIAGONAL = (0.7071067811865476, 0.7071067811865476)


def _room(p: Point, d: Point, edge: float) -> float:
    """Return the way from p in direction d to the line `edge` pixels inside the border of a fan, at most 1000."""
    ways = [(edge - x) / c for x, c in zip(p, d, strict=True) if c < -0.01]
    outward = d[0] + d[1]
    if outward > 0.01:
        ways.append((TILE_PX - 1.5 * edge - p[0] - p[1]) / outward)
    return max(min(ways, default=1e3), 0.0)


def _twigs(rng: RandomGenerator, depth: int) -> list[tuple[Point, Point, int]]:
    """Return the twigs of a fan (from, to, order), each before its side twigs."""
    twigs: list[tuple[Point, Point, int]] = []

    def branch(start: Point, d: Point, long: float, order: int) -> None:
        end = (start[0] + long * d[0], start[1] + long * d[1])
        twigs.append((start, end, order))
        if order >= depth:
            return
        side = 1.0 if rng.chance(0.5) else -1.0
        count = (9, 5, 3)[order]
        for i in range(count):
            t = (0.10 if order == 0 else 0.25) + 0.85 * (i + 0.5 * rng.unit()) / count
            at = (start[0] + t * (end[0] - start[0]), start[1] + t * (end[1] - start[1]))
            n = _turned(d, side * rng.between(0.55, 1.0))
            reach = (190.0, 62.0, 26.0)[order] * (1.0 - (0.45 if order == 0 else 0.6) * t) * rng.between(0.75, 1.1)
            branch(at, n, min(reach, 0.94 * _room(at, n, 6.0)), order + 1)
            side = -side

    branch((1.0, 1.0), _DIAGONAL, 160.0, 0)
    return twigs


def _fan(species: Species, season: Season, number: int) -> _Tile:
    """Return a tile whose lower left half is a fan of leaves, or of bare twigs."""
    rng = RandomGenerator(number, f"leaf.{species.name}.{season}")
    leaves = species.leaves(season)
    tile = _Tile(None)
    twigs = _twigs(rng, 3 if leaves is None else 2)
    for a, b, order in twigs:
        tile.line(a, b, (6.0, 3.6, 2.4, 1.8)[order], species.twig_rgb)
    if leaves is None:
        return tile
    tone = (0.95, 1.07)[number]
    leaves_at = []
    for a, b, order in twigs:
        ux, uy = b[0] - a[0], b[1] - a[1]
        long = sqrt(ux * ux + uy * uy)
        if order == 0 or long < 1.0:
            continue
        d = (ux / long, uy / long)
        count = int(1.0 + long / (0.5 * species.leaf_px))
        for i in range(count):
            side = (1.0 if i % 2 else -1.0) * rng.between(0.25, 1.4)
            t = (i + rng.unit()) / count
            if rng.unit() < leaves.share:
                leaves_at.append(((a[0] + t * ux, a[1] + t * uy), d if i == count - 1 else _turned(d, side)))
    for at, d in rng.shuffled(leaves_at):
        _leaf(tile, rng, species, leaves, at, d, tone)
    return tile


def _kite(species: Species, season: Season) -> _Tile:
    """Return a tile with a twig of a conifer along its diagonal."""
    rng = RandomGenerator(0, f"leaf.{species.name}.{season}")
    leaves = species.leaves(season) or species.summer
    tile = _Tile(None)
    tufts = species.shape == "tuft"
    tile.line((0.0, 0.0), (225.0, 225.0), 5.0, species.twig_rgb)
    twigs = []
    s, side = 22.0, 1.0
    while s < 300.0:
        start = (_DIAGONAL[0] * s, _DIAGONAL[1] * s)
        d = _turned(_DIAGONAL, side * rng.between(0.65, 1.1))
        long = max(_to_circle(start, d) * rng.between(0.8, 1.0), 4.0)
        twigs.append((start, (start[0] + long * d[0], start[1] + long * d[1])))
        s += (22.0 if tufts else 9.5) * rng.between(0.8, 1.2)
        side = -side
    twigs.append(((60.0, 60.0), (228.0, 228.0)))
    for a, b in twigs:
        if tufts:
            tile.line(a, b, 2.6, species.twig_rgb)
            _tufts(tile, rng, species, leaves, a, b)
        else:
            rgb = _mixed(leaves.rgb, leaves.other_rgb, 0.6 * rng.unit(), rng.between(0.8, 1.1))
            tile.needles(a, b, species.leaf_px, rgb, leaves.other_rgb)
    return tile


def _to_circle(p: Point, d: Point) -> float:
    """Return the way from p in direction d to the outline of a twig, a circle of 114 pixels about (134, 134)."""
    x, y = p[0] - 134.0, p[1] - 134.0
    b, c = x * d[0] + y * d[1], x * x + y * y - 114.0 * 114.0
    return sqrt(max(b * b - c, 0.0)) - b


def _leaf(
    tile: _Tile, rng: RandomGenerator, species: Species, leaves: Leaves, at: Point, d: Point, tone: float
) -> None:
    rgb = _mixed(leaves.rgb, leaves.other_rgb, rng.unit(), tone * rng.between(0.78, 1.18))
    length = min(species.leaf_px * rng.between(0.75, 1.1), _room(at, d, 4.0))
    if length < 0.3 * species.leaf_px:
        return
    turn = int(32.0 * (det_atan2(d[1], d[0]) / TURN_RAD + 1.0) + 0.5) % 32
    tile.put(_stamp(species.shape, int(8.0 * length / species.leaf_px), species.leaf_px, turn), at, rgb)


def _tufts(tile: _Tile, rng: RandomGenerator, species: Species, leaves: Leaves, a: Point, b: Point) -> None:
    """Draw long needles all round the twig from a to b."""
    ux, uy = b[0] - a[0], b[1] - a[1]
    length = sqrt(ux * ux + uy * uy)
    d = (ux / length, uy / length)
    count = int(4.0 + length / 1.7)
    for i in range(count):
        t = 0.15 + 0.85 * (i + rng.unit()) / count
        n = _turned(d, rng.between(-1.7, 1.7))
        turn = int(32.0 * (det_atan2(n[1], n[0]) / TURN_RAD + 1.0) + 0.5) % 32
        rgb = _mixed(leaves.rgb, leaves.other_rgb, rng.unit(), rng.between(0.8, 1.45))
        tile.put(_stamp("tuft", 5 + rng.index(4), species.leaf_px, turn), (a[0] + t * ux, a[1] + t * uy), rgb)


def _foliage(species: Species, season: Season, light: float, copies: int) -> Image:
    """Return dense foliage of half-size leaves without holes or seams, `copies` along each edge: (3, 256, 256)."""
    rng = RandomGenerator(0, f"foliage.{species.name}.{season}")
    leaves = species.leaves(season) or species.autumn
    tile = _Tile(_mixed(leaves.rgb, leaves.rgb, 0.0, 0.28 * light))
    side, middle = TILE_PX // copies, TILE_PX // 2
    needles = species.shape in ("needle", "tuft")
    long = 9.0 if needles else 0.5 * species.leaf_px
    count = 40 * 16 // (copies * copies) if needles else int(2.4 * (side / long) * (side / long))
    for i in range(count):
        tone = light * (0.55 + 0.45 * i / count) * rng.between(0.7, 1.15)
        at = (middle + side * (rng.unit() - 0.5), middle + side * (rng.unit() - 0.5))
        rgb = _mixed(leaves.rgb, leaves.other_rgb, rng.unit(), tone)
        turn = rng.index(32)
        for x in (at[0] - side, at[0], at[0] + side):
            for y in (at[1] - side, at[1], at[1] + side):
                if max(abs(x - middle), abs(y - middle)) > 0.5 * side + 16.0:
                    continue
                if needles:
                    d = (det_cos(TURN_RAD * turn / 32), det_sin(TURN_RAD * turn / 32))
                    tile.needles((x - 9.0 * d[0], y - 9.0 * d[1]), (x + 9.0 * d[0], y + 9.0 * d[1]), 5.0, rgb, rgb)
                else:
                    tile.put(_stamp(species.shape, 4, species.leaf_px, turn), (x, y), rgb)
    low, high = middle - side // 2, middle + side // 2
    return np.tile(tile.rgb[:, low:high, low:high], (1, copies, copies))


def leaves(name: str, season: Season) -> NDArray[np.uint8]:
    """Return red, green, blue and alpha of a texture, (256, 256, 4), first row at v = 1."""
    species = SPECIES[name]
    if species.evergreen:
        tile = _kite(species, season)
    else:
        tile, other = _fan(species, season, 0), _fan(species, season, 1)
        turned = other.opaque[::-1, ::-1]
        np.copyto(tile.rgb, other.rgb[:, ::-1, ::-1], where=turned)
        tile.opaque |= turned
    image = np.zeros((TILE_PX, TILE_PX, 4), np.uint8)
    part = image[::-1]
    rgb = np.clip(tile.rgb * np.float32(255.0) + np.float32(0.5), 0.0, 255.0).astype(np.uint8)
    part[:, :, :3] = rgb.transpose(1, 2, 0)
    part[:, :, 3] = np.where(tile.opaque, 255, 0)
    # Renderers that do not know holes show the mean colour of the leaves there.
    leaf = part[tile.opaque]
    part[~tile.opaque, :3] = leaf[:, :3].sum(axis=0, dtype=np.int64) // len(leaf)
    return image


def foliage(name: str, season: Season, light: float, copies: int) -> NDArray[np.uint8]:
    """Return dense foliage, (256, 256, 3), without holes.

    `light`: its brightness to that of leaves. `copies`: of the same picture along each edge.
    """
    rgb = _foliage(SPECIES[name], season, light, copies)
    image = np.clip(rgb[::-1, ::-1] * np.float32(255.0) + np.float32(0.5), 0.0, 255.0).astype(np.uint8)
    return image.transpose(1, 2, 0)[:, :, ::-1]
