"""Names of the streams that a page can show.

front/rgb, lidar/points       output of a sensor of the run: PORT/CHANNEL
view/camera/rgb               a preview that the page's server renders (`hil.apps.dash.views.preview_sensors`)
companion/NAME/map            the map that a companion publishes
drawings                      lines and texts of scripts in the 3-D view (`hil airsim`)
"""

from __future__ import annotations

CLOUD_CHANNEL = "points"  # the only channel of a LiDAR
DRAWINGS = "drawings"
PREVIEW_PREFIX = "view"
PREVIEW_STREAMS = (
    "view/camera/rgb",
    "view/camera/depth",
    "view/camera/segmentation",
    "view/lidar/points",
    "view/radar/range_doppler",
    "view/radar/points",
)
_MAP_PREFIX, _MAP_SUFFIX = "companion/", "/map"


def map_stream(client: str) -> str:
    """Return the stream of a companion's map."""
    return f"{_MAP_PREFIX}{client}{_MAP_SUFFIX}"


def map_client(stream: str) -> str | None:
    """Return the companion that publishes a map stream; None for any other stream."""
    if not (stream.startswith(_MAP_PREFIX) and stream.endswith(_MAP_SUFFIX)):
        return None
    return stream[len(_MAP_PREFIX) : -len(_MAP_SUFFIX)]
