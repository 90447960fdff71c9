"""Methods that take pictures: simGetImages and simGetImage."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from hil.apps.airsim.api.session import VEHICLE
from hil.apps.airsim.pictures.cameras import Wanted
from hil.apps.airsim.pictures.image_types import SCENE, Taken, bgr, colours, numbers, png
from hil.apps.airsim.rpc.arguments import BOOL, NAME, TEXT, either, list_of, one_of, struct
from hil.apps.airsim.rpc.methods import Method, Parameter, RpcError, method, optional
from hil.apps.airsim.simulation import Simulation

_MOST_IMAGES = 100
_LARGE_PIXELS = 1 << 19  # of one call, which takes some ten milliseconds: beyond, it is drawn in a thread
IMAGE_TYPE = one_of("ImageType", *range(12))
CAMERA = Parameter("camera_name", NAME)
# AirSim sends `external`, Cosys-AirSim the name of an annotation layer in its place.
EXTERNAL_OR_ANNOTATION = optional("external", either("true, false or a text", BOOL, TEXT), False)


class ImageRequest(NamedTuple):
    """AirSim's ImageRequest. Cosys-AirSim's has a name of an annotation layer; it tells the two clients apart."""

    camera_name: str = ""
    image_type: int = SCENE
    pixels_as_float: bool = False
    compress: bool = True
    annotation_name: str | None = None
    camera_id: str | None = None  # before AirSim 1.2

    @property
    def camera(self) -> str:
        """Name or number of the camera."""
        return self.camera_name if self.camera_id is None else self.camera_id


REQUEST = struct(
    "ImageRequest",
    ImageRequest,
    camera_name=NAME,
    image_type=IMAGE_TYPE,
    pixels_as_float=BOOL,
    compress=BOOL,
    annotation_name=TEXT,
    camera_id=NAME,
)


def methods(sim: Simulation) -> list[Method]:
    """Return the methods of this group."""

    def images(requests: list[ImageRequest], vehicle: str, external: bool) -> list[dict[str, Any]]:
        wanted = [
            Wanted(sim.cameras.find(each.camera, vehicle, external), each.image_type, each.annotation_name is not None)
            for each in requests
        ]
        taken = sim.cameras.take(wanted)
        replies = [_response(sim, *each) for each in zip(requests, wanted, taken, strict=True)]
        if not any(each.instances for each in wanted):
            sim.large_replies.note("simGetImages", sum(each["image_data_float"].size for each in replies))
        return replies

    def image(camera: str, image_type: int, vehicle: str, external: bool | str) -> bytes:
        wanted = Wanted(sim.cameras.find(camera, vehicle, external is True), image_type, isinstance(external, str))
        return png(colours(image_type, sim.cameras.take([wanted])[0]))

    def are_large(requests: list[ImageRequest], vehicle: str, external: bool) -> bool:
        return is_large([(each.camera, each.image_type) for each in requests], vehicle, external)

    def is_large(pictures: list[tuple[str, int]], vehicle: str, external: bool) -> bool:
        try:
            sizes = [sim.cameras.find(camera, vehicle, external).size(kind) for camera, kind in pictures]
        except RpcError:
            return False  # the call tells it
        return sum(width * height for width, height in sizes) > _LARGE_PIXELS

    external = optional("external", BOOL, False)
    requests, image_type = (
        Parameter("requests", list_of(REQUEST, most=_MOST_IMAGES)),
        Parameter("image_type", IMAGE_TYPE),
    )
    return [
        method("simGetImages", images, requests, VEHICLE, external)._replace(is_long=are_large),
        method("simGetImage", image, CAMERA, image_type, VEHICLE, EXTERNAL_OR_ANNOTATION)._replace(
            is_long=lambda camera, kind, vehicle, external: is_large([(camera, kind)], vehicle, external is True)
        ),
    ]


def _response(sim: Simulation, request: ImageRequest, wanted: Wanted, taken: Taken) -> dict[str, Any]:
    """Return AirSim's ImageResponse; raw pixels are BGR, and RGB for Cosys-AirSim."""
    pixels, shades = b"", np.empty(0, np.float32)
    if request.pixels_as_float:
        shades = numbers(wanted.image_type, taken).ravel()
    else:
        rgb = colours(wanted.image_type, taken)
        pixels = png(rgb) if request.compress else rgb.tobytes() if wanted.instances else bgr(rgb)
    pose = wanted.camera.frame.pose(*taken.place)
    response = {
        "image_data_uint8": pixels,
        "image_data_float": shades,
        "camera_position": pose.position,
        "camera_name": request.camera,
        "camera_orientation": pose.orientation,
        "time_stamp": sim.now_ns,
        "message": "",
        "pixels_as_float": request.pixels_as_float,
        "compress": request.compress,
        "width": taken.model.width,
        "height": taken.model.height,
        "image_type": wanted.image_type,
    }
    return response if request.annotation_name is None else {**response, "annotation_name": request.annotation_name}
