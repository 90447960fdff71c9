"""GNSS receiver: geodetic position and velocity with white and time-correlated errors.

    p = p_WB + R r + c + n_p         in W, then to WGS-84
    v = T (v_WB_W + R (w x r)) + n_v

T turns a vector of W, the tangent frame at the site, to east, north and up at the receiver's own place, as receivers
report it: the meridians converge by x tan(latitude) / R, 0.16 degrees after 10 km at 60 N. Where T changes no component
by more than half a step of the receiver's word, 0.5 mm/s, the velocity is taken as it is.

r is the antenna's position in B; c a first-order Gauss-Markov process (slow errors of orbit, clock, troposphere and
multipath); n white noise. While the signal is lost the receiver keeps sending: its last position (zeros before the
first fix), zero velocity, no fix, no satellites, and an accuracy of 1000 m. A receiver that sends nothing is a dropout
(`sim.sensors.faults`).

With `sky`, satellites on their orbits are seen past the scene (sim/gnss/receiver.py): it scales c and n_p by axis, adds
the errors by reflections, and decides on fix, satellites and accuracies. In the open it changes nothing of p and v.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

from pydantic import Field, model_validator

from signals._kernel import rotate_into_world
from signals.documents.validate import StrictModel
from signals.geodesy import LocalFrame
from signals.noise import NoiseStream
from signals.samples import GpsSample, TruthState, Vec3
from signals.time import NS_PER_S
from sim.gnss.parameters import ReceiverParameters, SkyParameters
from sim.sensors.drift import gauss_markov
from sim.sensors.sensor import Installation, InstalledSensor, Kind, Position

if TYPE_CHECKING:
    from sim.gnss.receiver import SkyFix, SkyReceiver

Deviation = Annotated[float, Field(ge=0.0, le=1000.0)]
Instant = Annotated[float, Field(ge=0.0, le=1e6)]

_NO_FIX = 1  # MAVLink GPS_FIX_TYPE: a receiver without a fix
_LOST_ACCURACY_M = 1000.0
_SPEED_STEP_MPS = 1e-3  # of the word for a velocity


class SignalLoss(StrictModel):
    """Interval of simulated time without a signal."""

    from_s: Instant
    until_s: Instant

    @model_validator(mode="after")
    def _in_order(self) -> SignalLoss:
        if not self.until_s > self.from_s:
            raise ValueError(f"until_s {self.until_s:g} must come after from_s {self.from_s:g}")
        return self


class GpsParameters(ReceiverParameters):
    """Errors of one receiver, 1 sigma: of each horizontal axis, or vertical.

    The accuracies are the values that the receiver reports; null: its true errors, sqrt(noise^2 + drift^2).
    """

    horizontal_noise_m: Deviation
    vertical_noise_m: Deviation
    horizontal_drift_m: Deviation
    vertical_drift_m: Deviation
    drift_time_constant_s: Annotated[float, Field(gt=0.0, le=1e6)]
    horizontal_speed_noise_mps: Deviation
    vertical_speed_noise_mps: Deviation
    horizontal_accuracy_m: Deviation | None = None
    vertical_accuracy_m: Deviation | None = None
    fix_type: Annotated[int, Field(ge=0, le=8)]  # MAVLink GPS_FIX_TYPE
    satellites: Annotated[int, Field(ge=0, le=64)]
    antenna_m: Position = (0.0, 0.0, 0.0)  # from the body origin, in B
    loss: tuple[SignalLoss, ...] = ()
    latency_s: Annotated[float, Field(ge=0.0, le=2.0)]
    sky: SkyParameters | None = None  # null: an open sky with the preset's figures, whatever the scene


class Gps(InstalledSensor):
    """GNSS receiver: position and velocity of its antenna."""

    sample_type = GpsSample

    def __init__(self, installation: Installation, parameters: GpsParameters) -> None:
        """Raises ValueError with `sky`, but without `installation.frames`."""
        p, name, seed = parameters, installation.name, installation.seed
        # Resolution of the receiver's protocol (UBX-NAV-PVT): 1e-7 degrees, millimetres.
        super().__init__(
            installation,
            p.latency_s,
            {"latitude_deg": 1e-7, "longitude_deg": 1e-7, "altitude_m": 1e-3, "v_W": _SPEED_STEP_MPS},
        )
        self._p = p
        self._horizontal_accuracy_m = _accuracy(p.horizontal_accuracy_m, p.horizontal_noise_m, p.horizontal_drift_m)
        self._vertical_accuracy_m = _accuracy(p.vertical_accuracy_m, p.vertical_noise_m, p.vertical_drift_m)
        self._has_arm = any(p.antenna_m)
        self._loss_ns = [(round(x.from_s * NS_PER_S), round(x.until_s * NS_PER_S)) for x in p.loss]
        self._held = (0.0, 0.0, 0.0)  # before the first fix a receiver sends zeros
        self._frame = LocalFrame(installation.scene.site)
        self._white = NoiseStream(seed, f"{name}.white", lanes=6)  # position, velocity
        self._drift = gauss_markov(installation, lanes=3, sigma=1.0, time_constant_s=p.drift_time_constant_s)
        self.receiver: SkyReceiver | None = None if p.sky is None else _receiver(installation, p, self.period_ns)
        self.sky_fix: SkyFix | None = None  # of the last sample

    def sample(self, truth: TruthState, seq: int) -> GpsSample:
        """Return sample `seq`."""
        t_ns, p = truth.t_ns, self._p
        n, c = self._white.normal(seq), self._drift.at(seq)
        if any(begin <= t_ns < end for begin, end in self._loss_ns):
            if self.receiver is not None:
                self.receiver.deaf(t_ns)
                self.sky_fix = None
            return self._without_fix(t_ns, seq, 0)
        x, y, z = truth.p_WB
        vx, vy, vz = truth.v_WB_W
        if self._has_arm:
            (rx, ry, rz), (wx, wy, wz) = p.antenna_m, truth.w_WB_B
            dx, dy, dz = rotate_into_world(truth.q_WB, p.antenna_m)
            ux, uy, uz = rotate_into_world(truth.q_WB, (wy * rz - wz * ry, wz * rx - wx * rz, wx * ry - wy * rx))
            x, y, z, vx, vy, vz = x + dx, y + dy, z + dz, vx + ux, vy + uy, vz + uz
        if self.receiver is not None:
            fix = self.sky_fix = self.receiver.observe(t_ns, (x, y, z), (vx, vy, vz), truth.q_WB)
            return self._under_the_sky(t_ns, seq, fix, (x, y, z), (vx, vy, vz))
        position = self._frame.geodetic_from_enu(
            (
                x + p.horizontal_drift_m * c[0] + p.horizontal_noise_m * n[0],
                y + p.horizontal_drift_m * c[1] + p.horizontal_noise_m * n[1],
                z + p.vertical_drift_m * c[2] + p.vertical_noise_m * n[2],
            )
        )
        self._held = position
        vx, vy, vz = self._at_antenna(position, (vx, vy, vz))
        return GpsSample(
            seq,
            t_ns,
            t_ns + self.latency_ns,
            *position,
            (
                vx + p.horizontal_speed_noise_mps * n[3],
                vy + p.horizontal_speed_noise_mps * n[4],
                vz + p.vertical_speed_noise_mps * n[5],
            ),
            self._horizontal_accuracy_m,
            self._vertical_accuracy_m,
            p.fix_type,
            p.satellites,
        )

    def _without_fix(self, t_ns: int, seq: int, satellites: int) -> GpsSample:
        return GpsSample(
            seq,
            t_ns,
            t_ns + self.latency_ns,
            *self._held,
            (0.0, 0.0, 0.0),
            _LOST_ACCURACY_M,
            _LOST_ACCURACY_M,
            _NO_FIX,
            satellites,
        )

    def _under_the_sky(self, t_ns: int, seq: int, fix: SkyFix, p_W: Vec3, v_W: Vec3) -> GpsSample:
        """Return the sample of a fix: the preset's errors times its scale, and its own errors."""
        if fix.fix_type <= _NO_FIX:
            return self._without_fix(t_ns, seq, fix.satellites)
        p, n, c = self._p, self._white.normal(seq), self._drift.at(seq)
        (kx, ky, kz), (sx, sy, sz), (ux, uy, uz) = fix.scale, fix.shift_m, fix.speed_shift_mps
        slow, slow_up = max(p.horizontal_drift_m, fix.drift_m[0]), max(p.vertical_drift_m, fix.drift_m[1])
        (x, y, z), (vx, vy, vz) = p_W, v_W
        position = self._frame.geodetic_from_enu(
            (
                x + kx * slow * c[0] + kx * p.horizontal_noise_m * n[0] + sx,
                y + ky * slow * c[1] + ky * p.horizontal_noise_m * n[1] + sy,
                z + kz * slow_up * c[2] + kz * p.vertical_noise_m * n[2] + sz,
            )
        )
        self._held = position
        vx, vy, vz = self._at_antenna(position, (vx, vy, vz))
        horizontal, vertical = self._horizontal_accuracy_m, self._vertical_accuracy_m
        if slow > p.horizontal_drift_m:
            horizontal = _accuracy(None, p.horizontal_noise_m, slow)
            vertical = _accuracy(None, p.vertical_noise_m, slow_up)
        return GpsSample(
            seq,
            t_ns,
            t_ns + self.latency_ns,
            *position,
            (
                vx + kx * p.horizontal_speed_noise_mps * n[3] + ux,
                vy + ky * p.horizontal_speed_noise_mps * n[4] + uy,
                vz + kz * p.vertical_speed_noise_mps * n[5] + uz,
            ),
            _root(horizontal * math.sqrt(0.5 * (kx * kx + ky * ky)), fix.residual_m[0]),
            _root(vertical * kz, fix.residual_m[1]),
            fix.fix_type,
            fix.satellites,
        )

    def _at_antenna(self, position: tuple[float, float, float], v_W: Vec3) -> Vec3:
        """Return a velocity in east, north, up of a position, where the receiver can tell it from that in W."""
        turned = self._frame.enu_at(position[0], position[1], v_W)
        is_seen = any(abs(a - b) > 0.5 * _SPEED_STEP_MPS for a, b in zip(turned, v_W, strict=True))
        return turned if is_seen else v_W


def _accuracy(stated_m: float | None, noise_m: float, drift_m: float) -> float:
    return math.sqrt(noise_m * noise_m + drift_m * drift_m) if stated_m is None else stated_m


def _root(a: float, b: float) -> float:
    """Return the root of the sum of two squares; exactly `a` for b = 0."""
    return math.sqrt(a * a + b * b) if b > 0.0 else a


def _receiver(installation: Installation, p: GpsParameters, period_ns: int) -> SkyReceiver:
    from sim.gnss.receiver import SkyReceiver  # loads the geometry's modules

    frames = installation.geometry_for("a GPS with a sky")
    assert p.sky is not None
    return SkyReceiver(installation.scene, frames.geometry, p, p.sky, best_fix=p.fix_type, period_ns=period_ns)


def _has_sky(parameters: GpsParameters) -> bool:
    return parameters.sky is not None


KIND = Kind(Gps, GpsParameters, casts=_has_sky)
