"""One frame of every channel as a person can look at it, for the datasheet.

Colours come from tables and comparisons alone, so that pictures are the same bytes everywhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.dataset.formats.datasheet import SamplePicture
from hil.dataset.formats.labels import PictureLabels
from hil.dataset.formats.png import encode_png
from hil.signals.classes import Classes

UInt8 = NDArray[np.uint8]

_SHOWN = ("rgb", "depth", "segmentation", "instance", "normal")
_BOX = (255, 255, 0)
_CLOUD_PX = 240
_SMALLEST_MAP_PX = 240
_NEAREST_M, _STEP = 0.5, 1.0274  # shades of distance: 256 steps of 2.74 %, from half a metre to 500 m
_DECADES_STEP = 1.0557  # shades of power: 255 steps make 60 dB
# Of things side by side, to tell them apart (any order does); the first is nothing.
_IDS = np.array(
    [
        *((24, 24, 24), (230, 159, 0), (86, 180, 233), (0, 158, 115), (240, 228, 66), (0, 114, 178), (213, 94, 0)),
        *((204, 121, 167), (170, 170, 170), (128, 90, 60), (150, 220, 120), (120, 100, 200), (250, 180, 180)),
    ],
    np.uint8,
)


def _shades(first: float, ratio: float, count: int) -> NDArray[np.float64]:
    """Thresholds, each `ratio` times the one before."""
    edges = [first]
    while len(edges) < count:
        edges.append(edges[-1] * ratio)
    return np.array(edges)


def coloured(channel: str, picture: NDArray[Any], classes: Classes) -> UInt8:
    """The picture as colours or grey."""
    if channel == "depth":
        shade = 255 - np.searchsorted(_shades(_NEAREST_M, _STEP, 255), picture).astype(np.uint8)
        return np.where(np.isfinite(picture), shade, 0).astype(np.uint8)
    if channel == "segmentation":
        table = _IDS[np.arange(256) % len(_IDS)].copy()
        if classes.colours:
            table[: len(classes.colours)] = classes.colours
        return table[picture]
    if channel == "instance":
        table = _IDS[1 + np.arange(65536) % (len(_IDS) - 1)]
        table[0] = _IDS[0]
        return table[picture]
    if channel == "normal":  # right is red, up is green, towards the camera is blue
        hit = (picture != 0.0).any(axis=2)
        towards = picture * np.array([1.0, -1.0, -1.0], np.float32)
        return np.where(hit[:, :, None], np.floor(127.0 * towards + 128.5), 0.0).astype(np.uint8)
    return np.asarray(picture, np.uint8)


def camera_looks(
    channels: Mapping[str, NDArray[Any]], classes: Classes, labels: PictureLabels | None = None
) -> list[SamplePicture]:
    """The channels that are there, and colour with its boxes."""
    looks = [
        SamplePicture(name, encode_png(coloured(name, channels[name], classes)), name)
        for name in _SHOWN
        if name in channels
    ]
    if labels is not None and "rgb" in channels:
        looks.insert(1, SamplePicture("boxes", encode_png(with_boxes(channels["rgb"], labels)), "boxes"))
    return looks


def with_boxes(rgb: UInt8, labels: PictureLabels) -> UInt8:
    """A copy with the outline of every box."""
    picture = rgb.copy()
    for o in labels.objects:
        rows, columns = slice(o.y_min, o.y_max + 1), slice(o.x_min, o.x_max + 1)
        picture[[o.y_min, o.y_max], columns] = _BOX
        picture[rows, [o.x_min, o.x_max]] = _BOX
    return picture


def cloud_look(points_L: NDArray[np.float32], segmentation: UInt8, classes: Classes) -> SamplePicture:
    """From above, forward is up, each point in its class's colour; as far as 40 m."""
    reach_m = 40.0
    picture = np.full((_CLOUD_PX, _CLOUD_PX, 3), 18, np.uint8)
    place = np.floor((1.0 - points_L[:, :2] / reach_m) * (0.5 * _CLOUD_PX)).astype(np.int64)
    seen = ((place >= 0) & (place < _CLOUD_PX)).all(axis=1)
    colours = np.full((256, 3), 200, np.uint8)
    if classes.colours:
        colours[: len(classes.colours)] = classes.colours
    picture[place[seen, 0], place[seen, 1]] = colours[segmentation[seen]]
    return SamplePicture("LiDAR from above, 40 m each way", encode_png(picture), "cloud")


def radar_look(range_doppler: NDArray[np.float32]) -> SamplePicture:
    """Power over 60 dB below the greatest; range to the right, speed upwards."""
    top = float(range_doppler.max(initial=0.0))
    edges = _shades(top * 1e-6, _DECADES_STEP, 255) if top > 0.0 else np.full(255, np.inf)
    grey = np.searchsorted(edges, range_doppler).astype(np.uint8)[::-1]
    grow = max(1, _SMALLEST_MAP_PX // max(grey.shape))
    picture = np.kron(grey, np.ones((grow, grow), np.uint8))
    return SamplePicture("radar, range and speed", encode_png(picture), "map")
