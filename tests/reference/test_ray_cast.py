"""Native rays against a plain reference, against mj_ray, and against themselves: tree, threads, CPU change no bit."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from sim._kernels import Geometry, RayCaster, coherent_order
from tests.reference.ray_reference import MUJOCO_NUMBER, SHAPES, nearest
from tests.worlds.mjcf_world import cast, compiled, mujoco_rays, native

KINDS = ("sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh")


def turn(rng: np.random.Generator) -> NDArray[Any]:
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def unit(v: Any) -> NDArray[Any]:
    v = np.asarray(v, float)
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def scatter(geoms: int, seed: int, *, extent: float = 40.0, movers: float = 0.0) -> str:
    """Return MJCF with a ground plane and shapes of every kind at random."""
    rng = np.random.default_rng(seed)
    ball = unit(rng.normal(size=(40, 3)))
    rows = [
        f'<mujoco><asset><mesh name="stone" vertex="{" ".join(f"{x:.5f}" for x in ball.ravel())}"/></asset>',
        '<worldbody><geom type="plane" size="0 0 1"/><geom type="plane" size="3 2 1" pos="4 4 2" euler="20 30 0"/>',
    ]
    for i in range(geoms):
        kind = KINDS[i % len(KINDS)]
        where = 'pos="{:.4f} {:.4f} {:.4f}"'.format(*(rng.uniform(-1, 1, 3) * [extent, extent, 4.0] + [0, 0, 4.5]))
        size = 'mesh="stone"' if kind == "mesh" else 'size="{:.4f} {:.4f} {:.4f}"'.format(*rng.uniform(0.1, 1.2, 3))
        quat = 'quat="{:.5f} {:.5f} {:.5f} {:.5f}"'.format(*rng.normal(size=4))
        hidden = ' rgba="1 1 1 0"' if i % 11 == 10 else ' group="3"' if i % 13 == 12 else ""
        if rng.uniform() < movers:
            rows.append(f'<body mocap="true" {where}><geom type="{kind}" {size} {quat}{hidden}/></body>')
        else:
            rows.append(f'<geom type="{kind}" {size} {where} {quat}{hidden}/>')
    return "".join([*rows, "</worldbody></mujoco>"])


def fan(channels: int, columns: int) -> NDArray[Any]:
    up = np.radians(np.linspace(-15, 15, channels))[:, None]
    turn_rad = np.linspace(0, 2 * np.pi, columns, endpoint=False)[None, :]
    rays = [np.cos(up) * np.cos(turn_rad), np.cos(up) * np.sin(turn_rad), np.sin(up) + 0 * turn_rad]
    return np.stack(rays, axis=-1).reshape(-1, 3)


@pytest.mark.parametrize("shape", [*SHAPES, "mesh"])
def test_every_shape_agrees_with_the_reference_from_outside_and_within(shape: str) -> None:
    rng = np.random.default_rng(MUJOCO_NUMBER[shape])
    met = missed = 0
    for trial in range(12):
        size = rng.uniform(0.2, 2.0, 3)
        if shape == "plane" and trial % 2:
            size[:2] = 0.0
        p, R = rng.uniform(-3, 3, 3), turn(rng)
        made = Geometry()
        triangles = None
        if shape == "mesh":
            vertex = rng.normal(size=(60, 3)).astype(np.float32)
            faces = np.arange(60, dtype=np.int32).reshape(-1, 3)
            made.add_mesh(vertex, faces, None, None)
            triangles = vertex[faces].astype(float)
        number = MUJOCO_NUMBER[shape]
        mesh = 0 if triangles is not None else -1
        made.add_geom(number, tuple(size), tuple(p), tuple(R.ravel()), mesh, False, True, 0, 0, 0)
        made.finish()
        # Aimed at the shape from near and far, and from its middle.
        origins = p + rng.normal(size=(40, 3)) * rng.choice([0.05, 1.0, 5.0, 300.0], (40, 1))
        directions = unit(p + rng.normal(size=(40, 3)) - origins)
        range_m, geom = cast(RayCaster(made), origins, directions)
        for o, d, r, g in zip(origins, directions, range_m, geom, strict=True):
            exact, _ = nearest([(shape, size, p, R, triangles)], o, d)
            if np.isinf(exact):
                missed += 1
                assert (r, g) == (np.inf, -1)
            else:
                met += 1
                assert r == pytest.approx(exact, abs=2e-9)
                assert g == 0
    assert met > 100
    assert missed > 10


def test_random_scenes_agree_with_mj_ray() -> None:
    for seed in range(3):
        model, data = compiled(scatter(120, seed))
        caster = RayCaster(native(model, data))
        rng = np.random.default_rng(seed)
        origins = rng.uniform(-1, 1, (1500, 3)) * [40, 40, 3] + [0, 0, 3.5]  # some within shapes
        directions = unit(rng.normal(size=(1500, 3)))
        range_m, geom = cast(caster, origins, directions)
        exact_m, exact_geom = mujoco_rays(model, data, origins, directions)
        assert np.array_equal(geom, exact_geom)
        hit = geom >= 0
        assert hit.sum() > 700
        assert np.abs(range_m[hit] - exact_m[hit]).max() < 1e-9


def test_a_sweep_agrees_with_mj_multiray() -> None:
    model, data = compiled(scatter(900, 5))
    directions = fan(16, 225)
    range_m, geom = cast(RayCaster(native(model, data)), (0.3, 0.2, 2.0), directions)
    n = len(directions)
    theirs, theirs_m = np.empty(n, np.int32), np.empty(n)
    groups = np.array([1, 1, 1, 0, 0, 0], np.uint8)
    mujoco.mj_multiRay(
        model, data, np.array([0.3, 0.2, 2.0]), directions.ravel(), groups, True, -1, theirs, theirs_m, None, n, 1e9
    )
    assert np.array_equal(geom, theirs)
    assert np.abs(range_m[geom >= 0] - theirs_m[geom >= 0]).max() < 1e-9


@pytest.fixture(scope="module")
def crowd() -> tuple[RayCaster, NDArray[Any], NDArray[Any]]:
    """Return caster, origins and directions: near and far rays, coherent and random."""
    model, data = compiled(scatter(600, 7, movers=0.2))
    rng = np.random.default_rng(1)
    directions = np.concatenate([fan(16, 200), unit(rng.normal(size=(1003, 3)))])
    origins = np.tile((0.3, 0.2, 2.0), (len(directions), 1)) + rng.normal(size=(len(directions), 3)) * 0.01
    return RayCaster(native(model, data)), origins, directions


def test_tree_range_order_threads_and_cpu_change_no_bit(crowd: Any) -> None:
    caster, origins, directions = crowd
    for t_max in (1e6, 12.0):
        plain = cast(caster, origins, directions, t_max=t_max)
        assert (plain[1] >= 0).sum() > 300
        backwards = np.arange(len(directions), dtype=np.int32)[::-1].copy()
        options: list[dict[str, Any]] = [{"tree": False}, {"max_range": False}, {"tree": False, "max_range": False}]
        options += [{"threads": 2}, {"threads": 5}, {"order": backwards}, {"isa": "base"}]
        for isa in ("avx2", "avx512"):
            try:
                cast(caster, origins[:1], directions[:1], isa=isa)
            except ValueError:
                continue
            options.append({"isa": isa})
        for option in options:
            got = cast(caster, origins, directions, t_max=t_max, **option)
            assert all(a.tobytes() == b.tobytes() for a, b in zip(plain, got, strict=True)), option


def test_normals_do_not_depend_on_earlier_rays(crowd: Any) -> None:
    caster, origins, directions = crowd
    together, alone = np.empty((len(directions), 3)), np.empty((len(directions), 3))
    backwards = np.arange(len(directions), dtype=np.int32)[::-1].copy()
    _, geom = cast(caster, origins, directions, normal_W=together, order=backwards)
    for i in range(len(directions)):
        cast(caster, origins[i : i + 1], directions[i : i + 1], normal_W=alone[i : i + 1])
    assert (geom >= 0).sum() > 300
    assert together.tobytes() == alone.tobytes()


def test_ties_go_to_the_lower_index() -> None:
    made = Geometry()
    level = (1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0)
    for size in (1.0, 1.0, 1.0):
        made.add_geom(6, (size, 1.0, 1.0), (5.0, 0.0, 0.0), level, -1, False, True, 0, 0, 0)
    made.finish()
    directions = unit(np.stack([np.ones(50), np.linspace(-0.1, 0.1, 50), np.zeros(50)], axis=-1))
    _, geom = cast(RayCaster(made), (0.0, 0.0, 0.0), directions)
    assert (geom == 0).all()


def test_moving_geoms_are_hit_at_their_present_place() -> None:
    model, data = compiled(scatter(300, 11, movers=0.6))
    made = native(model, data)
    caster = RayCaster(made)
    moving = [g for g in range(model.ngeom) if model.body_mocapid[model.geom_bodyid[g]] >= 0]
    rng = np.random.default_rng(4)
    directions = fan(16, 60)
    seen = []
    for _ in range(6):  # drifting apart: the tree is built anew on the way
        data.mocap_pos[:] += rng.normal(size=data.mocap_pos.shape) * [6.0, 6.0, 1.0]
        mujoco.mj_kinematics(model, data)
        n = len(moving)
        made.move(
            np.array(moving, np.int32),
            data.geom_xpos[moving].copy(),
            data.geom_xmat[moving].reshape(n, 3, 3).copy(),
            np.zeros((n, 3)),
            np.zeros((n, 3)),
        )
        range_m, geom = cast(caster, (0.0, 0.0, 2.0), directions)
        exact_m, exact_geom = mujoco_rays(model, data, (0.0, 0.0, 2.0), directions)
        assert np.array_equal(geom, exact_geom)
        assert np.abs(range_m[geom >= 0] - exact_m[geom >= 0]).max() < 1e-9
        seen.append(geom.tobytes())
    assert len(set(seen)) == 6


def test_normals_and_radial_velocities_are_those_of_the_formulas() -> None:
    model, data = compiled(
        '<mujoco><worldbody><geom type="plane" size="0 0 1"/>'
        '<body mocap="true" pos="8 0 2"><geom type="sphere" size="1.5"/></body></worldbody></mujoco>'
    )
    made = native(model, data)
    v, w = np.array([[1.0, 2.0, 3.0]]), np.array([[0.3, -0.2, 0.5]])
    made.move(np.array([1], np.int32), np.array([[8.0, 0, 2]]), np.eye(3)[None].copy(), v, w)
    directions = fan(16, 400)
    n = len(directions)
    normal, speed = np.empty((n, 3)), np.empty(n)
    range_m, geom = cast(RayCaster(made), (0.0, 0.0, 2.0), directions, normal_W=normal, radial_velocity_mps=speed)
    ball, ground, sky = geom == 1, geom == 0, geom == -1
    assert ball.sum() > 50
    arm = range_m[ball, None] * directions[ball] + [0, 0, 2] - [8.0, 0, 2]
    assert normal[ball] == pytest.approx(arm / 1.5, abs=1e-9)
    expected = np.sum((v + np.cross(w, arm)) * directions[ball], axis=1)
    assert speed[ball] == pytest.approx(expected, abs=1e-9)
    assert (normal[ground] == [0, 0, 1]).all()
    assert (speed[ground] == 0.0).all()
    assert (normal[sky] == 0.0).all()
    assert np.isnan(speed[sky]).all()


@pytest.mark.parametrize("shape", ["sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh"])
def test_normals_stand_on_the_surface_against_the_ray(shape: str) -> None:
    """The surface's slope by finite differences of the range itself."""
    model, data = compiled(one_shape(shape))
    caster = RayCaster(native(model, data))
    rng = np.random.default_rng(2)
    o = np.array([6.0, 1.0, 2.5])
    d = unit(-o + rng.uniform(-0.5, 0.5, (400, 3)))
    normal = np.empty((400, 3))
    range_m, geom = cast(caster, o, d, normal_W=normal)
    hit = geom == 0
    assert hit.sum() > 50
    step = 1e-6
    for axis in rng.normal(size=(2, 3)):
        aside = unit(d + step * axis)
        moved_m, moved_geom = cast(caster, o, aside)
        both = hit & (moved_geom == 0)
        along = np.where(both, moved_m, 1.0)[:, None] * aside - np.where(both, range_m, 1.0)[:, None] * d
        smooth = both & (np.linalg.norm(along, axis=1) < 1e-4)
        assert smooth.sum() > 40
        slope = np.abs(np.sum(along * normal, axis=1))[smooth] / step
        assert np.quantile(slope, 0.9) < 1e-3  # an edge between the two rays spoils a few
    assert (np.sum(normal * d, axis=1)[hit] <= 0.0).all()
    assert np.linalg.norm(normal[hit], axis=1) == pytest.approx(1.0, abs=1e-12)


