"""ArduPilot's JSON interface: packets, and the state line as SITL's substring search reads it."""

import math
import re
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_bridge.codecs.ardupilot_json import (
    MAGIC_16,
    MAGIC_32,
    PwmRange,
    ServoPacket,
    VehicleState,
    air_data,
    decode_servos,
    encode_state,
    hover_throttle,
    ideal_imu,
    state_from_truth,
    thrust_expo,
)
from firmware_bridge.codecs.errors import CodecError
from signals.samples import TruthState
from tests.worlds.ardupilot_json_sitl import encode_servos

# Section, key and number of values that SITL looks for, in its order; the last two are of newer firmware.
KEYS = [
    ("", "timestamp", 1),
    ("imu", "gyro", 3),
    ("imu", "accel_body", 3),
    ("", "position", 3),
    ("", "attitude", 3),
    ("", "quaternion", 4),
    ("", "velocity", 3),
    *[("", f"rng_{i}", 1) for i in range(1, 7)],
    ("windvane", "direction", 1),
    ("windvane", "speed", 1),
    ("", "airspeed", 1),
    ("", "no_time_sync", 1),
    ("", "no_lockstep", 1),
    ("", "latitude", 1),
    ("", "longitude", 1),
    ("", "altitude", 1),
    ("", "velocity_wind", 3),
    ("battery", "voltage", 1),
    ("battery", "current", 1),
    ("rc", "rc_1", 1),
]
NUMBER = re.compile(r"[-+]?\d+(\.\d*)?([eE][-+]?\d+)?")

LEVEL = VehicleState(
    2_500_000, (0.1, -0.2, 0.3), (0.0, 0.0, -9.80665), (1.0, 2.0, -3.0), (0.5, 0.25, -0.125), (1.0, 0.0, 0.0, 0.0)
)
TRUTH = TruthState(
    4,
    10_000_000,
    (10.0, 20.0, 5.0),
    (1.0, 0.0, 0.0, 0.0),
    (3.0, 4.0, 1.0),
    (0.1, 0.2, 0.3),
    (0.0, 0.0, 0.0),
    (0.0, 0.0, 0.0),
    (0.0,) * 4,
    False,
)


def as_sitl_reads(datagram: bytes) -> dict:
    """Return values as SITL finds them: from two characters after the first occurrence of a name."""
    text = datagram.decode("ascii")
    assert text[0] == "\n"
    assert text[-1] == "\n"
    assert text.count("\n") == 2
    line = text[1:-1]
    found = {}
    for section, key, values in KEYS:
        at = line.find(section)
        if at < 0:
            continue
        at = line.find(key, at + len(section) + 1)
        if at < 0:
            continue
        rest = line[at + len(key) + 2 :]
        if values == 1:
            found[key] = float(NUMBER.match(rest)[0])
        else:
            # sscanf's "[%f, %f, %f]": a blank in the pattern matches any number of blanks.
            numbers = re.match(r"\[" + r",\s*".join([f"({NUMBER.pattern})"] * values), rest)
            assert numbers, f"{key}: {rest[:40]!r}"
            found[key] = [float(n) for n in re.findall(r"[-+.\deE]+", numbers[0])]
    return found


def as_float(value: float) -> float:
    return struct.unpack("<f", struct.pack("<f", value))[0]


def packet(channels=16, magic=None, **changes):
    values = {"frame_rate_hz": 1200, "frame_count": 7, "pwm_us": tuple(range(1000, 1000 + channels))} | changes
    data = encode_servos(ServoPacket(**values))
    return data if magic is None else struct.pack("<H", magic) + data[2:]


@pytest.mark.parametrize(("channels", "magic", "size"), [(16, MAGIC_16, 40), (32, MAGIC_32, 72)])
def test_servo_packets_of_both_sizes(channels, magic, size):
    data = packet(channels)
    assert len(data) == size
    assert struct.unpack_from("<H", data)[0] == magic
    assert decode_servos(data) == ServoPacket(1200, 7, tuple(range(1000, 1000 + channels)))


def test_servo_packet_is_little_endian_as_documented():
    data = struct.pack("<HHI16H", 18458, 400, 0x01020304, *range(16))
    assert decode_servos(data) == ServoPacket(400, 0x01020304, tuple(range(16)))


@pytest.mark.parametrize(
    "data", [b"", b"\0" * 40, packet()[:-1], packet() + b"\0", packet(magic=MAGIC_32), packet(32, magic=MAGIC_16)]
)
def test_invalid_servo_packets_are_refused(data):
    with pytest.raises(CodecError, match="servo packet"):
        decode_servos(data)


