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
    """Before the next picture: four times as long as the last one took, so that drawing takes a fifth of a processor.

    What takes longer than 25 ms is drawn more often than that, so that what is seen is never much older than 0.1 s; and
    what takes longer than 0.1 s takes half a processor at most.
    """
    return max(0.05, min(4.0 * took_s, 0.1), took_s)
