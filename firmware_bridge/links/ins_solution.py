"""What an inertial navigation system believes of its motion: the truth, with errors of the size that it admits.

The filter inside a real device is not simulated. Its errors wander slowly: each component of position, velocity and
attitude is a first-order Gauss-Markov process of its own. They do not follow from the errors of the bench's GPS, IMU
and magnetometer, and a fault of those does not reach it. Whoever wants to see the autopilot's own estimator work on the
bench's sensors sets AHRS_EKF_TYPE 3, which leaves this solution unused.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, radians, sqrt

from hil.signals.noise import NoiseStream
from hil.signals.samples import Quat, TruthState, Vec3
from hil.signals.time import NS_PER_S

# Place in W [m] -> latitude [deg], longitude [deg], altitude above mean sea level [m].
Geodetic = Callable[[Vec3], tuple[float, float, float]]


@dataclass(frozen=True)
class InsErrors:
    """1 sigma of each axis, and how long an error stays. The default is a device that has RTK corrections."""

    position_m: float = 0.1
    velocity_mps: float = 0.02
    attitude_deg: float = 0.1
    correlation_s: float = 60.0


class InsSolution:
    """`solve` at rising times. The same seed makes the same errors."""

    def __init__(self, geodetic: Geodetic, errors: InsErrors, *, seed: int) -> None:
        self.errors = errors
        self._geodetic = geodetic
        self._noise = NoiseStream(seed, "external_ahrs", lanes=9)
        self._index = 0
        self._state = [0.0] * 9  # standard normal
        self._t_ns: int | None = None

    def solve(self, truth: TruthState) -> tuple[Quat, Vec3, Vec3]:
        """Attitude B to W, place (latitude, longitude, altitude), velocity in W."""
        keep = 0.0  # the first time: no memory
        if self._t_ns is not None:
            keep = exp(-(truth.t_ns - self._t_ns) / (self.errors.correlation_s * NS_PER_S))
        self._t_ns = truth.t_ns
        fresh = sqrt(1.0 - keep * keep)
        self._state = [keep * x + fresh * n for x, n in zip(self._state, self._noise.normal(self._index), strict=True)]
        self._index += 1
        e, s = self.errors, self._state
        p, v = truth.p_WB, truth.v_WB_W
        place = self._geodetic((p[0] + e.position_m * s[0], p[1] + e.position_m * s[1], p[2] + e.position_m * s[2]))
        velocity = (v[0] + e.velocity_mps * s[3], v[1] + e.velocity_mps * s[4], v[2] + e.velocity_mps * s[5])
        half = radians(e.attitude_deg) / 2.0
        return _turned(truth.q_WB, (half * s[6], half * s[7], half * s[8])), place, velocity


def _turned(q: Quat, half_B: Vec3) -> Quat:
    """q (1, half_B), normalised: turned further in B by a small angle."""
    w, x, y, z = q
    a, b, c = half_B
    raw = (w - x * a - y * b - z * c, x + w * a + y * c - z * b, y + w * b + z * a - x * c, z + w * c + x * b - y * a)
    norm = sqrt(sum(r * r for r in raw))
    return (raw[0] / norm, raw[1] / norm, raw[2] / norm, raw[3] / norm)
