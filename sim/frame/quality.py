"""Quality of a camera's colour in five named levels, each with one more feature than the previous one.

| level | resolution factor | samples per pixel | textures | shadows and shading (sim/frame/shading.py) | paths |
|---|---|---|---|---|---|
| low | 1 | 1 | no: mean colours | no | 8 |
| medium | 1 | 1 | yes | no | 16 |
| high | 1 | 1, on outlines 4 of coverage | yes | yes | 32 |
| epic | 1 | 4 | yes | yes, with ambient occlusion | 64 |
| cinematic | 2 in width and height | 4 | yes | yes, with ambient occlusion | 64 |

A camera without a level has the level `medium`. A level overrides the preset, and keys beside it override the level:
`{preset: camera_320x240, quality: high, shadows: false}` has no shadows. If the resolution (or `intrinsics`) is given
beside `cinematic`, the number of pixels stays and each takes 16 samples.

Only colour changes: the other channels are the truth at the pixel's centre, the same at all levels that have the same
resolution. Cameras whose colour MuJoCo draws use only the shadows and the resolution of a level. Path-traced colour
always has shadows, and 32 paths without a level.
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
    paths: int  # per pixel, of path-traced colour


QUALITIES: dict[str, Quality] = {
    "low": Quality(1, 1, shadows=False, shading=MEAN_COLOURS, paths=8),
    "medium": Quality(1, 1, shadows=False, shading=PLAIN, paths=16),
    "high": Quality(1, 1, shadows=True, shading=FULL, paths=32),
    "epic": Quality(1, 2, shadows=True, shading=OCCLUDED, paths=64),
    "cinematic": Quality(2, 2, shadows=True, shading=OCCLUDED, paths=64),
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
    elif values["colour"] == "path_traced":
        changed |= {"samples": level.paths, "textures": level.shading.textures}
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
