"""Codec of a VectorNav inertial navigation system (VN-100, VN-200, VN-300): pure functions and one state machine.

Layouts: VectorNav's interface control documents; their use by ArduPilot's driver: docs/ardupilot-on-a-board.md.

Set-up, text:      $VNWRG,75,3,2,01,0721*CC CR LF     answered with the same, or with $VNERR,nn
    CC is the exclusive or of all characters between $ and *; four digits are a CRC-16 instead, XX means no checksum.
    Register 75 to 77: ports, divisor of the base rate, groups, one mask of fields for each group. The device sends
    any selection of `_FIELDS`.
Measurements, binary, little-endian:     FA groups masks payload CRC
    CRC-16/XMODEM over everything between FA and itself, its high byte first.

World ENU and body FLU are converted to NED and FRD here. A number that is not finite is refused with `CodecError`,
which names the field.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, isfinite, sqrt
from typing import NamedTuple

from fastcrc.crc16 import xmodem

from firmware_bridge.codecs.errors import CodecError
from signals._kernel import roll_pitch_yaw
from signals.frames import frd_from_flu, ned_from_enu, q_NF_from_q_WB
from signals.samples import BaroSample, GpsSample, ImuSample, MagSample, Quat, Vec3

_SYNC = b"\xfa"
_GAUSS_PER_TESLA = 1e4
_KPA_PER_PA = 1e-3

_COMMON, _GNSS1, _ATTITUDE, _INS, _GNSS2 = 0, 3, 4, 5, 6

# (group, field) -> its type, and the attributes of `Readings` that it holds, in order.
_FIELDS: dict[tuple[int, int], tuple[str, tuple[str, ...]]] = {
    (_COMMON, 0): ("Q", ("startup_ns",)),
    (_COMMON, 1): ("Q", ("gps_ns",)),
    (_COMMON, 3): ("3f", ("ypr_deg",)),
    (_COMMON, 4): ("4f", ("q_NF_xyzw",)),
    (_COMMON, 5): ("3f", ("gyro_F_radps",)),
    (_COMMON, 6): ("3d", ("ins_lla",)),
    (_COMMON, 7): ("3f", ("ins_v_N_mps",)),
    (_COMMON, 8): ("3f", ("accel_F_mps2",)),
    (_COMMON, 9): ("6f", ("accel_F_mps2", "gyro_F_radps")),  # "uncompensated"
    (_COMMON, 10): ("5f", ("mag_F_gauss", "temperature_degc", "pressure_kpa")),
    (_COMMON, 12): ("H", ("ins_status",)),
    (_GNSS1, 3): ("B", ("satellites",)),
    (_GNSS1, 4): ("B", ("fix",)),
    (_GNSS1, 5): ("3d", ("gnss_lla",)),
    (_GNSS1, 7): ("3f", ("gnss_v_N_mps",)),
    (_GNSS1, 9): ("3f", ("gnss_sigma_N_m",)),
    (_GNSS1, 10): ("f", ("gnss_v_sigma_mps",)),
    (_GNSS1, 13): ("7f", ("dop",)),
    (_ATTITUDE, 1): ("3f", ("ypr_deg",)),
    (_ATTITUDE, 2): ("4f", ("q_NF_xyzw",)),
    (_ATTITUDE, 8): ("3f", ("ypr_sigma_deg",)),
    (_INS, 0): ("H", ("ins_status",)),
    (_INS, 1): ("3d", ("ins_lla",)),
    (_INS, 4): ("3f", ("ins_v_N_mps",)),
    (_INS, 9): ("f", ("ins_sigma_m",)),
    (_INS, 10): ("f", ("ins_v_sigma_mps",)),
    (_GNSS2, 3): ("B", ("satellites",)),
    (_GNSS2, 4): ("B", ("fix",)),
}

# Bits of the INS status.
INS_TRACKING = 2  # mode, bits 0 and 1
INS_GNSS_FIX = 4

# 1 sigma of a good receiver's velocity, which a GpsSample does not contain.
GNSS_VELOCITY_SIGMA_MPS = 0.1
# Accuracy of a receiver at a dilution of precision of 1.
_RANGE_ERROR_M = 0.6
_UNKNOWN_M = 9999.0


def _finite(name: str, values: Sequence[float]) -> None:
    """Raise CodecError if one of `values` is NaN or infinite."""
    for i, value in enumerate(values):
        if not isfinite(value):
            place = f"{name}[{i}]" if len(values) > 1 else name
            raise CodecError(f"VectorNav: {place} = {value!r}: not a finite number, so not sent")


@dataclass(slots=True)
class Readings:
    """The device's measurements in its units and frames (N: NED, F: FRD). `take_...` refuse non-finite values."""

    startup_ns: int = 0
    gps_ns: int = 0  # since 6 January 1980
    gyro_F_radps: Vec3 = (0.0, 0.0, 0.0)
    accel_F_mps2: Vec3 = (0.0, 0.0, 0.0)  # specific force
    mag_F_gauss: Vec3 = (0.0, 0.0, 0.0)
    temperature_degc: float = 0.0
    pressure_kpa: float = 0.0
    ypr_deg: Vec3 = (0.0, 0.0, 0.0)  # yaw, pitch, roll
    q_NF_xyzw: Quat = (0.0, 0.0, 0.0, 1.0)  # scalar last
    ypr_sigma_deg: Vec3 = (0.0, 0.0, 0.0)
    ins_status: int = 0
    ins_lla: Vec3 = (0.0, 0.0, 0.0)  # degrees, degrees, metres above mean sea level
    ins_v_N_mps: Vec3 = (0.0, 0.0, 0.0)
    ins_sigma_m: float = 0.0
    ins_v_sigma_mps: float = 0.0
    satellites: int = 0
    fix: int = 0  # as MAVLink's GPS_FIX_TYPE: ArduPilot does not convert it
    gnss_lla: Vec3 = (0.0, 0.0, 0.0)
    gnss_v_N_mps: Vec3 = (0.0, 0.0, 0.0)
    gnss_sigma_N_m: Vec3 = (0.0, 0.0, 0.0)
    gnss_v_sigma_mps: float = 0.0
    dop: tuple[float, ...] = (0.0,) * 7  # g, p, t, v, h, n, e

    def take_imu(self, imu: ImuSample) -> None:
        _finite("imu.accel_mps2", imu.accel_mps2)
        _finite("imu.gyro_radps", imu.gyro_radps)
        _finite("imu.temperature_degc", (imu.temperature_degc,))
        self.accel_F_mps2 = frd_from_flu(imu.accel_mps2)
        self.gyro_F_radps = frd_from_flu(imu.gyro_radps)
        self.temperature_degc = imu.temperature_degc

    def take_mag(self, mag: MagSample) -> None:
        _finite("mag.field_tesla", mag.field_tesla)
        x, y, z = frd_from_flu(mag.field_tesla)
        self.mag_F_gauss = (x * _GAUSS_PER_TESLA, y * _GAUSS_PER_TESLA, z * _GAUSS_PER_TESLA)

    def take_baro(self, baro: BaroSample) -> None:
        _finite("baro.pressure_pa", (baro.pressure_pa,))
        self.pressure_kpa = baro.pressure_pa * _KPA_PER_PA

    def take_gps(self, gps: GpsSample, gps_ns: int) -> None:
        """Take a GPS sample. `gps_ns`: its GPS time."""
        lla = (gps.latitude_deg, gps.longitude_deg, gps.altitude_m)
        for name, value in zip(("latitude_deg", "longitude_deg", "altitude_m"), lla, strict=True):
            _finite(f"gps.{name}", (value,))
        _finite("gps.v_W", gps.v_W)
        # A receiver without a fix may report an infinite accuracy, which cannot be sent.
        horizontal, vertical = min(gps.horizontal_accuracy_m, _UNKNOWN_M), min(gps.vertical_accuracy_m, _UNKNOWN_M)
        _finite("gps.horizontal_accuracy_m", (horizontal,))
        _finite("gps.vertical_accuracy_m", (vertical,))
        self.gps_ns = gps_ns
        self.fix = min(max(gps.fix_type, 0), 255)
        self.satellites = min(max(gps.satellites, 0), 255)
        self.gnss_lla = lla
        self.gnss_v_N_mps = ned_from_enu(gps.v_W)
        self.gnss_sigma_N_m = (horizontal, horizontal, vertical)
        self.gnss_v_sigma_mps = GNSS_VELOCITY_SIGMA_MPS
        h, v = horizontal / _RANGE_ERROR_M, vertical / _RANGE_ERROR_M
        p = sqrt(h * h + v * v)
        self.dop = (1.2 * p, p, 0.7 * p, v, h, 0.7 * h, 0.7 * h)

    def take_solution(
        self,
        q_WB: Quat,
        lla: Vec3,
        v_W: Vec3,
        *,
        attitude_sigma_deg: float,
        position_sigma_m: float,
        velocity_sigma_mps: float,
        status: int,
    ) -> None:
        """Take the device's estimate of its motion, with the uncertainty that it reports."""
        _finite("solution.q_WB", q_WB)
        _finite("solution.lla", lla)
        _finite("solution.v_W", v_W)
        _finite("solution.sigma", (attitude_sigma_deg, position_sigma_m, velocity_sigma_mps))
        w, x, y, z = q_NF_from_q_WB(q_WB)
        self.q_NF_xyzw = (x, y, z, w)
        roll, pitch, yaw = roll_pitch_yaw((w, x, y, z))
        self.ypr_deg = (degrees(yaw), degrees(pitch), degrees(roll))
        self.ypr_sigma_deg = (attitude_sigma_deg,) * 3
        self.ins_lla = lla
        self.ins_v_N_mps = ned_from_enu(v_W)
        self.ins_sigma_m = position_sigma_m
        self.ins_v_sigma_mps = velocity_sigma_mps
        self.ins_status = status


