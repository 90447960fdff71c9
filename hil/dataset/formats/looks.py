"""One frame of every channel as a person can look at it, for the datasheet."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.dataset.formats.datasheet import SamplePicture
from hil.dataset.formats.labels import PictureLabels
from hil.signals.classes import Classes
from sim._kernels import PngEncoder

_SHOWN = ("rgb", "depth", "segmentation", "instance", "normal")
_BOX = (255, 255, 0)
_CLOUD_PX = 240
_SMALLEST_MAP_PX = 240


def camera_looks(
    channels: Mapping[str, NDArray[Any]], classes: Classes, labels: PictureLabels | None = None
) -> list[SamplePicture]:
    """The channels that are there, and colour with its boxes."""
    from hil.report.frame_pictures import coloured  # half a second of matplotlib

    png = PngEncoder()
    looks = [
        SamplePicture(name, png.encode(np.ascontiguousarray(coloured(name, channels[name], classes))))
        for name in _SHOWN
        if name in channels
    ]
    if labels is not None and "rgb" in channels:
        looks.insert(1, SamplePicture("boxes", png.encode(with_boxes(channels["rgb"], labels))))
    return looks


def with_boxes(rgb: NDArray[np.uint8], labels: PictureLabels) -> NDArray[np.uint8]:
    """A copy with the outline of every box."""
    picture = rgb.copy()
    for o in labels.objects:
        rows, columns = slice(o.y_min, o.y_max + 1), slice(o.x_min, o.x_max + 1)
        picture[[o.y_min, o.y_max], columns] = _BOX
        picture[rows, [o.x_min, o.x_max]] = _BOX
    return picture


def cloud_look(points_L: NDArray[np.float32], segmentation: NDArray[np.uint8], classes: Classes) -> SamplePicture:
    """From above, forward is up, each point in its class's colour; as far as 40 m."""
    reach_m = 40.0
    picture = np.full((_CLOUD_PX, _CLOUD_PX, 3), 18, np.uint8)
    place = np.floor((1.0 - points_L[:, :2] / reach_m) * (0.5 * _CLOUD_PX)).astype(np.int64)
    seen = ((place >= 0) & (place < _CLOUD_PX)).all(axis=1)
    colours = np.full((256, 3), 200, np.uint8)
    if classes.colours:
        colours[: len(classes.colours)] = classes.colours
    picture[place[seen, 0], place[seen, 1]] = colours[segmentation[seen]]
    return SamplePicture("LiDAR from above, 40 m each way", PngEncoder().encode(picture))


def radar_look(range_doppler: NDArray[np.float32]) -> SamplePicture:
    """Power in decibels over 60 dB below the greatest; range to the right, speed upwards."""
    top = float(range_doppler.max(initial=0.0))
    level = np.log10(np.maximum(range_doppler, np.float32(1e-30)) / max(top, 1e-30))
    grey = (np.clip(1.0 + level / 6.0, 0.0, 1.0) * 255.0).astype(np.uint8)[::-1]
    grow = max(1, _SMALLEST_MAP_PX // max(grey.shape))
    return SamplePicture("radar, range and speed", PngEncoder().encode(np.kron(grey, np.ones((grow, grow), np.uint8))))
