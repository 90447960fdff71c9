"""Materials of plants. Leaves are added with the first plant of their species."""

from __future__ import annotations

from sim.scene import surfaces
from sim.scene.maps import textures
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.plants.species import SPECIES
from sim.scene.maps.season import Season


def plant_materials(builder: MapBuilder, season: Season = "summer") -> None:
    """Set the season of all plants that are added later, and add the material of solid shapes that are not drawn."""
    builder.season = season
    builder.texture("bark", textures.png("bark"))
    builder.material("plant_solid", surfaces.LEAVES, rgb=SPECIES["linden"].summer.rgb, specular=0.0)


def bark_material(builder: MapBuilder, name: str) -> str:
    """Return the bark of a species."""
    if name == "birch":
        builder.texture("birch_bark", textures.png("birch_bark"))
        return builder.material("bark_birch", surfaces.BARK, texture="birch_bark", specular=0.0)
    return builder.material(f"bark_{name}", surfaces.BARK, rgb=SPECIES[name].bark_rgb, texture="bark", specular=0.0)


def leaf_material(builder: MapBuilder, name: str) -> str:
    """Return the leaves of a species in the season of the map."""
    season = builder.season
    texture = builder.texture(f"leaves_{name}", textures.png(f"leaves_{name}_{season}"), holes=True)
    bare = SPECIES[name].leaves(season) is None
    surface = surfaces.BARK if bare else surfaces.LEAVES
    return builder.material(f"leaves_{name}", surface, texture=texture, specular=0.0)


def foliage_material(builder: MapBuilder, name: str) -> str:
    """Return dense foliage in the light, without holes."""
    texture = builder.texture(f"foliage_{name}", textures.png(f"foliage_{name}_{builder.season}"))
    return builder.material(f"foliage_{name}", surfaces.LEAVES, texture=texture, specular=0.0)


def inside_material(builder: MapBuilder, name: str, *, cube: bool = True) -> str:
    """Return dense foliage in the shade, for the inside of crowns; `cube`: for ellipsoids, else for meshes."""
    key = f"inside_{name}" if cube else f"inside_{name}_mesh"
    texture = builder.texture(key, textures.png(f"inside_{name}_{builder.season}"), cube=cube)
    return builder.material(key, surfaces.LEAVES, texture=texture, specular=0.0)
