"""The native walker is that of the equations in Python; derivatives are checked in test_scene_maps_walker.py."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim import _kernels
from sim.scene.maps.figure import LIMBS, Figure
from sim.scene.maps.walk_path import WalkPath, there_and_back
from sim.scene.maps.walker import Walker
from tests.reference import walker_reference

PATHS = {
    "corners": lambda speed_mps, lap: WalkPath([(0.0, 0.0), (6.0, 0.0), (5.0, 5.0)], speed_mps, start_lap=lap),
    "mostly_corner": lambda speed_mps, lap: WalkPath([(1.0, 2.0), (2.0, 2.5), (0.5, 4.0)], speed_mps, start_lap=lap),
    "there_and_back": lambda speed_mps, lap: there_and_back((1.0, -2.0), (9.0, 3.0), speed_mps, start_lap=lap),
}


def arrays() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    n = len(LIMBS)
    return np.zeros((n, 3)), np.zeros((n, 4)), np.zeros((n, 3)), np.zeros((n, 3))


@settings(max_examples=60)
@given(
    st.floats(1.0, 2.1),
    st.floats(0.4, 2.2),
    st.sampled_from(sorted(PATHS)),
    st.floats(0.0, 1.0),
    st.lists(st.integers(-(10**11), 10**13), min_size=20, max_size=20),
)
def test_walkers_are_those_of_the_equations(
    height_m: float, speed_mps: float, path: str, start_lap: float, times_ns: list[int]
) -> None:
    walker = Walker("w", Figure(height_m), PATHS[path](speed_mps, start_lap), ground_m=0.3)
    for t_ns in (0, *times_ns):
        found = walker.path.progress(t_ns)
        assert found == walker_reference.progress(walker.path, t_ns)
        assert walker.path.place(found[1]) == walker_reference.place(walker.path, found[1])
        assert walker.bound(t_ns)[0] == (*walker.path.place(found[1])[:2], 0.3 + 0.5 * height_m)
        p, q, v, w = arrays()
        walker.pose(t_ns, p, q, v, w)
        expected_p, expected_q = walker_reference.pose(walker, t_ns)
        assert np.abs(p - expected_p).max() < 1e-9
        assert np.abs(np.array([walker_reference.upright(row) for row in q]) - expected_q).max() < 1e-7


def test_joints_of_a_path_belong_to_what_follows() -> None:
    path = PATHS["corners"](1.3, 0.0)
    for s_m in [part[0] for part in (*path.straights, *path.corners)] + [path.lap_m, -1e-12, path.lap_m + 1.0]:
        assert path.place(s_m) == walker_reference.place(path, s_m)


def test_refusals() -> None:
    walker = Walker("w", Figure(1.7), PATHS["corners"](1.2, 0.0))
    p, q, v, w = arrays()
    with pytest.raises(TypeError):
        walker.pose(0, p[:-1], q, v, w)
    rest = {"path": walker.path, "cycles_per_m": 1.0, "ground_m": 0.0, "bound_z_m": 1.0, "bound_radius_m": 1.0}
    with pytest.raises(TypeError):
        _kernels.Walker(shape=walker.gait[:-1], **rest)
    with pytest.raises(ValueError, match="longer than the legs"):
        _kernels.fit_gait(Figure(1.7).lengths_m, 9.0, 4.0)
    tables = {name: np.array(getattr(walker.path, name)) for name in ("pieces", "straights", "corners")}
    _kernels.WalkPath(**tables, lap_s=1.0, offset_s=0.0)
    for times in ({"lap_s": 0.0, "offset_s": 0.0}, {"lap_s": 1.0, "offset_s": float("nan")}):
        with pytest.raises(ValueError, match="finite time"):
            _kernels.WalkPath(**tables, **times)
    assert np.isnan(walker.path.place(float("nan"))[:2]).all()
    for name, table in tables.items():
        with pytest.raises(ValueError, match="as many corners"):
            _kernels.WalkPath(**tables | {name: table[:0]}, lap_s=1.0, offset_s=0.0)
        with pytest.raises(TypeError):
            _kernels.WalkPath(**tables | {name: table[:, :-1].copy()}, lap_s=1.0, offset_s=0.0)
