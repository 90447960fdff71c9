"""The VectorNav codec against a decoder written here from the packet tables of ArduPilot's driver, by byte offsets."""

import math
import struct

import pytest
import scipy  # loads its packages when they are first used
from hypothesis import given
from hypothesis import strategies as st

from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.mavlink_frame import FrameEncoder, FrameParser
from firmware_bridge.codecs.messages import message_class, pack
from firmware_bridge.codecs.vectornav import PacketFormat, Readings, VectorNavDevice, ardupilot_outputs, sentence
from firmware_bridge.links.ardupilot.servo_outputs import has_rebooted, servo_output
from signals.samples import BaroSample, GpsSample, ImuSample, MagSample

IMU_HEADER = bytes.fromhex("fa012107")
ATTITUDE_HEADER = bytes.fromhex("fa1101000601")
INS_HEADER = bytes.fromhex("fa31010006011306")
GNSS_HEADER = bytes.fromhex("fa490300b8261800")
SETUP = (
    "VNASY,0",
    "VNWRG,06,0,1",
    "VNWRG,06,0,2",
    "VNRRG,01",
    "VNWRG,75,3,2,01,0721",
    "VNWRG,76,3,16,31,0001,0106,0613",
    "VNWRG,77,3,160,49,0003,26B8,0018",
    "VNASY,1",
)


