"""External vision: its frame, its errors, and the message that carries it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.hil_odometry import ODOMETRY, odometry_payload
from firmware_bridge.codecs.hil_ranging import ranging_message
from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import unpack
from signals.rotation import applied, conjugate, matrix_of, product
from signals.samples import OdometrySample, TruthState, Vec3
from sim.scene.scene import load_scene
from sim.sensors.catalog import make_sensor
from sim.sensors.sensor import Installation

EXACT = {
    "position_noise_m": 0.0, "attitude_noise_rad": 0.0, "velocity_noise_mps": 0.0, "scale_error": 0.0,
    "position_walk_m_per_rts": 0.0, "heading_walk_rad_per_rts": 0.0, "latency_s": 0.02,
}  # fmt: skip
PERIOD_NS = 20_000_000
FIELD = load_scene("airfield")


def sensor(seed: int = 3, **overrides: Any) -> Any:
    installation = Installation("vision", rate_hz=50.0, seed=seed, scene=FIELD, step_ns=4_000_000)
    return make_sensor(installation, kind="external_vision", overrides={**EXACT, **overrides})


def truth(k: int, p_W: Vec3, yaw_rad: float = 0.0, v_W: Vec3 = (0.0, 0.0, 0.0)) -> TruthState:
    q = (math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2))
    zero = (0.0, 0.0, 0.0)
    return TruthState(k, k * PERIOD_NS, p_W, q, v_W, zero, zero, zero, (), False)


def test_without_errors_it_is_the_pose_in_the_frame_of_the_start() -> None:
    yaw = 0.7
    vision = sensor()
    assert vision.sample(truth(0, (3.0, 4.0, 0.1), yaw), 0).p_OB == (0.0, 0.0, 0.0)
    there = truth(1, (3.0 + 2.0 * math.cos(yaw), 4.0 + 2.0 * math.sin(yaw), 1.1), yaw + 0.5, (1.0, 0.0, 0.0))
    sample = vision.sample(there, 1)
    assert sample.p_OB == pytest.approx((2.0, 0.0, 1.0))  # ahead and up
    assert 2.0 * math.atan2(sample.q_OB[3], sample.q_OB[0]) == pytest.approx(0.5)
    assert sample.v_OB_B == pytest.approx((math.cos(yaw + 0.5), -math.sin(yaw + 0.5), 0.0))
    assert sample.t_available_ns - sample.t_capture_ns == 20_000_000


def test_with_heading_north_x_is_north_and_y_west() -> None:
    vision = sensor(heading="north")
    vision.sample(truth(0, (0.0, 0.0, 0.0), 0.7), 0)
    assert vision.sample(truth(1, (2.0, 5.0, 0.0), 0.7), 1).p_OB == pytest.approx((5.0, -2.0, 0.0))


def test_white_noise_has_the_stated_deviations() -> None:
    vision = sensor(position_noise_m=0.1, attitude_noise_rad=0.01, velocity_noise_mps=0.2)
    samples = [vision.sample(truth(k, (0.0, 0.0, 0.0)), k) for k in range(4000)]
    for field, sigma in (("p_OB", 0.1), ("v_OB_B", 0.2)):
        values = np.array([getattr(s, field) for s in samples])
        assert np.abs(values.mean(axis=0)).max() < 4 * sigma / math.sqrt(4000)
        assert values.std(axis=0) == pytest.approx([sigma] * 3, rel=0.05)
    angles = 2.0 * np.array([s.q_OB[1:] for s in samples])
    assert angles.std(axis=0) == pytest.approx([0.01] * 3, rel=0.05)
    assert np.linalg.norm([s.q_OB for s in samples], axis=1) == pytest.approx(1.0, abs=1e-12)
    assert samples[0][6:] == (0.1, 0.01, 0.2)


def test_walks_grow_with_the_root_of_time_and_the_scale_with_the_path() -> None:
    n, runs = 500, 60
    ends = []
    for seed in range(runs):
        vision = sensor(seed, position_walk_m_per_rts=0.1, heading_walk_rad_per_rts=0.02)
        for k in range(0, n + 1, 50):  # samples may be skipped
            last = vision.sample(truth(k, (0.0, 0.0, 0.0)), k)
        ends.append([*last.p_OB, 2.0 * math.asin(last.q_OB[3])])
    root_s = math.sqrt(n * PERIOD_NS * 1e-9)
    assert np.std(ends, axis=0) == pytest.approx([0.1 * root_s] * 3 + [0.02 * root_s], rel=0.35)
    vision = sensor(scale_error=0.1)
    vision.sample(truth(0, (0.0, 0.0, 0.0)), 0)
    there = vision.sample(truth(1, (10.0, 0.0, 0.0), v_W=(5.0, 0.0, 0.0)), 1)
    assert there.p_OB[0] / 10.0 == pytest.approx(there.v_OB_B[0] / 5.0)
    assert there.p_OB[0] != pytest.approx(10.0, abs=1e-3)


def test_odometry_has_the_same_rotation_in_forward_right_down() -> None:
    q = (0.8, 0.2, -0.4, 0.4)
    sample = OdometrySample(0, 40_000_000, 60_000_000, (1.0, 2.0, 3.0), q, (4.0, 5.0, 6.0), 0.1, 0.01, 0.2)
    msgid, payload = ranging_message(60_000_000, sample)
    assert (msgid, payload) == (ODOMETRY, odometry_payload(60_000_000, sample))
    (frame,) = FrameParser().feed(FrameEncoder(1, 1).frame(msgid, payload))
    message = unpack(frame)
    assert (message.time_usec, message.frame_id, message.child_frame_id) == (40_000, 20, 12)
    assert (message.x, message.y, message.z) == (1.0, -2.0, -3.0)
    assert (message.vx, message.vy, message.vz) == (4.0, -5.0, -6.0)
    half_turn = (0.0, 1.0, 0.0, 0.0)  # FLU to FRD and back
    expected = product(product(half_turn, q), conjugate(half_turn))
    assert message.q == pytest.approx(expected, abs=1e-7)
    forward = applied(matrix_of(tuple(message.q)), (1.0, 0.0, 0.0))
    x, y, z = applied(matrix_of(q), (1.0, 0.0, 0.0))
    assert forward == pytest.approx((x, -y, -z), abs=1e-6)
    assert [message.pose_covariance[i] for i in (0, 6, 11, 15)] == pytest.approx([0.01, 0.01, 0.01, 1e-4], rel=1e-5)
    assert message.velocity_covariance[0] == pytest.approx(0.04, rel=1e-5)
    assert math.isnan(message.rollspeed)
    with pytest.raises(CodecError, match="ODOMETRY"):
        odometry_payload(0, sample._replace(p_OB=(math.nan, 0.0, 0.0)))
