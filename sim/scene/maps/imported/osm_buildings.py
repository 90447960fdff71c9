"""Buildings of an extract: walls with windows, a roof over any footprint, and convex solids.

Walls and roof are only visible; the solids are the hulls of the footprint's convex parts, up to the roof. They differ
from what is seen by at most 0.1 m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.scene import surfaces
from sim.scene.imports import osm_tags
from sim.scene.imports.contact_pieces import flat_parts
from sim.scene.imports.msh import msh
from sim.scene.imports.osm_file import Tags
from sim.scene.imports.roofs import Roof, make_roof
from sim.scene.imports.shapes import coordinates, parts, rings, rounded, shapely, triangles
from sim.scene.maps import textures
from sim.scene.maps.facade_layout import BAYS, STOREY_M, STOREYS, WHITE_WALL_RGB
from sim.scene.maps.map_builder import Body, MapBuilder
from sim.scene.random_generator import RandomGenerator
from sim.scene.scene_map import Surface

Float64 = NDArray[np.float64]

_HOUSE_STYLES = ("white", "cream", "ochre", "rose", "brick", "white", "cream")
_BLOCK_STYLES = ("cream", "ochre", "rose", "grey", "brick", "dark_brick", "white")
_SHED_KINDS = frozenset(
    ["industrial", "warehouse", "hangar", "garage", "garages", "shed", "barn", "carport", "farm_auxiliary"]
)
_OFFICE_KINDS = frozenset(["office", "commercial", "civic", "public", "hospital", "university", "supermarket"])
_SHOP_KINDS = frozenset(["retail", "commercial"])
_OPEN_KINDS = frozenset(["roof", "carport", "canopy"])  # a roof on posts
_POST_M, _POST_INSET_M, _POST_STEP_M = 0.09, 0.35, 6.0  # radius; from the edge of the roof; between posts
_EAVES_M = 0.35
_TILE_M, _FELT_M = 4.8, 6.0  # edge of the texture of roof tiles, and of flat roofs
_WALL_SURFACES: dict[str, Surface] = {"brick": surfaces.BRICK, "dark_brick": surfaces.BRICK, "metal": surfaces.METAL}
_ROOF_RGB = {
    "tiles": (1.0, 1.0, 1.0), "tiles_dark": (0.82, 0.78, 0.76), "slate": (0.72, 0.86, 1.0), "felt": (1.0, 1.0, 1.0),
    "gravel": (0.9, 0.9, 0.9), "metal": (0.60, 0.63, 0.65),
}  # fmt: skip


@dataclass(frozen=True)
class Footprint:
    """Footprint and measures of one building, or of a part of one."""

    key: str
    tags: Tags
    polygon: Any
    base_m: float
    top_m: float
    roof: str
    rise_m: float


class BuildingMaker:
    """Adds buildings to a map. `seed`: of their looks."""

    def __init__(self, builder: MapBuilder, seed: int, walled: Sequence[Any] = ()) -> None:
        """`walled`: footprints of buildings with walls from the ground, which hold a roof that rests on them."""
        self._builder, self._seed = builder, seed
        self._walled = shapely.STRtree(list(walled)) if walled else None
        self._tinted: dict[tuple[str, tuple[float, float, float]], str] = {}

    def add(self, body: Body, footprint: Footprint, ground_m: float) -> None:
        """Add one building to `body`, which stands at the middle of the footprint; `ground_m`: depth of the ground."""
        rng = RandomGenerator(self._seed, f"osm.{footprint.key}")
        middle = footprint.polygon.centroid
        polygon = shapely.transform(footprint.polygon, lambda xy: xy - (middle.x, middle.y))
        rectangle = _rectangle(polygon)
        eaves = footprint.top_m - footprint.rise_m
        across = footprint.tags.get("roof:orientation") == "across"
        downhill = _direction(footprint.tags.get("roof:direction"), rectangle)
        roof = make_roof(footprint.roof, rectangle, eaves, footprint.rise_m, across=across, slope=downhill)
        number = footprint.key
        pitched = footprint.roof != "flat"
        over = rounded(polygon.buffer(_EAVES_M, join_style="mitre")) if pitched and footprint.rise_m > 0.8 else polygon
        bottom = footprint.base_m if footprint.base_m > 0.0 else -ground_m
        if is_open(footprint.tags):
            bottom = max(bottom, footprint.top_m - footprint.rise_m - 0.3)
            self._posts(body, polygon, (-ground_m, bottom), footprint)
        if bottom > 0.0:
            self._underside(body, polygon, bottom, footprint)
        self._walls(body, polygon, roof, footprint, bottom, rng)
        self._roof(body, over, roof, footprint, rng)
        hulls = [_solid(part, roof, bottom) for part in _convex_parts(polygon)]
        if over is not polygon:
            hulls += [slab for part in _convex_parts(over) for slab in _slabs(part, roof)]
        for i, hull in enumerate(hulls):
            name = f"{number}_solid_{i}"
            self._builder.hull(name, hull)
            body.proxy("mesh", asset=name, material=self.solid_material(), part=f"{number}_solid_{i}")

    def _posts(self, body: Body, polygon: Any, span_m: tuple[float, float], footprint: Footprint) -> None:
        """Add posts under the edge of a roof without walls, from the ground to its underside.

        None stands where the roof rests on a building with walls.
        """
        low, high = span_m
        inner = polygon.buffer(-_POST_INSET_M, join_style="mitre")
        places = [place for part in parts(inner) for place in _post_places(rings(part)[0])]
        middle = footprint.polygon.centroid
        material = self._edge_material()
        for i, (x, y) in enumerate(places):
            if self._walled is not None:
                post = shapely.Point(x + middle.x, y + middle.y).buffer(_POST_M)
                if len(self._walled.query(post, predicate="intersects")):
                    continue
            body.geom(
                "cylinder", (_POST_M, 0.5 * (high - low)), material=material, pos=(x, y, 0.5 * (low + high)),
                part=f"{footprint.key}_post_{i}",
            )  # fmt: skip

    def _edge_material(self) -> str:
        """Return the material of posts and of the edges of roofs without walls."""
        return self._builder.material("osm_post", surfaces.METAL, rgb=(0.62, 0.64, 0.66), specular=0.4)

    def _underside(self, body: Body, polygon: Any, bottom: float, footprint: Footprint) -> None:
        """Add the face that is seen from below where a building does not stand on the ground."""
        corners = triangles(polygon)[:, ::-1]
        if not len(corners):
            return
        faces = _Faces()
        faces.add(np.concatenate([corners, np.full((*corners.shape[:2], 1), bottom)], axis=2), corners / _FELT_M)
        asset = f"{footprint.key}_underside"
        self._builder.mesh_file(f"{asset}.msh", faces.msh())
        material = self._builder.material("osm_underside", surfaces.CONCRETE, rgb=(0.62, 0.61, 0.59), specular=0.0)
        body.geom("mesh", asset=asset, material=material, solid=False, part=asset)

    def solid_material(self) -> str:
        return self._builder.material("osm_solid", surfaces.CONCRETE)

    def _style(self, footprint: Footprint, rng: RandomGenerator) -> str:
        tags, kind = footprint.tags, osm_tags.building_kind(footprint.tags)
        material = tags.get("building:material", "")
        house, block = rng.pick(_HOUSE_STYLES), rng.pick(_BLOCK_STYLES)
        if material == "brick" or kind in ("church", "chapel"):
            return "brick"
        if material == "glass" or (kind in _OFFICE_KINDS and material == ""):
            return "office"
        if material == "metal" or kind in _SHED_KINDS:
            return "metal"
        if osm_tags.is_house(tags, footprint.polygon.area):
            return house
        return "office" if footprint.top_m > 30.0 else block

    def _wall_material(self, style: str, tags: Tags, *, ground: bool, shops: bool) -> str:
        rgb = osm_tags.colour(tags.get("building:colour"))
        part = ("shops" if shops else "ground") if ground else "upper"
        name = f"osm_{style}_{part}"
        b = self._builder
        b.texture(name, textures.png(f"facade_{style}_{part}"))
        tint = (1.0, 1.0, 1.0)
        if rgb is not None:
            tint = tuple(min(1.0, c / w) for c, w in zip(rgb, WHITE_WALL_RGB, strict=True))  # type: ignore[assignment]
        key = (name, tint)
        if key not in self._tinted:
            self._tinted[key] = b.material(
                name if rgb is None else f"{name}_{len(self._tinted)}", _WALL_SURFACES.get(style, surfaces.PLASTER),
                rgb=tint, texture=name, specular=0.1, shininess=0.5,
            )  # fmt: skip
        return self._tinted[key]

    def _walls(
        self, body: Body, polygon: Any, roof: Roof, footprint: Footprint, bottom: float, rng: RandomGenerator
    ) -> None:
        """Add the walls: the ground floor and what is above it are meshes of their own."""
        tags, number = footprint.tags, footprint.key
        coloured = "building:colour" in tags
        style = self._style(footprint, rng)
        if coloured and style not in ("metal", "office"):
            style = "white"
        shops = "shop" in tags or osm_tags.building_kind(tags) in _SHOP_KINDS or (
            not osm_tags.is_house(tags, footprint.polygon.area) and style in _BLOCK_STYLES and rng.chance(0.35)
        )  # fmt: skip
        shift = rng.index(BAYS)
        floor = footprint.base_m if footprint.base_m > 0.0 else 0.0
        split = (
            floor + STOREY_M if floor == 0.0 and footprint.top_m - footprint.rise_m >= floor + STOREY_M - 0.4 else floor
        )
        lower, upper = _Faces(), _Faces()
        for ring in rings(polygon):
            for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
                length = float(np.sqrt((b - a) @ (b - a)))
                if length < 0.02:
                    continue
                stops = [0.0, *roof.breaks(a, b), 1.0]
                points = [a + t * (b - a) for t in stops]
                heights = roof.height(np.array(points)).tolist()
                bays = max(1.0, float(round(length / STOREY_M)))
                at = [(shift + t * bays) / BAYS for t in stops]
                if length < 1.5:  # too short for a window: the plain edge of a bay
                    at = [(shift + 0.06 * t * length) / BAYS for t in stops]
                if split > max(floor, bottom):
                    lower.strip(points, [bottom] * len(points), [min(split, z) for z in heights], at, floor, STOREY_M)
                low = max(split, bottom) if split > floor else bottom
                knees = [min(z, roof.low_m) for z in heights]
                upper.strip(points, [low] * len(points), knees, at, split, STOREYS * STOREY_M)
                plain = [(shift + 0.02 * t) / BAYS for t in stops]  # a gable has no windows
                upper.strip(points, [max(low, z) for z in knees], heights, plain, split, STOREYS * STOREY_M)
        for faces, ground, name in ((lower, True, "ground"), (upper, False, "upper")):
            if faces.triangles:
                asset = f"{number}_{name}"
                self._builder.mesh_file(f"{asset}.msh", faces.msh())
                material = self._wall_material(style, tags, ground=ground, shops=shops)
                if is_open(tags):  # the edge of a roof has no windows
                    material = self._edge_material()
                body.geom("mesh", asset=asset, material=material, solid=False, part=asset)

    def _roof(self, body: Body, polygon: Any, roof: Roof, footprint: Footprint, rng: RandomGenerator) -> None:
        faces = _Faces()
        kind = self._roof_kind(footprint, rng)
        tile_m = _FELT_M if kind in ("felt", "gravel") else _TILE_M
        n = len(roof.planes)
        for i, plane in enumerate(roof.planes):
            region = polygon if n == 1 else polygon.intersection(_region(roof, i, polygon))
            a, b = float(plane[0]), float(plane[1])
            steep = float(np.sqrt(a * a + b * b))
            down = np.array([-a, -b]) / steep if steep > 1e-6 else np.array([0.0, -1.0])
            along, stretch = np.array([-down[1], down[0]]), float(np.sqrt(1.0 + steep * steep))
            for part in parts(region):
                corners = triangles(part)
                z = corners @ plane[:2] + plane[2]
                uv = np.stack([corners @ along, -(corners @ down) * stretch], axis=-1) / tile_m
                faces.add(np.concatenate([corners, z[:, :, None]], axis=2), uv)
        if not faces.triangles:
            return
        asset = f"{footprint.key}_roof"
        self._builder.mesh_file(f"{asset}.msh", faces.msh())
        material = self._roof_material(kind, osm_tags.colour(footprint.tags.get("roof:colour")))
        body.geom("mesh", asset=asset, material=material, solid=False, part=asset)

    def _roof_kind(self, footprint: Footprint, rng: RandomGenerator) -> str:
        tiles = rng.pick(("tiles", "tiles", "tiles_dark", "slate"))
        flat = rng.pick(("felt", "gravel", "felt"))
        stated = footprint.tags.get("roof:material", "")
        if stated in ("metal", "copper", "zinc") or (footprint.roof in ("round", "dome", "onion") and not stated):
            return "metal"
        if stated in ("slate", "tar_paper"):
            return "slate" if stated == "slate" else "felt"
        return flat if footprint.roof == "flat" else tiles

    def _roof_material(self, kind: str, rgb: tuple[float, float, float] | None) -> str:
        b = self._builder
        texture = {"tiles": "roof_tiles", "tiles_dark": "roof_tiles", "slate": "roof_tiles", "felt": "roof_felt"}.get(
            kind, "gravel"
        )
        b.texture(texture, textures.png(texture))
        colour = _ROOF_RGB[kind] if rgb is None else rgb
        if rgb is not None and texture == "roof_tiles":  # the texture is red already
            texture = "gravel"
            b.texture(texture, textures.png(texture))
        key = (f"osm_roof_{kind}", colour)
        if key not in self._tinted:
            surface = {
                "metal": surfaces.METAL,
                "slate": surfaces.STONE,
                "felt": surfaces.ASPHALT,
                "gravel": surfaces.GRAVEL,
            }
            self._tinted[key] = b.material(
                key[0] if rgb is None else f"{key[0]}_{len(self._tinted)}", surface.get(kind, surfaces.ROOF_TILE),
                rgb=colour, texture="" if kind == "metal" else texture, specular=0.3 if kind == "metal" else 0.0,
            )  # fmt: skip
        return self._tinted[key]


def is_open(tags: Tags) -> bool:
    """Return True for a roof without walls."""
    return osm_tags.building_kind(tags) in _OPEN_KINDS or tags.get("wall") == "no"


def _post_places(ring: Float64) -> list[tuple[float, float]]:
    """Return places at the corners of a ring and between them, none within 1 m of another."""
    found: list[tuple[float, float]] = []
    for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        d = b - a
        count = max(1, int(np.ceil(float(np.sqrt(d @ d)) / _POST_STEP_M - 1e-6)))
        for k in range(count):
            x, y = (a + d * (k / count)).tolist()
            if all((x - u) ** 2 + (y - v) ** 2 > 1.0 for u, v in found):
                found.append((x, y))
    return found


class _Faces:
    """Triangles with texture coordinates, each with corners of its own."""

    def __init__(self) -> None:
        self.triangles: list[Float64] = []
        self._uvs: list[Float64] = []

    def add(self, corners: Float64, uv: Float64) -> None:
        if len(corners):
            self.triangles.append(corners)
            self._uvs.append(uv)

    def strip(
        self, points: list[Float64], low: list[float], high: list[float], u: list[float], zero_z: float, tile_m: float
    ) -> None:
        """Add a wall along `points` from `low` to `high`; v is 0 at `zero_z` and grows by 1 each `tile_m`."""
        for i in range(len(points) - 1):
            p, q = points[i], points[i + 1]
            corners = [(p, low[i], u[i]), (q, low[i + 1], u[i + 1]), (q, high[i + 1], u[i + 1]), (p, high[i], u[i])]
            for k in ((0, 1, 2), (0, 2, 3)):
                a, b, c = (corners[j] for j in k)
                if abs(a[1] - b[1]) + abs(b[1] - c[1]) + abs(a[1] - c[1]) < 0.01:
                    continue
                corner = np.array([(x[0][0], x[0][1], x[1]) for x in (a, b, c)])
                # v counts downwards, from the top of the tile.
                uv = np.array([(x[2], 1.0 - (x[1] - zero_z) / tile_m) for x in (a, b, c)])
                self.add(corner[None], uv[None])

    def msh(self) -> bytes:
        corners = np.concatenate(self.triangles).reshape(-1, 3)
        uv = np.concatenate(self._uvs).reshape(-1, 2)
        return msh(corners, np.arange(len(corners)).reshape(-1, 3), uv, None)


def _rectangle(polygon: Any) -> Float64:
    """Return the four corners of the least rectangle round a polygon."""
    box = shapely.minimum_rotated_rectangle(polygon)
    if box.geom_type != "Polygon":
        box = polygon.envelope
    return coordinates(box.exterior)[:4]


def _direction(text: str | None, rectangle: Float64) -> Float64:
    """Return the direction downhill that `roof:direction` states; without it, across the rectangle."""
    degrees = osm_tags.direction_deg(text)
    if degrees is not None:
        angle = np.deg2rad(degrees)
        return np.array([np.sin(angle), np.cos(angle)])
    u, v = rectangle[1] - rectangle[0], rectangle[2] - rectangle[1]
    short = v if float(u @ u) >= float(v @ v) else u
    return short / np.sqrt(short @ short)


def _region(roof: Roof, index: int, polygon: Any) -> Any:
    """Return where a plane of the roof is the lowest, within the polygon's bounds."""
    x0, y0, x1, y1 = polygon.bounds
    corners = [np.array(p) for p in ((x0 - 1, y0 - 1), (x1 + 1, y0 - 1), (x1 + 1, y1 + 1), (x0 - 1, y1 + 1))]
    for j, other in enumerate(roof.planes):
        d = other - roof.planes[index]
        if j == index or (abs(d) < 1e-12).all():
            continue
        kept = []
        for p, q in zip(corners, [*corners[1:], *corners[:1]], strict=True):
            at_p, at_q = d[0] * p[0] + d[1] * p[1] + d[2], d[0] * q[0] + d[1] * q[1] + d[2]
            if at_p >= 0.0:
                kept.append(p)
            if at_p * at_q < 0.0:
                kept.append(p + at_p / (at_p - at_q) * (q - p))
        corners = kept
        if len(corners) < 3:
            return shapely.Polygon()
    return rounded(shapely.Polygon(corners))


