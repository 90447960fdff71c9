"""Preview pictures for the datasheet: a sample's channels in display colours, as file names and their bytes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.apps.dataset.formats.labels import PictureLabels
from hil.run.report.channel_images import channel_image
from signals.classes import Classes

_SHOWN = ("rgb", "boxes", "depth", "segmentation", "instance", "normal")
_BOX = (255, 255, 0)
_CLOUD_PX, _CLOUD_RANGE_M = 240, 40.0


def camera_previews(
    channels: Mapping[str, NDArray[Any]], classes: Classes, labels: PictureLabels | None = None
) -> dict[str, bytes]:
    """Return a preview of each known channel and, with `labels`, of the colour picture with boxes."""
    shown = dict(channels)
    if labels is not None:
        shown["boxes"] = with_boxes(channels["rgb"], labels)
    return dict(
        _preview(name, "rgb" if name == "boxes" else name, shown[name], classes) for name in _SHOWN if name in shown
    )


def with_boxes(rgb: NDArray[np.uint8], labels: PictureLabels) -> NDArray[np.uint8]:
    """Return a copy of `rgb`, (height, width, 3) uint8, with the outline of every box."""
    boxed = rgb.copy()
    for o in labels.objects:
        cv2.rectangle(boxed, (o.x_min, o.y_min), (o.x_max, o.y_max), _BOX)
    return boxed


def cloud_previews(
    points_L: NDArray[np.float32], segmentation: NDArray[np.uint8], classes: Classes
) -> dict[str, bytes]:
    """Return a top view of a sweep: 40 m to each side, forward is up, points have the colours of their classes.

    `points_L` is (n, 3) [m] in the LiDAR's frame, `segmentation` (n,) class ids.
    """
    top_view = np.zeros((_CLOUD_PX, _CLOUD_PX), np.uint8)
    pixel = np.floor((1.0 - points_L[:, :2] / _CLOUD_RANGE_M) * (0.5 * _CLOUD_PX)).astype(np.int64)
    in_view = ((pixel >= 0) & (pixel < _CLOUD_PX)).all(axis=1)
    top_view[pixel[in_view, 0], pixel[in_view, 1]] = segmentation[in_view]
    return dict([_preview("cloud", "segmentation", top_view, classes)])


def radar_previews(range_doppler: NDArray[np.float32]) -> dict[str, bytes]:
    """Return a picture of a range-Doppler map: the 60 dB below its peak, range upwards, speed to the right."""
    return dict([_preview("map", "range_doppler", range_doppler, Classes())])


def _preview(name: str, channel: str, array: NDArray[Any], classes: Classes) -> tuple[str, bytes]:
    kind, data = channel_image(channel, array, classes)
    return f"{name}.{kind.rpartition('/')[2]}", data
