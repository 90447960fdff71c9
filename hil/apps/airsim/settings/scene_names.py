"""Scenes under the names that users of AirSim know."""

from __future__ import annotations

_NAMES = {
    "blocks": "blocks",
    "airsimnh": "airsim_nh",
    "neighborhood": "airsim_nh",
    "landscapemountains": "landscape_mountains",
    "mountains": "landscape_mountains",
}


def scene_name(name: str) -> str:
    """Return the bench's name of a scene that may be named as in AirSim, in any case; other names as they are."""
    return _NAMES.get(name.lower(), name)
