"""The whole SLAM in a yard in closed form: error, repeatability, loss of sensors, moving objects."""

from __future__ import annotations

import copy
from functools import cache
from typing import Any

import numpy as np
import pytest

from tests.worlds.slam_yard import HEIGHT_M, ROOF_M, Circle, Frame, wall_distance_m

from hil_companion.errors import OptionError  # isort: skip
from hil_companion.explore.mapping.slam import Slam, SlamEstimate  # isort: skip
from hil_companion.explore.mapping.slam_settings import SlamSettings  # isort: skip

SETTINGS: dict[str, Any] = {"particles": 6, "area_m": 64.0, "match_points": 100}


@cache
def flight() -> tuple[Circle, tuple[Frame, ...]]:
    circle = Circle()
    return circle, tuple(circle.frames(4.2))


def fly(frames: Any, circle: Circle, seed: int = 1, **settings: Any) -> tuple[Slam, list[SlamEstimate]]:
    slam = Slam(SlamSettings(**(SETTINGS | settings)), start_W=circle.start, seed=seed)
    return slam, [slam.update(frame) for frame in frames]


def errors_m(circle: Circle, estimates: list[SlamEstimate]) -> list[float]:
    return [float(np.linalg.norm(e.p_W - circle.place(e.t_ns * 1e-9))) for e in estimates]


def test_pose_and_map_without_noise() -> None:
    circle, frames = flight()
    _, estimates = fly(frames, circle)
    assert max(errors_m(circle, estimates)) < 0.06
    last = estimates[-1]
    assert np.linalg.norm(last.v_W - circle.velocity(last.t_ns * 1e-9)) < 0.1
    assert last.lidar_ok
    assert last.gps_ok
    assert last.inliers > 0.8
    grid = last.grid
    occupied = grid.centres(grid.occupied)
    assert len(occupied) > 200
    far = wall_distance_m(occupied)
    assert np.mean(far <= 2.0 * grid.cell_m) > 0.99
    # The low house lies below the flight and is not an obstacle; walls at the flight's height are not "free".
    row, column = grid.cell_of(-11.5, -9.0)
    assert not grid.occupied[row, column]
    assert ROOF_M < HEIGHT_M - 1.0
    free = grid.centres(grid.free)
    assert len(free) > 5000
    # Cells behind the walls are unknown.
    assert (np.abs(free[:, 0] - 1.1) < 23.6).all()
    assert (np.abs(free[:, 1] - 1.1) < 18.7).all()
    assert (grid.occupied ^ grid.free ^ grid.unknown).all()


def test_the_same_seed_gives_the_same_bytes_and_another_one_others() -> None:
    circle, frames = flight()
    paths = [np.array([e.p_W for e in fly(frames[:18], circle, seed=seed)[1]]).tobytes() for seed in (3, 3, 4)]
    assert paths[0] == paths[1]
    assert paths[0] != paths[2]


@pytest.mark.parametrize("how", ["none", "nan", "short"])
def test_a_lost_lidar_is_told_and_found_again(how: str) -> None:
    circle, frames = flight()
    changed = []
    for frame in frames:
        new = copy.copy(frame)
        if 2.0 <= frame.t_ns * 1e-9 < 3.0:
            lidar = copy.deepcopy(frame["lidar"])
            points = lidar.values["points_L"]
            if how == "none":
                del new["lidar"]
            elif how == "short":
                lidar.values["ring"] = lidar.values["ring"][:40]
            else:
                points[::2], points[1::2] = np.nan, np.inf
            if how != "none":
                new["lidar"] = lidar
        changed.append(new)
    slam, estimates = fly(changed, circle)
    told = [e.lidar_ok for e in estimates]
    assert all(told[1:20])
    assert not any(told[24:30])
    assert all(told[31:])
    assert max(errors_m(circle, estimates)) < 0.15
    assert all(np.isfinite(e.p_W).all() for e in estimates)
    assert slam.maps.version > 0


def test_without_imu_rows_the_map_waits_and_the_vehicle_is_found_again() -> None:
    circle = Circle()
    frames = []
    for frame in circle.frames(4.6):
        frames.append(frame)
        if 2.0 <= frame.t_ns * 1e-9 < 2.8:
            del frame["imu"]
    _, estimates = fly(frames, circle)
    told = [e.imu_ok for e in estimates]
    assert all(told[:20])
    assert not any(told[22:30])
    assert all(told[-5:])
    assert len({e.grid.version for e in estimates[21:33]}) == 1
    assert max(errors_m(circle, estimates)) < 0.25
    assert max(errors_m(circle, estimates)[-10:]) < 0.06
    last = estimates[-1]
    assert abs(last.roll) < 0.2
    assert np.mean(wall_distance_m(last.grid.centres(last.grid.occupied)) <= 2.0 * last.grid.cell_m) > 0.99


