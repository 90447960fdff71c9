"""Solid shapes of crowns, for contact and clearance; they are not drawn."""

from __future__ import annotations

from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.meshes import blob, revolve
from sim.scene.random_generator import RandomGenerator


def crown_hull(builder: MapBuilder, shape: int, radius_m: float) -> str:
    """Add one of the shared round crowns, in half-metre steps of radius; return its name."""
    steps = max(2, round(radius_m / 0.5))
    name = f"crown_{shape}_{steps}"
    if not builder.has_mesh(name):
        rng = RandomGenerator(shape, "crown")
        lumps = [[rng.between(0.80, 1.16) for _ in range(18)] for _ in range(11)]
        mesh = blob(lambda ring, side: lumps[ring][side], rings=11, sides=18)
        scale = 0.5 * steps
        mesh.vertices = [(scale * x, scale * y, 0.85 * scale * z) for x, y, z in mesh.vertices]
        builder.mesh(name, mesh)
    return name


def fir_hull(builder: MapBuilder, height_m: float) -> str:
    """Add the crown of a conifer, a cone of five tiers; return its name."""
    steps = round(height_m)
    name = f"fir_{steps}"
    if not builder.has_mesh(name):
        rng = RandomGenerator(steps, "fir")
        tiers = 5
        profile = [(0.12, 0.0)]
        for i in range(tiers):
            low, high = i / tiers, (i + 1) / tiers
            wide = 0.26 * height_m * (1.0 - 0.86 * low)
            profile.append((wide, low * height_m + 0.06 * height_m))
            profile.append((max(0.34 * wide, 0.05), high * height_m))
        lumps = [[rng.between(0.88, 1.12) for _ in range(14)] for _ in profile]
        builder.mesh(name, revolve(profile, 14, wobble=lambda ring, side: lumps[ring][side]))
    return name