def test_pulse_widths_become_controls():
    controls = PwmRange().controls((1000, 1500, 2000, 0, 900, 2100, 65535, 1) + (1250,) * 24)
    assert controls == (0.0, 0.5, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0) + (0.25,) * 8
    assert PwmRange(1100, 1900).controls((1100, 1500, 1900, 0) + (0,) * 12)[:4] == (0.0, 0.5, 1.0, 0.0)
    for low, high in ((0, 2000), (2000, 1000), (1000, 70000)):
        with pytest.raises(CodecError, match="pwm range"):
            PwmRange(low, high)


def test_state_line_is_what_sitl_demands():
    line = encode_state(LEVEL)
    assert b": " not in line
    assert as_sitl_reads(line) == {
        "timestamp": pytest.approx(0.0025, rel=2e-7),
        "gyro": [0.1, -0.2, 0.3],
        "accel_body": [0.0, 0.0, -9.80665],
        "position": [1.0, 2.0, -3.0],
        "velocity": [0.5, 0.25, -0.125],
        "quaternion": [1.0, 0.0, 0.0, 0.0],
    }


def test_optional_fields_are_read_and_do_not_affect_the_others():
    full = LEVEL._replace(
        ranges_m=(0.5, 1.5, 2.5, 3.5, 4.5, 5.5),
        airspeed_mps=11.0,
        windvane=(0.75, 12.0),
    )
    found = as_sitl_reads(encode_state(full))
    assert {key: found[key] for key in as_sitl_reads(encode_state(LEVEL))} == as_sitl_reads(encode_state(LEVEL))
    assert [found[f"rng_{i}"] for i in range(1, 7)] == [0.5, 1.5, 2.5, 3.5, 4.5, 5.5]
    assert (found["airspeed"], found["direction"], found["speed"]) == (11.0, 0.75, 12.0)
    for absent in ("attitude", "latitude", "altitude", "no_time_sync", "no_lockstep", "rc_1"):
        assert absent not in found
    with pytest.raises(CodecError, match="range finders"):
        encode_state(LEVEL._replace(ranges_m=(1.0,) * 7))


def test_a_key_that_contains_another_comes_after_it():
    line = encode_state(LEVEL._replace(airspeed_mps=1.0, windvane=(0.0, 2.0))).decode()
    keys = re.findall(r'"(\w+)":', line)
    for i, key in enumerate(keys):
        for earlier in keys[:i]:
            assert key not in earlier, f"SITL would find {key} in {earlier}"


small = st.floats(-1e6, 1e6, allow_subnormal=False)
vectors = st.tuples(small, small, small)


@given(
    st.integers(0, 10**14),
    vectors,
    vectors,
    vectors,
    vectors,
    st.tuples(*[st.floats(-1.0, 1.0, allow_subnormal=False)] * 4),
    st.lists(st.floats(0.0, 1e3, allow_subnormal=False), max_size=6),
)
def test_sitl_reads_the_numbers_that_were_sent(t_ns, gyro, accel, p, v, q, ranges):
    found = as_sitl_reads(encode_state(VehicleState(t_ns, gyro, accel, p, v, q, tuple(ranges))))
    assert found["position"] == pytest.approx(p, rel=6e-12)
    for key, sent in (("gyro", gyro), ("accel_body", accel), ("velocity", v), ("quaternion", q)):
        # To nine digits: at most one step of a 32-bit float.
        assert [as_float(x) for x in found[key]] == pytest.approx([as_float(x) for x in sent], rel=1.3e-7, abs=1e-38)
    assert [found[f"rng_{i + 1}"] for i in range(len(ranges))] == pytest.approx(ranges, rel=1e-8)
    assert found["timestamp"] == pytest.approx(t_ns * 1e-9, rel=2e-7, abs=1.1e-6)


@pytest.mark.parametrize("tick_ns", [1_000_000, 2_500_000, 4_000_000, 3_003_003, 833_333])
@pytest.mark.parametrize("start_tick", [0, 1_000_000])
def test_sitls_integer_clock_keeps_to_the_benchs(tick_ns, start_tick):
    """SITL adds the difference of two timestamps, as microseconds, and drops the fraction."""
    last_s, clock_us = None, start_tick * tick_ns // 1000
    for tick in range(start_tick, start_tick + 4000):
        seen_s = as_sitl_reads(encode_state(LEVEL._replace(t_ns=tick * tick_ns)))["timestamp"]
        if last_s is not None:
            clock_us = int(clock_us + (seen_s - last_s) * 1e6)
        last_s = seen_s
        assert clock_us == tick * tick_ns // 1000


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e39])
@pytest.mark.parametrize(
    ("changed", "name"),
    [
        (lambda x: {"gyro_F_radps": (0.0, x, 0.0)}, r"gyro_F_radps\[1\]"),
        (lambda x: {"accel_F_mps2": (0.0, 0.0, x)}, r"accel_F_mps2\[2\]"),
        (lambda x: {"p_NF": (x, 0.0, 0.0)}, r"p_NF\[0\]"),
        (lambda x: {"v_NF_N": (0.0, x, -x)}, r"v_NF_N\[1\].*v_NF_N\[2\]"),
        (lambda x: {"q_NF": (1.0, 0.0, 0.0, x)}, r"q_NF\[3\]"),
        (lambda x: {"ranges_m": (1.0, x)}, r"ranges_m\[1\]"),
        (lambda x: {"airspeed_mps": x}, r"airspeed_mps = "),
        (lambda x: {"windvane": (0.0, x)}, r"windvane\[1\]"),
    ],
)
def test_values_that_are_not_finite_are_not_sent(bad, changed, name):
    with pytest.raises(CodecError, match=name):
        encode_state(LEVEL._replace(**changed(bad)))


