"""Packets of the simulated VectorNav for each tick, made from the bench's samples and the truth.

IMU packet        IMU, magnetometer, barometer: the bench's samples, with their errors. Only for a tick with a new
                  IMU sample: the autopilot's main loop counts each packet as one. No packet is sent before each of
                  the three sensors has given a sample
solution          the truth with simulated errors; with a position only after the first fix
GNSS packet       the newest GPS sample, if it has not been sent yet: a dropout stays a dropout

The solution is the motion as an inertial navigation system estimates it: the truth, with errors of the size that the
device reports. The filter inside a real device is not simulated. The errors vary slowly: each component of position,
velocity and attitude is a first-order Gauss-Markov process. They are independent of the errors of the bench's GPS, IMU
and magnetometer, and faults of those have no effect on them. To test the autopilot's own estimator on the bench's
sensors, set AHRS_EKF_TYPE 3, which does not use this solution.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, radians, sqrt
from typing import NamedTuple

from firmware_bridge.codecs.vectornav import (
    INS_GNSS_FIX,
    INS_TRACKING,
    BinaryOutput,
    Readings,
    VectorNavDevice,
)
from firmware_bridge.links.autopilot_link import TickSamples
from signals.noise import NoiseStream
from signals.rotation import product
from signals.samples import Quat, TruthState, Vec3
from signals.time import NS_PER_S, RateAccumulator

# GPS time (since 6 January 1980) at the start of a run: 1 January 2026, 12:00 UTC; 18 leap seconds.
GPS_START_NS = (1_767_268_800 - 315_964_800 + 18) * NS_PER_S
_FIX_3D = 3
_FIX_LOST_NS = NS_PER_S
_BITS_PER_BYTE = 10  # 8N1
_RATE_TOLERANCE = 1.1  # divisors are whole numbers: 266.7 packets per second are requested instead of 250


# Place in W [m] -> latitude [deg], longitude [deg], altitude above mean sea level [m].
Geodetic = Callable[[Vec3], tuple[float, float, float]]


@dataclass(frozen=True)
class InsErrors:
    """Standard deviation of each axis, and correlation time. The default is a device with RTK corrections."""

    position_m: float = 0.1
    velocity_mps: float = 0.02
    attitude_deg: float = 0.1
    correlation_s: float = 60.0
    seed: int = 1  # the same seed makes the same errors


class InsSolution:
    """The simulated solution. Call `solve` at rising times."""

    def __init__(self, geodetic: Geodetic, errors: InsErrors) -> None:
        self.errors = errors
        self._geodetic = geodetic
        self._noise = NoiseStream(errors.seed, "external_ahrs", lanes=9)
        self._index = 0
        self._state = [0.0] * 9  # standard normal
        self._t_ns: int | None = None

    def solve(self, truth: TruthState) -> tuple[Quat, Vec3, Vec3]:
        """Return attitude B to W, place (latitude, longitude, altitude), velocity in W [m/s]."""
        kept_share = 0.0  # at the first time there is no earlier error
        if self._t_ns is not None:
            kept_share = exp(-(truth.t_ns - self._t_ns) / (self.errors.correlation_s * NS_PER_S))
        self._t_ns = truth.t_ns
        new_share = sqrt(1.0 - kept_share * kept_share)
        self._state = [
            kept_share * x + new_share * n for x, n in zip(self._state, self._noise.normal(self._index), strict=True)
        ]
        self._index += 1
        e, s = self.errors, self._state
        p, v = truth.p_WB, truth.v_WB_W
        place = self._geodetic((p[0] + e.position_m * s[0], p[1] + e.position_m * s[1], p[2] + e.position_m * s[2]))
        velocity = (v[0] + e.velocity_mps * s[3], v[1] + e.velocity_mps * s[4], v[2] + e.velocity_mps * s[5])
        half = radians(e.attitude_deg) / 2.0
        return _rotated(truth.q_WB, (half * s[6], half * s[7], half * s[8])), place, velocity


def _rotated(q: Quat, half_B: Vec3) -> Quat:
    """Return q (1, half_B), normalised: q after a rotation by the small angle 2 half_B in B [rad]."""
    raw = product(q, (1.0, *half_B))
    norm = sqrt(sum(r * r for r in raw))
    return (raw[0] / norm, raw[1] / norm, raw[2] / norm, raw[3] / norm)


class _ScheduledOutput(NamedTuple):
    output: BinaryOutput
    due: Callable[[], bool]


class VectorNavStream:
    """Makes the packets of `device`, tick by tick."""

    def __init__(self, device: VectorNavDevice, solution: InsSolution, *, period_ns: int) -> None:
        self.device = device
        self._solution = solution
        self._period_ns = period_ns
        self._tick_millihz = 1000 * NS_PER_S // period_ns
        self._readings = Readings()
        self._seen: set[str] = set()
        self._outputs: dict[int, BinaryOutput] = {}
        self._rates: tuple[_ScheduledOutput, ...] = ()
        self._fix_ns: int | None = None
        self._gps_is_new = False

    @property
    def missing(self) -> list[str]:
        """Sensors without a first sample, which IMU packets wait for."""
        return [name for name in ("IMU", "magnetometer", "barometer") if name not in self._seen]

    def problems(self, baud: int | None) -> list[str]:
        """Describe each request of the autopilot that cannot be met, with its remedy."""
        device, found = self.device, []
        tick_hz = self._tick_millihz / 1000
        requested_hz = max((device.base_rate_hz / out.divisor for out in device.outputs.values()), default=0.0)
        if requested_hz > _RATE_TOLERANCE * tick_hz:
            found.append(
                f"the autopilot requested {requested_hz:g} IMU packets a second and gets one a tick, {tick_hz:g}: set "
                f"EAHRS_RATE {tick_hz:g} with SCHED_LOOP_RATE {tick_hz / 2:g}, or tick_hz {requested_hz:g}"
            )
        if baud is not None and device.load_bytes_per_s * _BITS_PER_BYTE > 0.9 * baud:
            share = device.load_bytes_per_s * _BITS_PER_BYTE / baud
            found.append(
                f"the requested packets fill the sensor line of {baud} baud by {share:.0%}: use 921600, or a "
                "lower EAHRS_RATE"
            )
        return found

    def packets(self, t_ns: int, truth: TruthState, samples: TickSamples) -> bytes:
        """Take the tick's samples. Return the packets due at `t_ns`. CodecError if a sample is not a number."""
        readings = self._readings
        self._take(samples)
        device = self.device
        if device.outputs != self._outputs:
            self._set_rates()
        if not device.streaming:
            return b""
        readings.startup_ns = t_ns
        data = b""
        solved = False
        for output, due in self._rates:
            if not due():
                continue
            packet = output.packet
            if packet.is_gnss:
                if not self._gps_is_new or self._fix_ns is None:
                    continue
                self._gps_is_new = False
            elif packet.is_solution:
                if packet.needs_position and self._fix_ns is None:
                    continue
                if not solved:
                    self._solve(t_ns, truth)
                    solved = True
            elif samples.imu is None or self.missing:
                continue
            data += packet.encode(readings)
        return data

    def _take(self, samples: TickSamples) -> None:
        readings, seen = self._readings, self._seen
        imu, mag, baro, gps, _ = samples
        if imu is not None:
            readings.take_imu(imu)
            seen.add("IMU")
        if mag is not None:
            readings.take_mag(mag)
            seen.add("magnetometer")
        if baro is not None:
            readings.take_baro(baro)
            seen.add("barometer")
        if gps is not None:
            readings.take_gps(gps, GPS_START_NS + gps.t_capture_ns)
            self._gps_is_new = True
            if gps.fix_type >= _FIX_3D:
                self._fix_ns = gps.t_available_ns

    def _solve(self, t_ns: int, truth: TruthState) -> None:
        attitude, place, velocity = self._solution.solve(truth)
        fix = self._fix_ns is not None and t_ns - self._fix_ns < _FIX_LOST_NS
        errors = self._solution.errors
        self._readings.take_solution(
            attitude,
            place,
            velocity,
            attitude_sigma_deg=errors.attitude_deg,
            position_sigma_m=errors.position_m,
            velocity_sigma_mps=errors.velocity_mps,
            status=INS_TRACKING | (INS_GNSS_FIX if fix else 0),
        )

    def _set_rates(self) -> None:
        """Take over new requests of the autopilot."""
        self._outputs = dict(self.device.outputs)
        base_millihz = self.device.base_rate_hz * 1000
        rates = []
        for _, output in sorted(self._outputs.items()):
            event_millihz = min(round(base_millihz / output.divisor), self._tick_millihz)
            rates.append(
                _ScheduledOutput(
                    output, RateAccumulator(event_millihz=event_millihz, tick_millihz=self._tick_millihz).due
                )
            )
        self._rates = tuple(rates)
