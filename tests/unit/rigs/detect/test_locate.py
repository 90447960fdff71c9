"""Geolocation against closed forms: camera, ranges, covariances, pieces of a picture, and the own pose."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from hil.config.companion.clients import make_client_importable
from sim.frame.mount import Mount

make_client_importable()

from hil_companion.detect.decode import Detection  # noqa: E402
from hil_companion.locate.geolocation import (  # noqa: E402
    Camera,
    Geolocation,
    RadarView,
    depth_in,
    ground_range,
)
from hil_companion.locate.looks import object_pixels  # noqa: E402
from hil_companion.locate.own_pose import OwnPose  # noqa: E402
from hil_companion.locate.tiles import on_seat, pieces, rival_score, without_duplicates  # noqa: E402
from hil_companion.navigation.inertial import NavState  # noqa: E402

SECOND = 1_000_000_000
WIDTH, HEIGHT, FOCAL = 320, 240, 200.0
PITCH_DEG = 40.0


def calibration(coefficients: tuple[float, ...] = (0.0,) * 5) -> dict[str, Any]:
    mount = Mount((0.1, 0.0, -0.05), (0.0, PITCH_DEG, 0.0))
    K = [FOCAL, 0.0, WIDTH / 2 - 0.5, 0.0, FOCAL, HEIGHT / 2 - 0.5, 0.0, 0.0, 1.0]
    told: dict[str, Any] = {"width": WIDTH, "height": HEIGHT, "camera_matrix": K, "distortion": "plumb_bob"}
    return told | {"coefficients": list(coefficients), "p_BC": list(mount.p_BC), "q_BC": list(mount.q_BC)}


def pose(x: float, y: float, z: float, yaw_rad: float) -> NavState:
    return NavState(0, (x, y, z), (0.0, 0.0, 0.0), (math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2)))


def test_a_ray_through_the_middle_of_the_picture_is_the_axis_and_lenses_are_undone() -> None:
    camera = Camera("front", calibration())
    assert camera.rays_C([(WIDTH / 2, HEIGHT / 2)])[0] == pytest.approx((0.0, 0.0, 1.0), abs=1e-12)
    bent = Camera("front", calibration((-0.2, 0.05, 0.001, -0.002, 0.0)))
    places = np.array([[12.0, 20.0], [160.0, 120.0], [300.0, 200.0]])
    assert bent.pixels(bent.rays_C(places) * 7.0) == pytest.approx(places, abs=0.02)


@pytest.mark.parametrize("noise_m", [0.0, 1.0])
def test_depth_is_that_of_the_thing_and_not_of_what_is_behind_it(noise_m: float) -> None:
    rng = np.random.default_rng(1)
    depth = np.full((HEIGHT, WIDTH), 45.0, np.float32)
    depth[100:140, 150:170] = 20.0  # the object fills half of its box's width
    depth += (noise_m * rng.standard_normal(depth.shape)).astype(np.float32)
    depth[110:112, 155:158] = 3.0  # a thin object in front
    depth[130:133, 158:160] = np.nan
    found = depth_in(depth, (145.0, 98.0, 178.0, 142.0))
    assert found == pytest.approx(20.0, abs=0.01 if noise_m == 0.0 else 0.35)
    assert depth_in(np.full((HEIGHT, WIDTH), np.inf), (10.0, 10.0, 40.0, 90.0)) is None


def test_level_ground_is_met_where_trigonometry_says() -> None:
    camera = Camera("front", calibration())
    p, R = np.array([0.0, 0.0, 10.0]), camera.R_BC
    away = ground_range(p, R, np.array([0.0, 0.0, 1.0]), 0.0)
    assert away == pytest.approx(10.0 / math.sin(math.radians(PITCH_DEG)))
    assert ground_range(p, R, np.array([0.0, -2.0, 1.0]), 0.0) is None  # into the sky


@pytest.mark.parametrize("by_depth", [True, False])
@pytest.mark.parametrize("at", [(14.0, 3.0), (9.0, -4.0)])
def test_somebody_is_placed_where_he_stands(by_depth: bool, at: tuple[float, float]) -> None:
    camera = Camera("front", calibration())
    yaw, (x, y) = 0.7, (5.0, -2.0)
    c, s = math.cos(yaw), math.sin(yaw)
    truth = np.array([x + c * at[0] - s * at[1], y + s * at[0] + c * at[1]])
    R_WB = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    p_WC = np.array([x, y, 10.0]) + R_WB @ camera.p_BC

    def seen(z: float) -> np.ndarray:
        return (R_WB @ camera.R_BC).T @ (np.array([*truth, z]) - p_WC)

    head, foot, middle = seen(1.75), seen(0.0), seen(0.875)
    (u0, v0), (u1, v1) = camera.pixels([head])[0], camera.pixels([foot])[0]
    box = Detection("person", (min(u0, u1) - 5.0, v0, max(u0, u1) + 5.0, v1), 0.9)
    depth = np.full((HEIGHT, WIDTH), middle[2], np.float32) if by_depth else None
    (placed,) = Geolocation(camera, ground_z_m=0.0).place([box], pose(x, y, 10.0, yaw), depth, None)
    assert placed.p_W[:2] == pytest.approx(truth, abs=0.15)
    assert placed.range_m == pytest.approx(float(np.linalg.norm(middle if by_depth else foot)), rel=0.03)
    (nowhere,) = Geolocation(camera, ground_z_m=0.0).place([box], None, depth, None)
    assert nowhere.p_W is None
    cut_off = Detection("person", (100.0, 200.0, 120.0, float(HEIGHT)), 0.9)
    if not by_depth:  # no lower end in the picture, so no ground range
        (headless,) = Geolocation(camera, ground_z_m=0.0).place([cut_off], pose(x, y, 10.0, yaw), None, None)
        assert (headless.range_m, headless.p_W) == (None, None)


def test_the_radars_speed_is_that_of_the_point_in_the_box() -> None:
    camera = Camera("front", calibration())
    axis_B = camera.R_BC @ np.array([0.0, 0.0, 1.0])
    along = 15.0 * axis_B + camera.p_BC
    beside = 15.0 * (camera.R_BC @ np.array([0.5, 0.0, 1.0])) / math.hypot(0.5, 1.0)
    behind = 25.0 * axis_B + camera.p_BC
    places = np.stack([along, beside, behind])
    points = {"x_R": places[:, 0], "y_R": places[:, 1], "z_R": places[:, 2]}
    points |= {"snr_db": np.array([12.0, 30.0, 25.0]), "speed_mps": np.array([-1.5, 9.0, 4.0])}
    radar = RadarView(points, np.zeros(3), np.eye(3))
    box = Detection("person", (150.0, 100.0, 170.0, 140.0), 0.9)
    depth = np.full((HEIGHT, WIDTH), 15.0, np.float32)
    place = Geolocation(camera, ground_z_m=0.0)
    assert place.place([box], None, depth, radar)[0].radial_speed_mps == -1.5
    assert place.place([box], None, None, radar)[0].radial_speed_mps == 4.0  # no range: the strongest counts
    aside = Detection("person", (10.0, 10.0, 20.0, 30.0), 0.9)
    assert place.place([aside], None, depth, radar)[0].radial_speed_mps is None


def test_pieces_cover_a_picture_and_doubles_go() -> None:
    for size, across, down in (((640, 480), 2, 2), ((641, 479), 3, 2), ((320, 240), 1, 1)):
        covered = np.zeros(size[::-1], int)
        for x0, y0, x1, y1 in pieces(size, across, down):
            covered[y0:y1, x0:x1] += 1
        assert covered.min() >= 1
        assert len(pieces(size, across, down)) == across * down
    whole, cut = Detection("person", (10, 10, 30, 60), 0.6), Detection("person", (10, 35, 30, 60), 0.8)
    near, car = Detection("person", (28, 10, 48, 60), 0.5), Detection("vehicle", (10, 10, 30, 60), 0.7)
    assert without_duplicates([whole, near, car, cut]) == [cut, car, near]


def test_the_rival_of_a_box_is_the_best_one_of_another_label_over_it() -> None:
    person, bin_ = Detection("person", (10, 10, 30, 60), 0.5), Detection("bin", (11, 12, 31, 61), 0.6)
    behind, bench = Detection("house", (0, 0, 300, 200), 0.9), Detection("bench", (11, 20, 31, 61), 0.7)
    low = Detection("dog", (10, 10, 30, 60), 0.3)
    assert rival_score(person, [person, behind, low, bin_, bench]) == 0.6
    assert rival_score(bin_, [person, bin_, low]) == 0.5
    assert rival_score(person, [person, behind, bench]) is None
    assert on_seat(person, [person, bench], 0.7)
    assert not on_seat(person, [person, bench], 0.71)
    assert not on_seat(person, [Detection("bench", (27, 10, 90, 60), 0.7)], 0.4)  # beside it


def test_the_depth_of_a_thin_object_is_that_of_its_own_pixels() -> None:
    depth, rgb = np.full((HEIGHT, WIDTH), 30.0), np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    object_ = np.s_[100:140, 160:162]  # a twelfth of the box's width
    depth[object_], rgb[object_] = 25.0, (200, 30, 30)
    box = (148.0, 100.0, 173.0, 140.0)
    assert depth_in(depth, box) == 30.0
    assert depth_in(depth, box, object_pixels(rgb, box)) == 25.0
    depth[object_] = np.nan  # without a depth of their own, all pixels count
    assert depth_in(depth, box, object_pixels(rgb, box)) == 30.0


def test_a_position_is_less_sure_along_the_view_and_the_heading_moves_it_across() -> None:
    place, at = Geolocation(Camera("front", calibration()), ground_z_m=0.0), pose(0.0, 0.0, 0.0, 0.0)
    cov = place.covariance((40.0, 0.0, 0.0), at, 0.0, 0.0, by_depth=True)
    assert cov[0, 0] == pytest.approx((0.1 + 0.0004 * 40.0**2) ** 2)
    assert cov[1, 1] == pytest.approx((0.12 + 0.004 * 40.0) ** 2)
    assert cov[0, 1] == pytest.approx(0.0, abs=1e-12)
    turned = place.covariance((0.0, 40.0, 0.0), at, 0.0, 0.02, by_depth=True)
    assert turned[0, 0] == pytest.approx(cov[1, 1] + (40.0 * 0.02) ** 2)
    assert turned[1, 1] == pytest.approx(cov[0, 0])
    two_people = place.covariance((40.0, 0.0, 0.0), at, 0.0, 0.0, by_depth=True, height_m=3.1)
    assert two_people[0, 0] == pytest.approx(cov[0, 0] + 2.0**2)


def test_the_height_of_a_box_is_that_of_its_upright_object() -> None:
    camera, at = Camera("front", calibration()), pose(0.0, 0.0, 10.0, 0.0)
    R_WB_C = camera.R_BC
    feet, head = (np.array([12.1, 0.0, z]) for z in (0.0, 1.7))
    (u, bottom), (_, top) = camera.pixels(np.array([feet, head]) @ R_WB_C - (np.array([0.1, 0.0, 9.95]) @ R_WB_C))
    box = Detection("person", (u - 4.0, top, u + 4.0, bottom), 0.9, p_W=(12.1, 0.0, 0.85))
    place = Geolocation(camera, ground_z_m=0.0)
    assert place.height_m(box, at) == pytest.approx(1.7, abs=1e-6)
    assert place.height_m(box, None) is None
    assert place.height_m(box, NavState(0, (0, 0, 10), (0, 0, 0), _nose_down())) is None  # seen from above


def _nose_down() -> tuple[float, float, float, float]:
    half = 0.5 * math.radians(90.0 - PITCH_DEG)
    return (math.cos(half), 0.0, math.sin(half), 0.0)


@pytest.mark.parametrize("ground_m", [0.0, 3.5])
def test_the_height_of_a_box_above_the_ground_is_that_above_the_points_below_it(ground_m: float) -> None:
    camera, at = Camera("front", calibration()), pose(0.0, 0.0, 10.0 + ground_m, 0.0)
    v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
    down = -(camera.rays_C(np.column_stack([u.ravel() + 0.5, v.ravel() + 0.5])) @ camera.R_BC.T)[:, 2]
    depth = np.where(down > 0.01, (10.0 + camera.p_BC[2]) / np.maximum(down, 0.01), np.inf).reshape(HEIGHT, WIDTH)
    box = Detection("person", (150.0, 100.0, 160.0, 140.0), 0.9, p_W=(12.0, 0.0, ground_m + 0.85))
    place = Geolocation(camera, ground_z_m=0.0)
    assert place.middle_m(box, at, depth) == pytest.approx(0.85, abs=1e-6)
    assert place.middle_m(box, at, None) is None
    assert place.middle_m(box, None, depth) is None
    assert place.middle_m(box, at, np.full((HEIGHT, WIDTH), np.nan)) is None


def frame(t_ns: int, **topics: Any) -> Any:
    class Frame(dict):  # type: ignore[type-arg]
        pass

    made = Frame(topics)
    made.t_ns = t_ns  # type: ignore[attr-defined]
    return made


def test_own_pose_follows_gps_and_says_when_it_is_lost() -> None:
    from signals.geodesy import LocalFrame
    from sim.scene.scene import Site

    local = LocalFrame(Site(latitude_deg=47.0, longitude_deg=8.0, altitude_m=400.0))
    own = OwnPose((2.0, 1.0, 0.23, 0.0))
    assert own.at(0) is None
    accel, speed, dt = 0.5, 0.0, 0.004
    for k in range(1, 2501):
        t_ns = round(k * dt * SECOND)
        forward = accel if 250 < k <= 1250 else 0.0
        speed += forward * dt
        x = 2.0 + (0.0 if k <= 250 else 0.5 * accel * min((k - 250) * dt, 4.0) ** 2 + speed * max(0.0, (k - 1250) * dt))
        topics: dict[str, Any] = {
            "imu": {
                "t_capture_ns": [t_ns],
                "gyro_radps": [[0.0, 0.0, 0.0]],
                "accel_mps2": [[forward + 0.05, 0.0, 9.80665]],
            }
        }
        if k % 25 == 0 and k <= 1700:
            latitude, longitude, altitude = local.geodetic_from_enu((x + 3.0, 1.0, 0.23))  # a receiver 3 m off
            values = {"latitude_deg": latitude, "longitude_deg": longitude, "altitude_m": altitude, "fix_type": 3}
            values |= {"t_capture_ns": t_ns, "horizontal_accuracy_m": 0.1, "v_W": [speed, 0.0, 0.0]}
            topics["gps"] = {name: [value] for name, value in values.items()}
        own.update(frame(t_ns, **topics))
        if k == 1700:
            then = own.at(t_ns)
            assert then is not None
            assert then.p == pytest.approx((x, 1.0, 0.23), abs=0.1)
            assert own.sigma_m < 0.3
    assert not own.ok
    assert own.at(t_ns) is None


def test_the_gyros_bias_is_learned_before_take_off() -> None:
    own, dt, bias = OwnPose((0.0, 0.0, 0.23, 0.3)), 0.5, (0.001, -0.002, 0.004)
    for k in range(13):
        t_ns = [round((k * dt + 0.004 * (i + 1)) * SECOND) for i in range(125)]
        rows = {"t_capture_ns": t_ns, "gyro_radps": [bias] * 125, "accel_mps2": [(0.0, 0.0, 9.80665)] * 125}
        own.update(frame(t_ns[-1], imu=rows))
    assert own._filter.gyro_bias == pytest.approx(bias, abs=4e-4)
    assert own._filter.yaw_rad == pytest.approx(0.3, abs=0.003)  # 0.026 rad off without the correction
    assert own.yaw_sigma_rad < 0.006


def circled(own: OwnPose, *, frames_hz: int, over_s: int, scale: float, noise_mps: float = 0.0) -> tuple[Any, float]:
    """Fly `own` on a level circle, turning fast; return its pose and the true heading at the end.

    Radius 12 m, 3 m/s, 0.6 rad/s of heading, which the gyro understates by `scale`; fixes at 10 Hz with exact places.
    """
    from signals.geodesy import LocalFrame
    from sim.scene.scene import Site

    local = LocalFrame(Site(latitude_deg=47.0, longitude_deg=8.0, altitude_m=400.0))
    radius_m, speed_mps, turn_radps, imu_hz, rest_s = 12.0, 3.0, 0.6, 50, 4
    rng = np.random.default_rng(5)
    imu: dict[str, Any] = {"t_capture_ns": [], "gyro_radps": [], "accel_mps2": []}
    fixes: list[dict[str, Any]] = []
    per_frame = imu_hz // frames_hz
    for k in range(1, (rest_s + over_s) * imu_hz + 1):
        t_ns, t_s = k * SECOND // imu_hz, max(0.0, k / imu_hz - rest_s)
        yaw, way = turn_radps * (t_s - 0.5 / imu_hz) if t_s else 0.0, speed_mps / radius_m * t_s
        a_W = speed_mps**2 / radius_m * np.array([-math.cos(way), -math.sin(way)]) if t_s else np.zeros(2)
        if t_s and k == rest_s * imu_hz + 1:
            a_W = a_W + np.array([0.0, speed_mps * imu_hz])  # at once to its speed
        forward, left = a_W @ (math.cos(yaw), math.sin(yaw)), a_W @ (-math.sin(yaw), math.cos(yaw))
        imu["t_capture_ns"].append(t_ns)
        imu["gyro_radps"].append((0.0, 0.0, turn_radps / (1.0 + scale) if t_s else 0.0))
        imu["accel_mps2"].append((float(forward), float(left), 9.80665))
        if k % 5 == 0:
            place = (radius_m * (math.cos(way) - 1.0), radius_m * math.sin(way), 0.23)
            latitude, longitude, altitude = local.geodetic_from_enu(place)
            v = (-speed_mps * math.sin(way), speed_mps * math.cos(way)) if t_s else (0.0, 0.0)
            v_W = (v[0] + noise_mps * rng.standard_normal(), v[1] + noise_mps * rng.standard_normal(), 0.0)
            row = {"latitude_deg": latitude, "longitude_deg": longitude, "altitude_m": altitude, "fix_type": 3}
            fixes.append(row | {"t_capture_ns": t_ns, "horizontal_accuracy_m": 0.05, "v_W": v_W})
        if k % per_frame == 0:
            gps = {name: [fix[name] for fix in fixes] for name in (fixes[0] if fixes else ())}
            own.update(frame(t_ns, **({"imu": imu, "gps": gps} if fixes else {"imu": imu})))
            imu, fixes = {"t_capture_ns": [], "gyro_radps": [], "accel_mps2": []}, []
    return own.at(t_ns), turn_radps * over_s


def heading_off(pose: Any, yaw_rad: float) -> float:
    w, _, _, z = pose.q
    return abs(math.remainder(2.0 * math.atan2(z, w) - yaw_rad, 2.0 * math.pi))


def test_the_gyros_scale_is_learned_from_turns() -> None:
    own = OwnPose((0.0, 0.0, 0.23, 0.0))
    pose, yaw_rad = circled(own, frames_hz=2, over_s=120, scale=0.004)
    assert own._filter.gyro_scale[2] == pytest.approx(0.004, abs=5e-4)
    assert heading_off(pose, yaw_rad) < math.radians(0.5)  # 0.8 degrees if the scale is taken for exact


def test_fixes_of_one_frame_correct_as_fixes_of_many_frames() -> None:
    rare, often = (OwnPose((0.0, 0.0, 0.23, 0.0)) for _ in range(2))
    a, _ = circled(rare, frames_hz=1, over_s=30, scale=0.0, noise_mps=0.1)
    b, _ = circled(often, frames_hz=10, over_s=30, scale=0.0, noise_mps=0.1)
    assert a.p == pytest.approx(b.p, abs=5e-3)
    assert a.v == pytest.approx(b.v, abs=5e-3)
    assert heading_off(a, 2.0 * math.atan2(b.q[3], b.q[0])) < 1e-3


@pytest.mark.parametrize("near", range(1, 36))
def test_two_heaps_with_nothing_between_have_a_depth_all_the_same(near: int) -> None:
    depth_m = np.full((6, 6), 30.0)
    depth_m.ravel()[:near] = 2.0
    for box in ((0.0, 0.0, 6.0, 6.0), (1.0, 1.0, 4.0, 5.0), (3.0, 2.0, 6.0, 4.0)):
        assert depth_in(depth_m, box) in (2.0, 30.0)
