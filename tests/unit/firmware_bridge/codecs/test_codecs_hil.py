"""The HIL messages: signs, units, saturation and refusals. Oracle: pymavlink's decoder."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common

from firmware_bridge.codecs import hil
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import MSGID, message_class, pack
from signals.samples import BaroSample, DifferentialPressureSample, GpsSample, ImuSample, MagSample

IMU = ImuSample(0, 0, 0, (0.5, 1.5, 9.81), (0.1, 0.2, 0.3), 25.0)
MAG = MagSample(0, 0, 0, (2.0e-5, 3.0e-6, -4.0e-5))
BARO = BaroSample(0, 0, 0, 95_461.25, 500.5, 18.25)
PITOT = DifferentialPressureSample(0, 0, 0, -187.5, 20.0)
GPS = GpsSample(0, 0, 0, 47.3977418, 8.5455938, 488.125, (3.0, 4.0, -0.5), 0.9, 1.8, 3, 12)
NOT_SENT = ("yaw",)  # zero on the wire
T_NS = 123_456_789_000


def decoded(msgid: int, payload: bytes):
    raw = FrameEncoder(1, 1).frame(msgid, payload)
    return common.MAVLink(None).decode(bytearray(raw))


def sensor(imu=IMU, mag=MAG, baro=BARO):
    return decoded(hil.HIL_SENSOR, hil.hil_sensor_payload(T_NS, imu, mag, baro))


def gps(**changes):
    return decoded(hil.HIL_GPS, hil.hil_gps_payload(T_NS, GPS._replace(**changes)))


def test_units_are_the_dialects():
    for name, fields in hil.UNITS.items():
        theirs = common.mavlink_map[MSGID[name]].fieldunits_by_name
        for field, unit in fields.items():
            assert unit.unit == theirs.get(field, ""), f"{name}.{field}"
        for field in theirs:
            assert field in fields or field in NOT_SENT, f"{name}.{field} has a unit but is not in the table"


def test_sensor_turns_flu_into_frd_and_si_into_mavlink():
    m = sensor()
    assert m.time_usec == T_NS // 1000
    assert (m.xacc, m.yacc, m.zacc) == pytest.approx((0.5, -1.5, -9.81))
    assert (m.xgyro, m.ygyro, m.zgyro) == pytest.approx((0.1, -0.2, -0.3))
    assert (m.xmag, m.ymag, m.zmag) == pytest.approx((0.2, -0.03, 0.4))
    assert m.abs_pressure == pytest.approx(954.6125)
    assert m.pressure_alt == pytest.approx(500.5)
    assert m.temperature == pytest.approx(18.25)
    assert m.id == 0


@pytest.mark.parametrize("imu", [IMU, None])
@pytest.mark.parametrize("mag", [MAG, None])
@pytest.mark.parametrize("baro", [BARO, None])
def test_fields_updated_has_the_groups_of_given_samples(imu, mag, baro):
    expected = (0x3F if imu else 0) | (0x1C0 if mag else 0) | (0x1A00 if baro else 0)
    m = sensor(imu, mag, baro)
    assert m.fields_updated == expected
    assert (m.xmag != 0) == (mag is not None)
    assert (m.abs_pressure != 0) == (baro is not None)


def test_differential_pressure_is_in_hectopascals_with_its_own_bit():
    m = decoded(hil.HIL_SENSOR, hil.hil_sensor_payload(T_NS, IMU, None, None, PITOT))
    assert m.diff_pressure == -1.875
    assert m.fields_updated == 0x3F | 0x400
    assert sensor().diff_pressure == 0.0
    with pytest.raises(CodecError, match=r"pitot\.differential_pressure_pa = nan"):
        hil.hil_sensor_payload(0, IMU, MAG, BARO, PITOT._replace(differential_pressure_pa=math.nan))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    ("imu", "mag", "baro", "name"),
    [
        (lambda x: IMU._replace(accel_mps2=(0.0, x, 0.0)), None, None, r"imu\.accel_mps2\[1\]"),
        (lambda x: IMU._replace(gyro_radps=(0.0, 0.0, x)), None, None, r"imu\.gyro_radps\[2\]"),
        (None, lambda x: MAG._replace(field_tesla=(x, 0.0, 0.0)), None, r"mag\.field_tesla\[0\]"),
        (None, None, lambda x: BARO._replace(pressure_pa=x), r"baro\.pressure_pa"),
        (None, None, lambda x: BARO._replace(temperature_degc=x), r"baro\.temperature_degc"),
    ],
)
def test_values_that_are_not_finite_are_refused_by_name(imu, mag, baro, name, bad):
    with pytest.raises(CodecError, match=name):
        hil.hil_sensor_payload(0, imu(bad) if imu else IMU, mag(bad) if mag else MAG, baro(bad) if baro else BARO)


def test_opposite_infinities_do_not_cancel():
    with pytest.raises(CodecError):
        hil.hil_sensor_payload(0, IMU._replace(accel_mps2=(math.inf, -math.inf, 0.0)), None, None)


def test_values_beyond_a_32_bit_float_are_refused():
    with pytest.raises(CodecError, match="32-bit"):
        hil.hil_sensor_payload(0, IMU._replace(accel_mps2=(1e300, 0.0, 0.0)), None, None)


def test_gps_turns_enu_into_ned_and_si_into_scaled_integers():
    m = gps()
    assert (m.lat, m.lon, m.alt) == (473977418, 85455938, 488125)
    assert (m.vn, m.ve, m.vd) == (400, 300, 50)
    assert m.vel == 500
    assert m.cog == round(math.degrees(math.atan2(3.0, 4.0)) * 100)
    assert (m.eph, m.epv) == (90, 180)
    assert (m.fix_type, m.satellites_visible, m.id, m.yaw) == (3, 12, 0, 0)


@pytest.mark.parametrize("unknown", [math.nan, math.inf, 0.0, -1.0])
def test_accuracy_that_is_not_known_is_65535(unknown):
    m = gps(horizontal_accuracy_m=unknown, vertical_accuracy_m=unknown)
    assert (m.eph, m.epv) == (65535, 65535)


def test_gps_integers_saturate_and_never_pass_for_unknown():
    m = gps(horizontal_accuracy_m=1e6, latitude_deg=300.0, longitude_deg=-300.0, altitude_m=1e9, v_W=(1e4, -1e4, 1e4))
    assert m.eph == 65534
    assert (m.lat, m.lon, m.alt) == (2**31 - 1, -(2**31), 2**31 - 1)
    assert (m.vn, m.ve, m.vd) == (-32768, 32767, -32768)
    assert m.vel == 65534
    assert gps(satellites=1000).satellites_visible == 254


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_position_or_velocity_that_is_not_finite_is_refused(bad):
    for changes in ({"latitude_deg": bad}, {"longitude_deg": bad}, {"altitude_m": bad}, {"v_W": (0.0, bad, 0.0)}):
        with pytest.raises(CodecError, match="HIL_GPS"):
            gps(**changes)


def test_course_is_unknown_at_rest():
    assert gps(v_W=(0.05, 0.05, 0.0)).cog == 65535


@given(st.floats(0.11, 300.0), st.floats(0.0, 2.0 * math.pi))
def test_course_is_atan2(speed, angle):
    north, east = speed * math.cos(angle), speed * math.sin(angle)
    expected = math.degrees(math.atan2(east, north)) % 360.0
    course = gps(v_W=(east, north, 0.0)).cog
    assert 0 <= course < 36000
    assert abs((course / 100.0 - expected + 180.0) % 360.0 - 180.0) < 0.005 + 1e-9


def answer(controls, mode=129, time_us=4000):
    m = message_class("HIL_ACTUATOR_CONTROLS")(time_us, tuple(controls), mode, 1)
    (frame,) = FrameParser().feed(FrameEncoder(1, 1).frame(m.MSGID, pack(m)))
    return frame


def test_actuators():
    controls = [i / 16 for i in range(16)]
    got = hil.actuator_frame(7, answer(controls))
    assert got == (7, 4_000_000, tuple(controls), True, 129)
    assert not hil.actuator_frame(7, answer([0.0] * 16, mode=1)).armed


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1.001, -1.001])
@pytest.mark.parametrize("index", [0, 3, 15])
def test_controls_out_of_range_are_refused(bad, index):
    controls = [0.5] * 16
    controls[index] = bad
    with pytest.raises(CodecError, match=rf"{{{index}: "):
        hil.actuator_frame(0, answer(controls))


@given(st.tuples(*[st.floats(-1e3, 1e3, width=32)] * 6))
def test_sensor_floats_are_exactly_the_nearest_32_bit_ones(v):
    m = sensor(imu=IMU._replace(accel_mps2=v[:3], gyro_radps=v[3:]))
    assert (m.xacc, -m.yacc, -m.zacc, m.xgyro, -m.ygyro, -m.zgyro) == v


def test_a_payload_from_a_newer_sender_is_read():
    frame = answer([0.0] * 16)
    longer = Frame(*frame[:4], frame.payload + struct.pack("<f", 1.0), b"")
    assert hil.actuator_frame(0, longer).controls == (0.0,) * 16
