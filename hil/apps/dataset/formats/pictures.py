"""Camera channels as PNG files.

    colour      8-bit RGB, exact
    depth       16-bit grey: distance along the optical axis, rounded to steps of `DepthScale.step_m`;
                0: no surface; 65535: farther than 65534 steps
    class       8-bit grey: the class id; or indexed with the classes' colours as palette, as in Pascal VOC
    instance    16-bit grey: the instance id
    infrared    16-bit grey: the counts
    normal      8-bit RGB: (x, y, z) of the unit normal in the camera frame as floor(127 n + 128.5);
                (0, 0, 0): no surface

Pixels are the same on every machine; a file's bytes may change with the compression library (png.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.apps.dataset.formats.png import encode_png
from signals.errors import RecordingError
from sim import _kernels

NOTHING = 0  # depth value of a pixel without a surface
FARTHER = 65535  # depth value of a surface beyond the scale

UInt8 = NDArray[np.uint8]
UInt16 = NDArray[np.uint16]


@dataclass(frozen=True)
class DepthScale:
    """Scale of a depth picture: depth = value * `step_m`. 1 mm reaches to 65.5 m, 1/256 m (KITTI) to 256 m.

    Raises RecordingError if the step is not 1e-6 to 1 m.
    """

    step_m: float = 0.001

    def __post_init__(self) -> None:
        if not 1e-6 <= self.step_m <= 1.0:
            raise RecordingError(f"depth pictures: the step must be 1e-6 to 1 m, not {self.step_m:g}")

    def values(self, depth_m: NDArray[np.float32]) -> UInt16:
        """Return the pixel values of a (height, width) float32 depth [m]; NaN and infinity are "no surface"."""
        _check("depth", depth_m, np.float32, 1)
        steps = depth_m * np.float64(1.0 / self.step_m)
        steps += 0.5
        np.clip(steps, 1, FARTHER, out=steps)  # a surface closer than half a step must not become "no surface"
        steps[~np.isfinite(depth_m)] = NOTHING
        return steps.astype(np.uint16)


class PictureEncoder:
    """Encoder of channels as PNG files. Every method raises RecordingError for a wrong type or shape.

    `palette` holds the classes' colours, (classes, 3) uint8, for `indexed_png`.
    """

    def __init__(self, depth_scale: DepthScale | None = None, palette: UInt8 | None = None) -> None:
        self.depth_scale = depth_scale or DepthScale()
        self._palette = palette

    def rgb_png(self, rgb: UInt8) -> bytes:
        """Encode a colour picture, (height, width, 3) uint8."""
        _check("rgb", rgb, np.uint8, 3)
        return encode_png(rgb, sub=True)  # a quarter smaller than without, if the camera has noise

    def depth_png(self, depth_m: NDArray[np.float32]) -> bytes:
        """Encode a depth picture, (height, width) float32 [m]."""
        return encode_png(self.depth_scale.values(depth_m), sub=True)

    def class_png(self, segmentation: UInt8) -> bytes:
        """Encode class ids, (height, width) uint8, as grey values."""
        _check("segmentation", segmentation, np.uint8, 1)
        return encode_png(segmentation)

    def indexed_png(self, segmentation: UInt8) -> bytes:
        """Encode class ids, (height, width) uint8, with the palette, which must have a colour for each of them."""
        _check("segmentation", segmentation, np.uint8, 1)
        if self._palette is None:
            raise RecordingError("class pictures: no palette was given for an indexed picture")
        try:
            return encode_png(segmentation, palette=self._palette)
        except ValueError as error:
            raise RecordingError(f"class pictures: {error}; the palette has {len(self._palette)} colours") from error

    def instance_png(self, instance: UInt16) -> bytes:
        """Encode instance ids, (height, width) uint16, as grey values."""
        _check("instance", instance, np.uint16, 1)
        return encode_png(instance)

    def counts_png(self, infrared: UInt16) -> bytes:
        """Encode counts of a thermal camera, (height, width) uint16, as grey values."""
        _check("infrared", infrared, np.uint16, 1)
        return encode_png(infrared, sub=True)

    def normal_png(self, normal_C: NDArray[np.float32]) -> bytes:
        """Encode unit normals in the camera frame, (height, width, 3) float32."""
        return encode_png(normal_values(normal_C))


def normal_values(normal_C: NDArray[np.float32]) -> UInt8:
    """Return the pixel values of unit normals, both (height, width, 3). Raises RecordingError."""
    _check("normal", normal_C, np.float32, 3)
    values = np.empty(normal_C.shape, np.uint8)
    _kernels.normal_values(normal_C, values)
    return values


def palette_csv(names: tuple[str, ...], colours: tuple[tuple[int, int, int], ...]) -> str:
    """Return classes.csv: id, name and colour of each class."""
    rows = [f"{index},{name},{r},{g},{b}" for index, (name, (r, g, b)) in enumerate(zip(names, colours, strict=True))]
    return "\n".join(["#id,name,red,green,blue", *rows, ""])


def _check(name: str, array: NDArray[Any], dtype: type[np.generic], components: int) -> None:
    dimensions = 2 if components == 1 else 3
    fits = array.ndim == dimensions and (components == 1 or array.shape[2] == components)
    if array.dtype != dtype or not fits:
        shape = "(height, width)" if components == 1 else f"(height, width, {components})"
        raise RecordingError(
            f"{name}: the picture must be {np.dtype(dtype).name} {shape}, not {array.dtype.name} {array.shape}"
        )
    if array.size == 0:
        raise RecordingError(f"{name}: the picture is empty, {array.shape}")
    if not array.flags.c_contiguous:
        raise RecordingError(f"{name}: the picture's rows must be contiguous in memory; copy it first")
