"""Walking people: velocities against central differences, joints that hold, feet that stand still."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from sim import _kernels
from sim.scene.maps.catalog import GENERATORS
from sim.scene.maps.figure import LIMBS, Figure
from sim.scene.maps.walk_path import WalkPath, there_and_back
from sim.scene.maps.walker import Walker
from tests.worlds.rotation_matrices import rotation

Float64 = NDArray[np.float64]
N = len(LIMBS)
POLYGON = [(0.0, 0.0), (10.0, 0.0), (12.0, 6.0), (4.0, 9.0), (-3.0, 4.0)]


def walkers() -> list[Walker]:
    return [
        Walker("a", Figure(1.58), WalkPath(POLYGON, 0.8, start_lap=0.3)),
        Walker("b", Figure(1.75), WalkPath(POLYGON[::-1], 1.2, corner_m=0.8), ground_m=0.12),
        Walker("c", Figure(1.92), there_and_back((1.0, 0.0), (7.0, 0.0), 1.6, lane_m=0.5)),
        Walker("d", Figure(1.0), WalkPath([(1.0, 2.0), (2.0, 2.5), (0.5, 4.0)], 0.4), ground_m=0.3),  # mostly corner
        Walker("e", Figure(2.1), WalkPath(POLYGON, 2.2, start_lap=0.9)),
    ]


@pytest.fixture(params=range(5), ids=["slow", "kerb", "there_and_back", "small", "tall_and_fast"])
def walker(request: pytest.FixtureRequest) -> Walker:
    return walkers()[request.param]


def posed(walker: Walker, t_ns: int) -> tuple[Float64, Float64, Float64, Float64]:
    p, q, v, w = np.full((N, 3), np.nan), np.full((N, 4), np.nan), np.full((N, 3), np.nan), np.full((N, 3), np.nan)
    walker.pose(t_ns, p, q, v, w)
    return p, q, v, w


def test_velocities_are_the_derivatives_of_the_poses(walker: Walker) -> None:
    """2 us to either side: truncation about 1e-9, rounding about 1e-8 m/s."""
    h_ns = 2_000
    worst_v = worst_w = fastest = 0.0
    for k in range(250):
        t = 1_000_000_000 + k * 190_617_283
        p0, q0, _, _ = posed(walker, t - h_ns)
        p1, q1, _, _ = posed(walker, t + h_ns)
        _, q, v, w = posed(walker, t)
        assert np.allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-12)
        step = 2e-9 * h_ns
        worst_v = max(worst_v, float(np.abs((p1 - p0) / step - v).max()))
        fastest = max(fastest, float(np.abs(v).max()))
        # q and -q are one rotation; vee of (R1 - R0) R^T / step is the angular velocity.
        for i in range(N):
            spin = (rotation(q1[i]) - rotation(q0[i])) @ rotation(q[i]).T / step
            measured = 0.5 * np.array([spin[2, 1] - spin[1, 2], spin[0, 2] - spin[2, 0], spin[1, 0] - spin[0, 1]])
            worst_w = max(worst_w, float(np.abs(measured - w[i]).max()))
    assert fastest > 1.5  # a swinging foot: the test is about something
    assert worst_v < 1e-6
    assert worst_w < 1e-6


def test_bound_holds_everything(walker: Walker) -> None:
    shapes = walker.figure.shapes()
    for k in range(400):
        t = k * 73_000_001
        (cx, cy, cz), radius = walker.bound(t)
        p, q, _, _ = posed(walker, t)
        for shape in shapes:
            i = LIMBS.index(shape.limb)
            centre = p[i] + rotation(q[i]) @ np.array(shape.pos)
            reach = sum(shape.size) if shape.kind == "capsule" else max(shape.size)
            assert math.dist(centre, (cx, cy, cz)) + reach <= radius
    assert radius < 0.75 * walker.figure.height_m  # and little more


# Every other scene has people.
DESERTED = {"airsim_nh", "airstrip", "blocks", "landscape_mountains"}


@pytest.mark.parametrize("generator", sorted(GENERATORS.keys() - DESERTED))
def test_nobody_is_faster_than_it_says(generator: str) -> None:
    # What physics relies on when it asks only now and then where people are.
    chosen = GENERATORS[generator]
    actors = chosen.generate(chosen.parameters(), 3).actors
    assert actors
    step_ns = 20_000_000
    for actor in actors:
        places = np.array([actor.bound(k * step_ns)[0] for k in range(3000)])
        speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / (step_ns * 1e-9)
        assert speeds.max() <= actor.max_speed_mps < 3.0


def limb_end(walker: Walker, p: Float64, q: Float64, limb: str, along_z_m: float) -> Float64:
    i = LIMBS.index(limb)
    return p[i] + rotation(q[i]) @ np.array([0.0, 0.0, along_z_m])


def test_joints_hold_together(walker: Walker) -> None:
    f = walker.figure
    for k in range(200):
        p, q, _, _ = posed(walker, k * 91_000_003)
        for limb, length_m, apart_m in (
            ("thigh", f.thigh_m, f.hip_half_m),
            ("upper_arm", f.upper_arm_m, f.shoulder_half_m),
        ):
            left, right = (limb_end(walker, p, q, f"{limb}_{side}", length_m / 2) for side in "lr")
            assert math.dist(left, right) == pytest.approx(2.0 * apart_m, rel=6e-3)  # hips turn by 0.1 rad
        for side in "lr":
            knee = limb_end(walker, p, q, f"thigh_{side}", -f.thigh_m / 2)
            assert np.allclose(knee, limb_end(walker, p, q, f"shank_{side}", f.shank_m / 2), atol=1e-12)
            ankle = limb_end(walker, p, q, f"shank_{side}", -f.shank_m / 2)
            assert np.allclose(ankle, p[LIMBS.index(f"foot_{side}")], atol=1e-12)
            elbow = limb_end(walker, p, q, f"upper_arm_{side}", -f.upper_arm_m / 2)
            assert np.allclose(elbow, limb_end(walker, p, q, f"forearm_{side}", f.forearm_m / 2), atol=1e-12)


def sole(walker: Walker, t_ns: int, side: str) -> tuple[Float64, Float64]:
    """Heel and ball of the sole: positions (2, 3) and velocities (2, 3)."""
    f = walker.figure
    p, q, v, w = posed(walker, t_ns)
    i = LIMBS.index(f"foot_{side}")
    arms = np.array([[-f.heel_m, 0.0, -f.ankle_m], [f.ball_m, 0.0, -f.ankle_m]]) @ rotation(q[i]).T
    return p[i] + arms, v[i] + np.cross(w[i], arms)


def test_feet_stand_on_the_ground_and_do_not_slip_on_straights(walker: Walker) -> None:
    standing_on_straight = 0
    worst_corner_slip = 0.0
    for k in range(2000):
        t = k * 23_000_009
        _, s_m, _ = walker.path.progress(t)
        turning = walker.path.place(s_m)[6] != 0.0
        lowest = math.inf
        for side in "lr":
            points, velocities = sole(walker, t, side)
            heights = points[:, 2] - walker.ground_m
            assert heights.min() > -1e-9
            lowest = min(lowest, float(heights.min()))
            own = (walker.phase(t) + (0.5 if side == "r" else 0.0)) % 1.0
            if own >= walker.gait[15]:
                continue
            slip = float(np.linalg.norm(velocities[int(heights.argmin())]))
            if turning:
                worst_corner_slip = max(worst_corner_slip, slip)
            else:
                standing_on_straight += 1
                assert slip < 1e-9, (t, side)
        assert lowest < 0.05  # one foot at least is down
    assert standing_on_straight > 500
    # Round corners the standing foot turns with the walker; its slip stays below the walking speed.
    assert worst_corner_slip < 1.6


def test_knees_bend_forward_and_do_not_lock(walker: Walker) -> None:
    f = walker.figure
    for k in range(200):
        p, q, _, _ = posed(walker, k * 31_000_001)
        for side in "lr":
            hip = limb_end(walker, p, q, f"thigh_{side}", f.thigh_m / 2)
            ankle = p[LIMBS.index(f"foot_{side}")]
            assert math.dist(hip, ankle) < 0.9935 * f.leg_m


def test_any_order_gives_the_same_and_a_lap_closes(walker: Walker) -> None:
    times = [k * 1_234_567_891 for k in range(40)]
    forward = [posed(walker, t) for t in times]
    backward = [posed(walker, t) for t in reversed(times)][::-1]
    for a, b in zip(forward, backward, strict=True):
        assert all((x == y).all() for x, y in zip(a, b, strict=True))
    lap_ns = walker.path.lap_s * 1e9
    near = [posed(walker, round(lap_ns * k))[0] for k in (1, 2, 50)]
    for later in near[1:]:
        assert np.abs(later - near[0]).max() < 1e-7


def test_there_and_back_reaches_exactly_its_ends_and_cruises_at_its_speed() -> None:
    path = there_and_back((1.0, 0.0), (7.0, 0.0), 1.2, lane_m=0.5)
    xs, speeds, ys = [], [], []
    for k in range(4000):
        t = k * 5_000_000
        _, s_m, speed = path.progress(t)
        x, y, *_ = path.place(s_m)
        xs.append(x)
        ys.append(y)
        speeds.append(speed)
    assert min(xs) == pytest.approx(1.0, abs=1e-3)
    assert max(xs) == pytest.approx(7.0, abs=1e-3)
    assert max(ys) == pytest.approx(0.25, abs=1e-9)
    assert max(speeds) == pytest.approx(1.2, abs=1e-12)
    share = sum(speed == max(speeds) for speed in speeds) / len(speeds)
    assert share > 0.5


def test_corner_ends_where_the_next_leg_begins() -> None:
    """Position, heading and curvature are continuous over the joints of the path."""
    path = WalkPath(POLYGON, 1.3)
    for joint in [*(part[0] for part in (*path.corners, *path.straights[1:])), path.lap_m]:
        before, after = path.place(joint - 1e-9), path.place((joint + 1e-9) % path.lap_m)
        assert np.allclose(before, after, atol=1e-7)


def test_a_path_needs_an_area() -> None:
    with pytest.raises(ValueError, match="three vertices"):
        WalkPath([(0.0, 0.0), (1.0, 0.0)], 1.0)
    with pytest.raises(ValueError, match="turns back on itself"):
        WalkPath([(0.0, 0.0), (5.0, 0.0), (2.0, 0.0)], 1.0)


def test_what_the_kernels_refuse() -> None:
    walker = Walker("w", Figure(1.7), WalkPath(POLYGON, 1.2))
    p, q, v, w = posed(walker, 0)
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
        with pytest.raises(ValueError, match="finite duration above 0"):
            _kernels.WalkPath(**tables, **times)
    assert np.isnan(walker.path.place(float("nan"))[:2]).all()
    for name, table in tables.items():
        with pytest.raises(ValueError, match="as many corners"):
            _kernels.WalkPath(**tables | {name: table[:0]}, lap_s=1.0, offset_s=0.0)
        with pytest.raises(TypeError):
            _kernels.WalkPath(**tables | {name: table[:, :-1].copy()}, lap_s=1.0, offset_s=0.0)
