"""Effects of a camera's sensor on light, and of a depth camera on distance.

    x = gain (v L + sqrt(v L / N + (r / N)^2) n)       pixel = sRGB(clip(x, 0, 1))

L is the picture in linear light (with motion blur: its mean over the exposure), v the vignetting 1 - s (1 - cos^4
theta), N the electrons of a white pixel, r the read noise in electrons, n a standard normal. Auto exposure multiplies
the gain for the next picture by sqrt(target / mean light of this picture), limited to 1/2 .. 2.

Noise is a function of the seed, the sensor's name and the number of the picture alone (sim/native/image_noise.hpp).
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim._kernels import accumulate_linear, blur_depth, expose
from sim.frame.camera_model import CameraModel

Float32 = NDArray[np.float32]
UInt8 = NDArray[np.uint8]

_MAX_GAIN_CHANGE = 2.0  # factor from one picture to the next
_MIN_LIGHT = 1e-4  # mean light that auto exposure assumes at least


def vignette(camera: CameraModel, strength: float) -> Float32 | None:
    """Return the factor of each pixel, (height, width); None if all are 1."""
    if strength == 0.0:
        return None
    cosine = np.clip(camera.rays()[:, :, 2], 0.0, 1.0)
    square = cosine * cosine
    return (1.0 - strength * (1.0 - square * square)).astype(np.float32)


@functools.cache
def _light_of_codes() -> list[float]:
    """Return the linear light of the 256 codes."""
    light = np.zeros((1, 86, 3), np.float32)  # the codes and two more, as 86 RGB pixels
    accumulate_linear(np.arange(258, dtype=np.uint16).astype(np.uint8).reshape(1, 86, 3), 1.0, light)
    return [float(value) for value in light.reshape(-1)[:256]]


def mean_light(codes: UInt8) -> float:
    """Return the mean linear light of sRGB codes."""
    # Integers, and one sum in a fixed order: numpy's sums of floats depend on the processor.
    counts = np.bincount(codes.reshape(-1), minlength=256).tolist()
    return float(sum(n * light for n, light in zip(counts, _light_of_codes(), strict=True)) / codes.size)


class LightSensor:
    """Conversion of linear light to the camera's output. One instance per camera, because auto exposure has a state."""

    def __init__(
        self,
        shape: tuple[int, int],
        *,
        gain: float,
        auto_target: float | None,
        gain_limits: tuple[float, float],
        electrons_at_white: float | None,
        read_noise_electrons: float,
        vignette: Float32 | None,
        key: tuple[int, int],
    ) -> None:
        """`auto_target` None: constant gain. `electrons_at_white` None: no noise."""
        self.gain = gain
        self._target = auto_target
        self._limits = gain_limits
        self._electrons = electrons_at_white
        self._read_noise = read_noise_electrons
        self._vignette = vignette
        self._key = key
        self._light = np.zeros((*shape, 3), np.float32)

    def begin(self) -> None:
        """Start a new picture."""
        self._light.fill(0.0)

    def add(self, rgb: UInt8, weight: float) -> None:
        """Add the light of one instant of the exposure; weights sum to 1."""
        accumulate_linear(rgb, weight, self._light)

    def finish(self, index: int, out: UInt8) -> None:
        """Write picture number `index` to `out`, and adapt the gain for the next picture."""
        electrons = self._electrons
        expose(
            self._light,
            self._vignette,
            gain=self.gain,
            electrons_at_white=electrons if electrons is not None else 1.0,
            read_noise_electrons=self._read_noise,
            noisy=electrons is not None,
            key=self._key,
            index=index,
            rgb=out,
        )
        if self._target is not None:
            self._adapt_gain(out, self._target)

    def _adapt_gain(self, rgb: UInt8, target: float) -> None:
        change = math.sqrt(target / max(mean_light(rgb), _MIN_LIGHT))
        change = min(max(change, 1.0 / _MAX_GAIN_CHANGE), _MAX_GAIN_CHANGE)
        low, high = self._limits
        self.gain = min(max(self.gain * change, low), high)


class DepthSensor:
    """Errors of a depth camera, applied to planar depth in place."""

    def __init__(self, errors: Any, key: tuple[int, int]) -> None:
        """`errors`: sim.sensors.camera_parameters.DepthNoise."""
        inverse = errors.inverse_step_per_m
        self._errors = {
            "sigma_m": errors.sigma_m,
            "sigma_per_m": errors.sigma_per_m,
            "step_m": errors.step_m,
            "disparity_scale_m": 1.0 / inverse if inverse > 0.0 else 0.0,
            "min_m": errors.min_m,
            "max_m": errors.max_m,
        }
        self._key = key

    def measure(self, depth_m: Float32, index: int) -> None:
        """Change picture number `index`. Depth outside the camera's limits becomes inf: nothing measured."""
        blur_depth(depth_m, **self._errors, key=self._key, index=index)
