"""Convex pieces of meshes: they cover what is seen, and reach no farther than stated."""

from __future__ import annotations

import numpy as np
import pytest
import scipy  # loads its packages when they are first used

from sim.scene.imports import contact_pieces as module
from sim.scene.imports.contact_pieces import Pieces, contact_pieces
from tests.worlds.glb_file import box, joined

UP = np.array([0.0, 0.0, 1.0])


def triangles_of(*shapes) -> np.ndarray:
    vertex, triangle, _ = joined(*shapes)
    return vertex[triangle]


def samples(corners: np.ndarray, step_m: float) -> np.ndarray:
    """Return points of the triangles, at most `step_m` apart."""
    found = []
    for a, b, c in corners:
        n = max(1, int(np.ceil(max(np.linalg.norm(b - a), np.linalg.norm(c - a), np.linalg.norm(c - b)) / step_m)))
        i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1))
        u, v = i[i + j <= n] / n, j[i + j <= n] / n
        found.append(a + u[:, None] * (b - a) + v[:, None] * (c - a))
    return np.concatenate(found)


def hulls_of(pieces: Pieces) -> list[np.ndarray]:
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return [*pieces.hulls, *(c + (signs * half) @ axes.T for c, half, axes in pieces.boxes)]


def check(corners: np.ndarray, pieces: Pieces, *, hollow: bool = True) -> None:
    """Every seen point lies in a piece; for a hollow shape no point of a piece is farther away than stated."""
    seen = samples(corners, 0.05 * pieces.error_m / 0.2)
    along = int(np.argmax(np.ptp(seen, axis=0)))
    seen = seen[np.argsort(seen[:, along])]
    tree = scipy.spatial.cKDTree(seen, balanced_tree=False, compact_nodes=False) if hollow else None
    covered = np.zeros(len(seen), bool)
    for hull in hulls_of(pieces):
        low, high = hull.min(axis=0) - 1e-6, hull.max(axis=0) + 1e-6
        first, last = np.searchsorted(seen[:, along], (low[along], high[along]))
        part = seen[first:last]
        near = first + np.flatnonzero(((part >= low) & (part <= high)).all(axis=1) & ~covered[first:last])
        equations = scipy.spatial.ConvexHull(hull).equations
        inside = (seen[near] @ equations[:, :3].T + equations[:, 3]).max(axis=1) < 1e-4
        covered[near[inside]] = True
        if tree is not None:
            points = samples(hull[scipy.spatial.ConvexHull(hull).simplices], 0.1)
            most_m = pieces.error_m + 0.03
            assert tree.query(points, distance_upper_bound=most_m)[0].max() <= most_m  # infinite beyond
    assert covered.all()


def test_a_house_round_a_courtyard_stays_open() -> None:
    walls = triangles_of(
        box((-9, -7, 0), (9, -4, 5)),
        box((-9, 4, 0), (9, 7, 5)),
        box((-9, -4, 0), (-5, 4, 5)),
        box((5, -4, 0), (9, 4, 5)),
    )
    pieces = contact_pieces(walls, error_m=0.2, max_pieces=100, up=UP)
    check(walls, pieces, hollow=False)
    for point in ((0.0, 0.0, 2.0), (4.7, 3.7, 1.0)):
        assert not any(scipy.spatial.Delaunay(hull).find_simplex(point) >= 0 for hull in hulls_of(pieces))


def test_a_wall_with_a_window_is_solid_beside_it_only() -> None:
    # One sheet of 6 x 3 m with an opening of 2 x 1 m, as eight rectangles.
    cells = []
    for x0, x1 in ((0, 2), (2, 4), (4, 6)):
        for z0, z1 in ((0, 1), (1, 2), (2, 3)):
            if (x0, z0) != (2, 1):
                a, b, c, d = (np.array(p, float) for p in ((x0, 0, z0), (x1, 0, z0), (x1, 0, z1), (x0, 0, z1)))
                cells += [(a, b, c), (a, c, d)]
    corners = np.array(cells)
    pieces = contact_pieces(corners, error_m=0.2, max_pieces=50, up=UP)
    assert pieces.count <= 6
    check(corners, pieces)
    assert not any(scipy.spatial.Delaunay(hull).find_simplex((3.0, 0.05, 1.5)) >= 0 for hull in hulls_of(pieces))


@pytest.mark.parametrize("budget", [400, 60])
def test_a_torus_within_the_stated_error(budget: int) -> None:
    n, m = 40, 20
    a, b = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.arange(m) * 2 * np.pi / m, indexing="ij")
    r = 2.0 + 0.6 * np.cos(b)
    vertex = np.stack([r * np.cos(a), r * np.sin(a), 0.6 * np.sin(b)], axis=-1).reshape(-1, 3)
    i = np.arange(n * m).reshape(n, m)
    j, k, o = np.roll(i, -1, 0), np.roll(i, -1, 1), np.roll(np.roll(i, -1, 0), -1, 1)
    triangle = np.concatenate([np.stack([i, j, o], -1).reshape(-1, 3), np.stack([i, o, k], -1).reshape(-1, 3)])
    pieces = contact_pieces(vertex[triangle], error_m=0.2, max_pieces=budget, up=UP)
    assert pieces.count <= budget
    check(vertex[triangle], pieces)


