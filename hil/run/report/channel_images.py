"""Channels of cameras and radars in display colours, encoded as JPEG or PNG files."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from signals.channels import CHANNELS
from signals.classes import Classes

_MIN_RANGE_M, _MAX_RANGE_M = 0.5, 200.0
_NO_SURFACE = (190, 190, 190)  # BGR
_MAX_SPEED_MPS = 5.0
_MAP_SPAN_DB = 60.0  # dynamic range of a range-Doppler map


def channel_image(channel: str, array: NDArray[Any], classes: Classes) -> tuple[str, bytes]:
    """Return the media type and the bytes of a channel's picture.

    `array` has the shape of a camera's channel, or is a range-Doppler map, which spans 60 dB below its peak. Distances
    and speeds have fixed scales, ids a hue each.
    """
    look = CHANNELS[channel].look if channel in CHANNELS else "power"  # a radar's range-Doppler map
    if look == "colour":
        return _encoded(".jpg", cv2.cvtColor(np.ascontiguousarray(array), cv2.COLOR_RGB2BGR))
    if look == "distance":
        finite = np.isfinite(array)
        metres = np.clip(np.where(finite, array, _MAX_RANGE_M), _MIN_RANGE_M, _MAX_RANGE_M)
        nearness = 1.0 - np.log(metres / _MIN_RANGE_M) / np.float32(np.log(_MAX_RANGE_M / _MIN_RANGE_M))
        bgr = cv2.applyColorMap(np.rint(255.0 * nearness).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
        bgr[~finite] = _NO_SURFACE
        return _encoded(".jpg", bgr)
    if look == "speed":
        grey = (127.5 + 127.5 * np.clip(np.nan_to_num(array) / _MAX_SPEED_MPS, -1.0, 1.0)).astype(np.uint8)
        return _encoded(".jpg", cv2.applyColorMap(grey, cv2.COLORMAP_TWILIGHT_SHIFTED))
    if look == "direction":
        # Red to the right, green up, blue to the camera: the camera's y is down and its z forward.
        bgr = (np.clip(np.nan_to_num(array), -1.0, 1.0) * (1.0, -1.0, -1.0))[..., ::-1]
        return _encoded(".jpg", (127.5 + 127.5 * bgr).astype(np.uint8))
    if look == "value":
        finite = array[np.isfinite(array)]
        low, high = np.percentile(finite, (1.0, 99.0)) if finite.size else (0.0, 1.0)
        share = np.clip((np.nan_to_num(array) - low) / max(high - low, 1e-9), 0.0, 1.0)
        return _encoded(".jpg", cv2.applyColorMap((255.0 * share).astype(np.uint8), cv2.COLORMAP_INFERNO))
    if look == "power":
        power_db = 10.0 * np.log10(np.maximum(array, 1e-6))
        peak_db = float(power_db.max(initial=-60.0))
        grey = (255.0 * np.clip(1.0 + (power_db - peak_db) / _MAP_SPAN_DB, 0.0, 1.0)).astype(np.uint8)
        # Range upwards, speed to the right.
        return _encoded(".png", cv2.applyColorMap(np.ascontiguousarray(grey.T[::-1]), cv2.COLORMAP_INFERNO))
    palette = _palette(classes.colours if look == "classes" else ())
    return _encoded(".png", cv2.applyColorMap((array & 255).astype(np.uint8), palette))


def rgb_png(rgb: NDArray[np.uint8]) -> bytes:
    """Return a colour picture, (height, width, 3) uint8, as a PNG file."""
    return bgr_png(rgb[:, :, ::-1])


def bgr_png(bgr: NDArray[Any]) -> bytes:
    """Return a picture as OpenCV has it, uint8, colours blue first, as a PNG file."""
    encoded, data = cv2.imencode(".png", np.ascontiguousarray(bgr))
    assert encoded
    return data.tobytes()


@lru_cache(maxsize=4)
def _palette(named: tuple[tuple[int, int, int], ...]) -> NDArray[np.uint8]:
    """Return the BGR colours of ids 0 to 255: from `named` (RGB), for further ids hues a golden ratio apart."""
    ids = np.arange(256)
    hsv = np.stack([(ids * 111) % 180, 150 + 40 * (ids % 3), 235 - 45 * (ids % 4)], axis=-1).astype(np.uint8)
    colours = cv2.cvtColor(hsv[:, None], cv2.COLOR_HSV2BGR)
    colours[0] = (68, 59, 52)
    if named:
        colours[: len(named), 0] = np.array(named, np.uint8)[:256, ::-1]
    return np.asarray(colours, np.uint8)


def _encoded(kind: str, bgr: NDArray[Any]) -> tuple[str, bytes]:
    options = [cv2.IMWRITE_JPEG_QUALITY, 85] if kind == ".jpg" else [cv2.IMWRITE_PNG_COMPRESSION, 1]
    encoded, data = cv2.imencode(kind, np.ascontiguousarray(bgr), options)
    assert encoded
    return ("image/jpeg" if kind == ".jpg" else "image/png"), data.tobytes()
