"""Image types of AirSim: which channels each needs, and its pixels as colours or as numbers.

Z is the distance along the camera's axis, W the picture's width and f the focal length in pixels. After AirSim's
documentation:

    Scene                sRGB
    DepthPlanar          Z [m]; the sky is at 65504 m, the greatest number of AirSim's 16-bit pictures
    DepthPerspective     distance from the camera along the ray [m]
    DepthVis             Z / 100 m, at most 1
    DisparityNormalized  disparity of a stereo pair with a base of 25 cm over the width: 0.25 m f / (W Z)
    Segmentation         colour of the object's id
    SurfaceNormals       (1 + n) / 2 of the unit normal n: north, east, up
    Infrared             the object's id as a shade

Colours of a picture of numbers are shades: 255 for 1 and more. Numbers of a picture of colours are red / 255.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.apps.airsim.pictures.camera import CameraPlace, ServedCamera
from hil.apps.airsim.pictures.noise import with_noise
from hil.apps.airsim.pictures.segmentation import Segmentation
from hil.apps.airsim.rpc.methods import RpcError
from sim.frame.camera_model import CameraModel

SCENE, DEPTH_PLANAR, DEPTH_PERSPECTIVE, DEPTH_VIS, DISPARITY, SEGMENTATION, NORMALS, INFRARED = range(8)
NAMES = (
    "Scene", "DepthPlanar", "DepthPerspective", "DepthVis", "DisparityNormalized", "Segmentation", "SurfaceNormals",
    "Infrared", "OpticalFlow", "OpticalFlowVis", "Lighting", "Annotation",
)  # fmt: skip
_CHANNEL = ("rgb", "depth", "range", "depth", "depth", "instance", "normal", "instance")
_SKY_M = np.float32(65504.0)
_BASE_M, _WHITE_M = 0.25, 100.0


class Taken(NamedTuple):
    """Channels of one view, and how it was taken."""

    arrays: dict[str, NDArray[Any]]
    t_ns: int
    camera: ServedCamera
    place: CameraPlace
    model: CameraModel
    segmentation: Segmentation
    instances: bool  # ids as Cosys-AirSim has them


def channel(image_type: int) -> str:
    """Return the channel that an image type needs. Raises RpcError for a type that is not drawn here."""
    if image_type >= len(_CHANNEL):
        drawn = ", ".join(f"{number} {name}" for number, name in enumerate(NAMES[: len(_CHANNEL)]))
        raise RpcError(f"the image type {image_type} ({NAMES[image_type]}) is not drawn here; the types are: {drawn}")
    return _CHANNEL[image_type]


def numbers(image_type: int, taken: Taken) -> NDArray[np.float32]:
    """Return the picture as numbers, (height, width)."""
    if image_type in (DEPTH_PLANAR, DEPTH_PERSPECTIVE, DEPTH_VIS, DISPARITY):
        return _measured(image_type, taken)
    return colours(image_type, taken)[:, :, 0] * np.float32(1.0 / 255.0)


def colours(image_type: int, taken: Taken) -> NDArray[np.uint8]:
    """Return the picture as RGB, (height, width, 3), with the noise of the settings."""
    noise = taken.camera.settings.noise(image_type)
    rgb = _colours(image_type, taken)
    return with_noise(rgb, noise, f"{taken.camera.key}.{image_type}", taken.t_ns) if noise.enabled else rgb


def _colours(image_type: int, taken: Taken) -> NDArray[np.uint8]:
    if image_type == SCENE:
        return taken.arrays["rgb"]
    if image_type == SEGMENTATION:
        return np.take(taken.segmentation.colours(taken.instances), taken.arrays["instance"], axis=0)
    if image_type == INFRARED:
        return _grey(np.take(taken.segmentation.grey(), taken.arrays["instance"]))
    if image_type == NORMALS:
        return _normals(taken)
    shade = np.minimum(_measured(image_type, taken), np.float32(1.0)) * np.float32(255.0)
    return _grey(shade.astype(np.uint8))


def png(rgb: NDArray[np.uint8]) -> bytes:
    """Return a PNG with four channels, as AirSim's have."""
    done, data = cv2.imencode(".png", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGRA))
    if not done:
        raise RpcError("the picture cannot be written as PNG")
    return bytes(data)


def bgr(rgb: NDArray[np.uint8]) -> bytes:
    """Return the pixels in the order blue, green, red."""
    return cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR).tobytes()


def _measured(image_type: int, taken: Taken) -> NDArray[np.float32]:
    measured = taken.arrays[_CHANNEL[image_type]]
    if image_type == DEPTH_VIS:
        return np.minimum(measured * np.float32(1.0 / _WHITE_M), np.float32(1.0))
    if image_type == DISPARITY:
        scale = np.float32(_BASE_M * taken.model.fx / taken.model.width)
        return scale / np.maximum(measured, np.float32(1e-3))
    return np.minimum(measured, _SKY_M)


def _grey(shade: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return cv2.cvtColor(shade, cv2.COLOR_GRAY2RGB)  # type: ignore[return-value]


def _normals(taken: Taken) -> NDArray[np.uint8]:
    """Return normals as colours; no surface is black."""
    n = taken.arrays["normal"].reshape(-1, 3)
    R_WC = np.array(taken.place.optical.R_WC, np.float32).reshape(3, 3)[[1, 0, 2]]  # rows: north, east, up
    x, y, z = n[:, :1], n[:, 1:2], n[:, 2:]
    n_W = x * R_WC[:, 0] + y * R_WC[:, 1] + z * R_WC[:, 2]
    shown = (n_W + np.float32(1.0)) * np.float32(127.5)
    np.clip(shown, 0.0, 255.0, out=shown)
    shown[~n.any(axis=1)] = 0.0
    return shown.astype(np.uint8).reshape(taken.arrays["normal"].shape)