class PacketFormat:
    """One selection of fields: `masks` holds (group, mask of fields). CodecError for a field unknown here."""

    def __init__(self, masks: Sequence[tuple[int, int]]) -> None:
        self.masks = tuple(masks)
        groups = 0
        types = "<"
        names: list[str] = []
        for group, mask in self.masks:
            groups |= 1 << group
            for bit in range(16):
                if mask >> bit & 1:
                    if (group, bit) not in _FIELDS:
                        raise CodecError(f"VectorNav: field {bit} of binary group {group} is not supported")
                    kind, attributes = _FIELDS[group, bit]
                    types += kind
                    names += attributes
        self._header = struct.pack(f"<B{len(self.masks)}H", groups, *(mask for _, mask in self.masks))
        self._payload = struct.Struct(types)
        self._names = tuple(names)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PacketFormat) and self.masks == other.masks

    def __hash__(self) -> int:
        return hash(self.masks)

    @property
    def size(self) -> int:
        """Size of one packet [bytes]."""
        return 1 + len(self._header) + self._payload.size + 2

    def has_group(self, group: int) -> bool:
        """Return True if the packet has fields of `group`."""
        return any(g == group and mask for g, mask in self.masks)

    @property
    def is_gnss(self) -> bool:
        return self.has_group(_GNSS1) or self.has_group(_GNSS2)

    @property
    def is_solution(self) -> bool:
        """True if it has attitude, position or velocity of the solution."""
        return self.has_group(_ATTITUDE) or self.has_group(_INS)

    @property
    def needs_position(self) -> bool:
        return self.is_gnss or self.has_group(_INS)

    def encode(self, readings: Readings) -> bytes:
        """Encode a packet. CodecError if a number does not fit its field."""
        values: list[float] = []
        for name in self._names:
            value = getattr(readings, name)
            if type(value) is tuple:
                values += value
            else:
                values.append(value)
        try:
            body = self._header + self._payload.pack(*values)
        except (struct.error, OverflowError) as error:
            raise CodecError(f"VectorNav: a number does not fit its field: {readings}") from error
        return _SYNC + body + xmodem(body).to_bytes(2, "big")


