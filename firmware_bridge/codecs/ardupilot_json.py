"""Codec of ArduPilot SITL's "JSON" interface: servo packets in, one line of state out. Pure functions.

Servo packet, little-endian, one UDP datagram (libraries/SITL/SIM_JSON.h in ArduPilot):
    16 channels   magic 18458   u16 magic, u16 frame_rate, u32 frame_count, u16 pwm[16]    40 bytes
    32 channels   magic 29569   the same with pwm[32]; the firmware may switch at any packet    72 bytes

State line. SITL does not parse JSON: it searches the first occurrence of a key's name and reads the number or the
bracket two characters after it. So `encode_state` follows these rules:
    - a newline at the beginning and at the end; no space after a colon; numbers only
    - a key whose name contains another's (velocity_wind: velocity) comes after it
    - finite numbers only: a NaN ends ArduPilot with SIGFPE. Refused with `CodecError`, which names the field

World ENU and body FLU are converted to NED and FRD here only (`state_from_truth`).

Rounding: the position is printed with %.12g and read as a double: 5e-12 of the value, at 50 km 50 nm at most. The other
numbers are printed with %.9g and read as 32-bit floats; nine digits keep a float's own 6e-8 of the value. (SITL then
keeps the position in 1e-7 degrees and whole centimetres of altitude: 11 mm and 10 mm, its sensors' resolution.)

Time: SITL adds the difference of two timestamps, in microseconds, to an integer clock and drops the fraction. Without
correction, some differences are 2499.9999 us and lose a microsecond. Timestamps are therefore whole microseconds,
stretched by 1e-7: each difference then exceeds its whole number by a little, and SITL's clock counts exactly the
bench's microseconds, in runs of any length.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, sqrt
from typing import NamedTuple, NoReturn

from firmware_bridge.codecs.errors import CodecError
from signals._kernel import rotate_into_body
from signals.frames import frd_from_flu, ned_from_enu, q_NF_from_q_WB
from signals.samples import Quat, TruthState, Vec3
from signals.units import STANDARD_GRAVITY_MPS2

MAGIC_16 = 18458
MAGIC_32 = 29569
RANGE_FINDERS = 6
CONTROLS = 16  # of an ActuatorFrame

_unpack_16 = struct.Struct("<HHI16H").unpack
_unpack_32 = struct.Struct("<HHI32H").unpack
_BYTES_16, _BYTES_32 = 40, 72
_SEA_LEVEL_KGPM3 = 1.225
_LAPSE_PER_M = 0.0065 / 288.15  # L / T_0
_DENSITY_EXPONENT = 9.80665 / (287.05287 * 0.0065) - 1.0
_LARGEST = 1e30  # far above any physical value; a 32-bit float ends at 3.4e38
_STRETCH_PER_US = 1.0000001e-6  # seconds per microsecond, stretched: see the module's header


class ServoPacket(NamedTuple):
    """A servo packet: the outputs, and the number of the step that SITL requests."""

    frame_rate_hz: int  # requested; the timestamps of the answers decide
    frame_count: int  # 0 after a (re)start, one more after each accepted answer
    pwm_us: tuple[int, ...]  # 16 or 32; 0: no pulse


def decode_servos(datagram: bytes) -> ServoPacket:
    """Decode a servo packet. CodecError for any other bytes."""
    size = len(datagram)
    if size == _BYTES_16:
        values, magic = _unpack_16(datagram), MAGIC_16
    elif size == _BYTES_32:
        values, magic = _unpack_32(datagram), MAGIC_32
    else:
        raise CodecError(f"ArduPilot servo packet: {size} bytes, but 16 channels are {_BYTES_16}, 32 are {_BYTES_32}")
    if values[0] != magic:
        raise CodecError(f"ArduPilot servo packet: magic {values[0]} in {size} bytes, not {magic}")
    return ServoPacket(values[1], values[2], values[3:])


@dataclass(frozen=True)
class PwmRange:
    """Pulse widths of motor off and motor full: the parameters MOT_PWM_MIN and MOT_PWM_MAX.

    `signed` channels are control surfaces: 1000 us is -1, 1500 us 0, 2000 us 1.
    """

    low_us: int = 1000
    high_us: int = 2000
    signed: frozenset[int] = frozenset()

    def __post_init__(self) -> None:
        if not 0 < self.low_us < self.high_us <= 65535:
            raise CodecError(
                f"pwm range {self.low_us}..{self.high_us} us: the first must be below the second, both within 1..65535"
            )

    def controls(self, pwm_us: Sequence[int]) -> tuple[float, ...]:
        """Return the first 16 channels as controls 0..1. No pulse (0) and widths up to `low_us` give 0.

        A signed one is -1..1, and 0 without a pulse.
        """
        low, high = self.low_us, self.high_us
        span = high - low
        controls = [0.0 if pwm <= low else 1.0 if pwm >= high else (pwm - low) / span for pwm in pwm_us[:CONTROLS]]
        for i in self.signed:
            controls[i] = _signed(pwm_us[i])
        return tuple(controls)


def _signed(pwm_us: int) -> float:
    return 0.0 if pwm_us == 0 else min(1.0, max(-1.0, (pwm_us - 1500) / 500))


class VehicleState(NamedTuple):
    """The state for SITL. N is NED with its origin at home, F is the body, FRD; SI units.

    Fields with a default are omitted from the line if they are None (or empty).
    """

    t_ns: int
    gyro_F_radps: Vec3
    accel_F_mps2: Vec3  # specific force: (0, 0, -9.81) at rest
    p_NF: Vec3
    v_NF_N: Vec3
    q_NF: Quat  # w-x-y-z, rotates F into N
    ranges_m: tuple[float, ...] = ()  # rng_1 ... rng_6
    airspeed_mps: float | None = None
    windvane: tuple[float, float] | None = None  # apparent wind: origin [rad from the nose], speed [m/s]


_STATE = (
    '\n{"timestamp":%.12f,"imu":{"gyro":[%.9g,%.9g,%.9g],"accel_body":[%.9g,%.9g,%.9g]},'
    '"position":[%.12g,%.12g,%.12g],"velocity":[%.9g,%.9g,%.9g],"quaternion":[%.9g,%.9g,%.9g,%.9g]%s}\n'
)


def encode_state(state: VehicleState) -> bytes:
    """Encode the line, ASCII. CodecError names each field that is not finite."""
    (t_ns, (gx, gy, gz), (ax, ay, az), (px, py, pz), (vx, vy, vz), (qw, qx, qy, qz)) = state[:6]
    # Squares cannot cancel. NaN fails the comparison; infinity, and values beyond a float's range, exceed it.
    total = gx * gx + gy * gy + gz * gz + ax * ax + ay * ay + az * az + px * px + py * py + pz * pz
    total += vx * vx + vy * vy + vz * vz + qw * qw + qx * qx + qy * qy + qz * qz
    if not total < _LARGEST * _LARGEST:
        _refuse(state)
    more = "" if state[6:] == _DEFAULTS else _optional(state)
    return (
        _STATE
        % ((t_ns // 1000) * _STRETCH_PER_US, gx, gy, gz, ax, ay, az, px, py, pz, vx, vy, vz, qw, qx, qy, qz, more)
    ).encode("ascii")


_DEFAULTS = ((), None, None)


def _optional(state: VehicleState) -> str:
    """Return the optional fields, each after a comma."""
    ranges, airspeed, vane = state[6:]
    if len(ranges) > RANGE_FINDERS:
        raise CodecError(f"ArduPilot state: {len(ranges)} range finders, but SITL takes {RANGE_FINDERS} at most")
    numbers = (*ranges, *(vane or ()), airspeed or 0.0)
    if not all(-_LARGEST < number < _LARGEST for number in numbers):
        _refuse(state)
    text = "".join(f',"rng_{i}":{range_m:.9g}' for i, range_m in enumerate(ranges, start=1))
    if vane is not None:
        text += f',"windvane":{{"direction":{vane[0]:.9g},"speed":{vane[1]:.9g}}}'
    if airspeed is not None:
        text += f',"airspeed":{airspeed:.9g}'
    return text


def _refuse(state: VehicleState) -> NoReturn:
    """Raise CodecError, which names the numbers of `state` that cannot be sent."""
    bad = []
    for name, value in zip(state._fields[1:], state[1:], strict=True):
        for i, number in enumerate(value if isinstance(value, tuple) else (value,)):
            if number is not None and not -_LARGEST < number < _LARGEST:
                bad.append(f"{name}[{i}] = {number!r}" if isinstance(value, tuple) else f"{name} = {number!r}")
    raise CodecError(f"ArduPilot state: {', '.join(bad)}: not a finite number of sensible size, so not sent")


def state_from_truth(
    t_ns: int,
    truth: TruthState,
    *,
    home_W: Vec3,
    accel_B_mps2: Vec3,
    gyro_B_radps: Vec3,
    ranges_m: tuple[float, ...] = (),
) -> VehicleState:
    """Return the state at `truth`, with the IMU's measurement. ENU -> NED, FLU -> FRD, position from `home_W`."""
    x, y, z = truth.p_WB
    return VehicleState(
        t_ns,
        frd_from_flu(gyro_B_radps),
        frd_from_flu(accel_B_mps2),
        (y - home_W[1], x - home_W[0], home_W[2] - z),
        ned_from_enu(truth.v_WB_W),
        q_NF_from_q_WB(truth.q_WB),
        ranges_m,
    )


