"""Quality of a camera's colour in five named levels, each with one more feature than the previous one.

| level | resolution factor | samples per pixel | textures | shadows and shading (sim/frame/shading.py) |
|---|---|---|---|---|
| low | 1 | 1 | no: mean colours | no |
| medium | 1 | 1 | yes | no |
| high | 1 | 1 | yes | yes |
| epic | 1 | 4 | yes | yes, with ambient occlusion |
| cinematic | 2 in width and height | 4 | yes | yes, with ambient occlusion |

A camera without a level has the level `medium`. A level overrides the preset, and keys beside it override the level:
`{preset: camera_320x240, quality: high, shadows: false}` has no shadows. If the resolution (or `intrinsics`) is given
beside `cinematic`, the number of pixels stays and each takes 16 samples.

Only colour changes: the other channels are the truth at the pixel's centre, the same at all levels that have the same
resolution. Cameras whose colour MuJoCo draws use only the shadows and the resolution of a level.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from sim.frame.shading import FULL, LEVELLED, MEAN_COLOURS, OCCLUDED, PLAIN, Shading

QualityName = Literal["low", "medium", "high", "epic", "cinematic"]


@dataclass(frozen=True)
class Quality:
    """Level of quality."""

    resolution_factor: int
    supersample: int  # samples of colour along a pixel's edge
    shadows: bool
    shading: Shading


QUALITIES: dict[str, Quality] = {
    "low": Quality(1, 1, shadows=False, shading=MEAN_COLOURS),
    "medium": Quality(1, 1, shadows=False, shading=PLAIN),
    "high": Quality(1, 1, shadows=True, shading=FULL),
    "epic": Quality(1, 2, shadows=True, shading=OCCLUDED),
    "cinematic": Quality(2, 2, shadows=True, shading=OCCLUDED),
}

_PIXELS = frozenset({"resolution", "intrinsics"})


def with_quality(values: Mapping[str, Any], quality: str, given: Collection[str] = ()) -> dict[str, Any]:
    """Return plain values of a camera (sim.sensors.camera_parameters) at a level; keys in `given` stay unchanged."""
    level = QUALITIES[quality]
    changed: dict[str, Any] = {"quality": quality, "shadows": level.shadows}
    supersample = level.supersample
    if level.resolution_factor > 1:
        if _PIXELS.isdisjoint(given) and values.get("resolution") is not None:
            changed |= _finer(values, level.resolution_factor)
        else:
            supersample *= level.resolution_factor
    if values.get("colour", "native") == "native":
        changed["supersample"] = supersample
        changed |= {key: getattr(level.shading, key) for key in LEVELLED}
    return {**values, **{key: value for key, value in changed.items() if key not in given}}


def _finer(values: Mapping[str, Any], factor: int) -> dict[str, Any]:
    width, height = values["resolution"]
    finer: dict[str, Any] = {"resolution": [factor * width, factor * height]}
    given = values.get("intrinsics")
    if given is not None:  # pixel centres have whole numbers there
        finer["intrinsics"] = {
            "fx": factor * given["fx"],
            "fy": factor * given["fy"],
            "cx": factor * (given["cx"] + 0.5) - 0.5,
            "cy": factor * (given["cy"] + 0.5) - 0.5,
        }
    return finer