def one_shape(shape: str) -> str:
    rng = np.random.default_rng(8)
    ball = " ".join(f"{x:.5f}" for x in unit(rng.normal(size=(40, 3))).ravel())
    size = 'mesh="m"' if shape == "mesh" else 'size="0.9 0.7 0.5"'
    return (
        f'<mujoco><asset><mesh name="m" vertex="{ball}"/></asset><worldbody>'
        f'<geom type="{shape}" {size} quat="0.8 0.3 0.2 0.5"/></worldbody></mujoco>'
    )


LEVEL = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def ball_ahead(x: float = 5.0) -> RayCaster:
    made = Geometry()
    made.add_geom(2, (1.0, 0.0, 0.0), (x, 0.0, 0.0), LEVEL, -1, False, True, 0, 0, 0)
    made.finish()
    return RayCaster(made)


def test_invalid_rays_hit_nothing_and_do_not_change_their_neighbours() -> None:
    caster = ball_ahead()
    nan, inf = np.nan, np.inf
    odd = [(nan, 0, 0), (0, 0, 0), (inf, 0, 0), (1, nan, 0), (1e-9, 0, 0), (-inf, inf, nan)]
    directions = np.array([(1.0, 0, 0), *odd, (1.0, 0, 0)])
    normal, speed = np.empty((8, 3)), np.empty(8)
    range_m, geom = cast(caster, (0.0, 0, 0), directions, normal_W=normal, radial_velocity_mps=speed)
    assert geom.tolist() == [0, -1, -1, -1, -1, -1, -1, 0]
    assert range_m.tolist() == [4.0, inf, inf, inf, inf, inf, inf, 4.0]
    assert normal[[0, 7]].tolist() == [[-1.0, 0, 0]] * 2
    far = np.array([(nan, 0, 0), (inf, 0, 0), (1e9, 0, 0), (0.0, 0, 0)])
    assert cast(caster, far, np.tile((1.0, 0, 0), (4, 1)))[1].tolist() == [-1, -1, -1, 0]


