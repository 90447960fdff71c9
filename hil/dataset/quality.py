"""Quality levels: how finely cameras draw, by name."""

from __future__ import annotations

from dataclasses import dataclass, replace

from hil.config import Bench
from sim.sensors.camera_parameters import CameraParameters


@dataclass(frozen=True)
class Quality:
    """Of all cameras of a bench."""

    factor: int  # of the resolution of the bench file
    supersample: int
    shadows: bool


QUALITIES: dict[str, Quality] = {
    "low": Quality(1, 1, shadows=False),
    "medium": Quality(1, 1, shadows=True),
    "high": Quality(1, 2, shadows=True),
    "epic": Quality(2, 1, shadows=True),
    "cinematic": Quality(2, 2, shadows=True),
}


def at_quality(bench: Bench, name: str) -> Bench:
    """The bench with its cameras drawing like that. KeyError for a name that is none."""
    quality = QUALITIES[name]
    sensors = dict(bench.config.sensors)
    for key, sensor in sensors.items():
        p = sensor.parameters
        if not isinstance(p, CameraParameters):
            continue
        width, height = p.resolution
        changes = {
            "resolution": (width * quality.factor, height * quality.factor),
            "supersample": quality.supersample,
            "shadows": quality.shadows,
        }
        if p.intrinsics is not None and quality.factor > 1:
            i, f = p.intrinsics, quality.factor
            # Pixel centres have whole numbers: the picture's edge is at -1/2.
            scaled = {"fx": f * i.fx, "fy": f * i.fy, "cx": f * (i.cx + 0.5) - 0.5, "cy": f * (i.cy + 0.5) - 0.5}
            changes["intrinsics"] = i.model_copy(update=scaled)
        sensors[key] = sensor.model_copy(update={"parameters": p.model_copy(update=changes)})
    return replace(bench, config=bench.config.model_copy(update={"sensors": sensors}))