def test_a_ball_is_one_hull() -> None:
    hull = scipy.spatial.ConvexHull(np.random.default_rng(1).normal(size=(60, 3)))
    corners = hull.points[hull.simplices]
    flip = (
        np.einsum("ij,ij->i", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), corners[:, 0]) < 0
    )
    corners[flip] = corners[flip][:, ::-1]
    pieces = contact_pieces(corners, error_m=0.2, max_pieces=10, up=UP)
    assert (len(pieces.hulls), len(pieces.boxes)) == (1, 0)


def test_terrain_becomes_a_height_field() -> None:
    n = 40
    x, y = np.meshgrid(np.linspace(-50, 50, n), np.linspace(-30, 30, n))
    z = 4.0 * np.sin(x / 15.0) * np.cos(y / 12.0)
    i = np.arange(n * n).reshape(n, n)
    a, b, c, d = (k.ravel() for k in (i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]))
    triangle = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    vertex = np.stack([x.ravel(), y.ravel(), z.ravel()], 1)
    pieces = contact_pieces(vertex[triangle], error_m=0.2, max_pieces=100, up=UP)
    field = pieces.terrain
    assert field is not None
    assert pieces.count == 0
    rows, columns = field.heights.shape
    at_x = np.linspace(field.centre[0] - field.half[0], field.centre[0] + field.half[0], columns)
    at_y = np.linspace(field.centre[1] - field.half[1], field.centre[1] + field.half[1], rows)
    gx, gy = np.meshgrid(at_x, at_y)
    assert np.abs(field.heights - 4.0 * np.sin(gx / 15.0) * np.cos(gy / 12.0)).max() < 0.12  # the mesh's own error


def test_a_house_without_a_floor_is_one_hull() -> None:
    """Houses of city models end at the ground; the grid over the walls of thousands of them took minutes."""
    closed = triangles_of(box((-4, -3, 0), (4, 3, 6)))
    corners = closed[~(closed[:, :, 2] == 0.0).all(axis=1)]
    assert len(corners) == 10
    pieces = contact_pieces(corners, error_m=0.2, max_pieces=100, up=UP)
    assert (len(pieces.hulls), pieces.error_m) == (1, 0.2)
    assert (pieces.hulls[0].min(axis=0).tolist(), pieces.hulls[0].max(axis=0).tolist()) == ([-4, -3, 0], [4, 3, 6])
    check(corners, pieces, hollow=False)


@pytest.mark.parametrize("side", ["wall", "roof"])
def test_a_house_that_is_open_elsewhere_stays_open(side: str) -> None:
    closed = triangles_of(box((-4, -3, 0), (4, 3, 6)))
    missing = closed[:, :, 0] == 4.0 if side == "wall" else closed[:, :, 2] == 6.0
    pieces = contact_pieces(closed[~missing.all(axis=1)], error_m=0.2, max_pieces=100, up=UP)
    assert pieces.count == 5
    check(closed[~missing.all(axis=1)], pieces)


def bent_wall(scale: float = 1.0) -> np.ndarray:
    """Return a wall of 80 flat parts, 1,400 square metres."""
    x = np.linspace(0.0, 160.0, 81)
    y = 3.0 * np.sin(0.9 * np.arange(81))
    low, high = np.column_stack([x, y, 0 * x]), np.column_stack([x, y, 0 * x + 6.0])
    corners = [np.stack([low[:-1], low[1:], high[:-1]], 1), np.stack([high[:-1], low[1:], high[1:]], 1)]
    return scale * np.concatenate(corners)


def test_walls_beyond_the_budget_are_covered_by_a_coarser_grid() -> None:
    """At the stated error half a million boxes would be made first."""
    corners = bent_wall()
    pieces = contact_pieces(corners, error_m=0.05, max_pieces=15, up=np.array([0.0, 1.0, 0.0]))
    assert pieces.error_m > 0.05
    seen, hulls = samples(corners[::5], 0.5), hulls_of(pieces)
    assert all(any(((p >= h.min(axis=0) - 1e-6) & (p <= h.max(axis=0) + 1e-6)).all() for h in hulls) for p in seen)


def test_wide_walls_stay_as_they_are_where_a_grid_would_not_save_pieces() -> None:
    corners = bent_wall()
    pieces = contact_pieces(corners, error_m=0.2, max_pieces=30, up=np.array([0.0, 1.0, 0.0]))
    assert (pieces.error_m, pieces.count) == (0.2, 78)
    check(corners, pieces)


@pytest.mark.parametrize("scale", [1.0, 5.0, 25.0])
def test_the_grid_does_not_grow_with_the_area(scale: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """At the last of five steps, any number of boxes was made: minutes for a city at five times its size."""
    made = []
    original = module._grid_boxes

    def counted(corners: np.ndarray, cell_m: float) -> list[tuple[np.ndarray, np.ndarray]]:
        boxes = original(corners, cell_m)
        made.append(len(boxes))
        return boxes

    monkeypatch.setattr(module, "_grid_boxes", counted)
    pieces = contact_pieces(bent_wall(scale), error_m=0.2, max_pieces=15, up=np.array([0.0, 1.0, 0.0]))
    assert pieces.count <= 15
    assert max(made) <= 4 * 15
