"""Ground of an imported map with heights."""

from __future__ import annotations

from sim.scene.imports.elevation import Terrain
from sim.scene.maps.map_builder import MapBuilder

_DEPTH_M = 5.0  # of the solid ground under the lowest height


def add_terrain(builder: MapBuilder, terrain: Terrain, *, material: str) -> None:
    """Add a terrain as the ground."""
    low, high = float(terrain.heights.min()), float(terrain.heights.max())
    rise = max(high - low, 0.01)
    half = 0.5 * terrain.cell_m * (len(terrain.heights) - 1)
    builder.hfield("terrain", (terrain.heights - low) / rise, (half, half, rise, _DEPTH_M))
    builder.ground_hfield("terrain", material=material, pos=(terrain.low[0] + half, terrain.low[1] + half, low))