class BinaryOutput(NamedTuple):
    """A request in registers 75 to 77: `packet` at the base rate divided by `divisor`."""

    ports: int
    divisor: int
    packet: PacketFormat


# Numbers nn of $VNERR,nn
_BAD_CHECKSUM, _BAD_COMMAND, _TOO_FEW, _TOO_MANY, _BAD_VALUE, _BAD_REGISTER, _READ_ONLY = 3, 4, 5, 6, 7, 8, 9
_REFUSALS = {
    _BAD_CHECKSUM: "a wrong checksum",
    _BAD_COMMAND: "an unknown command",
    _TOO_FEW: "too few parameters",
    _TOO_MANY: "too many parameters",
    _BAD_VALUE: "a parameter that this device does not have",
    _BAD_REGISTER: "a register that this device does not have",
    _READ_ONLY: "a register that cannot be written",
}
_MODEL = 1
_IDENTITY = frozenset({1, 2, 3, 4})
_BINARY = frozenset({75, 76, 77})
_LINE_LIMIT = 255
_find_line = re.compile(rb"\$([^$\r\n]{0,255})[\r\n]").finditer
_form = re.compile(r"VN[A-Z]{3}(?:,[ -)+-~]*)?\*([0-9A-Fa-f]{2}|[0-9A-Fa-f]{4}|XX)")