def crc16(data):
    """Compute the CRC bit by bit: polynomial 0x1021, from 0, high bit first."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def checked(packet, header, size):
    assert len(packet) == size
    assert packet[: len(header)] == header
    assert crc16(packet[1:-2]) == packet[-2] << 8 | packet[-1]
    assert crc16(packet[1:]) == 0
    return packet


def at(packet, offset, count, kind="f"):
    return struct.unpack_from(f"<{count}{kind}", packet, offset)


def f32(values):
    return struct.unpack(f"<{len(values)}f", struct.pack(f"<{len(values)}f", *values))


def device(model="VN-200T"):
    """Return a device configured by ArduPilot."""
    made = VectorNavDevice(model)
    made.outputs = ardupilot_outputs(made, 400)
    return made


number = st.floats(-1000.0, 1000.0, allow_nan=False, width=32)
vector = st.tuples(number, number, number)


def test_crc_of_the_check_string():
    assert crc16(b"123456789") == 0x31C3
    packet = PacketFormat([(0, 1)]).encode(Readings(startup_ns=7))
    assert packet == bytes.fromhex("fa010100") + (7).to_bytes(8, "little") + crc16(packet[1:-2]).to_bytes(2, "big")


@given(vector, vector, vector, number, st.floats(1e3, 1.1e5), st.integers(0, 2**63))
def test_imu_packet(accel, gyro, field, temperature, pressure, t_ns):
    readings = Readings(startup_ns=t_ns)
    readings.take_imu(ImuSample(0, 0, 0, accel, gyro, temperature))
    readings.take_mag(MagSample(0, 0, 0, tuple(b * 1e-4 for b in field)))
    readings.take_baro(BaroSample(0, 0, 0, pressure, 0.0, 15.0))
    packet = checked(device().outputs[75].packet.encode(readings), IMU_HEADER, 82)
    assert at(packet, 4, 1, "Q") == (t_ns,)
    accel_F, gyro_F = (accel[0], -accel[1], -accel[2]), (gyro[0], -gyro[1], -gyro[2])
    assert at(packet, 12, 3) == gyro_F
    assert at(packet, 24, 3) == accel_F
    assert at(packet, 36, 3) == accel_F
    assert at(packet, 48, 3) == gyro_F
    assert at(packet, 60, 3) == pytest.approx((field[0], -field[1], -field[2]), rel=1e-6, abs=1e-6)
    assert at(packet, 72, 1) == (temperature,)
    assert at(packet, 76, 1)[0] * 1000.0 == pytest.approx(pressure, rel=1e-6)


def solve(readings, q_WB, **changes):
    wanted = {
        "lla": (47.4, 8.5, 488.0), "v_W": (1.0, 2.0, 3.0), "attitude_sigma_deg": 0.25, "position_sigma_m": 0.5,
        "velocity_sigma_mps": 0.125, "status": 6,
    }  # fmt: skip
    readings.take_solution(q_WB, **(wanted | changes))


def rotated(q, v):
    """Return R(q) v with q = (x, y, z, w)."""
    return tuple(scipy.spatial.transform.Rotation.from_quat(q).apply(v))


@given(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: sum(c * c for c in q) > 0.01))
def test_ins_packet_turns_body_to_north_east_down(q):
    norm = math.sqrt(sum(c * c for c in q))
    w, x, y, z = (c / norm for c in q)
    readings = Readings(startup_ns=9)
    solve(readings, (w, x, y, z))
    packet = checked(device().outputs[76].packet.encode(readings), INS_HEADER, 104)
    # Forward (1, 0, 0) and down (0, 0, -1 in FLU) of the body in ENU by the sample's own quaternion, then in NED.
    for v_flu, v_frd in (((1.0, 0.0, 0.0), (1.0, 0.0, 0.0)), ((0.0, 0.0, -1.0), (0.0, 0.0, 1.0))):
        e, n, u = rotated((x, y, z, w), v_flu)
        assert rotated(at(packet, 28, 4), v_frd) == pytest.approx((n, e, -u), abs=1e-6)
    # The angles agree with the quaternion.
    yaw, pitch, _ = (math.radians(a) for a in at(packet, 16, 3))
    north, east, down = rotated(at(packet, 28, 4), (1.0, 0.0, 0.0))
    assert -math.sin(pitch) == pytest.approx(down, abs=1e-5)
    assert (math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw)) == pytest.approx((north, east), abs=1e-3)


@given(st.floats(-90, 90), st.floats(-180, 180), number, vector)
def test_ins_packet_place_and_velocity(latitude, longitude, altitude, velocity):
    readings = Readings()
    solve(readings, (1.0, 0.0, 0.0, 0.0), lla=(latitude, longitude, altitude), v_W=velocity)
    packet = checked(device().outputs[76].packet.encode(readings), INS_HEADER, 104)
    assert at(packet, 44, 3) == (0.25, 0.25, 0.25)
    assert at(packet, 56, 1, "H") == (6,)
    assert at(packet, 58, 3, "d") == (latitude, longitude, altitude)
    assert at(packet, 82, 3) == (velocity[1], velocity[0], -velocity[2])
    assert at(packet, 94, 2) == (0.5, 0.125)


def test_attitude_packet_of_a_vn_100():
    readings = Readings(startup_ns=3)
    solve(readings, (1.0, 0.0, 0.0, 0.0))  # level, facing east
    outputs = device("VN-100").outputs
    assert sorted(outputs) == [75, 76]
    packet = checked(outputs[76].packet.encode(readings), ATTITUDE_HEADER, 56)
    assert at(packet, 14, 3) == pytest.approx((90.0, 0.0, 0.0), abs=1e-5)
    assert at(packet, 26, 4) == pytest.approx((0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)), abs=1e-6)


GPS = GpsSample(0, 0, 0, 47.5, 8.25, 488.5, (1.0, 2.0, -3.0), 0.5, 0.75, 3, 14)


@given(vector, st.floats(0.01, 100), st.integers(0, 6), st.integers(0, 40))
def test_gnss_packet(velocity, accuracy, fix, satellites):
    readings = Readings(startup_ns=5)
    sample = GPS._replace(v_W=velocity, horizontal_accuracy_m=accuracy, fix_type=fix, satellites=satellites)
    readings.take_gps(sample, 1_451_347_218_000_000_000)
    packet = checked(device().outputs[77].packet.encode(readings), GNSS_HEADER, 110)
    assert at(packet, 8, 2, "Q") == (5, 1_451_347_218_000_000_000)
    assert packet[24:26] == bytes((satellites, fix))
    assert at(packet, 26, 3, "d") == (47.5, 8.25, 488.5)
    assert at(packet, 50, 3) == (velocity[1], velocity[0], -velocity[2])
    assert at(packet, 62, 3) == f32((accuracy, accuracy, 0.75))
    horizontal, vertical = at(packet, 78, 7)[4], at(packet, 78, 7)[3]
    assert horizontal / vertical == pytest.approx(accuracy / 0.75, rel=1e-5)
    assert packet[106:108] == bytes((satellites, fix))


def test_unknown_gnss_accuracy_is_sent_as_a_large_one():
    readings = Readings()
    readings.take_gps(GPS._replace(horizontal_accuracy_m=math.inf), 0)
    assert readings.gnss_sigma_N_m[0] == 9999.0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_nan_is_refused_by_name(bad):
    readings = Readings()
    imu = ImuSample(0, 0, 0, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0), 25.0)
    with pytest.raises(CodecError, match=r"imu\.accel_mps2\[1\]"):
        readings.take_imu(imu._replace(accel_mps2=(0.0, bad, 9.8)))
    with pytest.raises(CodecError, match=r"imu\.gyro_radps\[2\]"):
        readings.take_imu(imu._replace(gyro_radps=(0.0, 0.0, bad)))
    with pytest.raises(CodecError, match=r"mag\.field_tesla\[0\]"):
        readings.take_mag(MagSample(0, 0, 0, (bad, 0.0, 0.0)))
    with pytest.raises(CodecError, match=r"baro\.pressure_pa "):
        readings.take_baro(BaroSample(0, 0, 0, bad, 0.0, 0.0))
    with pytest.raises(CodecError, match=r"gps\.altitude_m"):
        readings.take_gps(GPS._replace(altitude_m=bad), 0)
    with pytest.raises(CodecError, match=r"gps\.v_W\[0\]"):
        readings.take_gps(GPS._replace(v_W=(bad, 0.0, 0.0)), 0)
    with pytest.raises(CodecError, match=r"solution\.q_WB\[0\]"):
        solve(readings, (bad, 0.0, 0.0, 0.0))
    with pytest.raises(CodecError, match=r"gps\.vertical_accuracy_m"):
        readings.take_gps(GPS._replace(vertical_accuracy_m=math.nan), 0)


def test_values_beyond_a_float_are_refused():
    readings = Readings(accel_F_mps2=(1e39, 0.0, 0.0))
    with pytest.raises(CodecError, match="does not fit"):
        device().outputs[75].packet.encode(readings)


# ---- the set-up


def talk(made, *texts):
    return [made.take(sentence(text)) for text in texts]


def test_checksums_of_known_sentences():
    assert sentence("VNRRG,01") == b"$VNRRG,01*72\r\n"
    assert sentence("VNRRG,01", long=True) == f"$VNRRG,01*{crc16(b'VNRRG,01'):04X}\r\n".encode()


def test_the_whole_set_up_is_answered_and_remembered():
    made = VectorNavDevice("VN-200T-CR")
    assert not (made.streaming and made.outputs)
    answers = talk(made, *SETUP)
    for text, answer in zip(SETUP, answers, strict=True):
        wanted = text + ",VN-200T-CR" if text == "VNRRG,01" else text
        assert answer == sentence(wanted)
    assert made.streaming
    assert made.outputs
    assert made.starts == 1
    assert made.outputs == ardupilot_outputs(made, 400)
    assert [(n, o.divisor, o.packet.size) for n, o in made.outputs.items()] == [
        (75, 2, 82),
        (76, 16, 104),
        (77, 160, 110),
    ]
    assert made.load_bytes_per_s == 400 * 82 + 50 * 104 + 5 * 110


@pytest.mark.parametrize(
    ("model", "base", "divisors"),
    [
        ("VN-100", 800, (2, 16)),
        ("VN-200T", 800, (2, 16, 160)),
        ("VN-300", 400, (1, 8, 80)),
        ("VN-310", 800, (2, 16, 160)),
    ],
)
def test_rates_by_model(model, base, divisors):
    made = device(model)
    assert made.base_rate_hz == base
    assert tuple(out.divisor for out in made.outputs.values()) == divisors


@given(st.lists(st.integers(1, 20), min_size=1, max_size=40), st.binary(max_size=50).filter(lambda b: b"$" not in b))
def test_the_answers_depend_on_the_stream_only(cuts, noise):
    stream = noise + b"\r\n".join(sentence(text) for text in SETUP) + b"$VNRRG,0" + sentence("VNRRG,01")
    whole, cut = VectorNavDevice(), VectorNavDevice()
    wanted = whole.take(stream)
    got, pos = b"", 0
    for size in cuts:
        got += cut.take(stream[pos : pos + size])
        pos += size
    assert got + cut.take(stream[pos:]) == wanted
    assert wanted.endswith(sentence("VNRRG,01,VN-200T"))
    assert cut.outputs == whole.outputs


@given(st.binary(max_size=2000))
def test_noise_between_sentences_is_ignored(noise):
    made = VectorNavDevice()
    made.take(noise)
    assert made.take(b"\r\n" + sentence("VNRRG,01")).endswith(sentence("VNRRG,01,VN-200T"))


def test_a_repeated_set_up_is_one_start_and_a_later_one_another():
    made = VectorNavDevice()
    talk(made, "VNASY,0", *SETUP, "VNASY,1")
    assert made.starts == 1
    talk(made, "VNASY,0")
    assert not (made.streaming and made.outputs)
    talk(made, *SETUP)
    assert made.starts == 2


@pytest.mark.parametrize(
    ("line", "code"),
    [
        (b"$VNRRG,01*00\r\n", 3),
        (sentence("VNXXX,1"), 4),
        (sentence("VNWRG,75"), 5),
        (sentence("VNWRG,75,3,2,31,0001"), 5),
        (sentence("VNWRG,75,3,2,01,0001,0002"), 6),
        (sentence("VNWRG,75,3,0,01,0721"), 7),  # EAHRS_RATE above the base rate
        (sentence("VNWRG,75,3,2,01,8000"), 7),
        (sentence("VNWRG,75,3,2,01,zz"), 7),
        (sentence("VNWRG,75,3,2,02,0001"), 7),  # the time group is not known here
        (sentence("VNRRG,99"), 8),
        (sentence("VNWRG,01,VN-300"), 9),
    ],
)
def test_errors_are_answered_by_number_and_reported_as_text(line, code):
    made = VectorNavDevice()
    assert made.take(line) == sentence(f"VNERR,{code:02d}")
    assert made.refused
    assert not made.outputs


def test_other_forms_of_checksum():
    made = VectorNavDevice()
    assert made.take(sentence("VNRRG,01", long=True)) == sentence("VNRRG,01,VN-200T", long=True)
    assert made.take(b"$VNRRG,01*XX\r\n") == sentence("VNRRG,01,VN-200T")


def test_registers_are_remembered_and_outputs_can_be_switched_off():
    made = device()
    talk(made, "VNWRG,07,20", "VNWRG,77,0,160,49,0003,26B8,0018")
    assert made.take(sentence("VNRRG,07")) == sentence("VNRRG,07,20")
    assert sorted(made.outputs) == [75, 76]
    talk(made, "VNRFS")
    assert not (made.streaming and made.outputs)


# ---- SERVO_OUTPUT_RAW


def servo_frame(**fields):
    names = {f"servo{i}_raw": 1000 + i for i in range(1, 17)}
    message = message_class("SERVO_OUTPUT_RAW")(**({"time_usec": 42, "port": 0} | names | fields))
    return FrameParser().feed(FrameEncoder(1, 1).frame(message.MSGID, pack(message)))[0]


def test_servo_outputs_in_order():
    assert servo_output(servo_frame()) == (42, tuple(range(1001, 1017)))
    cut = servo_frame(**{f"servo{i}_raw": 0 for i in range(5, 17)})
    assert servo_output(cut) == (42, (1001, 1002, 1003, 1004) + (0,) * 12)
    short = cut._replace(payload=cut.payload[:21])  # MAVLink 1: eight outputs
    assert servo_output(short) == servo_output(cut)
    assert servo_output(servo_frame(port=1)) is None


@pytest.mark.parametrize(
    ("before_us", "after_us", "anew"),
    [
        (30_000_000, 2_000_000, True),
        (4_000_000_000, 2_000_000, True),
        (5_000_000, 5_004_000, False),
        (5_004_000, 5_000_000, False),
        (2**32 - 1000, 3000, False),
        (0, 100_000_000, False),
    ],
)
def test_a_time_that_goes_back_is_a_reboot_and_one_that_wraps_is_not(before_us, after_us, anew):
    assert has_rebooted(before_us, after_us) is anew
