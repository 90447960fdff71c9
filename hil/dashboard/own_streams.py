"""Names of the streams that the page's own process draws (`hil.dashboard.own_views`)."""

from __future__ import annotations

PREFIX = "view"
STREAMS = (
    "view/camera/rgb",
    "view/camera/depth",
    "view/camera/segmentation",
    "view/lidar/points",
    "view/radar/range_doppler",
    "view/radar/points",
)


def wait_s(took_s: float) -> float:
    """Before the next picture: as long as the last one took, so that drawing takes half a processor at most."""
    return max(0.05, took_s)
