"""Air-data vanes: angle of attack and sideslip of the flow at the vanes' place.

u is the velocity of the place through the air in the frame of the mount (sim/sensors/relative_wind.py):

    alpha = atan2(w, u),  beta = atan2(v, u)       u forward, v to the right, w down
    theta' = (angle - theta) / T,  T = tau V_ref / V      each vane follows its angle of the flow: its restoring torque
                                                          grows with V^2, its aerodynamic damping with V
    |angle - theta| <= f (V_ref / V)^2                    friction: within this it stays, and it stops at this distance
    out = round(theta + zero + n), saturated at -limit and +limit

The vane's inertia is left out: a lag without overshoot. Below `min_airspeed_mps` it hangs where it is. beta is the
flank angle that a vane measures, not asin(v / |u|). The lag is exact for an angle that is constant since the sample
before; tau and f are stated at V_ref.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from signals._kernel import det_atan2, det_exp
from signals.documents.validate import StrictModel
from signals.noise import NoiseStream
from signals.rotation import applied_back, matrix_of
from signals.samples import TruthState, VaneSample
from signals.time import NS_PER_S
from signals.units import RAD_PER_DEG
from sim.frame.mount import quaternion_of_rpy
from sim.sensors.relative_wind import airspeed_B_mps, wind_source
from sim.sensors.rounding import drawn_sigma, noise_with_rounding, saturated
from sim.sensors.sensor import Attitude, Installation, InstalledSensor, Kind, Position

Degrees = Annotated[float, Field(ge=0.0, le=45.0)]


class VaneParameters(StrictModel):
    """Errors of both vanes, deviations 1 sigma. The noise includes the rounding (sim/sensors/rounding.py)."""

    noise_deg: Degrees
    resolution_deg: Annotated[float, Field(gt=0.0, le=10.0)]
    zero_error_deg: Degrees = 0.0  # drawn once for each vane
    friction_deg: Degrees = 0.0  # at the reference airspeed
    time_constant_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0  # at the reference airspeed; 0: none
    reference_airspeed_mps: Annotated[float, Field(gt=0.0, le=340.0)] = 15.0
    min_airspeed_mps: Annotated[float, Field(ge=0.0, le=100.0)] = 1.0
    limit_deg: Annotated[float, Field(gt=0.0, le=180.0)] = 180.0
    mount_m: Position = (0.0, 0.0, 0.0)  # from the body origin, in B
    mount_rpy_deg: Attitude = (0.0, 0.0, 0.0)  # (0, 0, 0) points forward (sim/frame/mount.py)
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0


class Vane(InstalledSensor):
    """Two vanes at one place; each sample moves them by the flow since the one before."""

    sample_type = VaneSample

    def __init__(self, installation: Installation, parameters: VaneParameters) -> None:
        p, name, seed = parameters, installation.name, installation.seed
        step = p.resolution_deg * RAD_PER_DEG
        super().__init__(installation, p.latency_s, {"angle_of_attack_rad": step, "sideslip_rad": step})
        self._p, self._step_rad, self._limit_rad = p, step, p.limit_deg * RAD_PER_DEG
        self._sigma_rad = drawn_sigma(p.noise_deg * RAD_PER_DEG, step)
        deviation = noise_with_rounding(self._sigma_rad, step)
        self.deviations = {"angle_of_attack_rad": deviation, "sideslip_rad": deviation}
        self._wind_at = wind_source(installation)
        self._R_BM = matrix_of(quaternion_of_rpy(p.mount_rpy_deg))  # mount to body
        self._white = NoiseStream(seed, f"{name}.white", lanes=2)
        zero = NoiseStream(seed, f"{name}.zero", lanes=2).normal(0)
        self._zero_rad = (p.zero_error_deg * RAD_PER_DEG * zero[0], p.zero_error_deg * RAD_PER_DEG * zero[1])
        self._stands: tuple[float, float] | None = None  # angles of the vanes [rad]
        self._was_ns = 0

    def sample(self, truth: TruthState, seq: int) -> VaneSample:
        """Return sample `seq`. At the first one the vanes stand in the flow."""
        self._move(truth)
        assert self._stands is not None
        n, zero = self._white.normal(seq), self._zero_rad
        out = [
            saturated(angle + zero[i] + self._sigma_rad * n[i], self._step_rad, self._limit_rad)
            for i, angle in enumerate(self._stands)
        ]
        return VaneSample(seq, truth.t_ns, truth.t_ns + self.latency_ns, out[0], out[1])

    def _move(self, truth: TruthState) -> None:
        p = self._p
        forward, left, up = applied_back(self._R_BM, airspeed_B_mps(truth, self._wind_at(), p.mount_m))
        speed = math.sqrt(forward * forward + left * left + up * up)
        dt_s = max(truth.t_ns - self._was_ns, 0) / NS_PER_S
        self._was_ns = truth.t_ns
        if speed < p.min_airspeed_mps:
            self._stands = self._stands or (0.0, 0.0)
            return
        flow = (det_atan2(-up, forward), det_atan2(-left, forward))
        if self._stands is None:
            self._stands = flow
            return
        ratio = speed / p.reference_airspeed_mps
        stays = p.friction_deg * RAD_PER_DEG / (ratio * ratio)
        left_over = 0.0 if p.time_constant_s == 0.0 else det_exp(-dt_s * ratio / p.time_constant_s)
        a, b = self._stands
        self._stands = (_moved(a, flow[0], stays, left_over), _moved(b, flow[1], stays, left_over))


def _moved(angle: float, flow: float, stays: float, left_over: float) -> float:
    """Return the angle of a vane that moves towards `flow` until it is `stays` away from it."""
    away = angle - flow
    if away > math.pi:  # the short way round
        flow, away = flow + 2.0 * math.pi, away - 2.0 * math.pi
    elif away < -math.pi:
        flow, away = flow - 2.0 * math.pi, away + 2.0 * math.pi
    if abs(away) <= stays:
        return angle
    end = flow + math.copysign(stays, away)
    turned = end + (angle - end) * left_over
    return turned if -math.pi <= turned <= math.pi else turned - math.copysign(2.0 * math.pi, turned)


KIND = Kind(Vane, VaneParameters)