def ideal_imu(truth: TruthState, gravity_mps2: float = STANDARD_GRAVITY_MPS2) -> tuple[Vec3, Vec3]:
    """Return specific force [m/s2] and rate [rad/s] in B of an error-free IMU at the body origin."""
    a_E, a_N, a_U = truth.a_WB_W
    return rotate_into_body(truth.q_WB, (a_E, a_N, a_U + gravity_mps2)), truth.w_WB_B


def air_data(truth: TruthState, wind_W_mps: Vec3) -> tuple[float, tuple[float, float]]:
    """Return airspeed [m/s], and (origin [rad clockwise from the nose], speed) of the wind at a vane on board."""
    v, w = truth.v_WB_W, wind_W_mps
    air_W = (v[0] - w[0], v[1] - w[1], v[2] - w[2])
    forward, left, _ = rotate_into_body(truth.q_WB, air_W)
    return sqrt(sum(c * c for c in air_W)), (atan2(-left, forward), sqrt(forward * forward + left * left))


def true_airspeed_mps(differential_pressure_pa: float, altitude_m: float) -> float:
    """Return the airspeed of which SITL makes this pressure at an altitude above the sea; 0 for a pressure below 0.

    V = sqrt(2 dp / rho_0) sqrt(rho_0 / rho(h)), with the density of the standard atmosphere below 11 km (ISO 2533),
    rho(h) = rho_0 (1 - L h / T_0)^(g / (R L) - 1). Since 4.3 SITL takes the state's airspeed for the true one: it
    divides by the second root, and its sensor has the pressure of the rest (AP_HAL_SITL/sitl_airspeed.cpp).
    """
    density_ratio = max(1.0 - _LAPSE_PER_M * altitude_m, 0.1) ** _DENSITY_EXPONENT
    return sqrt(2.0 * max(differential_pressure_pa, 0.0) / (_SEA_LEVEL_KGPM3 * density_ratio))


def thrust_expo(thrust_model_factor: float, *, spin_min: float, spin_max: float) -> float:
    """Return the MOT_THST_EXPO that makes ArduPilot's thrust linear on rotors with T ~ f u^2 + (1 - f) u, exactly.

    ArduPilot outputs u = spin_min + (spin_max - spin_min) a with e a^2 + (1 - e) a = the wanted thrust, 0..1. With
    this u, the rotors' thrust above that at spin_min is a quadratic in a without a constant term as well, and e is the
    share of its square. For f = 1 and spin 0.15 to 0.95 it is 8/11.
    """
    f, d = thrust_model_factor, spin_max - spin_min
    square = f * d
    return square / (square + 2.0 * f * spin_min + 1.0 - f)


def hover_throttle(hover_control: float, thrust_model_factor: float, *, spin_min: float, spin_max: float) -> float:
    """Return MOT_THST_HOVER of a vehicle that hovers at `hover_control` (0..1 of the rotor command)."""
    f = thrust_model_factor

    def thrust(u: float) -> float:
        return f * u * u + (1.0 - f) * u

    low = thrust(spin_min)
    return (thrust(hover_control) - low) / (thrust(spin_max) - low)
