"""Range finder and optical flow on the wire: axes, units, saturation, refusals. Oracle: pymavlink's decoder."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.hil_ranging import (
    DISTANCE_SENSOR,
    HIL_OPTICAL_FLOW,
    distance_sensor_payload,
    hil_optical_flow_payload,
)
from firmware_bridge.codecs.mavlink_frame import FrameEncoder
from signals.rotation import applied, matrix_of
from signals.samples import FlowSample, RangeSample

T_NS = 123_456_789_000
RANGE = RangeSample(3, T_NS, T_NS, 2.343, 0.3, 12.0, 0.05, 100, (0.0, 0.0, -1.0))
FLOW = FlowSample(3, T_NS, T_NS, 20_000_000, (0.01, 0.02), (0.001, 0.002, 0.003), 180, 2.5, 31.25)


def decoded(msgid: int, payload: bytes):
    return common.MAVLink(None).decode(bytearray(FrameEncoder(1, 1).frame(msgid, payload)))


def distance(**changes):
    return decoded(DISTANCE_SENSOR, distance_sensor_payload(T_NS, RANGE._replace(**changes)))


def flow(**changes):
    return decoded(HIL_OPTICAL_FLOW, hil_optical_flow_payload(T_NS, FLOW._replace(**changes)))


def test_distance_in_centimetres_looking_down() -> None:
    m = distance()
    assert (m.time_boot_ms, m.current_distance, m.min_distance, m.max_distance) == (123_456, 234, 30, 1200)
    assert m.orientation == common.MAV_SENSOR_ROTATION_PITCH_270
    assert m.type == common.MAV_DISTANCE_SENSOR_LASER
    assert m.covariance == 25
    assert m.signal_quality == 100


@pytest.mark.parametrize(
    ("axis_B", "rotation"),
    [
        ((1.0, 0.0, 0.0), common.MAV_SENSOR_ROTATION_NONE),
        ((0.0, -1.0, 0.0), common.MAV_SENSOR_ROTATION_YAW_90),  # right
        ((-1.0, 0.0, 0.0), common.MAV_SENSOR_ROTATION_YAW_180),
        ((0.0, 1.0, 0.0), common.MAV_SENSOR_ROTATION_YAW_270),
        ((math.sqrt(0.5), -math.sqrt(0.5), 0.0), common.MAV_SENSOR_ROTATION_YAW_45),
        ((0.0, 0.0, 1.0), common.MAV_SENSOR_ROTATION_PITCH_90),
        ((0.0, 0.0, -1.0), common.MAV_SENSOR_ROTATION_PITCH_270),
    ],
)
def test_directions_with_a_name(axis_B, rotation) -> None:
    m = distance(axis_B=axis_B)
    assert (m.orientation, m.quaternion) == (rotation, [0.0, 0.0, 0.0, 0.0])


@given(st.floats(-179.0, 179.0), st.floats(-89.0, 89.0))
def test_any_other_direction_is_a_rotation_from_forward(yaw_deg: float, pitch_deg: float) -> None:
    yaw, pitch = math.radians(yaw_deg), math.radians(pitch_deg)
    axis_F = (math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), math.sin(pitch))
    m = distance(axis_B=(axis_F[0], -axis_F[1], -axis_F[2]))
    if m.orientation != common.MAV_SENSOR_ROTATION_CUSTOM:
        assert min(abs(pitch_deg), abs(yaw_deg % 45.0)) < 1e-3
        return
    w, x, y, z = m.quaternion
    turned = applied(matrix_of((w, x, y, z)), (1.0, 0.0, 0.0))
    assert turned == pytest.approx(axis_F, abs=1e-6)


def test_no_distance_is_marked_invalid_and_not_unknown() -> None:
    m = distance(quality=0, distance_m=0.0, sigma_m=0.0)
    assert (m.signal_quality, m.covariance) == (1, 255)
    assert distance(quality=1).signal_quality == 2  # 1 would mean that it is invalid


def test_distance_saturates() -> None:
    m = distance(distance_m=1e4, max_distance_m=1e4, sigma_m=3.0)
    assert (m.current_distance, m.max_distance, m.covariance) == (65535, 65535, 254)
    assert distance(distance_m=-1.0).current_distance == 0


def test_flow_turns_flu_into_frd() -> None:
    m = flow()
    assert (m.time_usec, m.integration_time_us) == (T_NS // 1000, 20_000)
    assert (m.integrated_x, m.integrated_y) == pytest.approx((0.01, -0.02))
    assert (m.integrated_xgyro, m.integrated_ygyro, m.integrated_zgyro) == pytest.approx((0.001, -0.002, -0.003))
    assert (m.temperature, m.quality, m.distance, m.time_delta_distance_us) == (3125, 180, 2.5, 0)


def test_forward_flight_moves_the_picture_as_mavlink_says() -> None:
    """common.xml: linear motion along the positive X axis (F: forward) induces a positive integrated_y, and along the
    positive Y axis (right) a negative integrated_x. In B, forward at v over d turns the picture by -v/d about y."""
    speed, height, dt = 2.0, 4.0, 0.02
    assert flow(flow_rad=(0.0, -speed / height * dt)).integrated_y > 0.0
    right = (-speed) / height * dt  # velocity to the right is -y in B: w_x + v_y / d
    assert flow(flow_rad=(right, 0.0)).integrated_x < 0.0


def test_unknown_distance_is_minus_one() -> None:
    assert flow(distance_m=-5.0).distance == -1.0


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_not_finite_is_refused(bad: float) -> None:
    for field in ("distance_m", "min_distance_m", "max_distance_m", "sigma_m"):
        with pytest.raises(CodecError, match="finite"):
            distance(**{field: bad})
    for changes in ({"flow_rad": (bad, 0.0)}, {"gyro_rad": (0.0, bad, 0.0)}, {"temperature_degc": bad}):
        with pytest.raises(CodecError, match="finite"):
            flow(**changes)
    with pytest.raises(CodecError, match="fit"):
        flow(flow_rad=(1e300, 0.0))


@given(st.floats(-1e5, 1e5), st.floats(0, 1e5), st.integers(-5, 300))
def test_any_finite_sample_can_be_sent(distance_m: float, sigma_m: float, quality: int) -> None:
    m = distance(distance_m=distance_m, sigma_m=sigma_m, quality=quality)
    assert abs(m.current_distance - min(max(distance_m * 100, 0), 65535)) <= 0.5 + 1e-6
    assert 1 <= m.signal_quality <= 100
