"""External vision: visual-inertial odometry or motion capture, which gives pose and velocity in a frame of its own.

Frame O has its origin where the body was at the first sample, z up, and x along the vehicle's heading then
(`heading: start`, as odometry begins) or to the north (`heading: north`, as motion capture does).

    p = x + w + n_p,   x_k = x_{k-1} + (1 + s) Rz(psi_k) R_OW dp      dp the path in W since the previous sample
    q = qz(psi) q_OB dq                                               dq a small rotation
    v = (1 + s) R_BW v + n_v                                          in B

What grows are a scale error s, drawn once, and random walks of the position, w, and of the heading, psi: deviations
position_walk sqrt(t) and heading_walk sqrt(t). n and dq are white. By default all errors are those of a good
visual-inertial odometry at low speed; no device has been measured for them.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from signals._kernel import det_cos, det_sin, rotate_into_body
from signals.documents.validate import StrictModel
from signals.noise import NoiseStream
from signals.rotation import product, quaternion_norm, yaw_of
from signals.samples import OdometrySample, Quat, TruthState, Vec3
from signals.time import NS_PER_S
from sim.sensors.drift import Drift
from sim.sensors.sensor import Installation, InstalledSensor, Kind

Deviation = Annotated[float, Field(ge=0.0, le=10.0)]
_NORTH_RAD = math.pi / 2.0  # from east
_WORD = 1e-6  # of the output, for stuck bits: about the last bit of a 32-bit float at 10 m


class ExternalVisionParameters(StrictModel):
    """Errors of an estimate of the pose, deviations 1 sigma."""

    heading: Literal["start", "north"] = "start"
    position_noise_m: Deviation = 0.01
    attitude_noise_rad: Deviation = 0.003
    velocity_noise_mps: Deviation = 0.03
    scale_error: Annotated[float, Field(ge=0.0, le=0.2)] = 0.01
    position_walk_m_per_rts: Deviation = 0.01
    heading_walk_rad_per_rts: Deviation = 0.001
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.03


class ExternalVision(InstalledSensor):
    """Pose and velocity of the body origin."""

    sample_type = OdometrySample

    def __init__(self, installation: Installation, parameters: ExternalVisionParameters) -> None:
        p, name, seed = parameters, installation.name, installation.seed
        super().__init__(installation, p.latency_s, dict.fromkeys(("p_OB", "v_OB_B"), _WORD))
        self._p = p
        self._white = NoiseStream(seed, f"{name}.white", lanes=9)  # position, attitude, velocity
        self._scale = 1.0 + p.scale_error * NoiseStream(seed, f"{name}.scale").normal(0)[0]
        rt_s = math.sqrt(installation.period_ns / NS_PER_S)
        walks = ((f"{name}.walk", 3, p.position_walk_m_per_rts), (f"{name}.heading", 1, p.heading_walk_rad_per_rts))
        self._walk, self._heading = (
            Drift(seed, stream, lanes=lanes, start=0.0, phi=1.0, step=deviation * rt_s)
            for stream, lanes, deviation in walks
        )
        self._start_rad = 0.0  # heading of O's x axis, from east
        self._path_O: Vec3 = (0.0, 0.0, 0.0)
        self._before_W: Vec3 | None = None

    def sample(self, truth: TruthState, seq: int) -> OdometrySample:
        """Return sample `seq`. The path since the sample before is measured with this sample's heading error."""
        p, scale = self._p, self._scale
        n = self._white.normal(seq)
        if self._before_W is None:
            self._before_W = truth.p_WB
            self._start_rad = _NORTH_RAD if p.heading == "north" else yaw_of(truth.q_WB)
        turn_rad = self._heading.at(seq)[0] - self._start_rad
        c, s = det_cos(turn_rad), det_sin(turn_rad)
        dx, dy, dz = (scale * (now - old) for now, old in zip(truth.p_WB, self._before_W, strict=True))
        x, y, z = self._path_O
        x, y, z = self._path_O = (x + c * dx - s * dy, y + s * dx + c * dy, z + dz)
        self._before_W = truth.p_WB
        wx, wy, wz = self._walk.at(seq)
        sigma = p.position_noise_m
        half = 0.5 * turn_rad
        turn: Quat = (det_cos(half), 0.0, 0.0, det_sin(half))
        tilt = 0.5 * p.attitude_noise_rad
        q = product(product(turn, truth.q_WB), (1.0, tilt * n[3], tilt * n[4], tilt * n[5]))
        length = quaternion_norm(q)
        vx, vy, vz = rotate_into_body(truth.q_WB, truth.v_WB_W)
        noise = p.velocity_noise_mps
        return OdometrySample(
            seq,
            truth.t_ns,
            truth.t_ns + self.latency_ns,
            (x + wx + sigma * n[0], y + wy + sigma * n[1], z + wz + sigma * n[2]),
            (q[0] / length, q[1] / length, q[2] / length, q[3] / length),
            (scale * vx + noise * n[6], scale * vy + noise * n[7], scale * vz + noise * n[8]),
            sigma,
            p.attitude_noise_rad,
            noise,
        )


KIND = Kind(ExternalVision, ExternalVisionParameters)