def _convex_parts(polygon: Any) -> list[Float64]:
    """Return the outlines of convex polygons that cover a polygon and reach at most 0.1 m beyond it."""
    if not polygon.interiors and polygon.convex_hull.area - polygon.area < 0.01:
        return [rings(polygon)[0]]
    return flat_parts(triangles(polygon))


def _solid(outline: Float64, roof: Roof, bottom: float) -> Float64:
    """Return points whose hull is what is between `bottom` and the roof."""
    points = [outline]
    if len(roof.planes) > 1:
        part = shapely.Polygon(outline)
        for i in range(len(roof.planes)):
            region = _region(roof, i, part).intersection(part)
            points += [rings(piece)[0] for piece in parts(region)]
    top = np.concatenate(points)
    z = roof.height(top)
    lower = np.column_stack([outline, np.full(len(outline), min(bottom, float(z.min()) - 0.1))])
    return np.concatenate([np.column_stack([top, z]), lower])


def _slabs(outline: Float64, roof: Roof) -> list[Float64]:
    """Return points whose hulls are 0.15 m of the roof over a convex outline, one for each plane."""
    part = shapely.Polygon(outline)
    found = []
    for i in range(len(roof.planes)):
        for piece in parts(_region(roof, i, part).intersection(part)):
            top = rings(piece)[0]
            z = roof.height(top)
            found.append(np.concatenate([np.column_stack([top, z]), np.column_stack([top, z - 0.15])]))
    return found