class _Refusal(Exception):
    """A command that the device answers with $VNERR."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class VectorNavDevice:
    """The device's end of the set-up: answers the driver's commands and keeps its requests.

    `outputs` has the binary outputs by register, to be sent while `streaming`. `starts` counts how often they were
    stopped and started again, which ArduPilot does once per boot. `refused` describes the last refused command. Bytes
    outside of commands are ignored.
    """

    def __init__(self, model: str = "VN-200T") -> None:
        self.model = model
        self.outputs: dict[int, BinaryOutput] = {}
        self.streaming = True
        self.starts = 0
        self.commands = 0  # accepted
        self.refused = ""  # description of the last refused command
        self._pending = b""
        self._registers = {
            0: "", _MODEL: model, 2: "7", 3: "100000001", 4: "2.1.0.0", 5: "921600", 6: "14", 7: "40",
        }  # fmt: skip

    @property
    def base_rate_hz(self) -> int:
        """Base of the divisors. 400 Hz for a VN-300, as ArduPilot assumes."""
        return 400 if self.model.startswith("VN-300") else 800

    @property
    def has_ins(self) -> bool:
        """True if it has GNSS, and with it a position. A VN-100 has none."""
        return not self.model.startswith("VN-1")

    @property
    def load_bytes_per_s(self) -> float:
        """Load of all outputs on the line [bytes/s]."""
        return sum(self.base_rate_hz / out.divisor * out.packet.size for out in self.outputs.values())

    def take(self, data: bytes) -> bytes:
        """Take bytes of the driver. Return the device's answers."""
        data = self._pending + data
        answers = b""
        end = 0
        for found in _find_line(data):
            end = found.end()
            answers += self._answer(found[1].decode("latin-1"))
        rest = data[end:]
        start = rest.rfind(b"$")
        self._pending = rest[start:] if start >= 0 and len(rest) - start <= _LINE_LIMIT else b""
        return answers

    def _answer(self, line: str) -> bytes:
        found = _form.fullmatch(line)
        if found is None:
            return b""  # noise, or part of a command: the driver repeats it
        text, check = line[: found.start(1) - 1], found[1]
        long = len(check) == 4
        try:
            if check != "XX" and int(check, 16) != (_crc(text) if long else _xor(text)):
                raise _Refusal(_BAD_CHECKSUM)
            answer = self._execute(text)
            self.commands += 1
        except _Refusal as refusal:
            self.refused = f"{text!r} has {_REFUSALS[refusal.code]}"
            answer = f"VNERR,{refusal.code:02d}"
        return sentence(answer, long=long)

    def _execute(self, text: str) -> str:
        command, *terms = text.split(",")
        if command == "VNRRG":
            (number,) = _exactly(terms, 1)
            return f"{text},{self._registers[self._known(number)]}"
        if command == "VNWRG":
            if len(terms) < 2:
                raise _Refusal(_TOO_FEW)
            self._write(self._known(terms[0]), terms[1:])
        elif command == "VNASY":
            (switch,) = _exactly(terms, 1)
            if switch not in ("0", "1"):
                raise _Refusal(_BAD_VALUE)
            self.starts += switch == "1" and not self.streaming
            self.streaming = switch == "1"
        elif command == "VNRFS":
            self.outputs.clear()
        elif command not in ("VNWNV", "VNRST", "VNTAR"):  # settings stay, as if they had been saved
            raise _Refusal(_BAD_COMMAND)
        return text

    def _known(self, number: str) -> int:
        if not number.isdigit() or int(number) not in self._registers.keys() | _BINARY:
            raise _Refusal(_BAD_REGISTER)
        register = int(number)
        self._registers.setdefault(register, "0,0,00")
        return register

    def _write(self, register: int, terms: Sequence[str]) -> None:
        if register in _IDENTITY:
            raise _Refusal(_READ_ONLY)
        if register in _BINARY:
            output = _binary_output(terms)
            if output is None:
                self.outputs.pop(register, None)
            else:
                self.outputs[register] = output
        self._registers[register] = ",".join(terms)


