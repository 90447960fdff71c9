"""Textures of the maps, as PNG: sRGB, shipped in sim/scene/assets/textures (made by tools/art/textures)."""

from __future__ import annotations

from functools import cache

from sim.scene.maps.asset_files import asset_file


@cache
def png(name: str) -> bytes:
    """Return the texture `name`, read once in a process."""
    return asset_file(f"textures/{name}.png")[0].read_bytes()
