"""Tracks from points: birth, estimates, pauses, identities, death."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pydantic
import pytest
from numpy.typing import NDArray

from sim.radar.processing.parameters import Processing, TrackerParameters
from sim.radar.processing.points import POINT_DTYPE
from sim.radar.processing.tracker import TRACK_DTYPE, Tracker, _Filter, _Points
from tests.worlds.radar_point_targets import CHIRP, direction

PERIOD_NS = 50_000_000
WHOLE = 2.0 * CHIRP.max_speed_mps
Seen = tuple[float, float, float, float]  # range, speed, azimuth [deg], snr


def points(*seen: Seen) -> NDArray[np.void]:
    out = np.zeros(len(seen), POINT_DTYPE)
    for i, (range_m, speed, azimuth, snr) in enumerate(seen):
        x, y, z = range_m * direction(azimuth, 0.0)
        folded = speed - WHOLE * math.floor(speed / WHOLE + 0.5)
        out[i] = (x, y, z, range_m, folded, math.radians(azimuth), 0.0, snr)
    return out


def run(frames: Sequence[Sequence[Seen]], **changes: Any) -> list[NDArray[np.void]]:
    tracker = Tracker(CHIRP, Processing(tracker=TrackerParameters(**changes)))
    return [tracker.step(points(*seen), i * PERIOD_NS) for i, seen in enumerate(frames)]


def away(i: int, speed: float = 1.2, near: float = 1.0, azimuth: float = 10.0) -> Seen:
    return near + speed * i * 0.05, speed, azimuth, 30.0


def test_the_filter_is_that_of_white_acceleration() -> None:
    """x' = F x, P' = F P F^T + Q, and the update with gain P H^T / (H P H^T + s^2), in matrices."""
    dt, q, sigma = 0.3, 1.7, 0.4
    f = _Filter(2.0, -0.5, 0.9, 0.2, 0.6)
    x, p = np.array([f.value, f.rate]), np.array([[f.p00, f.p01], [f.p01, f.p11]])
    step = np.array([[1.0, dt], [0.0, 1.0]])
    x, p = step @ x, step @ p @ step.T + q * q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    f.predict(dt, q)
    for i, update in ((0, f.update_value), (1, f.update_rate)):
        assert [f.value, f.rate, f.p00, f.p01, f.p11] == pytest.approx([*x, p[0, 0], p[0, 1], p[1, 1]], rel=1e-12)
        gain = p[:, i] / (p[i, i] + sigma**2)
        x, p = x + gain * (1.2 - x[i]), p - np.outer(gain, p[i])
        update(1.2, sigma)
    assert [f.value, f.rate, f.p00, f.p01, f.p11] == pytest.approx([*x, p[0, 0], p[0, 1], p[1, 1]], rel=1e-12)


def test_range_is_weighted_by_amplitude_and_speed_by_power() -> None:
    seen = _Points(points((2.0, 0.0, 0.0, 20.0), (3.0, 0.0, 0.0, 6.0)))
    assert seen.weight == pytest.approx([10.0, 10.0**0.3])
    assert seen.power == pytest.approx([100.0, 10.0**0.6])


def test_a_walker_is_found_within_three_frames_and_followed() -> None:
    tracks = run([[away(i)] for i in range(60)])
    assert [len(t) for t in tracks[:4]] == [0, 0, 1, 1]
    for i, t in enumerate(tracks[2:], start=2):
        assert t["id"].tolist() == [1]
        assert t["age_frames"][0] == i + 1
        assert t["range_m"][0] == pytest.approx(away(i)[0], abs=0.02)
        assert t["speed_mps"][0] == pytest.approx(1.2, abs=0.02)
        assert t["p_R_m"][0] == pytest.approx(away(i)[0] * direction(10.0, 0.0), abs=0.03)
        assert t["unseen_s"][0] == 0.0
    assert tracks[-1]["v_R_mps"][0] == pytest.approx(1.2 * direction(10.0, 0.0), abs=0.05)
    assert tracks[-1]["range_std_m"][0] < 0.1
    assert tracks[-1].dtype == TRACK_DTYPE


def test_deviations_are_those_of_the_errors() -> None:
    rng = np.random.default_rng(1)
    errors, deviations = [], []
    for _ in range(60):
        noise = rng.standard_normal((40, 2))
        frames = [[(3.0 + 0.06 * i + 0.12 * n[0], 1.2 + 0.2 * n[1], 0.0, 30.0)] for i, n in enumerate(noise)]
        t = run(frames)[-1][0]
        errors.append((t["range_m"] - (3.0 + 0.06 * 39), t["speed_mps"] - 1.2))
        deviations.append((t["range_std_m"], t["speed_std_mps"]))
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    stated = np.mean(deviations, axis=0)
    # The filter allows for acceleration that this walker has not, so it is a little better than it says.
    assert np.all(rms < 1.1 * stated)
    assert np.all(rms > 0.4 * stated)


def test_limbs_do_not_pull_the_trunk() -> None:
    frames = []
    for i in range(80):
        r, v, azimuth, _ = away(i)
        swing = 2.0 * math.sin(2.0 * math.pi * i / 20.0)
        limbs = [(r + 0.2, v + swing, azimuth, 24.0), (r - 0.2, v - swing, azimuth, 24.0), (r, v + 4.0, azimuth, 20.0)]
        frames.append([(r, v, azimuth, 34.0), *limbs])
    tracks = run(frames)
    assert {int(i) for t in tracks for i in t["id"]} == {1}  # nor are they people of their own
    for i, t in enumerate(tracks[5:], start=5):
        assert t["speed_mps"][0] == pytest.approx(1.2, abs=0.1)
        assert t["range_m"][0] == pytest.approx(away(i)[0], abs=0.12)


def test_a_trunk_that_fades_is_not_replaced_by_a_limb() -> None:
    frames = []
    for i in range(100):
        r, v, azimuth, _ = away(i)
        arm = (r - 0.1, v - 0.4, azimuth, 18.0)
        # For two of ten frames the arm alone is seen, then trunk and arm, equally strong, half a cell apart.
        faded = {0: [arm], 1: [arm], 2: [arm, (r, v, azimuth, 18.0)]}
        frames.append(faded.get(i % 10, [(r, v, azimuth, 34.0), arm]))
    for t in run(frames)[5:]:
        assert t["id"].tolist() == [1]
        assert t["speed_mps"][0] == pytest.approx(1.2, abs=0.1)


def test_a_short_pause_keeps_the_track_where_it_stopped() -> None:
    walk = [[away(i)] for i in range(20)]
    stop = away(19)[0]
    pause: list[list[Seen]] = [[] for _ in range(25)]  # 1.25 s of nothing
    again = [[(stop + 0.06 * i, 1.2, 10.0, 30.0)] for i in range(20)]
    tracks = run(walk + pause + again)
    assert all(t["id"].tolist() == [1] for t in tracks[2:])
    assert tracks[44]["range_m"][0] == pytest.approx(stop, abs=0.4)
    assert tracks[44]["speed_mps"][0] == pytest.approx(0.0, abs=0.1)
    assert tracks[44]["unseen_s"][0] == pytest.approx(1.25)
    assert tracks[44]["range_std_m"][0] > 3.0 * tracks[19]["range_std_m"][0]
    assert tracks[-1]["speed_mps"][0] == pytest.approx(1.2, abs=0.05)


def test_what_is_gone_for_long_is_gone_and_a_new_one_gets_a_new_name() -> None:
    tracks = run([[away(i)] for i in range(10)] + [[]] * 40 + [[away(i)] for i in range(10)])
    assert [len(t) for t in tracks[10:50]] == [1] * 30 + [0] * 10
    assert tracks[-1]["id"].tolist() == [2]


def test_a_single_false_alarm_is_no_track() -> None:
    rng = np.random.default_rng(2)
    frames: list[list[Seen]] = []
    for _ in range(400):
        r, v, azimuth = rng.uniform(0.5, 11.5), rng.uniform(-3.0, 3.0), rng.uniform(-60.0, 60.0)
        frames.append([(r, v, azimuth, 14.0)] if rng.random() < 0.1 else [])
    assert sum(len(t) for t in run(frames)) == 0


def test_what_stands_still_or_is_faint_begins_no_track() -> None:
    assert sum(len(t) for t in run([[(3.0, 0.1, 0.0, 60.0)]] * 40)) == 0
    assert sum(len(t) for t in run([[(*away(i)[:3], 10.0)] for i in range(40)])) == 0
    assert len(run([[(*away(i)[:3], 13.0)] for i in range(40)])[-1]) == 1


def test_two_people_pass_each_other_and_keep_their_names() -> None:
    frames = [[(2.0 + 0.06 * i, 1.2, 15.0, 30.0), (8.0 - 0.05 * i, -1.0, -15.0, 30.0)] for i in range(100)]
    tracks = run(frames)
    for i, t in enumerate(tracks[3:], start=3):
        assert t["id"].tolist() == [1, 2]
        assert t["range_m"] == pytest.approx([2.0 + 0.06 * i, 8.0 - 0.05 * i], abs=0.1)


def test_speed_is_followed_over_the_end_of_the_axis() -> None:
    frames, r = [], 1.0
    for i in range(80):
        v = 2.6 + 0.015 * i  # up to 3.8 m/s; the radar sees 6.3 m/s less from 3.15 m/s on
        r += 0.05 * v
        frames.append([(r, v, 0.0, 30.0)])
    tracks = run(frames)
    assert tracks[-1]["id"].tolist() == [1]
    assert tracks[-1]["speed_mps"][0] == pytest.approx(2.6 + 0.015 * 79, abs=0.1)


def test_reset_is_as_new_and_time_has_one_direction() -> None:
    tracker = Tracker(CHIRP, Processing())
    first = [tracker.step(points(away(i)), i * PERIOD_NS).tobytes() for i in range(10)]
    with pytest.raises(ValueError, match="order of time"):
        tracker.step(points(), 9 * PERIOD_NS)
    tracker.reset()
    assert [tracker.step(points(away(i)), i * PERIOD_NS).tobytes() for i in range(10)] == first
    with pytest.raises(pydantic.ValidationError, match="cannot be above confirm_frames"):
        TrackerParameters(confirm_hits=6, confirm_frames=5)
