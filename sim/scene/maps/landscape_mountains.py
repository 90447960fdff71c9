"""Mountain valley of 1.2 x 1.2 km in the manner of AirSim's LandscapeMountains: hills, a lake, trees, a power line.

The vehicle starts on level ground at z = 0; north is +y. The ground has cells of 9.4 m, in the distance of 19 m, with
grass below and rock and snow above. The wires of the power line hang 6 m (at the masts) to 9 m (half-way) below the
path of drone_env.py, AirSim's example of reinforcement learning, whose reward is to follow them.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import sqrt
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from signals.documents.validate import StrictModel
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene import surfaces
from sim.scene.maps import textures
from sim.scene.maps.layout import Layout
from sim.scene.maps.map_builder import MapBuilder, yaw_quat
from sim.scene.maps.meshes import Mesh, blob, ellipse, slab
from sim.scene.maps.plants import add_tree, plant_materials
from sim.scene.maps.plants.solids import fir_hull
from sim.scene.maps.plants.trees import add_conifer
from sim.scene.maps.season import Season
from sim.scene.maps.texture_tools import clouds
from sim.scene.random_generator import RandomGenerator
from sim.scene.scene_map import SceneMap

Grid = NDArray[np.float64]

_CELLS = 128
_HALF_M = 600.0
# Middle of the ground. No edge between its triangles lies on a round coordinate, where rays straight down may miss it.
_MIDDLE_X_M, _MIDDLE_Y_M = 1.3717, 150.6131
_STEP_M = 2.0 * _HALF_M / _CELLS
_LOWEST_M, _HIGHEST_M, _RANGE_M = -16.0, 240.0, 256.0  # of the height field; z = 0 is exact in 32-bit floats
_LAKE = (-150.0, 130.0, 100.0)  # x, y, radius
_WATER_M = -3.0
_SUMMIT = (430.0, 600.0, 260.0)  # x, y, radius
_ROCK_M, _SNOW_M = 42.0, 105.0
_TILES_M = {"grass": 16.0, "rock": 22.0, "snow": 30.0}  # periods of the textures
_HANG_M = 6.0  # of the wires below the path, at the masts
# East, north, up: the way points of drone_env.py, and masts between them.
_LINE: tuple[Vec3, ...] = (
    (-31.98, -0.55, 19.02), (-63.33, 48.6, 60.07), (-59.2, 121.1, 53.2), (-55.08, 193.6, 46.32),
    (-9.9, 281.4, 54.4), (35.32, 369.25, 62.57), (89.5, 455.3, 47.3), (143.67, 541.35, 32.07),
)  # fmt: skip


class Parameters(StrictModel):
    """Numbers of plants and rocks."""

    conifers: Annotated[int, Field(ge=0, le=2000)] = 240
    trees: Annotated[int, Field(ge=0, le=300)] = 40
    rocks: Annotated[int, Field(ge=0, le=300)] = 40
    season: Season = "summer"


def _smooth(low: float, high: float, x: Grid) -> Grid:
    """Return 0 below `low`, 1 above `high`, and the smoothstep between them."""
    u = np.clip((x - low) / (high - low), 0.0, 1.0)
    return u * u * (3.0 - 2.0 * u)


def terrain(seed: int) -> Grid:
    """Return the heights [m] of the corners of the cells: rows from south to north, from west to east in a row."""
    count = _CELLS + 1
    axis = np.arange(count) * _STEP_M - _HALF_M
    x = np.broadcast_to(axis + _MIDDLE_X_M, (count, count))
    y = np.broadcast_to((axis + _MIDDLE_Y_M)[:, None], (count, count))

    def noise(name: str, cells: int) -> Grid:
        sheet = clouds(f"landscape.{seed}.{name}", cells, cells, (count, count))
        return sheet.astype(np.float64)

    hills = 0.7 * noise("hills", 9) + 0.3 * noise("bumps", 24)
    ridges = 1.0 - np.abs(2.0 * noise("ridges", 7) - 1.0)
    from_start = np.sqrt(x * x + y * y)
    to_rim = np.maximum(np.abs(x - _MIDDLE_X_M), np.abs(y - _MIDDLE_Y_M)) / _HALF_M
    height = 2.0 + 30.0 * hills * _smooth(50.0, 230.0, from_start)
    height += _smooth(0.5, 0.92, to_rim) * (55.0 + 95.0 * ridges * ridges + 25.0 * hills)
    sx, sy, radius = _SUMMIT
    rise = 1.0 - _smooth(0.0, radius, np.sqrt((x - sx) * (x - sx) + (y - sy) * (y - sy)))
    height = height * (1.0 - 0.5 * rise) + 150.0 * rise * (0.6 + 0.4 * ridges)
    # The ground stays 18 m below the path along the power line, and rises beside it.
    for (x0, y0, z0), (x1, y1, z1) in pairwise(_LINE):
        ax, ay = x1 - x0, y1 - y0
        u = np.clip(((x - x0) * ax + (y - y0) * ay) / (ax * ax + ay * ay), 0.0, 1.0)
        dx, dy = x - x0 - u * ax, y - y0 - u * ay
        beside = np.maximum(np.sqrt(dx * dx + dy * dy) - 25.0, 0.0)
        height = np.minimum(height, z0 + u * (z1 - z0) - 18.0 + 0.6 * beside)
    height = np.maximum(height, 0.3)
    lx, ly, shore = _LAKE
    dry = _smooth(0.35 * shore, shore, np.sqrt((x - lx) * (x - lx) + (y - ly) * (y - ly)))
    height = height * dry + (_LOWEST_M + 6.0) * (1.0 - dry)
    level = _smooth(18.0, 44.0, from_start)
    height = height * level
    height = np.clip(height, _LOWEST_M + 0.5, _HIGHEST_M - 0.5)
    # MuJoCo scales a height field to its lowest and highest corner, so both are fixed.
    for extreme, value in (
        (int(np.argmin(height[::2, ::2])), _LOWEST_M),
        (int(np.argmax(height[::2, ::2])), _HIGHEST_M),
    ):
        row, column = np.unravel_index(extreme, height[::2, ::2].shape)
        height[2 * row, 2 * column] = value
    return _flattened(height, coarse_blocks())


def coarse_blocks() -> NDArray[np.bool_]:
    """Return which blocks of 2 x 2 cells are drawn as two triangles: those far from the start and from the lake."""
    axis = (np.arange(_CELLS // 2) + 0.5) * 2.0 * _STEP_M - _HALF_M
    x, y = axis[None, :] + _MIDDLE_X_M, axis[:, None] + _MIDDLE_Y_M
    lx, ly, shore = _LAKE
    from_lake = np.sqrt((x - lx) * (x - lx) + (y - ly) * (y - ly))
    far: NDArray[np.bool_] = (np.sqrt(x * x + y * y) > 210.0) & (from_lake > 1.3 * shore)
    return far


def _flattened(height: Grid, coarse: NDArray[np.bool_]) -> Grid:
    """Return the heights with the middles of coarse blocks on their two triangles, cut from low x, y to high x, y."""
    for row, column in zip(*np.nonzero(coarse), strict=True):
        j, i = 2 * row, 2 * column
        a, b, c, d = height[j, i], height[j, i + 2], height[j + 2, i], height[j + 2, i + 2]
        height[j, i + 1], height[j + 1, i] = 0.5 * (a + b), 0.5 * (a + c)
        height[j + 2, i + 1], height[j + 1, i + 2] = 0.5 * (c + d), 0.5 * (b + d)
        height[j + 1, i + 1] = 0.5 * (a + d)
    return height


def _triangles(coarse: NDArray[np.bool_]) -> Iterator[tuple[tuple[int, int], tuple[int, int], tuple[int, int]]]:
    """Yield the triangles of the ground as (row, column) of their corners, counter-clockwise seen from above."""
    for row in range(_CELLS // 2):
        for column in range(_CELLS // 2):
            step = 2 if coarse[row, column] else 1
            for j in range(2 * row, 2 * row + 2, step):
                for i in range(2 * column, 2 * column + 2, step):
                    far = (j + step, i + step)
                    yield (j, i), (j, i + step), far
                    yield (j, i), far, (j + step, i)


class _Landscape:
    def __init__(self, parameters: Parameters, seed: int) -> None:
        self.parameters, self.seed = parameters, seed
        self.builder = MapBuilder("landscape_mountains")
        self.layout = Layout()
        self.layout.take_disc(0.0, 0.0, 20.0)
        self.layout.take_band(((0.0, 0.0), _LINE[0][:2]), 6.0)
        self.layout.take_disc(_LAKE[0], _LAKE[1], 0.95 * _LAKE[2])
        self.height = terrain(seed)

    def rng(self, name: str) -> RandomGenerator:
        return RandomGenerator(self.seed, f"landscape_mountains.{name}")

    def at(self, x: float, y: float) -> float:
        """Return the height of the ground, bilinear between the corners of a cell."""
        u, v = (x - _MIDDLE_X_M + _HALF_M) / _STEP_M, (y - _MIDDLE_Y_M + _HALF_M) / _STEP_M
        i, j = min(max(int(u), 0), _CELLS - 1), min(max(int(v), 0), _CELLS - 1)
        u, v = u - i, v - j
        low = (1.0 - u) * self.height[j, i] + u * self.height[j, i + 1]
        high = (1.0 - u) * self.height[j + 1, i] + u * self.height[j + 1, i + 1]
        return float((1.0 - v) * low + v * high)

    def steepness(self, x: float, y: float) -> float:
        """Return the greatest change of height within 4 m, per metre."""
        z = self.at(x, y)
        return max(abs(self.at(x + dx, y + dy) - z) for dx, dy in ((4, 0), (-4, 0), (0, 4), (0, -4))) / 4.0

    def materials(self) -> None:
        b = self.builder
        plant_materials(b, self.parameters.season)
        for name in ("grass", "water", "rock"):
            b.texture(name, textures.png(name))
        b.material("grass", surfaces.GRASS, texture="grass", specular=0.0)
        b.material("rock", surfaces.STONE, texture="rock", specular=0.0)
        b.material("snow", surfaces.PLASTER, rgb=(0.92, 0.93, 0.95), specular=0.0)
        b.material("boulder", surfaces.STONE, rgb=(0.45, 0.44, 0.42), specular=0.0)
        b.material(
            "lake", surfaces.WATER, rgb=(0.62, 0.78, 0.86), texture="water", tile_m=12.0, specular=0.9, shininess=0.95
        )
        b.material("steel", surfaces.METAL, rgb=(0.55, 0.57, 0.58), specular=0.4, shininess=0.5)
        b.material("wire", surfaces.METAL, rgb=(0.12, 0.12, 0.13), specular=0.2, shininess=0.3)

    def ground(self) -> None:
        """Add the ground: solid as a height field, drawn as meshes of grass, rock and snow with the same triangles."""
        b = self.builder
        body = b.named_body("Landscape_0", (_MIDDLE_X_M, _MIDDLE_Y_M, _LOWEST_M), yaw_quat(0.0))
        b.classify("terrain", "Landscape_0")
        asset = b.hfield("landscape", (self.height - _LOWEST_M) / _RANGE_M, (_HALF_M, _HALF_M, _RANGE_M, 1.0))
        body.proxy("hfield", asset=asset, material="rock", part="solid")
        ragged = 22.0 * clouds(f"landscape.{self.seed}.limits", 16, 16, self.height.shape).astype(np.float64)
        meshes = {name: Mesh.empty() for name in _TILES_M}
        index: dict[tuple[str, int, int], int] = {}
        for triangle in _triangles(coarse_blocks()):
            over = max(self.height[j, i] - ragged[j, i] for j, i in triangle)
            name = "snow" if over > _SNOW_M else "rock" if over > _ROCK_M else "grass"
            mesh, tile_m = meshes[name], _TILES_M[name]
            corners = []
            for j, i in triangle:
                if (name, j, i) not in index:
                    index[name, j, i] = len(mesh.vertices)
                    x, y = i * _STEP_M - _HALF_M, j * _STEP_M - _HALF_M
                    mesh.vertices.append((x, y, float(self.height[j, i]) - _LOWEST_M))
                    mesh.uvs.append((x / tile_m, y / tile_m))
                corners.append(index[name, j, i])
            mesh.triangles.append((corners[0], corners[1], corners[2]))
        for name, mesh in meshes.items():
            if mesh.triangles:
                body.geom("mesh", asset=b.mesh(name, mesh), material=name, solid=False, part=name)

    def lake(self) -> None:
        b = self.builder
        x, y, radius = _LAKE
        body = b.body("water", (x, y, _WATER_M))
        mesh = b.mesh("lake", slab(ellipse(0.9 * radius, 0.9 * radius, 48), -0.5, 0.0, tile_m=12.0))
        body.geom("mesh", asset=mesh, material="lake")

    def power_line(self) -> None:
        """Add masts at the way points and three wires with some sag between them."""
        b = self.builder
        tops = []
        for k, (x, y, z) in enumerate(_LINE):
            x0, y0, _ = _LINE[max(k - 1, 0)]
            x1, y1, _ = _LINE[min(k + 1, len(_LINE) - 1)]
            length = sqrt((x1 - x0) * (x1 - x0) + (y1 - y0) * (y1 - y0))
            across = ((y1 - y0) / length, -(x1 - x0) / length)
            foot, top = self.at(x, y), z - _HANG_M
            self.mast(k, (x, y, foot), top - foot, across)
            tops.append(tuple((x + s * across[0], y + s * across[1], top) for s in (-4.0, 0.0, 4.0)))
            self.layout.take_disc(x, y, 9.0)
        for k, (one, other) in enumerate(pairwise(tops)):
            body = b.named_body(f"wire_{k:03d}", (0.0, 0.0, 0.0), yaw_quat(0.0))
            for w, (p, q) in enumerate(zip(one, other, strict=True)):
                points = []
                for i in range(9):
                    u = i / 8.0
                    sag = 12.0 * u * (1.0 - u)  # a parabola, 3 m in the middle: 9 m below the path
                    points.append(tuple(p[c] + u * (q[c] - p[c]) - (sag if c == 2 else 0.0) for c in range(3)))
                for i, (start, end) in enumerate(pairwise(points)):
                    body.rod(0.04, (*start, *end), material="wire", part=f"{w}_{i}")
            self.layout.take_band((one[1][:2], other[1][:2]), 10.0)
        b.classify("pole", "mast_*")
        b.classify("obstacle", "wire_*", "rock_*")

    def mast(self, number: int, foot: Vec3, height_m: float, across: tuple[float, float]) -> None:
        """Add a mast of four legs with struts and a beam across the wires."""
        body = self.builder.named_body(f"mast_{number:03d}", foot, yaw_quat(0.0))
        wide, narrow = 0.09 * height_m + 0.6, 0.35
        corners = ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))
        for k, (sx, sy) in enumerate(corners):
            body.rod(
                0.09,
                (wide * sx, wide * sy, -1.5, narrow * sx, narrow * sy, height_m),
                material="steel",
                part=f"leg_{k}",
            )
        levels = max(2, round(height_m / 6.0))
        for level in range(levels):
            low, high = height_m * level / levels, height_m * (level + 1) / levels
            r0, r1 = (wide + (narrow - wide) * z / height_m for z in (low, high))
            for k, ((ax, ay), (bx, by)) in enumerate(pairwise((*corners, corners[0]))):
                ends = (r0 * ax, r0 * ay, low, r1 * bx, r1 * by, high)
                body.rod(0.045, ends, material="steel", part=f"strut_{level}_{k}")
        x, y = 4.4 * across[0], 4.4 * across[1]
        body.rod(0.12, (-x, -y, height_m, x, y, height_m), material="steel", part="beam")

    def plants(self) -> None:
        b, p, rng = self.builder, self.parameters, self.rng("plants")
        for k in range(p.conifers):
            # Two of three stand within 250 m of the start, where they are seen from near.
            reach = 250.0 if k % 3 else 540.0
            for _ in range(12):
                x, y = rng.between(-reach, reach), rng.between(-0.7 * reach, 1.25 * reach)
                if abs(x) > 560.0 or y > 700.0:
                    continue
                z = self.at(x, y)
                if z < 85.0 and self.steepness(x, y) < 0.7 and self.layout.free(x, y, 2.0):
                    self.layout.take_disc(x, y, 1.6)
                    self.conifer(rng, x, y, z - 0.3)
                    break
        trees = self.rng("trees")

        def tree(x: float, y: float) -> None:
            if self.steepness(x, y) < 0.4:
                add_tree(b, trees, x, y, ground_m=self.at(x, y) - 0.2)

        self.layout.scatter(trees, p.trees, 2.6, (-130.0, -130.0, 170.0, 190.0), tree)

    def conifer(self, rng: RandomGenerator, x: float, y: float, z: float) -> None:
        b = self.builder
        height = rng.between(6.0, 14.0)
        body = b.body("tree", (x, y, z), yaw_quat(rng.between(0.0, TURN_RAD)))
        body.proxy("cylinder", (0.16, 0.5), material="plant_solid", pos=(0.0, 0.0, 0.5), part="trunk_solid")
        crown = fir_hull(b, height)
        body.proxy("mesh", asset=crown, material="plant_solid", pos=(0.0, 0.0, 0.7), part="crown_solid")
        add_conifer(b, body, "pine" if rng.chance(0.3) else "fir", height, rng.index(2))

    def rocks(self) -> None:
        b, rng = self.builder, self.rng("rocks")
        shapes = []
        for _ in range(3):
            bumps = [[rng.between(0.86, 1.1) for _ in range(10)] for _ in range(6)]
            round_one = blob(lambda i, j, bumps=bumps: bumps[i][j], rings=6, sides=10)  # type: ignore[misc]
            flat = [(x, 0.8 * y, 0.6 * z) for x, y, z in round_one.vertices]
            shapes.append(Mesh(flat, round_one.uvs, round_one.triangles))
        number = 0
        for k in range(self.parameters.rocks):
            size, shape = rng.pick((0.8, 1.4, 2.4, 4.0)), rng.index(3)
            reach = 200.0 if k % 2 else 450.0
            x, y = rng.between(-reach, reach), rng.between(-0.6 * reach, 1.2 * reach)
            if not self.layout.free(x, y, size + 1.0):
                continue
            self.layout.take_disc(x, y, size)
            asset = b.mesh(f"rock_{shape}_{size:g}", shapes[shape], scale=size, source=f"rock_{shape}")
            at = (x, y, self.at(x, y) + 0.1 * size)
            body = b.named_body(f"rock_{number:03d}", at, yaw_quat(rng.between(0.0, TURN_RAD)))
            body.geom("mesh", asset=asset, material="boulder")
            number += 1


def generate(parameters: Parameters, seed: int) -> SceneMap:
    landscape = _Landscape(parameters, seed)
    landscape.materials()
    landscape.ground()
    landscape.lake()
    landscape.power_line()
    landscape.plants()
    landscape.rocks()
    return landscape.builder.build()