def test_imu_rows_that_no_imu_sends_are_left_out() -> None:
    circle, frames = flight()
    changed = []
    for frame in frames[1:20]:
        new = copy.copy(frame)
        imu = new["imu"] = copy.deepcopy(frame["imu"])
        imu.values["accel_mps2"][3], imu.values["gyro_radps"][4] = [1e6, 0.0, 0.0], [0.0, 0.0, -1e4]
        imu.values["t_capture_ns"] = [*imu.values["t_capture_ns"][:-1], 10**15]  # the last row is far in the future
        changed.append(new)
    _, estimates = fly(changed, circle)
    assert max(errors_m(circle, estimates)) < 0.08


def test_a_broken_part_of_the_lidar_marks_no_cell_free() -> None:
    circle, frames = flight()
    frame = copy.deepcopy(frames[0])
    lidar = frame["lidar"].values
    # Vehicle at (5, 0) looking north: L's +x is world north. Half of the returns there are not finite.
    broken = lidar["points_L"][:, 0] > 0.0
    lidar["points_L"][broken] = np.nan
    estimate = fly([frame], circle)[1][-1]
    free = estimate.grid.centres(estimate.grid.log_odds < 0.0)
    reference = fly(frames[:1], circle)[1][-1]
    free_whole = reference.grid.centres(reference.grid.log_odds < 0.0)
    assert np.sum(free_whole[:, 1] > 1.0) > 1000
    assert np.sum(free[:, 1] > 1.0) < 0.02 * np.sum(free_whole[:, 1] > 1.0)
    assert np.sum(free[:, 1] < -1.0) > 0.9 * np.sum(free_whole[:, 1] < -1.0)


def test_lost_gps_is_told_and_noise_of_gps_does_not_move_the_vehicle() -> None:
    circle, frames = flight()
    draws = np.random.default_rng(5).normal(scale=1.5, size=(len(frames), 2))
    changed = []
    for k, frame in enumerate(frames):
        new = copy.copy(frame)
        gps = new["gps"] = copy.deepcopy(frame["gps"])
        gps.values["latitude_deg"][0] += draws[k, 1] / 111_000.0
        gps.values["longitude_deg"][0] += draws[k, 0] / 76_000.0
        if k >= 30:
            gps.values["fix_type"] = [1]
            gps.values["latitude_deg"] = [float("nan")]
        changed.append(new)
    _, estimates = fly(changed, circle)
    assert max(errors_m(circle, estimates)) < 0.08
    assert all(e.gps_ok for e in estimates[2:30])
    assert not any(e.gps_ok for e in estimates[37:])


def test_moved_objects_are_removed_from_the_map() -> None:
    def walker(t: float) -> tuple[float, float]:
        return (-4.0, 6.0) if t < 1.4 else (-4.0 - 30.0 * (t - 1.4), 6.0)

    circle = Circle(walker=walker)
    _, estimates = fly(circle.frames(4.8), circle, particles=2)

    def near(e: SlamEstimate) -> int:
        xy = e.grid.centres(e.grid.occupied)
        return int(np.sum(np.linalg.norm(xy - (-4.0, 6.0), axis=1) < 0.8))

    assert near(estimates[13]) >= 3
    assert near(estimates[-1]) == 0
    assert max(errors_m(circle, estimates)) < 0.08


def test_estimates_stay_as_they_were_when_the_map_goes_on() -> None:
    circle, frames = flight()
    slam = Slam(SlamSettings(**SETTINGS), start_W=circle.start, seed=1)
    first = [slam.update(frame) for frame in frames[:12]][-1]
    kept = first.grid.log_odds.tobytes()
    versions = {slam.update(frame).grid.version for frame in frames[12:30]}
    assert first.grid.log_odds.tobytes() == kept
    assert len(versions) > 3


def test_all_wrong_settings_are_reported() -> None:
    with pytest.raises(OptionError) as error:
        SlamSettings(particles=0, cell_m=-1.0, decimation=99)
    assert all(name in str(error.value) for name in ("particles", "cell_m", "decimation"))