def test_limits_of_range_and_origins_within() -> None:
    caster, ahead = ball_ahead(), [(1.0, 0.0, 0.0)]
    assert cast(caster, (0.0, 0, 0), ahead, t_max=4.0)[0][0] == 4.0  # the limit itself counts
    assert cast(caster, (0.0, 0, 0), ahead, t_max=3.999)[1][0] == -1
    assert cast(caster, (0.0, 0, 0), ahead, t_max=0.0)[1][0] == -1
    assert cast(caster, (0.0, 0, 0), ahead, t_min=4.5)[0][0] == 6.0  # past the near side: the point where it leaves
    assert cast(caster, (0.0, 0, 0), ahead, t_min=-5.0)[0][0] == 4.0
    assert cast(caster, (5.0, 0, 0), ahead)[0][0] == 1.0  # within
    assert cast(caster, (7.0, 0, 0), ahead)[1][0] == -1  # behind
    assert cast(caster, (0.0, 0, 0), ahead, t_max=np.inf)[0][0] == 4.0
    assert cast(caster, (0.0, 0, 0), ahead, t_max=np.nan)[1][0] == -1
    assert cast(caster, (0.0, 0, 0), ahead, t_min=np.nan)[1][0] == -1
    assert cast(caster, (0.0, 0, 0), ahead, t_min=5.0, t_max=4.0)[1][0] == -1