def _exactly(terms: Sequence[str], count: int) -> Sequence[str]:
    if len(terms) != count:
        raise _Refusal(_TOO_FEW if len(terms) < count else _TOO_MANY)
    return terms


def _binary_output(terms: Sequence[str]) -> BinaryOutput | None:
    """Parse ports, divisor, groups, masks. Return None for no output; a divisor of 0 is refused."""
    if len(terms) < 3:
        raise _Refusal(_TOO_FEW)
    try:
        ports, divisor = int(terms[0]), int(terms[1])
        groups, *masks = (int(term, 16) for term in terms[2:])
    except ValueError as error:
        raise _Refusal(_BAD_VALUE) from error
    if groups == 0 or ports == 0:
        return None
    if divisor < 1 or groups > 0x7F or any(mask > 0x7FFF for mask in masks):
        raise _Refusal(_BAD_VALUE)
    bits = [bit for bit in range(7) if groups >> bit & 1]
    _exactly([str(mask) for mask in masks], len(bits))
    try:
        return BinaryOutput(ports, divisor, PacketFormat(list(zip(bits, masks, strict=True))))
    except CodecError as error:
        raise _Refusal(_BAD_VALUE) from error


def _xor(text: str) -> int:
    value = 0
    for byte in text.encode("latin-1"):
        value ^= byte
    return value


def _crc(text: str) -> int:
    return xmodem(text.encode("latin-1"))


def sentence(text: str, *, long: bool = False) -> bytes:
    """Return `text` between $ and its checksum: two hexadecimal digits, or the four of a CRC-16."""
    check = f"{_crc(text):04X}" if long else f"{_xor(text):02X}"
    return f"${text}*{check}\r\n".encode("latin-1")


def ardupilot_outputs(device: VectorNavDevice, rate_hz: int) -> dict[int, BinaryOutput]:
    """Return the outputs that ArduPilot requests of `device` at its boot with EAHRS_RATE = `rate_hz`."""
    imu = ((_COMMON, 0x0721),)
    attitude = ((_COMMON, 0x0001), (_ATTITUDE, 0x0106))
    base = device.base_rate_hz
    outputs = {75: BinaryOutput(3, max(1, base // rate_hz), PacketFormat(imu))}
    if not device.has_ins:
        return outputs | {76: BinaryOutput(3, 16, PacketFormat(attitude))}
    gnss = ((_COMMON, 0x0003), (_GNSS1, 0x26B8), (_GNSS2, 0x0018))
    return outputs | {
        76: BinaryOutput(3, base // 50, PacketFormat((*attitude, (_INS, 0x0613)))),
        77: BinaryOutput(3, base // 5, PacketFormat(gnss)),
    }
