"""The native walker is that of the equations in Python; derivatives are checked in test_scene_maps_walker.py."""

from __future__ import annotations

import numpy as np
from hypothesis import given, reject, settings
from hypothesis import strategies as st

from sim.scene.maps.figure import Figure
from sim.scene.maps.walk_path import WalkPath, there_and_back
from sim.scene.maps.walker import Walker
from sim.scene.scene_map import actor_pose
from tests.reference import walker_reference

PATHS = {
    "corners": lambda speed_mps, lap: WalkPath([(0.0, 0.0), (6.0, 0.0), (5.0, 5.0)], speed_mps, start_lap=lap),
    "mostly_corner": lambda speed_mps, lap: WalkPath([(1.0, 2.0), (2.0, 2.5), (0.5, 4.0)], speed_mps, start_lap=lap),
    "there_and_back": lambda speed_mps, lap: there_and_back((1.0, -2.0), (9.0, 3.0), speed_mps, start_lap=lap),
}


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
    try:
        walker = Walker("w", Figure(height_m), PATHS[path](speed_mps, start_lap), ground_m=0.3)
    except ValueError:  # steps longer than the legs of a small person who walks fast
        reject()
    for t_ns in (0, *times_ns):
        found = walker.path.progress(t_ns)
        assert found == walker_reference.progress(walker.path, t_ns)
        assert walker.path.place(found[1]) == walker_reference.place(walker.path, found[1])
        assert walker.bound(t_ns)[0] == (*walker.path.place(found[1])[:2], 0.3 + 0.5 * height_m)
        p, q, _, _ = actor_pose(walker, t_ns)
        expected_p, expected_q = walker_reference.pose(walker, t_ns)
        assert np.abs(p - expected_p).max() < 1e-9
        assert np.abs(np.array([walker_reference.upright(row) for row in q]) - expected_q).max() < 1e-7


def test_joints_of_a_path_belong_to_what_follows() -> None:
    path = PATHS["corners"](1.3, 0.0)
    for s_m in [part[0] for part in (*path.straights, *path.corners)] + [path.lap_m, -1e-12, path.lap_m + 1.0]:
        assert path.place(s_m) == walker_reference.place(path, s_m)
