"""Split a triangle mesh into convex pieces for contact.

MuJoCo collides a mesh as its convex hull, which closes courtyards, doors and valleys. Here a mesh becomes pieces that
cover every triangle and reach at most `error_m` E beyond the surface:

1. A closed convex part (every vertex within E/20 of the inside of every face) is one hull; so is one that is open at
   its foot only, as houses of city models are.
2. Triangles that share an edge are merged into flat convex slabs as long as their vertices stay within E/4 of a plane
   and the hull of the slab has at most (E/2)^2 more area than its triangles, so that no gap of a radius above 0.4 E is
   closed. A slab reaches E/2 behind the surface.
3. What stays in more than `max_pieces` slabs is covered, the smallest slabs first, by boxes of a grid with cells of
   E / sqrt(3), joined along the axes. If these are too many as well, E is doubled. Up to `max_wide` slabs stay if they
   are so wide that a grid of 4 E needs too many boxes as well: the walls of a city.

Terrain (a surface that every vertical line meets once) becomes a height field instead. With slopes above 80 degrees, as
in scans of houses from the air, E is then at least 2 cells of the field.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from math import sqrt

import numpy as np
import scipy  # loads its packages when they are first used
from numpy.typing import NDArray

from sim.scene.work_progress import progress

Float64 = NDArray[np.float64]

MAX_HFIELD = 400  # cells along a side: MuJoCo and the raster prepare some 300,000 triangles
_MERGE_TRIANGLES = 60_000
_TERRAIN_TRIANGLES = 200
_STEEP = 0.17  # cosine of 80 degrees
_MAX_E_STEPS = 40  # never reached: boxes get fewer with each step
_LEAST_PIECES = 12
_TOLD_PARTS = 100  # of a mesh, whose progress is told
_WIDE_E, _WIDE_SHARE = 4.0, 4
_MAX_CORNERS = 64  # of a slab's outline


@dataclass
class HeightField:
    """Heights [m] on a grid, rows from -y; centre and half lengths in the frame of the mesh."""

    heights: Float64
    centre: tuple[float, float]
    half: tuple[float, float]


@dataclass
class Pieces:
    """Convex pieces in the frame of the mesh. `error_m`: how far they may reach beyond the surface."""

    error_m: float
    hulls: list[Float64] = field(default_factory=list)  # corners (n, 3)
    boxes: list[tuple[Float64, Float64, Float64]] = field(default_factory=list)  # centre, half edges, axes as columns
    terrain: HeightField | None = None

    @property
    def count(self) -> int:
        return len(self.hulls) + len(self.boxes)


def contact_pieces(
    corners: Float64, *, error_m: float, max_pieces: int, up: Float64, max_wide: int | None = None
) -> Pieces:
    """Return pieces that cover the triangles `corners` (n, 3, 3), whose areas are not zero; `up`: the vertical.

    `max_wide`: of wide slabs; None: 4 `max_pieces`.
    """
    max_wide = _WIDE_SHARE * max_pieces if max_wide is None else max_wide
    pieces = Pieces(error_m)
    rest = []
    parts = _parts(corners)
    for number, part in enumerate(parts):
        if len(parts) >= _TOLD_PARTS:
            progress.tell("parts of a mesh", number, len(parts))
        hull = _convex(part, error_m / 20.0, up)
        if hull is not None:
            pieces.hulls.append(hull)
        else:
            rest.append(part)
    if len(pieces.hulls) > max_pieces:
        rest, pieces.hulls = [corners], []
    if not rest:
        return pieces
    left = np.concatenate(rest)
    if np.array_equal(up, (0.0, 0.0, 1.0)):
        pieces.terrain, left, pieces.error_m = _terrain(rest, error_m)
        if not len(left):
            return pieces
    taken = len(pieces.hulls)
    slabs, boxes, E = _fitted(left, error_m, max(max_pieces - taken, _LEAST_PIECES), max_wide - taken)
    pieces.error_m = max(pieces.error_m, E)
    for slab in slabs:
        box = _as_box(slab)
        if box is not None:
            pieces.boxes.append(box)
        else:
            pieces.hulls.append(slab.corners())
    pieces.boxes += [(centre, half, np.eye(3)) for centre, half in boxes]
    return pieces


def _fitted(
    left: Float64, error_m: float, max_pieces: int, max_wide: int
) -> tuple[list[_Slab], list[tuple[Float64, Float64]], float]:
    """Return slabs and boxes of a grid that cover triangles, and E: the least that needs no more than `max_pieces`.

    The work of each step is bounded by the number of triangles and of pieces, not by the size of the surface.
    """
    longest = np.linalg.norm(left - np.roll(left, 1, axis=1), axis=2).max(axis=1)
    E = error_m
    for step in range(_MAX_E_STEPS):
        E = error_m * 2.0**step
        # Merging takes some 30 us for each triangle, so that of very many only the large ones are merged.
        merged = longest > (0.0 if len(left) <= _MERGE_TRIANGLES else 4.0 * E)
        if merged.sum() > _MERGE_TRIANGLES or _expected_boxes(left[~merged], E) > 2.0 * max_pieces:
            continue
        slabs, members = _slabs(left[merged], E)
        kept = len(slabs) if len(slabs) <= max_pieces else max_pieces // 2
        small = np.concatenate([left[merged][[i for rest in members[kept:] for i in rest]], left[~merged]])
        is_wide = _expected_boxes(small, _WIDE_E * error_m) > 2.0 * max_pieces
        if step == 0 and is_wide and merged.all() and len(slabs) <= max_wide:
            return slabs, [], E
        if _expected_boxes(small, E) > 2.0 * max_pieces:
            continue
        boxes = _grid_boxes(small, E / sqrt(3.0)) if len(small) else []
        if kept + len(boxes) <= max_pieces:
            break
    return slabs[:kept], boxes, E


def flat_parts(corners: Float64) -> list[Float64]:
    """Return the outlines (n, 2) of convex polygons that cover flat triangles (n, 3, 2), with E = 0.2 m."""
    raised = np.concatenate([corners, np.zeros((*corners.shape[:2], 1))], axis=2)
    slabs, _ = _slabs(raised, 0.2)
    return [slab.points[:, :2] for slab in slabs]


def _welded(corners: Float64, grid_m: float) -> tuple[NDArray[np.int64], Float64]:
    """Return the vertex indices (n, 3) of triangles whose corners within a grid cell are one, and the vertices."""
    points = corners.reshape(-1, 3)
    cells = np.floor(points / grid_m + 0.5).astype(np.int64)
    _, first, index = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    return index.reshape(-1, 3), points[first]


def _parts(corners: Float64) -> list[Float64]:
    """Return the triangles of each part that hangs together by its vertices."""
    index, points = _welded(corners, 1e-5)
    n = len(points)
    rows = np.concatenate([index[:, 0], index[:, 1]])
    columns = np.concatenate([index[:, 1], index[:, 2]])
    count, label = scipy.sparse.csgraph.connected_components(
        scipy.sparse.coo_array((np.ones(len(rows), bool), (rows, columns)), shape=(n, n)), directed=False
    )
    of_triangle = label[index[:, 0]]
    order = np.argsort(of_triangle, kind="stable")
    cuts = np.searchsorted(of_triangle[order], np.arange(1, count))
    return [corners[part] for part in np.split(order, cuts) if len(part)]


def _convex(corners: Float64, slack_m: float, up: Float64) -> Float64 | None:
    """Return the corners of the hull of a convex surface that is closed, or open at its foot; None if it is not one."""
    if len(corners) < 4:
        return None
    index, points = _welded(corners, 1e-5)
    edges = np.concatenate([index[:, [0, 1]], index[:, [1, 2]], index[:, [2, 0]]])
    keys = edges[:, 0] * len(points) + edges[:, 1]
    if len(np.unique(keys)) != len(keys):
        return None
    rim = edges[~np.isin(keys, edges[:, 1] * len(points) + edges[:, 0])]  # edges without their opposite
    if len(rim):
        height = points @ up
        if height[rim].max() > height.min() + slack_m or height.max() <= height.min() + slack_m:
            return None
    try:
        hull = points[scipy.spatial.ConvexHull(points).vertices]
    except (scipy.spatial.QhullError, ValueError):
        return None
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    offset = np.einsum("ij,ij->i", normal, corners[:, 0])
    for begin in range(0, len(normal), 4096):
        reach = normal[begin : begin + 4096] @ hull.T - offset[begin : begin + 4096, None]
        if reach.max() > slack_m:
            return None
    return hull


class _Slab:
    """A convex outline in a plane. `points`: its corners in 3D, in order; `area`: of the triangles in it."""

    __slots__ = ("area", "n", "points", "spread", "thickness")

    def __init__(self, points: Float64, n: Float64, area: float, spread: tuple[float, float], thickness: float) -> None:
        self.points, self.n, self.area, self.spread, self.thickness = points, n, area, spread, thickness

    def corners(self) -> Float64:
        flat = self.points
        front, back = self.spread[1], self.spread[0] - self.thickness
        return np.concatenate([flat + front * self.n, flat + back * self.n])


def _outline(points: Float64, n: Float64) -> tuple[Float64, float]:
    """Return the convex hull of points in the plane through the origin of normal `n`, and its area (Andrew 1979)."""
    k = int(np.argmax(np.abs(n)))
    a, b = [(1, 2), (2, 0), (0, 1)][k]
    if n[k] < 0.0:
        a, b = b, a
    xs, ys = points[:, a].tolist(), points[:, b].tolist()
    order = sorted(range(len(xs)), key=lambda i: (xs[i], ys[i]))
    hull: list[int] = []
    for sweep in (order, order[::-1]):
        start = len(hull)
        for i in sweep:
            while len(hull) > start + 1:
                o, p = hull[-2], hull[-1]
                if (xs[p] - xs[o]) * (ys[i] - ys[o]) - (ys[p] - ys[o]) * (xs[i] - xs[o]) > 0.0:
                    break
                hull.pop()
            hull.append(i)
        hull.pop()
    area2 = sum(
        xs[p] * ys[q] - xs[q] * ys[p] for p, q in zip(hull, [*hull[1:], *hull[:1]], strict=True)
    )  # of the projection
    return points[hull], 0.5 * abs(area2) / abs(float(n[k]))


def _slabs(corners: Float64, E: float) -> tuple[list[_Slab], list[list[int]]]:
    """Merge triangles into slabs; return these, the largest first, and the triangles of each."""
    if not len(corners):
        return [], []
    index, _ = _welded(corners, 1e-5)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1)
    normals = cross / length[:, None]
    areas = 0.5 * length
    owner = list(range(len(corners)))

    def root(i: int) -> int:
        while owner[i] != i:
            owner[i] = owner[owner[i]]
            i = owner[i]
        return i

    outline: list[Float64] = list(corners)  # corners of the hull of each root
    normal: list[Float64] = list(normals)
    area = areas.tolist()
    reach = [(0.0, 0.0)] * len(corners)  # of the vertices along the normal, about the plane through the first point
    flat, excess = E / 4.0, 0.25 * E * E
    edges = _shared_edges(index, corners, normals)
    for number, (i, j) in enumerate(edges):
        if number % 1000 == 999:
            progress.tell("edges of flat parts", number, len(edges))
        a, b = root(i), root(j)
        if a == b:
            continue
        big, small = (a, b) if area[a] >= area[b] else (b, a)
        n = normal[big]
        if float(n @ normal[small]) < 0.9:
            continue
        points = np.concatenate([outline[big], outline[small]])
        along = points @ n
        height = along - along[0]
        low = min(float(height.min()), reach[big][0])
        high = max(float(height.max()), reach[big][1])
        # Points inside an outline are within its reach too.
        if small != big:
            low, high = low + min(0.0, reach[small][0]), high + max(0.0, reach[small][1])
        if high - low > flat:
            continue
        hull, hull_area = _outline(points - height[:, None] * n, n)
        if hull_area - area[a] - area[b] > excess or len(hull) > _MAX_CORNERS:
            continue
        owner[small] = big
        outline[big], area[big] = hull, area[a] + area[b]
        base = float(hull[0] @ n) - float(along[0])
        reach[big] = (low - base, high - base)
    members: dict[int, list[int]] = defaultdict(list)
    for i in range(len(corners)):
        members[root(i)].append(i)
    ordered = sorted(members, key=lambda r: -area[r])
    slabs = [_Slab(outline[r], normal[r], area[r], reach[r], E / 2.0) for r in ordered]
    return slabs, [members[r] for r in ordered]


def _shared_edges(index: NDArray[np.int64], corners: Float64, normals: Float64) -> list[tuple[int, int]]:
    """Return pairs of triangles with a common edge: the flattest first, and of these the longest edge first."""
    edges = np.sort(np.concatenate([index[:, [0, 1]], index[:, [1, 2]], index[:, [2, 0]]]), axis=1)
    triangle = np.tile(np.arange(len(index)), 3)
    lengths = np.linalg.norm(
        np.concatenate([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1], corners[:, 0] - corners[:, 2]]),
        axis=1,
    )
    order = np.lexsort((triangle, edges[:, 1], edges[:, 0]))
    same = np.all(edges[order[1:]] == edges[order[:-1]], axis=1)
    first, second = triangle[order[:-1]][same], triangle[order[1:]][same]
    length = lengths[order[:-1]][same]
    bend = np.floor(20.0 * (1.0 - np.einsum("ij,ij->i", normals[first], normals[second])))
    by = np.lexsort((first, -length, bend))
    by = by[bend[by] <= 2.0]
    return list(zip(first[by].tolist(), second[by].tolist(), strict=True))


def _as_box(slab: _Slab) -> tuple[Float64, Float64, Float64] | None:
    """Return a slab with a rectangular outline as a box: centre, half edges, axes as columns."""
    if len(slab.points) != 4:
        return None
    p = slab.points
    u, v = p[1] - p[0], p[3] - p[0]
    width, height = float(np.linalg.norm(u)), float(np.linalg.norm(v))
    if min(width, height) < 1e-4 or abs(float(u @ v)) > 1e-4 * width * height:
        return None
    if float(np.linalg.norm(p[0] + p[2] - p[1] - p[3])) > 1e-3:
        return None
    u, n = u / width, slab.n
    front, back = slab.spread[1], slab.spread[0] - slab.thickness
    centre = 0.25 * p.sum(axis=0) + 0.5 * (front + back) * n
    return centre, np.array([0.5 * width, 0.5 * height, 0.5 * (front - back)]), np.stack([u, np.cross(n, u), n], axis=1)


def _expected_boxes(corners: Float64, E: float) -> float:
    """Return the area of triangles in cells of the grid of E, of which about three make a box."""
    if not len(corners):
        return 0.0
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(0.5 * np.linalg.norm(cross, axis=1).sum()) / (E * E / 3.0) / 3.0


def _grid_boxes(corners: Float64, cell_m: float) -> list[tuple[Float64, Float64]]:
    """Return boxes (centre, half edges) of grid cells that cover the triangles: runs of cells, joined where alike."""
    cells = _cells(corners, cell_m)
    low, high = cells, cells
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        keys = np.column_stack([low[:, axis], *(low[:, k] for k in others), *(high[:, k] for k in others)])
        order = np.lexsort(keys.T)
        keys = keys[order]
        begins = np.ones(len(keys), bool)
        begins[1:] = (keys[1:, 1:] != keys[:-1, 1:]).any(axis=1) | (keys[1:, 0] != high[order][:-1, axis] + 1)
        ends = np.append(begins[1:], True)
        joined = high[order][ends].copy()
        low, high = low[order][begins].copy(), joined
    a, b = low * cell_m, (high + 1) * cell_m
    return list(zip(0.5 * (a + b), 0.5 * (b - a), strict=True))


def _cells(corners: Float64, cell_m: float) -> NDArray[np.int64]:
    """Return the grid cells that hold points of the triangles, sampled at a quarter of a cell."""
    found = []
    for triangle in _small(corners, 8.0 * cell_m):
        edge = np.linalg.norm(triangle - np.roll(triangle, 1, axis=1), axis=2).max()
        steps = max(1, int(np.ceil(4.0 * edge / cell_m)))
        i, j = np.meshgrid(np.arange(steps + 1), np.arange(steps + 1), indexing="ij")
        inside = i + j <= steps
        u, v = i[inside] / steps, j[inside] / steps
        w = 1.0 - u - v
        points = (
            u[:, None] * triangle[:, None, 0] + v[:, None] * triangle[:, None, 1] + w[:, None] * triangle[:, None, 2]
        )
        found.append(np.unique(np.floor(points.reshape(-1, 3) / cell_m).astype(np.int64), axis=0))
    return np.unique(np.concatenate(found), axis=0)


def _small(corners: Float64, edge_m: float) -> list[Float64]:
    """Return the triangles in groups of like size, those with edges above `edge_m` halved until none is left."""
    done = []
    while len(corners):
        lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)  # of the edge that ends at each corner
        longest = lengths.max(axis=1)
        for low, high in ((0.0, edge_m / 8.0), (edge_m / 8.0, edge_m)):
            group = corners[(longest > low) & (longest <= high)]
            done += [group[begin : begin + 20_000] for begin in range(0, len(group), 20_000)]
        corners, lengths = corners[longest > edge_m], lengths[longest > edge_m]
        if not len(corners):
            break
        k = lengths.argmax(axis=1)
        rows = np.arange(len(corners))
        end, start, top = corners[rows, k], corners[rows, k - 1], corners[rows, (k + 1) % 3]
        middle = 0.5 * (start + end)
        corners = np.concatenate([np.stack([start, middle, top], 1), np.stack([middle, end, top], 1)])
    return [group for group in done if len(group)]


def _terrain(parts: list[Float64], error_m: float) -> tuple[HeightField | None, Float64, float]:
    """Return a height field of the largest part if it is one, the other triangles, and the error of the field."""
    parts = sorted(parts, key=len, reverse=True)
    ground = parts[0]
    everything = np.concatenate(parts)
    if len(ground) < _TERRAIN_TRIANGLES:
        return None, everything, error_m
    cross = np.cross(ground[:, 1] - ground[:, 0], ground[:, 2] - ground[:, 0])
    n_z = cross[:, 2] / np.linalg.norm(cross, axis=1)
    steep = float(np.abs(n_z).min()) < _STEEP
    if not (np.all(n_z > 1e-6) or np.all(n_z < -1e-6)):
        return None, everything, error_m
    low, high = ground.reshape(-1, 3).min(axis=0), ground.reshape(-1, 3).max(axis=0)
    size = high - low
    cell = float(max(size[0], size[1])) / MAX_HFIELD
    columns, rows = (max(2, int(np.ceil(size[k] / cell)) + 1) for k in (0, 1))
    height = np.full((rows, columns), -np.inf)
    times = np.zeros((rows, columns), np.int64)
    step_x, step_y = size[0] / (columns - 1), size[1] / (rows - 1)
    for triangle in ground:
        a, b, c = triangle
        det = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        x0, y0 = triangle[:, :2].min(axis=0) - low[:2]
        x1, y1 = triangle[:, :2].max(axis=0) - low[:2]
        j0, j1 = int(np.ceil(x0 / step_x - 1e-9)), int(np.floor(x1 / step_x + 1e-9))
        i0, i1 = int(np.ceil(y0 / step_y - 1e-9)), int(np.floor(y1 / step_y + 1e-9))
        if j1 < j0 or i1 < i0:
            continue
        x = low[0] + step_x * np.arange(j0, j1 + 1)[None, :]
        y = low[1] + step_y * np.arange(i0, i1 + 1)[:, None]
        u = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / det
        v = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / det
        inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9)
        z = np.where(inside, a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2]), -np.inf)
        block = np.s_[i0 : i1 + 1, j0 : j1 + 1]
        strictly = (u > 1e-6) & (v > 1e-6) & (u + v < 1.0 - 1e-6)
        times[block] += strictly
        height[block] = np.maximum(height[block], z)
    if times.max() > 1:
        return None, everything, error_m  # it folds over itself
    known = np.isfinite(height)
    if not known.any():
        return None, everything, error_m
    height[~known] = low[2] - 1.0
    # The field must follow the mesh between its own points as well.
    points = ground.reshape(-1, 3)
    at_x, at_y = (points[:, 0] - low[0]) / step_x, (points[:, 1] - low[1]) / step_y
    if steep:  # no corner of a roof sticks out
        nearest = (np.floor(at_y + 0.5).astype(int), np.floor(at_x + 0.5).astype(int))
        np.maximum.at(height, nearest, points[:, 2])
        known[nearest] = True
    j, i = np.clip(at_x.astype(int), 0, columns - 2), np.clip(at_y.astype(int), 0, rows - 2)
    u, v = at_x - j, at_y - i
    z = (height[i, j] * (1 - u) + height[i, j + 1] * u) * (1 - v) + (
        height[i + 1, j] * (1 - u) + height[i + 1, j + 1] * u
    ) * v
    whole = known[i, j] & known[i, j + 1] & known[i + 1, j] & known[i + 1, j + 1]
    if steep:  # the field is as high as every point within a cell, and as low beyond the next
        error_m = max(error_m, 2.0 * cell)
    bad = not steep and np.abs(z - points[:, 2])[whole].max(initial=0.0) > error_m
    if bad or (~known).mean() > 0.5:
        return None, everything, error_m
    field_ = HeightField(height, (0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])), (0.5 * size[0], 0.5 * size[1]))
    others = np.concatenate(parts[1:]) if len(parts) > 1 else np.zeros((0, 3, 3))
    return field_, others, error_m
