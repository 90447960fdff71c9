"""Directions of LiDAR beams, and their origins on a moving vehicle, against the formulas."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pydantic
import pytest

from signals.samples import TruthState
from sim._kernels import sweep_rays
from sim.sensors.lidar_pattern import RosettePattern, SpinningPattern
from sim.sensors.presets import PRESETS
from sim.sensors.sweep_motion import at_rest, sweep_motion
from tests.worlds.mjcf_world import truth_at

T_NS = 100_000_000
ZERO = (0.0, 0.0, 0.0)


def pattern_of(preset: str) -> Any:
    return PRESETS[preset].parameters.pattern  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("preset", "channels", "columns", "lowest_deg", "highest_deg"),
    [
        ("vlp16", 16, 1808, -15.0, 15.0),
        ("hdl32e", 32, 2170, -30.67, 10.67),
        ("os1_64", 64, 1024, -16.611, 16.611),
    ],
)
def test_spinning_devices_look_where_their_tables_say(
    preset: str, channels: int, columns: int, lowest_deg: float, highest_deg: float
) -> None:
    pattern = pattern_of(preset)
    sweep = pattern.over(T_NS).sweep(0)
    n = channels * columns
    assert pattern.points(T_NS) == n == len(sweep.directions_L)
    d = sweep.directions_L
    assert np.linalg.norm(d, axis=1) == pytest.approx(1.0, abs=1e-14)
    elevation_deg = np.degrees(np.arcsin(d[:, 2]))
    assert elevation_deg.min() == pytest.approx(lowest_deg, abs=1e-9)
    assert elevation_deg.max() == pytest.approx(highest_deg, abs=1e-9)
    # Rings from the lowest up, each with its own elevation.
    by_ring = np.array([elevation_deg[sweep.ring == k].mean() for k in range(channels)])
    assert (np.diff(by_ring) > 0.3).all()
    assert all(np.ptp(elevation_deg[sweep.ring == k]) < 1e-9 for k in range(channels))
    # Fired in the order of time, all within the turn.
    offset = sweep.time_offset_ns.astype(np.int64)
    assert (np.diff(offset) >= 0).all()
    assert offset[0] == -T_NS
    assert offset[-1] < 0
    # Clockwise from behind, the head turning while the channels fire.
    stagger = np.tile(np.radians(pattern.azimuth_offset_deg or (0.0,) * channels), columns)
    azimuth = math.pi - 2.0 * math.pi * (offset + T_NS) / T_NS + stagger
    wrapped = np.angle(np.exp(1j * (np.arctan2(d[:, 1], d[:, 0]) - azimuth)))
    assert np.abs(wrapped).max() < 1e-12


def test_firing_order_and_vertical_correction_of_the_vlp16() -> None:
    sweep = pattern_of("vlp16").over(T_NS).sweep(3)
    assert np.degrees(np.arcsin(sweep.directions_L[:4, 2])) == pytest.approx([-15, 1, -13, 3])
    assert np.diff(sweep.time_offset_ns[:17]).tolist() == [2304] * 15 + [55_296 - 15 * 2304]
    assert sweep.origin_z_m[:2].tolist() == [0.0112, -0.0007]


def test_overlapping_columns_are_put_in_the_order_of_time() -> None:
    wide = SpinningPattern(kind="spinning", elevation_deg=(0.0, 1.0), firing_ns=1_500_000, columns=100, clockwise=False)
    sweep = wide.over(T_NS).sweep(0)
    assert (np.diff(sweep.time_offset_ns) >= 0).all()
    assert sweep.ring[:4].tolist() == [0, 0, 1, 0]  # 0, 1, 1.5, 2 ms
    assert np.arctan2(*sweep.directions_L[1, 1::-1]) == pytest.approx(-math.pi + 2 * math.pi / 100)


def test_the_rosette_is_the_sum_of_two_turning_prisms_an_hour_on() -> None:
    pattern = RosettePattern(kind="rosette", field_of_view_deg=38.4, prism_rpm=(7294, -4664), points_per_s=100_000)
    running = pattern.over(T_NS)
    seen = []
    for seq in (0, 1, 36_011):
        sweep = running.sweep(seq)
        assert len(sweep.directions_L) == 10_000
        turns = [
            [(rpm * (seq * T_NS + i * 10_000)) % 60_000_000_000 / 6e10 for i in range(0, 10_000, 97)]
            for rpm in (7294, -4664)
        ]
        r = 0.5 * math.tan(math.radians(19.2)) * np.sum(np.exp(2j * np.pi * np.array(turns)), axis=0)
        exact = np.stack([np.ones(len(r)), r.real, r.imag], axis=-1)
        exact /= np.linalg.norm(exact, axis=1)[:, None]
        assert sweep.directions_L[::97] == pytest.approx(exact, abs=1e-12)
        off_axis_deg = np.degrees(np.arccos(sweep.directions_L[:, 0]))
        assert off_axis_deg.max() <= 19.2 + 1e-9
        assert off_axis_deg.max() > 19.0
        seen.append(sweep.directions_L.tobytes())
    assert len(set(seen)) == 3


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"columns": None}, "either column_ns or columns"),
        ({"column_ns": 1000}, "either column_ns or columns"),
        ({"azimuth_offset_deg": (1.0,)}, "1 values for 2 channels"),
        ({"columns": None, "column_ns": 5000, "firing_ns": 6000}, "do not fit"),
        ({"elevation_deg": ()}, "at least 1"),
        ({"elevation_deg": (95.0, 0.0)}, "less than or equal to 90"),
    ],
)
def test_bad_patterns_are_refused(changes: dict[str, Any], message: str) -> None:
    good: dict[str, Any] = {"kind": "spinning", "elevation_deg": (0.0, 1.0), "firing_ns": 0, "columns": 10}
    SpinningPattern(**good)
    with pytest.raises(pydantic.ValidationError, match=message):
        SpinningPattern(**(good | changes))


def rays_at(now: TruthState, before: TruthState | None, s: Any) -> tuple[Any, Any]:
    """Positions, and where x of B points, at times s [s] before `now`."""
    offset_ns = np.round(np.asarray(s) * 1e9).astype(np.int32)
    n = len(offset_ns)
    origins, directions = np.empty((n, 3)), np.empty((n, 3))
    motion = sweep_motion(now, before)
    sweep_rays(motion, offset_ns, np.zeros((n, 3)), np.tile((1.0, 0, 0), (n, 1)), origins, directions)
    return origins, directions


def test_steady_acceleration_and_steady_turns_are_exact() -> None:
    s = np.arange(-50, 1) * 0.002
    p, v, a = np.array([1.0, 2, 3]), np.array([4.0, -5, 6]), np.array([7.0, 8, -9])
    rate = 3.0

    def truth(t: float) -> TruthState:
        half = 0.5 * rate * t
        return truth_at(
            round(1e9 * (1 + t)),
            p_WB=tuple(p + v * t + 0.5 * a * t * t),
            v_WB_W=tuple(v + a * t),
            a_WB_W=tuple(a),
            q_WB=(math.cos(half), 0.0, 0.0, math.sin(half)),
            w_WB_B=(0.0, 0.0, rate),
        )

    for before in (None, truth(-0.1), truth(-0.15)):
        origins, directions = rays_at(truth(0.0), before, s)
        assert origins == pytest.approx(p + np.outer(s, v) + 0.5 * np.outer(s * s, a), abs=1e-12)
        assert directions == pytest.approx(np.stack([np.cos(rate * s), np.sin(rate * s), 0 * s], axis=-1), abs=1e-12)


def test_a_shaken_vehicle_is_within_the_stated_error() -> None:
    """10 m/s2 at 1 Hz along x, and a roll of 0.2 rad at 1 Hz under a yaw of 1 rad/s."""
    w = 2.0 * math.pi

    def attitude(t: float) -> Any:
        yaw, roll = 0.5 * t, 0.1 * math.sin(w * t)
        return np.array([
            math.cos(yaw) * math.cos(roll), math.cos(yaw) * math.sin(roll),
            math.sin(yaw) * math.sin(roll), math.sin(yaw) * math.cos(roll),
        ])  # fmt: skip

    def truth(t: float) -> TruthState:
        roll, roll_rate = 0.2 * math.sin(w * t), 0.2 * w * math.cos(w * t)
        return truth_at(
            round(1e9 * (1 + t)),
            p_WB=(-10.0 / w**2 * math.sin(w * t), 0.0, 0.0),
            v_WB_W=(-10.0 / w * math.cos(w * t), 0.0, 0.0),
            a_WB_W=(10.0 * math.sin(w * t), 0.0, 0.0),
            q_WB=tuple(attitude(t)),
            w_WB_B=(roll_rate, math.sin(roll), math.cos(roll)),
            alpha_WB_B=ZERO,
        )

    worst_m = worst_rad = worst_taylor_m = 0.0
    for t in np.linspace(0.0, 1.0, 21):
        s = np.linspace(-0.1, 0.0, 30)
        origins, directions = rays_at(truth(t), truth(t - 0.1), s)
        exact_m = np.array([-10.0 / w**2 * math.sin(w * (t + x)) for x in s])
        x_of_B = [
            (1 - 2 * (q[2] ** 2 + q[3] ** 2), 2 * (q[1] * q[2] + q[0] * q[3]), 2 * (q[1] * q[3] - q[0] * q[2]))
            for q in map(attitude, t + s)
        ]
        worst_m = max(worst_m, np.abs(origins[:, 0] - exact_m).max())
        worst_rad = max(worst_rad, np.linalg.norm(directions - np.array(x_of_B), axis=1).max())
        worst_taylor_m = max(worst_taylor_m, np.abs(rays_at(truth(t), None, s)[0][:, 0] - exact_m).max())
    assert worst_m < 3e-4
    assert worst_rad < 2e-4
    assert worst_m < worst_taylor_m < 0.012  # jerk of 63 m/s3 over 0.1 s


def test_a_great_turn_between_samples_falls_back_to_the_rates() -> None:
    spun = truth_at(T_NS, q_WB=(math.cos(0.8), 0.0, 0.0, math.sin(0.8)), w_WB_B=(0.0, 0.0, 1.0))
    assert sweep_motion(spun, truth_at(0)) == sweep_motion(spun, None)
    assert sweep_motion(spun, truth_at(T_NS)) == sweep_motion(spun, None)
    assert at_rest(spun)[5] == ZERO
