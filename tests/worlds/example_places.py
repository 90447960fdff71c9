"""The example places of docs/examples/places: a yard as glTF, a quarter as an OpenStreetMap extract, an alp as
a GeoTIFF.

`python -m tests.worlds.example_places FOLDER` writes them.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim.scene.random_generator import RandomGenerator
from tests.worlds.geotiff_file import geotiff
from tests.worlds.glb_file import GlbFile, box, joined

LATITUDE_DEG, LONGITUDE_DEG = 47.397742, 8.545594
_M_PER_DEG = 111_180.0  # of latitude there
_M_PER_DEG_EAST = 75_450.0


def yard_glb() -> bytes:
    """Return a yard: rolling ground, a house round a courtyard with a gate, a net fence, six trees, a container."""
    file = GlbFile()
    rng = RandomGenerator(1, "yard")
    brick = _bricks()
    wall = file.material("brick wall", texture=file.image(brick))
    roof = file.material("roof tiles", (0.30, 0.07, 0.04, 1.0))
    grass = file.material("grass", (0.10, 0.20, 0.05, 1.0))
    bark = file.material("bark", (0.10, 0.06, 0.04, 1.0))
    leaves = file.material("leaves", (0.08, 0.22, 0.04, 1.0))
    steel = file.material("painted steel", (0.05, 0.16, 0.35, 1.0))
    net = file.material("net", texture=file.image(_net()), alphaMode="MASK", alphaCutoff=0.5, doubleSided=True)
    # The ground, in glTF's axes: x east, y up, -z north.
    n, half = 25, 60.0
    line = np.linspace(-half, half, n)
    x, z = np.meshgrid(line, line)
    far = np.sqrt(x * x + z * z)
    y = np.where(far < 25.0, 0.0, (far - 25.0) * 0.06 * (1.0 + 0.5 * x / half))
    index = np.arange(n * n).reshape(n, n)
    a, b, c, d = (index[:-1, :-1].ravel(), index[:-1, 1:].ravel(), index[1:, 1:].ravel(), index[1:, :-1].ravel())
    triangles = np.concatenate([np.stack([a, d, c], 1), np.stack([a, c, b], 1)])
    ground = file.mesh("ground", (np.stack([x.ravel(), y.ravel(), z.ravel()], 1), triangles, grass, None))
    file.node("ground", ground)
    # Walls of 5 m round a courtyard of 10 x 8 m, with a gate to the south (+z).
    walls = joined(
        box((-9, 0, -7), (9, 5, -4)), box((-9, 0, -4), (-5, 5, 4)), box((5, 0, -4), (9, 5, 4)),
        box((-9, 0, 4), (-1.5, 5, 7)), box((1.5, 0, 4), (9, 5, 7)), box((-1.5, 3.2, 4), (1.5, 5, 7)),
    )  # fmt: skip
    tops = joined(
        box((-9.3, 5, -7.3), (9.3, 5.3, -3.8)), box((-9.3, 5, -3.8), (-4.8, 5.3, 3.8)),
        box((4.8, 5, -3.8), (9.3, 5.3, 3.8)), box((-9.3, 5, 3.8), (9.3, 5.3, 7.3)),
    )  # fmt: skip
    house = file.mesh("courtyard house", (walls[0], walls[1], wall, walls[2]), (tops[0], tops[1], roof, None))
    file.node("house_1", house, translation=[18.0, 0.0, 8.0])
    posts, corners, uv = box((-10, 0, -0.01), (10, 2, 0.01))
    file.node("fence", file.mesh("net fence", (posts, corners, net, 2.0 * uv)), translation=[-4.0, 0.0, 14.0])
    trunk, crown = box((-0.15, 0, -0.15), (0.15, 2.6, 0.15)), _ball(1.6, 1.4, 4.0)
    tree = file.mesh("tree", (trunk[0], trunk[1], bark, None), (crown[0], crown[1], leaves, None))
    for i in range(6):
        size = rng.between(0.8, 1.3)
        place = [-14.0 - 3.0 * (i % 2), 0.0, -15.0 + 5.0 * i]
        file.node(f"tree_{i}", tree, translation=place, scale=[size, size, size])
    container = box((-3.0, 0, -1.2), (3.0, 2.6, 1.2))
    turn = [0.0, 0.25881904510252074, 0.0, 0.9659258262890683]  # 30 degrees about y
    file.node(
        "container", file.mesh("container", (container[0], container[1], steel, None)),
        translation=[2.0, 0.0, -16.0], rotation=turn,
    )  # fmt: skip
    return file.glb()


def _ball(radius: float, height: float, middle: float) -> tuple[NDArray, NDArray]:
    rings, sides = 7, 10
    up = np.linspace(-1.0, 1.0, rings)[1:-1]
    angle = np.arange(sides) * (2.0 * np.pi / sides)
    r = radius * np.sqrt(1.0 - up * up)
    vertex = np.stack(
        [
            np.outer(r, np.cos(angle)).ravel(),
            np.repeat(middle + height * up, sides),
            np.outer(r, np.sin(angle)).ravel(),
        ],
        1,
    )
    vertex = np.concatenate([vertex, [[0, middle - height, 0], [0, middle + height, 0]]])
    triangles = []
    for j in range(sides):
        k = (j + 1) % sides
        for i in range(rings - 3):
            a, b = i * sides + j, i * sides + k
            triangles += [(a, a + sides, b + sides), (a, b + sides, b)]
        low, high = len(vertex) - 2, len(vertex) - 1
        last = (rings - 3) * sides
        triangles += [(low, j, k), (high, last + k, last + j)]
    return vertex, np.array(triangles)


def _bricks() -> NDArray[np.uint8]:
    y, x = np.mgrid[0:64, 0:64]
    course = y // 8
    joint = (y % 8 == 0) | ((x + 8 * (course % 2)) % 16 == 0)
    tone = 0.8 + 0.05 * ((course * 5 + (x + 8 * (course % 2)) // 16 * 3) % 7)
    image = np.array((52, 70, 140))[None, None] * tone[:, :, None]
    image[joint] = (170, 176, 180)
    return image.clip(0, 255).astype(np.uint8)


def _net() -> NDArray[np.uint8]:
    y, x = np.mgrid[0:32, 0:32]
    wire = ((x + y) % 16 < 3) | ((x - y) % 16 < 3)
    image = np.full((32, 32, 4), (120, 124, 126, 255), np.uint8)
    image[:, :, 3] = np.where(wire, 255, 0)
    return image


class _Extract:
    """An extract under construction, with places in metres east and north of its middle."""

    def __init__(self) -> None:
        self._nodes: dict[tuple[float, float], int] = {}
        self._spots: list[tuple[int, dict[str, str]]] = []
        self._ways: list[str] = []

    def node(self, x: float, y: float) -> int:
        return self._nodes.setdefault((round(x, 2), round(y, 2)), len(self._nodes) + 1)

    def spot(self, x: float, y: float, **tags: str) -> None:
        number = self.node(x, y)
        self._spots.append((number, tags))

    def way(self, points: list[tuple[float, float]], **tags: str) -> None:
        refs = "".join(f'<nd ref="{self.node(x, y)}"/>' for x, y in points)
        self._ways.append(f'<way id="{len(self._ways) + 1}">{refs}{_tags(tags)}</way>')

    def ring(self, points: list[tuple[float, float]], **tags: str) -> None:
        self.way([*points, points[0]], **tags)

    def xml(self) -> str:
        tagged = dict(self._spots)
        lines = ["<?xml version='1.0' encoding='UTF-8'?>", '<osm version="0.6">']
        xs, ys = zip(*self._nodes, strict=True)
        low, high = _degrees(min(xs), min(ys)), _degrees(max(xs), max(ys))
        lines.append(f'<bounds minlat="{low[0]}" minlon="{low[1]}" maxlat="{high[0]}" maxlon="{high[1]}"/>')
        for (x, y), number in self._nodes.items():
            lat, lon = _degrees(x, y)
            own = tagged.get(number)
            end = f">{_tags(own)}</node>" if own else "/>"
            lines.append(f'<node id="{number}" lat="{lat}" lon="{lon}"{end}')
        return "\n".join([*lines, *self._ways, "</osm>", ""])


def _tags(tags: dict[str, str]) -> str:
    return "".join(f'<tag k="{key.replace("__", ":")}" v="{value}"/>' for key, value in tags.items())


def _degrees(x: float, y: float) -> tuple[str, str]:
    return f"{LATITUDE_DEG + y / _M_PER_DEG:.7f}", f"{LONGITUDE_DEG + x / _M_PER_DEG_EAST:.7f}"


def quarter_osm(rows: int = 4, columns: int = 4) -> str:
    """Return a quarter of `rows` x `columns` plots between streets, with 8 houses on each plot, a park and a wood."""
    out = _Extract()
    rng = RandomGenerator(2, "quarter")
    pitch_x, pitch_y = 78.0, 58.0
    x0, y0 = -0.5 * columns * pitch_x, -0.5 * rows * pitch_y
    roofs = ("gabled", "hipped", "gabled", "half-hipped", "pyramidal", "gambrel", "skillion", "mansard", "flat")
    for j in range(rows + 1):
        y = y0 + j * pitch_y
        out.way(
            [(x0 + i * pitch_x, y) for i in range(columns + 1)], highway="residential" if j % 3 else "secondary",
            sidewalk="both", name=f"Street {j}",
        )  # fmt: skip
    for i in range(columns + 1):
        out.way([(x0 + i * pitch_x, y0 + j * pitch_y) for j in range(rows + 1)], highway="residential", lanes="2")
    for i in range(columns):
        for j in range(rows):
            cx, cy = x0 + (i + 0.5) * pitch_x, y0 + (j + 0.5) * pitch_y
            plot = [(cx - 32, cy - 22), (cx + 32, cy - 22), (cx + 32, cy + 22), (cx - 32, cy + 22)]
            if (i, j) == (columns // 2, rows // 2):
                out.ring(plot, leisure="park")
                out.ring([(cx - 12, cy - 8), (cx + 4, cy - 12), (cx + 14, cy), (cx, cy + 10)], natural="water")
                out.way([(cx - 32, cy - 22), (cx - 18, cy + 4), (cx + 32, cy + 22)], highway="footway")
                for k in range(8):
                    out.spot(cx - 28 + 8 * k, cy + (17 if k % 2 else -17), natural="tree")
                continue
            if (i, j) == (0, 0):
                out.ring(plot, landuse="forest")
                continue
            out.ring(plot, landuse="grass")
            if (i + j) % 4 == 0:  # a block round a courtyard
                out.ring(
                    [(cx - 26, cy - 17), (cx + 26, cy - 17), (cx + 26, cy + 17), (cx - 26, cy + 17), (cx - 26, cy - 4),
                     (cx - 14, cy - 4), (cx - 14, cy + 6), (cx + 14, cy + 6), (cx + 14, cy - 6), (cx - 26, cy - 6)],
                    building="apartments", building__levels=str(4 + (i + j) % 3),
                )  # fmt: skip
                continue
            for k in range(8):
                hx, hy = cx - 24 + 16 * (k % 4), cy + (12 if k < 4 else -12)
                w, d = rng.between(4.0, 6.0), rng.between(4.0, 6.5)
                corners = [(hx - w, hy - d), (hx + w, hy - d), (hx + w, hy + d), (hx - w, hy + d)]
                if k % 4 == 1:  # an L
                    corners = [*corners[:2], (hx + w, hy), (hx, hy), (hx, hy + d), corners[3]]
                tags = {"building": "house", "roof__shape": roofs[(k + i + j) % len(roofs)]}
                if k % 3:
                    tags["building__levels"] = str(1 + rng.index(3))
                out.ring(corners, **tags)
            out.way([(cx - 31, cy), (cx + 31, cy)], barrier="hedge" if (i + j) % 2 else "fence")
    return out.xml()


def alp_tif() -> bytes:
    """Return heights of a spur over a valley, 1.2 km wide, in steps of 20 m."""
    n, step_deg = 60, (0.00026, 0.00018)
    row, column = np.mgrid[0:n, 0:n] / n
    heights = 1560.0 + 130.0 * np.exp(-8.0 * (column - 0.6) ** 2) * (1.0 - row) - 60.0 * column
    heights += 9.0 * np.sin(11.0 * row + 7.0 * column) * np.cos(13.0 * column)
    return geotiff(heights, (8.545594 - 0.5 * n * step_deg[0], 47.397742 + 0.5 * n * step_deg[1]), step_deg, 4326)


def main() -> None:
    folder = Path(sys.argv[1])
    (folder / "alp.tif").write_bytes(alp_tif())
    (folder / "yard.glb").write_bytes(yard_glb())
    (folder / "quarter.osm").write_text(quarter_osm(), encoding="utf-8")


if __name__ == "__main__":
    main()
