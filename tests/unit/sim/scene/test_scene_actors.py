"""Poses of actors in a geometry. tests/accuracy/test_frame_scenes.py has native walkers against `mj_ray`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from signals.samples import Vec3
from sim._kernels import FieldOfView, Geometry, RayCaster, Reach, SceneActors, Vicinity

ONE = np.zeros(1, np.int32)
COORDINATE = st.floats(-30.0, 30.0)
PLACE = st.tuples(COORDINATE, COORDINATE, COORDINATE)
SIZE = st.floats(0.1, 10.0)


class Ball:
    """An actor of one body at a given place; it moves along x at 1 m/s."""

    bodies = ("ball",)

    def __init__(self, centre: Vec3 = (0.0, 0.0, 0.0), radius_m: float = 1.0) -> None:
        self.centre, self.radius_m = centre, radius_m

    def _centre(self, t_ns: int) -> Vec3:
        x, y, z = self.centre
        return x + t_ns * 1e-9, y, z

    def bound(self, t_ns: int) -> tuple[Vec3, float]:
        return self._centre(t_ns), self.radius_m

    def pose(self, t_ns: int, p_WB: Any, q_WB: Any, v_WB_W: Any, w_WB_W: Any) -> None:
        p_WB[:] = self._centre(t_ns)
        q_WB[:] = (1.0, 0.0, 0.0, 0.0)
        v_WB_W[:] = (1.0, 0.0, 0.0)
        w_WB_W[:] = 0.0


def among(*balls: Ball, moving: bool = True) -> tuple[Geometry, SceneActors]:
    geometry = Geometry()
    level = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    for ball in balls:
        geometry.add_geom(2, (ball.radius_m, 0.0, 0.0), (0.0, 0.0, 0.0), level, -1, moving, True, 1, 1, 0)
    geometry.finish()
    actors = SceneActors(geometry)
    for i, ball in enumerate(balls):
        actors.add(ball, ONE + i, ONE, np.zeros((1, 3)), np.eye(3)[None].copy())
    return geometry, actors


def misses(reach: Reach, centre: Vec3, radius_m: float) -> bool:
    return among(Ball(centre, radius_m))[1].pose_within(0, reach) == 0


@given(PLACE, SIZE, PLACE, st.tuples(SIZE, SIZE, SIZE), SIZE)
def test_a_vicinity_is_what_is_near_a_box(centre: Vec3, radius_m: float, low: Vec3, size: Vec3, range_m: float) -> None:
    high = (low[0] + size[0], low[1] + size[1], low[2] + size[2])
    nearest = [min(max(c, a), b) for c, a, b in zip(centre, low, high, strict=True)]
    gap_m = math.dist(centre, nearest) - radius_m - range_m
    if abs(gap_m) > 2e-3:
        assert misses(Vicinity(low, high, range_m), centre, radius_m) == (gap_m > 0.0)
    assert misses(Vicinity(low, high, -math.inf), centre, radius_m)


@given(PLACE, SIZE, PLACE, st.floats(0.1, 1.0), st.floats(0.1, 1.0), st.floats(0.0, 6.0))
def test_a_field_of_view_is_what_its_planes_bound(
    centre: Vec3, radius_m: float, eye: Vec3, right: float, down: float, turn_rad: float
) -> None:
    c, s = math.cos(turn_rad), math.sin(turn_rad)
    R_WC = np.array([(s, 0.0, c), (-c, 0.0, s), (0.0, -1.0, 0.0)])
    x, y, z = R_WC.T @ (np.array(centre) - np.array(eye))
    left, top = -0.3, -0.2
    inside_m = min(
        z,
        (x - left * z) / math.hypot(1.0, left),
        (right * z - x) / math.hypot(1.0, right),
        (y - top * z) / math.hypot(1.0, top),
        (down * z - y) / math.hypot(1.0, down),
    )
    if abs(inside_m + radius_m) > 2e-3:
        view = FieldOfView(eye, R_WC.ravel().tolist(), left, right, top, down)
        assert misses(view, centre, radius_m) == (inside_m < -radius_m)


def test_posed_once_a_moment_hidden_when_missed_and_brought_back() -> None:
    geometry, actors = among(Ball((5.0, 0.0, 0.0)), Ball((50.0, 0.0, 0.0)))
    caster = RayCaster(geometry)

    def seen_m() -> float:
        range_m, geom = np.empty(1), np.empty(1, np.int32)
        caster.cast(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]]), 0.0, 100.0, range_m, geom)
        return float(range_m[0]) if geom[0] >= 0 else math.inf

    here = Vicinity((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 10.0)
    assert actors.absent(0) == 2
    assert (actors.pose_within(0, None), actors.absent(0), seen_m()) == (2, 0, 4.0)
    assert (actors.pose_within(1_000_000_000, here), actors.absent(1_000_000_000), seen_m()) == (1, 1, 5.0)
    assert (actors.pose_within(1_000_000_000, here), actors.absent(1_000_000_000)) == (0, 1)
    assert (actors.pose_within(1_000_000_000, None), actors.absent(1_000_000_000)) == (1, 0)
    assert (actors.pose_within(2_000_000_000, here), seen_m()) == (1, 6.0)
    assert (actors.pose_within(30_000_000_000, here), actors.absent(30_000_000_000), seen_m()) == (0, 2, math.inf)
    assert (actors.pose_within(30_000_000_000, None), seen_m()) == (2, 34.0)


def test_refusals() -> None:
    with pytest.raises(ValueError, match="moving"):
        among(Ball(), moving=False)
    _, actors = among(Ball())
    rest = (np.zeros((1, 3)), np.eye(3)[None].copy())
    for geoms, bodies, says in ((ONE + 1, ONE, "moving"), (ONE - 1, ONE, "moving"), (ONE, ONE + 1, "body"),
                                (ONE, ONE - 1, "body"), (np.zeros(2, np.int32), ONE, "the same length")):  # fmt: skip
        with pytest.raises(ValueError, match=says):
            actors.add(Ball(), geoms, bodies, *rest)
    with pytest.raises(AttributeError):
        actors.add(object(), ONE, ONE, *rest)
