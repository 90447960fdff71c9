"""One frame of every channel as a person can look at it, for the datasheet: file name to its bytes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.dashboard.pictures import picture
from hil.dataset.formats.labels import PictureLabels
from hil.signals.classes import Classes

_SHOWN = ("rgb", "boxes", "depth", "segmentation", "instance", "normal")
_BOX = (255, 255, 0)
_CLOUD_PX, _CLOUD_REACH_M = 240, 40.0


def camera_looks(
    channels: Mapping[str, NDArray[Any]], classes: Classes, labels: PictureLabels | None = None
) -> dict[str, bytes]:
    """The channels that are there, and colour with its boxes."""
    shown = dict(channels)
    if labels is not None:
        shown["boxes"] = with_boxes(channels["rgb"], labels)
    return dict(
        _look(name, "rgb" if name == "boxes" else name, shown[name], classes) for name in _SHOWN if name in shown
    )


def with_boxes(rgb: NDArray[np.uint8], labels: PictureLabels) -> NDArray[np.uint8]:
    """A copy with the outline of every box."""
    boxed = rgb.copy()
    for o in labels.objects:
        cv2.rectangle(boxed, (o.x_min, o.y_min), (o.x_max, o.y_max), _BOX)
    return boxed


def cloud_looks(points_L: NDArray[np.float32], segmentation: NDArray[np.uint8], classes: Classes) -> dict[str, bytes]:
    """From above, forward is up, each point in its class's colour; as far as 40 m."""
    seen_from_above = np.zeros((_CLOUD_PX, _CLOUD_PX), np.uint8)
    place = np.floor((1.0 - points_L[:, :2] / _CLOUD_REACH_M) * (0.5 * _CLOUD_PX)).astype(np.int64)
    near = ((place >= 0) & (place < _CLOUD_PX)).all(axis=1)
    seen_from_above[place[near, 0], place[near, 1]] = segmentation[near]
    return dict([_look("cloud", "segmentation", seen_from_above, classes)])


def radar_looks(range_doppler: NDArray[np.float32]) -> dict[str, bytes]:
    """Power over 60 dB below the greatest; range upwards, speed to the right."""
    return dict([_look("map", "range_doppler", range_doppler, Classes())])


def _look(name: str, channel: str, array: NDArray[Any], classes: Classes) -> tuple[str, bytes]:
    kind, data = picture(channel, array, classes)
    return f"{name}.{kind.rpartition('/')[2]}", data
