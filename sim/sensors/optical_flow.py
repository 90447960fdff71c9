"""Downward optical flow sensor with its own gyro and, on some devices, a range finder.

Rotation of the picture about x and y of B, for a sensor at r in B and distance d from the ground along -z:

    u = R^T v + w x r,      flow rate = (w_x + u_y / d,  w_y - u_x / d)

Each sample integrates the rate since the previous one by the trapezoidal rule (error of second order in the sample
period; motion faster than half the sample rate is lost). Then scale error and noise are added and the result is
rounded. Quality falls from its best value at the ground to a third of it at the maximum distance. Quality and flow are
0 if the ground is out of range, the tilt too great, or the flow faster than the device can track.

Haze, rain and snow of extinction beta leave the ground the contrast C = exp(-beta d) (Koschmieder, scene/weather.py).
Quality falls to the share C. The error of a displacement found by correlation is inversely proportional to the gradient
of the picture (Sutton et al., "Image correlation for shape, motion and deformation measurements", Springer 2009, ch.
5), so the noise is 1 / C times as great. Below C = 0.1 the device finds nothing.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field, model_validator

from signals._kernel import det_cos, det_exp, rotate_into_body
from signals.documents.validate import StrictModel
from signals.noise import NoiseStream
from signals.rotation import cos_tilt_of
from signals.samples import FlowSample, TruthState
from signals.time import NS_PER_S
from signals.units import RAD_PER_DEG
from sim.sensors.ground_range import DOWN_B, GroundRange
from sim.sensors.rounding import drawn_sigma, rounded
from sim.sensors.sensor import Installation, InstalledSensor, Kind, Position, check_order

_UNKNOWN_M = -1.0
_LEAST_CONTRAST = 0.1  # a choice


class OpticalFlowParameters(StrictModel):
    """Errors of one optical flow sensor: deviations 1 sigma, of the rounded output (sim/sensors/rounding.py).

    The gyro's noise density is Allan's N, as of the IMU (sim/sensors/imu.py).
    """

    min_distance_m: Annotated[float, Field(ge=0.0, le=100.0)]
    max_distance_m: Annotated[float, Field(gt=0.0, le=1000.0)]
    max_flow_radps: Annotated[float, Field(gt=0.0, le=100.0)]
    flow_noise_radps: Annotated[float, Field(ge=0.0, le=10.0)]  # of the mean rate over one sample
    flow_scale_error: Annotated[float, Field(ge=0.0, le=0.2)] = 0.0
    flow_resolution_rad: Annotated[float, Field(gt=0.0, le=0.1)]
    gyro_noise_radps_per_rthz: Annotated[float, Field(ge=0.0, le=1.0)]
    gyro_turn_on_bias_radps: Annotated[float, Field(ge=0.0, le=1.0)]
    gyro_resolution_rad: Annotated[float, Field(gt=0.0, le=0.1)]
    has_range: bool  # has a range finder; else the distance of a sample is unknown
    range_noise_m: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    max_tilt_deg: Annotated[float, Field(gt=0.0, le=90.0)] = 60.0
    quality: Annotated[int, Field(ge=1, le=255)] = 255  # best value
    temperature_degc: Annotated[float, Field(ge=-40.0, le=125.0)] = 35.0
    mount_m: Position = (0.0, 0.0, 0.0)  # from the body origin, in B
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0

    @model_validator(mode="after")
    def _limits_in_order(self) -> OpticalFlowParameters:
        check_order(("min_distance_m", self.min_distance_m), ("max_distance_m", self.max_distance_m))
        return self

    @property
    def unmeasured(self) -> tuple[str, ...]:
        """Fields of a sample that this sensor does not measure: they have no faults."""
        return () if self.has_range else ("distance_m",)


class OpticalFlow(InstalledSensor):
    """Optical flow sensor: flow and rates integrated since the previous sample."""

    sample_type = FlowSample

    def __init__(self, installation: Installation, parameters: OpticalFlowParameters) -> None:
        p, name, seed = parameters, installation.name, installation.seed
        super().__init__(
            installation,
            p.latency_s,
            {"flow_rad": p.flow_resolution_rad, "gyro_rad": p.gyro_resolution_rad, "distance_m": 0.001},
        )
        self._p = p
        self._range = GroundRange(installation.scene, p.mount_m, DOWN_B)
        self._extinction_per_m = installation.scene.extinction_per_m
        self._white = NoiseStream(seed, f"{name}.white", lanes=7)  # flow, gyro, distance, quality
        scale = NoiseStream(seed, f"{name}.scale", lanes=2).normal(0)
        self._scale = (1.0 + p.flow_scale_error * scale[0], 1.0 + p.flow_scale_error * scale[1])
        bias = NoiseStream(seed, f"{name}.turn_on", lanes=3).normal(0)
        self._bias = [p.gyro_turn_on_bias_radps * n for n in bias]
        self._min_cosine = det_cos(p.max_tilt_deg * RAD_PER_DEG)
        self._before: tuple[int, float, float, float, float, float] | None = None

    def sample(self, truth: TruthState, seq: int) -> FlowSample:
        """Return sample `seq`. The first one assumes unchanged motion over its period."""
        p, t_ns = self._p, truth.t_ns
        n = self._white.normal(seq)
        true_m = self._range.distance_m(truth)
        wx, wy, wz = truth.w_WB_B
        vx, vy, _ = rotate_into_body(truth.q_WB, truth.v_WB_W)
        rx, ry, rz = p.mount_m
        vx, vy = vx + wy * rz - wz * ry, vy + wz * rx - wx * rz
        upright = cos_tilt_of(truth.q_WB)
        in_range = p.min_distance_m <= true_m <= p.max_distance_m and true_m > 0.0
        # Out of range the flow is 0. The rate of rotation stands in for it, so that the next trapezoid stays finite.
        fx, fy = (wx + vy / true_m, wy - vx / true_m) if in_range else (wx, wy)
        now = (t_ns, fx, fy, wx, wy, wz)
        old = self._before
        if old is None or old[0] >= t_ns:  # the first sample, or a clock set back
            old = (t_ns - self.period_ns, *now[1:])
        self._before = now
        integration_ns = t_ns - old[0]
        dt = integration_ns / NS_PER_S
        half = 0.5 * dt
        seen = in_range and upright >= self._min_cosine and max(abs(fx), abs(fy)) <= p.max_flow_radps
        contrast = 1.0
        if self._extinction_per_m > 0.0:
            contrast = det_exp(-self._extinction_per_m * max(true_m, 0.0))
            seen = seen and contrast >= _LEAST_CONTRAST
        step = p.flow_resolution_rad
        noise = drawn_sigma(p.flow_noise_radps * dt, step)
        noise = noise / contrast if seen else noise
        flow = (
            rounded(half * (old[1] + fx) * self._scale[0] + noise * n[0], step) if seen else 0.0,
            rounded(half * (old[2] + fy) * self._scale[1] + noise * n[1], step) if seen else 0.0,
        )
        bias, step = self._bias, p.gyro_resolution_rad
        angle = drawn_sigma(p.gyro_noise_radps_per_rthz * math.sqrt(dt), step)
        gyro = (
            rounded(half * (old[3] + wx) + bias[0] * dt + angle * n[2], step),
            rounded(half * (old[4] + wy) + bias[1] * dt + angle * n[3], step),
            rounded(half * (old[5] + wz) + bias[2] * dt + angle * n[4], step),
        )
        quality = 0
        if seen:
            quality = round(p.quality * contrast * (1.0 - true_m / (1.5 * p.max_distance_m)) + 4.0 * n[6])
            quality = min(max(quality, 1), p.quality)
        distance = max(0.0, true_m + p.range_noise_m * n[5]) if p.has_range and in_range else _UNKNOWN_M
        return FlowSample(
            seq, t_ns, t_ns + self.latency_ns, integration_ns, flow, gyro, quality, distance, p.temperature_degc
        )


KIND = Kind(OpticalFlow, OpticalFlowParameters)