def test_world_and_body_are_turned_into_ned_and_frd():
    state = state_from_truth(
        TRUTH.t_ns, TRUTH, home_W=(1.0, 2.0, 3.0), accel_B_mps2=(0.5, 0.25, 9.8), gyro_B_radps=TRUTH.w_WB_B
    )
    assert state.p_NF == (18.0, 9.0, -2.0)
    assert state.v_NF_N == (4.0, 3.0, -1.0)
    assert state.gyro_F_radps == (0.1, -0.2, -0.3)
    assert state.accel_F_mps2 == (0.5, -0.25, -9.8)
    # Nose to the east: a right turn of 90 degrees from north.
    assert state.q_NF == pytest.approx((math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)))


def test_ideal_imu_reads_minus_g_down_at_rest_in_any_attitude():
    assert ideal_imu(TRUTH, 9.81) == ((0.0, 0.0, 9.81), TRUTH.w_WB_B)
    rolled = TRUTH._replace(q_WB=(math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0))  # left side up
    assert ideal_imu(rolled, 9.81)[0] == pytest.approx((0.0, 9.81, 0.0))
    falling = TRUTH._replace(a_WB_W=(0.0, 0.0, -9.81))
    assert ideal_imu(falling, 9.81)[0] == pytest.approx((0.0, 0.0, 0.0))


def test_air_data_is_of_the_air_and_seen_from_the_nose():
    moving = TRUTH._replace(v_WB_W=(5.0, 0.0, 0.0))  # ahead: its nose points east
    assert air_data(moving, (0.0, 0.0, 0.0)) == (5.0, (0.0, 5.0))
    assert air_data(moving, (5.0, 0.0, 0.0)) == (0.0, (0.0, 0.0))
    at_rest = TRUTH._replace(v_WB_W=(0.0, 0.0, 0.0))
    airspeed, (direction, speed) = air_data(at_rest, (0.0, 3.0, 0.0))  # from the south, which is to its right
    assert (airspeed, speed) == (3.0, 3.0)
    assert direction == pytest.approx(math.pi / 2)


@given(st.floats(0.0, 1.0), st.floats(0.0, 0.3), st.floats(0.6, 1.0), st.floats(0.0, 1.0))
def test_thrust_is_linear_with_the_expo_for_the_rotors(factor, low, high, wanted):
    def rotor(u):
        return factor * u * u + (1.0 - factor) * u

    expo = thrust_expo(factor, spin_min=low, spin_max=high)
    # ArduPilot's curve, inverted: e a^2 + (1 - e) a = wanted.
    a = wanted if expo < 1e-9 else (expo - 1.0 + math.sqrt((1.0 - expo) ** 2 + 4.0 * expo * wanted)) / (2.0 * expo)
    got = (rotor(low + (high - low) * a) - rotor(low)) / (rotor(high) - rotor(low))
    assert got == pytest.approx(wanted, abs=1e-6)


def test_expo_and_hover_of_a_quadratic_rotor():
    assert thrust_expo(1.0, spin_min=0.15, spin_max=0.95) == pytest.approx(8 / 11)
    assert hover_throttle(0.15, 1.0, spin_min=0.15, spin_max=0.95) == 0.0
    assert hover_throttle(0.95, 1.0, spin_min=0.15, spin_max=0.95) == 1.0
    assert hover_throttle(0.598, 1.0, spin_min=0.15, spin_max=0.95) == pytest.approx((0.598**2 - 0.0225) / 0.88)


def test_channels_of_surfaces_are_signed_about_1500() -> None:
    pwm = PwmRange(1100, 1900, frozenset({1, 2, 3, 4}))
    controls = pwm.controls((1500, 1500, 1000, 2000, 0, 1500) + (0,) * 10)
    assert controls[:6] == (0.5, 0.0, -1.0, 1.0, 0.0, 0.5)
    assert pwm.controls((0, 1250, 900, 2100) + (0,) * 12)[1:4] == (-0.5, -1.0, 1.0)