def footprint_of(key: str, tags: Tags, polygon: Any) -> tuple[Footprint, list[str]]:
    """Return a building's measures, and what is not as its tags state, worded for several buildings."""
    area = float(polygon.area)
    base, top, stated_rise, has_height, contradictory = osm_tags.heights(tags, area)
    shape, as_stated = osm_tags.roof_shape(tags, area, (top - base) / osm_tags.LEVEL_M)
    rectangle = _rectangle(polygon)
    edges = np.sqrt(((rectangle[1:3] - rectangle[:2]) ** 2).sum(axis=1))
    short = float(edges.min())
    if short < 1.0:
        shape = "flat"
    rise = 0.0
    if shape != "flat":
        angle = osm_tags.number(tags.get("roof:angle"))
        natural = {
            "skillion": 0.25 * short,
            "dome": 0.5 * short,
            "onion": 0.7 * short,
            "mansard": 3.0,
            "pyramidal": 0.4 * short,
        }
        rise = natural.get(shape, 0.36 * short)
        if angle is not None and 0.0 < angle < 80.0:
            rise = 0.5 * short * float(np.tan(np.deg2rad(angle)))
        rise = min(rise, 6.0) if shape in ("gabled", "hipped", "half-hipped", "gambrel") else rise
        if stated_rise is not None:
            rise = stated_rise
        elif not has_height:  # the type's height is that of the walls
            top += rise
        rise = min(max(rise, 0.2), 0.9 * (top - base))
    if shape == "mansard" and rise > 0.9 * short:
        rise = 0.9 * short
    notes = {
        "buildings state no height and have that of their type": not has_height,
        "buildings state min_height above height: the height counts": contradictory,
        "roofs have the nearest shape that is built": not as_stated,
    }
    return Footprint(key, tags, polygon, base, top, shape, rise), [text for text, is_so in notes.items() if is_so]