def test_an_empty_world_and_no_rays_are_allowed() -> None:
    made = Geometry()
    made.finish()
    assert cast(RayCaster(made), (0.0, 0, 0), fan(4, 5))[1].tolist() == [-1] * 20
    assert len(cast(ball_ahead(), (0.0, 0, 0), np.empty((0, 3)))[0]) == 0


def test_arrays_of_wrong_shape_are_refused() -> None:
    caster = ball_ahead()
    o, d, r, g = np.zeros((1, 3)), np.ones((4, 3)), np.empty(4), np.empty(4, np.int32)
    caster.cast(o, d, 0.0, 1.0, r, g)
    for bad, error in (
        ((np.zeros((3, 3)), d, r, g), ValueError),
        ((o, d, np.empty(3), g), ValueError),
        ((o, d, r, np.empty(5, np.int32)), ValueError),
        ((o, d, np.empty(4, np.float32), g), TypeError),
        ((o, d, r, np.empty(4, np.int64)), TypeError),
        ((o, d, np.empty(8)[::2], g), TypeError),
    ):
        with pytest.raises(error):
            caster.cast(bad[0], bad[1], 0.0, 1.0, bad[2], bad[3])
    for order in ([0, 1, 2, 2], [0, 1, 2, 4], [-1, 0, 1, 2], [0, 1, 2]):
        with pytest.raises(ValueError, match="order"):
            caster.cast(o, d, 0.0, 1.0, r, g, order=np.array(order, np.int32))
    with pytest.raises(ValueError, match="sse9"):
        caster.cast(o, d, 0.0, 1.0, r, g, isa="sse9")


def test_the_order_of_rays_is_a_permutation_that_keeps_neighbours() -> None:
    directions = fan(16, 900)
    directions[5] = np.nan
    order = np.empty(len(directions), np.int32)
    coherent_order(directions, order)
    assert sorted(order.tolist()) == list(range(len(directions)))
    assert order[-1] == 5
    packets = directions[order[:-8]][: 8 * 1790].reshape(-1, 8, 3)
    spread = np.linalg.norm(packets.max(axis=1) - packets.min(axis=1), axis=1)
    assert np.median(spread) < 0.12  # rad: 8 rays of 2 by 0.4 degrees
