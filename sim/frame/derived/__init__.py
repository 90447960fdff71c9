"""Channels that are computed from others: one file each, found by the channel's name, with a function

    def fill(pictures, classes, out): ...

that writes `out`, rows of the picture, from the same rows of the channels that the table names (`Channel.of`). A
channel that depends on the scene or the camera's pose has a class instead, made once for a camera:

    class Filler:
        def __init__(self, view: View) -> None: ...
        def fill(self, pictures, pose, first_row, out) -> None: ...
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from numpy.typing import NDArray

from signals.classes import Classes
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose

Fill = Callable[[Mapping[str, NDArray[Any]], CameraPose, int, NDArray[Any]], None]


@dataclass(frozen=True)
class View:
    """The view of one camera for which channels are computed. `shadows`: the sun's shadows are wanted."""

    geometry: Any  # sim.frame.geometry.FrameGeometry
    camera: CameraModel
    classes: Classes
    shadows: bool = False


def fill_of(channel: str, view: View) -> Fill:
    """Return the function that computes a channel of this view."""
    module = import_module(f"{__name__}.{channel}")
    if hasattr(module, "Filler"):
        fill: Fill = module.Filler(view).fill
        return fill

    def fill_by_classes(
        pictures: Mapping[str, NDArray[Any]], _pose: CameraPose, _first_row: int, out: NDArray[Any]
    ) -> None:
        module.fill(pictures, view.classes, out)

    return fill_by_classes
