"""The kernels of the search for mirrors against the same steps written with numpy, and what they refuse."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from sim._kernels import MirrorSearch, mirror_in_plane
from sim.radar.bistatic import BistaticReflection
from sim.radar.ray_grid import CellIndex, children, directions, forward_cells
from sim.radar.reflection import Reflection
from sim.scene.surfaces import CONCRETE, METAL, NO_SURFACE

SURFACES = (NO_SURFACE, CONCRETE, METAL)
SPACING_RAD = 0.2
FLOOR = 0.02
SAME = 1.0 - 1e-5


class Case:
    """Rays of a coarse grid before two walls, a mesh and the sky, at random places."""

    def __init__(self) -> None:
        rng = np.random.default_rng(2)
        self.cells = forward_cells(SPACING_RAD)
        n = len(self.cells)
        self.way = np.ascontiguousarray(directions(self.cells, SPACING_RAD).T)
        self.geom = np.where(self.cells[:, 1] < -1, 0, np.where(self.cells[:, 1] < 2, 1, 2)).astype(np.int64)
        self.geom[rng.random(n) < 0.05] = -1
        self.normal = np.zeros((3, n))
        self.normal[:, self.geom == 0] = np.array([[-0.6], [0.0], [0.8]])
        self.normal[:, self.geom == 1] = np.array([[-1.0], [0.0], [0.0]])
        self.normal[:, self.geom == 2] = np.array([[-0.8], [0.6], [0.0]])
        self.range_m = rng.uniform(2.0, 5.0, n)
        self.range_m[self.geom < 0] = np.inf
        self.share = rng.uniform(0.02, 1.0, n)
        self.around = CellIndex(self.cells).neighbours(self.cells)
        self.surface = np.array([1, 2, 1], np.int64)
        self.mirror, self.flat = np.array([1, 1, 1], np.uint8), np.array([1, 1, 0], np.uint8)
        self.fine_cells = children(self.cells)
        self.fine_R = np.ascontiguousarray(directions(self.fine_cells, SPACING_RAD / 3.0).T)
        self.reflection = BistaticReflection(SURFACES, 60e9, Reflection())

    def search(self, **changed: Any) -> MirrorSearch:
        made: dict[str, Any] = {
            "surface": self.surface, "mirror": self.mirror, "flat": self.flat, "around": self.around,
            "fine_R": self.fine_R, "floor": FLOOR,
        }  # fmt: skip
        return MirrorSearch(self.reflection.table, **(made | changed))

    @property
    def power(self) -> NDArray[np.float64]:
        power = np.empty(len(self.geom))
        self.search().powers(self.geom, self.normal, self.way, self.share, power)
        return power


def dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def test_powers_of_what_rays_meet() -> None:
    case = Case()
    hit = case.geom >= 0
    expected = np.zeros(len(hit))
    cosine = -dot(case.normal, case.way)[hit]
    expected[hit] = case.reflection.mirror_power(case.surface[case.geom[hit]], cosine)
    expected[expected * case.share < FLOOR] = 0.0
    assert np.array_equal(case.power, expected)
    assert 0 < np.count_nonzero(expected) < np.count_nonzero(hit)


def test_cells_near_mirrors_and_their_fine_rays() -> None:
    case, power = Case(), Case().power
    n = len(power)
    near, within = np.empty(n, np.int64), np.empty(n, np.uint8)
    near = near[: case.search().near(case.geom, case.normal, case.way, power, near, within)]
    shows = power > 0.0
    beside = [row[row >= 0] for row in case.around]
    assert near.tolist() == [c for c in range(n) if shows[c] or shows[beside[c]].any()]
    for c in range(n):
        whole = len(beside[c]) == 8 and shows[c] and shows[beside[c]].all() and case.flat[case.geom[c]]
        whole = whole and bool((case.geom[beside[c]] == case.geom[c]).all())
        whole = whole and bool((dot(case.normal[:, [c]], case.normal[:, beside[c]]) > SAME).all())
        assert bool(within[c]) == whole
    assert 0 < within.sum() < len(near)

    m = 9 * len(near)
    axes = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
    way_W, normal = np.empty((3, m)), np.empty((3, m))
    range_m, geom, assumed = np.empty(m), np.empty(m, np.int64), np.empty(m, np.uint8)
    coarse_W = np.ascontiguousarray((case.way.T @ axes).T)
    case.search().fine(
        case.geom, case.normal, coarse_W, case.range_m, near, within, axes, way_W, range_m, geom, normal, assumed
    )
    of = (9 * near[:, None] + np.arange(9)).reshape(-1)
    parent = np.repeat(near, 9)
    assert way_W == pytest.approx(np.asarray(case.fine_R[:, of].T @ axes).T, abs=1e-15)
    assert np.array_equal(normal, case.normal[:, parent])
    assert np.array_equal(geom, case.geom[parent])
    down = dot(normal, way_W)
    assert np.array_equal(assumed == 1, (within[parent] == 1) & (down < -1e-3))
    on = assumed == 1
    reached = case.range_m[parent[on]] * dot(normal[:, on], coarse_W[:, parent[on]])
    assert range_m[on] * down[on] == pytest.approx(reached, rel=1e-12)
    assert not range_m[~on].any()


def test_facets_in_one_plane() -> None:
    """A facet is plane with two or more of eight neighbours in its plane: same normal, and within 5 mm of it."""
    cells = np.array([(i, j) for i in range(-3, 4) for j in range(-3, 4)], np.int64)
    n = len(cells)
    rng = np.random.default_rng(5)
    way = np.stack([np.ones(n), 0.1 * cells[:, 0], 0.1 * cells[:, 1]])
    way /= np.sqrt(dot(way, way))
    normal = np.zeros((3, n))
    normal[0] = -1.0
    tilted = rng.random(n) < 0.3
    normal[:, tilted] = np.array([[-0.8], [0.6], [0.0]])
    range_m = (4.0 + np.where(rng.random(n) < 0.4, 0.1, 0.0)) / way[0]
    range_m[rng.random(n) < 0.1] = np.inf
    some = np.flatnonzero(np.isfinite(range_m))
    found = np.empty(len(some), np.uint8)
    mirror_in_plane(cells, normal, way, range_m, some, found)
    place = np.where(np.isfinite(range_m), range_m, 0.0) * way
    for k, i in enumerate(some.tolist()):
        reach = np.abs(cells - cells[i]).max(axis=1)
        beside = np.flatnonzero(reach == 1)
        same = dot(normal[:, [i]], normal[:, beside]) > SAME
        same &= np.abs(dot(normal[:, [i]], place[:, beside] - place[:, [i]])) < 5e-3
        assert found[k] == (same.sum() >= 2)
    assert 0 < found.sum() < len(some)


def test_refusals() -> None:
    case = Case()
    n = len(case.geom)
    out = np.empty(n)
    for message, call in {
        "one row per ray": lambda: case.search().powers(case.geom, case.normal, case.way, case.share[1:], out),
        "no such geom": lambda: case.search().powers(case.geom + 1, case.normal, case.way, case.share, out),
        "no such surface": lambda: case.search(surface=np.array([1, 2, 3], np.int64)),
        "one row per geom": lambda: case.search(flat=case.flat[1:]),
        "nine fine ones": lambda: case.search(fine_R=np.ascontiguousarray(case.fine_R[:, 1:])),
        "no such cell": lambda: case.search(around=np.where(case.around == 3, n, case.around)),
        "no such ray": lambda: mirror_in_plane(
            case.cells, case.normal, case.way, case.range_m, np.array([n]), np.empty(1, np.uint8)
        ),
        r"reach to \+-4095": lambda: mirror_in_plane(
            case.cells + 5000, case.normal, case.way, case.range_m, np.array([0]), np.empty(1, np.uint8)
        ),
    }.items():
        with pytest.raises(ValueError, match=message):
            call()
    none = np.empty((3, 0))
    mirror_in_plane(  # an empty list of rays is none
        np.empty((0, 2), np.int64), none, none, np.empty(0), np.empty(0, np.int64), np.empty(0, np.uint8)
    )
