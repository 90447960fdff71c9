"""Range finder: one ray in the direction of its mount, with noise, limits and lost returns.

    d = round(d_true (1 + s) + n),   deviation with rounding: max(noise, relative noise * d_true)

s is a constant random scale error. There is no return (quality 0, distance `no_return_m`) if the ray hits nothing, the
distance leaves [min, max], the vehicle tilts too far, or at random with `dropout_probability`. Haze, rain and snow of
extinction beta take light on the way out and back: as light falls with the square of the distance, there is no return
beyond d_true exp(beta d_true) = max.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from signals._kernel import det_cos, det_exp
from signals.documents.validate import StrictModel
from signals.noise import NoiseStream, normal_from_uniform
from signals.rotation import cos_tilt_of
from signals.samples import RangeSample, TruthState
from signals.units import RAD_PER_DEG
from sim.frame.mount import Mount
from sim.sensors.ground_range import GroundRange
from sim.sensors.rounding import drawn_sigma, rounded
from sim.sensors.sensor import Attitude, Installation, InstalledSensor, Kind, Position, check_order

_MAX_QUALITY = 100


class RangeFinderParameters(StrictModel):
    """Errors of one range finder, deviations 1 sigma, of the rounded output (sim/sensors/rounding.py)."""

    min_distance_m: Annotated[float, Field(ge=0.0, le=1000.0)]
    max_distance_m: Annotated[float, Field(gt=0.0, le=1000.0)]
    noise_m: Annotated[float, Field(ge=0.0, le=10.0)]
    relative_noise: Annotated[float, Field(ge=0.0, le=0.5)] = 0.0
    scale_error: Annotated[float, Field(ge=0.0, le=0.2)] = 0.0
    resolution_m: Annotated[float, Field(gt=0.0, le=1.0)]
    max_tilt_deg: Annotated[float, Field(gt=0.0, le=90.0)] = 60.0  # of the vehicle
    dropout_probability: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    no_return_m: Annotated[float, Field(ge=0.0, le=1000.0)] = 0.0  # distance that it sends without a return
    mount_m: Position = (0.0, 0.0, 0.0)  # from the body origin, in B
    mount_rpy_deg: Attitude = (0.0, 90.0, 0.0)  # (0, 0, 0) looks forward (sim/frame/mount.py); as it is: down
    latency_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0

    @model_validator(mode="after")
    def _limits_in_order(self) -> RangeFinderParameters:
        check_order(("min_distance_m", self.min_distance_m), ("max_distance_m", self.max_distance_m))
        return self


class RangeFinder(InstalledSensor):
    """Range finder that looks along x of its mount."""

    sample_type = RangeSample

    def __init__(self, installation: Installation, parameters: RangeFinderParameters) -> None:
        p, name, seed = parameters, installation.name, installation.seed
        super().__init__(installation, p.latency_s, {"distance_m": p.resolution_m})
        self._p = p
        self.mount = Mount(p.mount_m, p.mount_rpy_deg, optical=False)
        self._axis_B = self.mount.axis_B
        self._range = GroundRange(installation.scene, p.mount_m, self._axis_B)
        self._extinction_per_m = installation.scene.extinction_per_m
        self._white = NoiseStream(seed, f"{name}.white", lanes=2)  # distance, dropout
        self._scale = 1.0 + p.scale_error * NoiseStream(seed, f"{name}.scale").normal(0)[0]
        self._min_cosine = det_cos(p.max_tilt_deg * RAD_PER_DEG)
        # A standard normal is below this value with the probability of a dropout.
        probability = p.dropout_probability
        self._drop_below = float(normal_from_uniform(np.array([probability]))[0]) if probability > 0.0 else -math.inf

    def sample(self, truth: TruthState, seq: int) -> RangeSample:
        """Return sample `seq`."""
        p, t_ns = self._p, truth.t_ns
        n, drop = self._white.normal(seq)
        true_m = self._range.distance_m(truth)
        sigma = max(p.noise_m, p.relative_noise * true_m)
        upright = cos_tilt_of(truth.q_WB)
        drawn = drawn_sigma(sigma, p.resolution_m) * n
        distance = rounded(true_m * self._scale + drawn, p.resolution_m)
        seen = (
            true_m >= 0.0
            and upright >= self._min_cosine
            and drop >= self._drop_below
            and p.min_distance_m <= distance <= p.max_distance_m
            and true_m * det_exp(self._extinction_per_m * true_m) <= p.max_distance_m
        )
        return RangeSample(
            seq,
            t_ns,
            t_ns + self.latency_ns,
            distance if seen else p.no_return_m,
            p.min_distance_m,
            p.max_distance_m,
            sigma if seen else 0.0,
            _MAX_QUALITY if seen else 0,
            self._axis_B,
        )


KIND = Kind(RangeFinder, RangeFinderParameters)
