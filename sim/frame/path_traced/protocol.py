"""Messages between the bench and the path tracer's process. No module of the tracer itself is imported here."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim.frame.path_traced.sky_request import SkyRequest

PLAIN, WATERY, LEAFY = 0, 1, 2  # kinds of a surface


class StartRequest(NamedTuple):
    """First message: the light of the scene, and the tracer's threads."""

    sky: SkyRequest
    threads: int


class LensData(NamedTuple):
    """Directions of a camera. Those of a lens with distortion are tabulated at `nodes` points per pixel and edge."""

    width: int
    height: int
    f: tuple[float, float]
    c: tuple[float, float]
    table: NDArray[np.float32] | None  # (nodes height + 1, nodes width + 1, 3), the first at the picture's corner
    nodes: int
    planes_m: tuple[float, float]  # along the axis for a pinhole, along the ray for other lenses


class Exposure(NamedTuple):
    """Poses of the camera in one picture, of `moments` x `bands`; each band has `band_rows` rows."""

    p_WC: NDArray[np.float64]  # (moments * bands, 3), relative to the scene's origin
    R_WC: NDArray[np.float64]  # (moments * bands, 9)
    moments: int
    bands: int
    band_rows: int


class RenderRequest(NamedTuple):
    """One picture. `moving`: geoms of actors, their positions and rotations."""

    lens: int
    exposure: Exposure
    moving: tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]
    samples: int
    seed: int
    textures: bool = True
    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)  # of light before the tone curve
