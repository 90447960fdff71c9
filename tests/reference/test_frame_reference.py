"""The reference frame itself: against closed forms, against mj_ray, and its velocities against moved geometry."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.reference.frame_reference import Twists, cast, pinhole_directions
from tests.reference.frame_shapes import posed, shapes_mjcf

Float64 = NDArray[np.float64]
GROUPS = np.array([1, 1, 1, 0, 0, 0], np.uint8)
AHEAD = np.array([[1.0, 0.0, 0.0]])


def one(geom: str, asset: str = "") -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(f"<mujoco><asset>{asset}</asset><worldbody>{geom}</worldbody></mujoco>")
    return model, posed(model)


@pytest.mark.parametrize(
    ("geom", "origin", "direction", "range_m", "normal"),
    [
        ('<geom type="plane" size="0 0 1"/>', (0, 0, 3), (3, 0, -4), 3.75, (0, 0, 1)),
        ('<geom type="sphere" size="2" pos="5 0 0"/>', (0, 0, 0), (1, 0, 0), 3.0, (-1, 0, 0)),
        ('<geom type="sphere" size="2"/>', (0, 0, 0), (0, 0, 1), 2.0, (0, 0, -1)),  # from inside: the way out
        ('<geom type="box" size="1 2 3" pos="5 0 0"/>', (0, 1.9, 2.9), (1, 0, 0), 4.0, (-1, 0, 0)),
        ('<geom type="box" size="1 2 3"/>', (0, 0, 0), (0, 1, 0), 2.0, (0, -1, 0)),
        ('<geom type="ellipsoid" size="1 2 3"/>', (0, 5, 0), (0, -1, 0), 3.0, (0, 1, 0)),
        ('<geom type="cylinder" size="1 2"/>', (0.5, 0, 7), (0, 0, -1), 5.0, (0, 0, 1)),
        ('<geom type="cylinder" size="1 2"/>', (-4, 0, 1.5), (1, 0, 0), 3.0, (-1, 0, 0)),
        ('<geom type="capsule" size="1 2"/>', (-4, 0, 1.5), (1, 0, 0), 3.0, (-1, 0, 0)),
        ('<geom type="capsule" size="1 2"/>', (0, 0, 7), (0, 0, -1), 4.0, (0, 0, 1)),
        # 3-4-5: the cap's sphere, centre (0, 0, 2), met 0.6 above it
        ('<geom type="capsule" size="1 2"/>', (-4, 0, 2.6), (1, 0, 0), 3.2, (-0.8, 0, 0.6)),
    ],
)
def test_closed_forms(
    geom: str, origin: tuple[float, ...], direction: tuple[float, ...], range_m: float, normal: tuple[float, ...]
) -> None:
    model, data = one(geom)
    hits = cast(model, data, np.array(origin, float), np.array([direction], float))
    assert hits.geom[0] == 0
    assert hits.range_m[0] == pytest.approx(range_m, rel=1e-14)
    assert hits.normal_W[0] == pytest.approx(normal, abs=1e-14)


def test_a_plane_has_no_underside_and_ends_where_it_says() -> None:
    model, data = one('<geom type="plane" size="2 3 1"/>')
    assert cast(model, data, np.array([0.0, 0, -1]), np.array([[0.0, 0, 1]])).geom[0] == -1
    above = np.array([0.0, 0.0, 1.0])
    ends = np.array([[1.99, 0, -1], [2.01, 0, -1], [0, 2.99, -1], [0, 3.01, -1]])
    assert cast(model, data, above, ends).geom.tolist() == [0, -1, 0, -1]


def test_a_height_field_is_solid() -> None:
    asset = '<hfield name="h" nrow="2" ncol="2" size="1 1 2 0.5" elevation="0 1 0 1"/>'
    model, data = one('<geom type="hfield" hfield="h"/>', asset)
    down, side = np.array([[0.0, 0, -1]]), np.array([[-1.0, 0, 0]])
    assert cast(model, data, np.array([0.25, 0.1, 9.0]), down).range_m[0] == pytest.approx(9 - 1.25)  # a ramp
    assert cast(model, data, np.array([5.0, 0.2, 1.0]), side).range_m[0] == pytest.approx(4.0)  # the side under it
    assert cast(model, data, np.array([5.0, 0.2, -0.4]), side).range_m[0] == pytest.approx(4.0)  # the base


def test_nearer_than_the_near_plane_is_not_seen() -> None:
    model, data = one('<geom type="sphere" size="1" pos="1.02 0 0"/><geom type="sphere" size="1" pos="5 0 0"/>')
    assert cast(model, data, np.zeros(3), AHEAD).range_m[0] == pytest.approx(0.02)
    assert cast(model, data, np.zeros(3), AHEAD, t_min=0.05).range_m[0] == pytest.approx(2.02)  # its far side


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_ranges_ids_and_normals_agree_with_mj_ray(seed: int) -> None:
    model = mujoco.MjModel.from_xml_string(shapes_mjcf(seed))
    data = posed(model)
    random = np.random.Generator(np.random.Philox(seed + 100))
    for origin in random.uniform((-14, -14, 0.3), (14, 14, 9), (4, 3)):
        directions = random.normal(size=(400, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        hits = cast(model, data, origin, directions)
        geom, distance, normal = mujoco_rays(model, data, origin, directions)
        assert (hits.geom >= 0).sum() > 100
        # Where a ray only just touches a shape, mj_ray gives up below a discriminant of 1e-15.
        same = hits.geom == geom
        assert same.mean() >= 0.997
        hit = same & (geom >= 0)
        np.testing.assert_allclose(hits.range_m[hit], distance[hit], rtol=1e-9, atol=1e-9)
        facing = normal[hit] * -np.sign(np.einsum("ij,ij->i", normal[hit], directions[hit]))[:, None]
        assert np.abs(hits.normal_W[hit] - facing).max() < 1e-6


def test_radial_velocity_is_the_rate_of_the_range() -> None:
    """Move bodies and origin by +-dt along their twists and watch the distance to the same point of the same body."""
    model = mujoco.MjModel.from_xml_string(shapes_mjcf(4))
    data = posed(model)
    random = np.random.Generator(np.random.Philox(9))
    bodies = np.flatnonzero(model.body_mocapid >= 0)
    v_B, w_B = random.normal(size=(model.nbody, 3)), random.normal(size=(model.nbody, 3))
    moving = np.isin(model.geom_bodyid, bodies)[:, None]
    body = model.geom_bodyid
    twists = Twists(data.xpos[body], np.where(moving, v_B[body], 0.0), np.where(moving, w_B[body], 0.0))
    origin, v_origin = np.array([-13.0, 1.0, 4.0]), np.array([3.0, -1.0, 0.5])
    directions = pinhole_directions(40, 30, 90.0).reshape(-1, 3)[:, [2, 0, 1]] * [1.0, -1.0, -1.0]
    hits = cast(model, data, origin, directions, twists=twists, v_origin_W=v_origin)
    hit = hits.geom >= 0
    p_W = origin + hits.range_m[hit, None] * directions[hit]
    dt = 1e-5
    distance = []
    for sign in (-1.0, 1.0):
        moved = p_W.copy()
        for k, (p, geom) in enumerate(zip(p_W, hits.geom[hit], strict=True)):
            if moving[geom, 0]:
                b, turn, arm = body[geom], np.zeros(4), np.zeros(3)
                rate = np.linalg.norm(w_B[b])
                mujoco.mju_axisAngle2Quat(turn, w_B[b] / rate, sign * dt * rate)
                mujoco.mju_rotVecQuat(arm, p - data.xpos[b], turn)
                moved[k] = data.xpos[b] + sign * dt * v_B[b] + arm
        distance.append(np.linalg.norm(moved - (origin + sign * dt * v_origin), axis=1))
    rate_of_range = (distance[1] - distance[0]) / (2 * dt)
    assert np.isin(hits.geom[hit], np.flatnonzero(moving)).sum() > 30
    np.testing.assert_allclose(hits.radial_velocity_mps[hit], rate_of_range, atol=1e-8)


def mujoco_rays(
    model: mujoco.MjModel, data: mujoco.MjData, origin: Float64, directions: Float64
) -> tuple[NDArray[np.int32], Float64, Float64]:
    geom, distance, normal = np.zeros(1, np.int32), np.zeros(len(directions)), np.zeros((len(directions), 3))
    ids = np.zeros(len(directions), np.int32)
    for i, direction in enumerate(directions):
        distance[i] = mujoco.mj_ray(model, data, origin, direction, GROUPS, 1, -1, geom, normal[i])
        ids[i] = geom[0]
    return ids, distance, normal
