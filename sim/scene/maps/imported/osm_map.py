"""Make a map of an OpenStreetMap extract: ground, areas, roads, paths, water, buildings, barriers, trees, furniture.

With `objects` there are parked cars, people and details of the roads, too (osm_objects.py, osm_road_details.py).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals._kernel import det_atan2
from signals.errors import ConfigError, Problem
from signals.geodesy import LocalFrame, Site
from signals.rotation import NO_TURN
from signals.samples import Quat, Vec3
from signals.units import RAD_PER_DEG
from sim.scene import surfaces
from sim.scene.budget import Budget
from sim.scene.imports import osm_road_details, osm_streets, osm_tags
from sim.scene.imports.class_patterns import ClassPatterns
from sim.scene.imports.elevation import Terrain
from sim.scene.imports.msh import msh
from sim.scene.imports.osm_file import OsmData, Tags
from sim.scene.imports.osm_parking import bays, is_on_ground
from sim.scene.imports.osm_shapes import Shapes, Spot, shapes_of
from sim.scene.imports.shapes import coordinates, need_shapely, parts, rounded, shapely, triangles, union
from sim.scene.map_section import OsmObjects
from sim.scene.maps import textures
from sim.scene.maps.imported.grounds import GROUNDS
from sim.scene.maps.imported.imported_map import ImportedMap, Walk
from sim.scene.maps.imported.osm_bridges import BridgeMaker, bridge_ends, is_bridge, is_deck, width_m
from sim.scene.maps.imported.osm_buildings import BuildingMaker, Footprint, footprint_of, is_open
from sim.scene.maps.imported.osm_objects import ObjectPlacer, Streets
from sim.scene.maps.imported.osm_occupancy import Occupancy, disc
from sim.scene.maps.imported.terrain import add_terrain
from sim.scene.maps.map_builder import Body, MapBuilder, yaw_quat
from sim.scene.maps.plants import add_bush, add_tree, plant_materials
from sim.scene.maps.street_furniture import add_bench, add_bin, add_lamp, furniture_materials
from sim.scene.random_generator import RandomGenerator
from sim.scene.work_progress import progress

Float64 = NDArray[np.float64]

_LIFT_M = 0.03  # of areas over the ground; roads are not solid
_MARKING_M = 0.02  # of road paint over the road
_FREE_M = 6.0  # radius of the free ground where the vehicle takes off
_WOOD_STEP_M, _ROW_STEP_M = 6.0, 8.0  # with `objects` the first is that of density 1
_CROWN_M, _TRUNK_M = 2.2, 0.8  # radii that are free of other things and of other crowns, for size 1, with `objects`
_SMALL_NODES = {  # key, value -> class, height [m], radius [m], material
    ("man_made", "flagpole"): ("pole", 8.0, 0.06), ("man_made", "mast"): ("pole", 20.0, 0.2),
    ("man_made", "chimney"): ("tower", 20.0, 1.0), ("man_made", "water_tower"): ("tower", 25.0, 3.0),
    ("man_made", "tower"): ("tower", 20.0, 1.5), ("power", "pole"): ("pole", 9.0, 0.15),
    ("power", "tower"): ("pole", 25.0, 0.4), ("barrier", "bollard"): ("pole", 0.9, 0.1),
    ("man_made", "street_cabinet"): ("object", 1.2, 0.4), ("advertising", "column"): ("object", 2.8, 0.6),
    ("highway", "traffic_signals"): ("pole", 3.5, 0.08), ("historic", "memorial"): ("object", 2.0, 0.5),
}  # fmt: skip


@dataclass(frozen=True)
class OsmOptions:
    """Options by which an extract becomes a map."""

    radius_m: float = 500.0
    seed: int = 1
    ground: str = "auto"  # a material of the ground, or auto
    max_trees: int = 1500
    objects: OsmObjects | None = None
    classes: Mapping[str, Sequence[str]] | None = None  # patterns of "key=value"


class _Builder(MapBuilder):
    """A builder whose objects stand on the terrain; every geom is charged to a budget."""

    def __init__(self, terrain: Terrain | None, budget: Budget) -> None:
        super().__init__("osm", flat_meshes=True)
        self._terrain, self._budget = terrain, budget

    def claim_geom(self, name: str) -> None:
        self._budget.objects(1, f"geom {name[:80]!r}")
        super().claim_geom(name)

    def z(self, x: float, y: float) -> float:
        return 0.0 if self._terrain is None else float(self._terrain.height(np.array([[x, y]]))[0])

    def body(self, kind: str, pos: Vec3 = (0.0, 0.0, 0.0), quat: Quat = NO_TURN) -> Body:
        x, y, z = pos
        return super().body(kind, (x, y, z + self.z(x, y)), quat)


def map_of_osm(
    data: OsmData, site: Site, options: OsmOptions, terrain: Terrain | None, budget: Budget | None = None
) -> ImportedMap:
    """Return the map of an extract round a site. Raises ConfigError."""
    need_shapely(data.source)
    shapes = shapes_of(data, site, options.radius_m)
    if not shapes.areas and not shapes.lines and not shapes.spots:
        raise ConfigError([_nothing_shown(data, site, options.radius_m)])
    return _District(data.source, shapes, options, terrain, budget or Budget(data.source)).make()


def _nothing_shown(data: OsmData, site: Site, radius_m: float) -> Problem:
    """Return the problem of an extract without anything round the site, or without anything at all."""
    latitude, longitude = data.middle()
    x, y, _ = LocalFrame(site).enu_from_geodetic(latitude, longitude, site.altitude_m)
    if max(abs(x), abs(y)) < radius_m:
        message = "holds nothing that a map shows: no building, way or area with its tags and nodes"
        return Problem(data.source, message, "export the district again, whole: osmium extract --bbox W,S,E,N")
    message = f"has nothing within {radius_m:g} m of the site"
    return Problem(
        data.source, message, f"its middle is at latitude_deg: {latitude:.6f}, longitude_deg: {longitude:.6f}"
    )


def take_off_place(data: OsmData, radius_m: float) -> tuple[float, float]:
    """Return latitude and longitude of free ground close to the middle of an extract. Raises ConfigError."""
    need_shapely(data.source)
    latitude, longitude = data.middle()
    site = _Place(latitude, longitude)
    shapes = shapes_of(data, site, min(radius_m, 300.0))
    blocked = [area.polygon for area in shapes.areas if _blocks(area.tags)]
    blocked += [
        shapely.LineString(line.points).buffer(1.0)
        for line in shapes.lines
        if "barrier" in line.tags or line.tags.get("natural") == "tree_row" or "waterway" in line.tags or is_deck(line)
    ]
    blocked += [shapely.Point(spot.place).buffer(3.0) for spot in shapes.spots if _stands(spot.tags)]
    tree = shapely.STRtree(blocked) if blocked else None
    frame = LocalFrame(site)
    for ring in range(60):
        for i in range(max(1, 8 * ring)):
            x, y = _square(i, ring, 4.0)
            if tree is None or not len(tree.query(shapely.Point(x, y).buffer(_FREE_M), predicate="intersects")):
                lat, lon, _ = frame.geodetic_from_enu((x, y, 0.0))
                return round(lat, 7), round(lon, 7)
    return latitude, longitude


@dataclass(frozen=True)
class _Place:
    latitude_deg: float
    longitude_deg: float
    altitude_m: float = 0.0


def _square(i: int, ring: int, step: float) -> tuple[float, float]:
    """Return point `i` of 8 * `ring` on the square of half length `ring` steps."""
    if ring == 0:
        return 0.0, 0.0
    side, at = divmod(i, 2 * ring)
    a, b = -ring + at, -ring
    x, y = ((a, b), (-b, a), (-a, -b), (b, -a))[side]
    return step * x, step * y


def _blocks(tags: Tags) -> bool:
    return "building" in tags or "building:part" in tags or tags.get("natural") in ("water", "wood") or (
        tags.get("landuse") in ("forest", "reservoir", "basin") or tags.get("leisure") == "swimming_pool"
    )  # fmt: skip


def _stands(tags: Tags) -> bool:
    return tags.get("natural") in ("tree", "shrub") or any(tags.get(k) == v for k, v in _SMALL_NODES) or (
        tags.get("highway") == "street_lamp" or tags.get("amenity") in ("bench", "waste_basket")
    )  # fmt: skip


class _District:
    def __init__(
        self, source: str, shapes: Shapes, options: OsmOptions, terrain: Terrain | None, budget: Budget
    ) -> None:
        self._source, self._shapes, self._options, self._terrain = source, shapes, options, terrain
        self._builder = _Builder(terrain, budget)
        self._notes: Counter[str] = shapes.notes
        self._patterns = ClassPatterns(options.classes)
        self._names: set[str] = set()
        self._terrain_cells: Any = None
        self._serial = 0
        self._half_m = options.radius_m
        self._objects = options.objects
        self._occupied: Occupancy | None = None  # with objects
        self._decks = [line for line in shapes.lines if is_deck(line) and not osm_tags.is_underground(line.tags)]
        self._walks: list[Walk] = []
        self._deck_keys = {line.key for line in self._decks}

    def rng(self, name: str) -> RandomGenerator:
        return RandomGenerator(self._options.seed, f"osm.{name}")

    def make(self) -> ImportedMap:
        self._materials()
        buildings = self._footprints()
        self._built = union(b.polygon for b in buildings) if buildings else shapely.Polygon()
        self._ground(buildings)
        progress.tell("roads and areas")
        self._surfaces()
        self._buildings(buildings)
        self._bridges()
        self._barriers()
        if self._objects is not None:
            self._occupied = Occupancy(self._blocked(buildings))
        self._plants()
        self._furniture()
        if self._objects is not None and self._occupied is not None:
            self._street_life(self._objects, self._occupied)
        self._builder.classify("ground", "ground")
        built = self._builder.build()
        notes = tuple(f"{count} {text}" for text, count in sorted(self._notes.items()))
        return ImportedMap(
            replace(built, notes=notes),
            self._patterns.unmatched,
            (),
            tuple(sorted(self._names)),
            tuple(self._walks),
        )

    def _class(self, tags: Tags, default: str) -> str:
        """Return an object's class: that of the last of the user's patterns that matches a tag, or the default."""
        if not self._options.classes:
            return default
        words = [f"{key}={value}" for key, value in tags.items()]
        self._names.update(words)
        return self._patterns.class_of(words, default)

    def _materials(self) -> None:
        b = self._builder
        plant_materials(b)
        furniture_materials(b)
        for name in ("grass", "gravel", "asphalt", "paving", "water", "earth", "concrete", "blockwork", "leaves"):
            b.texture(name, textures.png(name))
        for name, ground in GROUNDS.items():
            surface, texture, tile_m, specular = ground
            gloss = 0.9 * (specular > 0.0)
            b.material(f"osm_{name}", surface, texture=texture, specular=specular, shininess=gloss)
            b.material(f"osm_ground_{name}", surface, texture=texture, tile_m=tile_m, specular=0.0)
        b.material("osm_paint", surfaces.ROAD_PAINT, rgb=(0.86, 0.86, 0.84), specular=0.0)
        b.material("osm_stone_wall", surfaces.STONE, texture="blockwork", tile_m=3.2, specular=0.0)
        b.material("osm_fence", surfaces.WOOD, rgb=(0.78, 0.74, 0.70), texture="wood", tile_m=0.6, specular=0.0)
        b.material("osm_steel", surfaces.METAL, rgb=(0.62, 0.64, 0.66), specular=0.6, shininess=0.6)
        b.material("osm_concrete", surfaces.CONCRETE, texture="concrete", tile_m=3.0, specular=0.0)
        b.material("osm_hedge", surfaces.LEAVES, rgb=(0.34, 0.50, 0.20), texture="leaves", tile_m=1.5, specular=0.0)

    # --- ground -------------------------------------------------------------------------------------------------

    def _ground(self, buildings: list[Footprint]) -> None:
        name = self._options.ground
        if name == "auto":
            within = [b.polygon for b in buildings if b.polygon.centroid.distance(shapely.Point(0.0, 0.0)) < 150.0]
            name = "paving" if sum(p.area for p in within) > 0.3 * 70_685.0 else "grass"
        material = f"osm_ground_{name}"
        if self._terrain is None:
            self._builder.ground("plane", (0.0, 0.0, 1.0), material=material)
            return
        add_terrain(self._builder, self._terrain, material=material)

    def _surfaces(self) -> None:
        """Add areas, water, paths and roads, each cut out of those below it."""
        layers: list[tuple[str, str, Any]] = []  # class, material, shape; upwards
        areas: dict[tuple[int, str, str], list[Any]] = {}
        for area in self._shapes.areas:
            for level, (key, values, kind, material) in enumerate(osm_tags.AREAS):
                if kind and area.tags.get(key) in values and not osm_tags.is_underground(area.tags):
                    areas.setdefault((level, self._class(area.tags, kind), material), []).append(area.polygon)
            kind, material = _way_area(area.tags)
            if kind:
                areas.setdefault((len(osm_tags.AREAS), self._class(area.tags, kind), material), []).append(area.polygon)
        layers += [
            (kind, material, union(found)) for (_, kind, material), found in sorted(areas.items(), key=lambda a: a[0])
        ]
        layers += self._ways()
        box = shapely.box(-self._half_m, -self._half_m, self._half_m, self._half_m)
        above: Any = shapely.Polygon()
        made = []
        for kind, material, shape in reversed(layers):
            shape = rounded(shapely.intersection(shape, box))
            made.append((kind, material, rounded(shape - above)))
            above = rounded(above | shape)
        for kind, material, shape in reversed(made):
            for part in parts(shape):
                self._flat(kind, f"osm_{material}", part, GROUNDS[material].tile_m, _LIFT_M)
            if material == "water" and shape.intersects(shapely.Point(0.0, 0.0)):
                self._notes["area of water is at the take-off place, and the ground below carries the vehicle"] += 1
        self._markings(box)

    def _ways(self) -> list[tuple[str, str, Any]]:
        """Return streams, paths, sidewalks and roads as layers."""
        found: dict[tuple[int, str, str], list[Any]] = {}
        for line in self._shapes.lines:
            tags = line.tags
            if osm_tags.is_underground(tags) or (line.closed and tags.get("area") == "yes"):
                continue
            if line.key in self._deck_keys:
                continue
            if is_bridge(tags) and ("highway" in tags or "railway" in tags):
                self._notes["short bridges lie on the ground"] += 1
            path = shapely.LineString(line.points)
            waterway, highway = tags.get("waterway", ""), tags.get("highway", "")
            if waterway in osm_tags.WATERWAYS_M:
                wide = osm_tags.width_m(tags, osm_tags.WATERWAYS_M[waterway])
                found.setdefault((0, self._class(tags, "water"), "water"), []).append(path.buffer(wide / 2.0))
            elif highway in osm_tags.PATHS and osm_tags.PATHS[highway][1]:
                wide, material = osm_tags.PATHS[highway]
                kind = "sidewalk" if tags.get("footway") == "sidewalk" else "path"
                key = (1, self._class(tags, kind), osm_tags.SURFACES.get(tags.get("surface", ""), material))
                found.setdefault(key, []).append(path.buffer(osm_tags.width_m(tags, wide) / 2.0))
            elif highway in osm_tags.ROADS:
                wide, material = osm_tags.ROADS[highway]
                wide = osm_tags.width_m(tags, wide)
                if tags.get("sidewalk") in ("both", "yes", "left", "right"):
                    found.setdefault((2, self._class(tags, "sidewalk"), "paving"), []).append(
                        path.buffer(wide / 2.0 + 1.8)
                    )
                key = (3, self._class(tags, "road"), osm_tags.SURFACES.get(tags.get("surface", ""), material))
                found.setdefault(key, []).append(path.buffer(wide / 2.0))
            elif tags.get("railway") in ("rail", "tram", "light_rail", "narrow_gauge") and tags["railway"] != "tram":
                found.setdefault((1, self._class(tags, "path"), "gravel"), []).append(path.buffer(1.8))
        return [
            (kind, material, union(shapes)) for (_, kind, material), shapes in sorted(found.items(), key=lambda a: a[0])
        ]

    def _markings(self, box: Any) -> None:
        """Add the dashes in the middle of roads with two lanes."""
        uses: Counter[int] = Counter()
        roads = [
            line
            for line in self._shapes.lines
            if line.tags.get("highway") in osm_tags.ROADS
            and not osm_tags.is_underground(line.tags)
            and line.key not in self._deck_keys
        ]
        for line in roads:
            uses.update(set(line.nodes))
        corners = []
        for line in roads:
            wide, material = osm_tags.ROADS[line.tags["highway"]]
            wide = osm_tags.width_m(line.tags, wide)
            details = self._objects is not None and not line.closed
            if wide < 5.5 or osm_tags.SURFACES.get(line.tags.get("surface", ""), material) != "asphalt":
                continue
            if line.tags.get("oneway") == "yes" and wide < 6.5:
                continue
            is_oneway = details and line.tags.get("oneway") == "yes"
            path = shapely.intersection(shapely.LineString(line.points), box)
            crossings = [
                shapely.Point(p).buffer(wide) for p, n in zip(line.points, line.nodes, strict=True) if uses[n] > 1
            ]
            inner = [n for n in line.nodes[1:-1] if uses[n] > 1]
            if crossings and (inner or len(crossings) > 0):
                path = path - union(crossings)
            for piece in shapely.get_parts(path).tolist():
                if piece.geom_type == "LineString" and piece.length > 4.0 and not is_oneway:
                    corners += _dashes(piece, 3.0, 5.0, 0.06)
            if details:
                corners += osm_road_details.road_lines(path, line.tags, wide)
        self._paint("marking", corners, "osm_paint")

    def _paint(self, kind: str, quads: list[list[tuple[float, float]]], material: str) -> None:
        """Add quads just above the roads as one object."""
        if quads:
            corners = np.array(quads)
            flat = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
            z = self._heights(flat) + _LIFT_M + _MARKING_M
            self._mesh(self._builder.body(kind), np.concatenate([flat, z[:, :, None]], axis=2), None, material)

    # --- bridges, and what `objects` adds ------------------------------------------------------------------------

    def _bridges(self) -> None:
        box = shapely.box(-self._half_m, -self._half_m, self._half_m, self._half_m)
        ends = bridge_ends(self._decks)
        ways = osm_streets.carriageways(self._shapes, self._deck_keys)
        maker = BridgeMaker(self._builder, [shape for _, shape in ways], box, self._builder.z)
        for line in self._decks:
            highway, surface = line.tags.get("highway", ""), line.tags.get("surface", "")
            default = (osm_tags.PATHS | osm_tags.ROADS).get(highway, (0.0, "gravel"))[1]
            kind = "road" if highway in osm_tags.ROADS else "path"
            first, last = (ends[node] == 1 for node in (line.nodes[0], line.nodes[-1]))
            material = f"osm_ground_{osm_tags.SURFACES.get(surface, default)}"
            maker.add(line, self._class(line.tags, kind), material, open_ends=(first, last))
            self._notes["bridges are decks in the air, without their ramps"] += 1

    def _blocked(self, buildings: list[Footprint]) -> list[Any]:
        """Return the ground on which no object may be placed."""
        found = [b.polygon.buffer(0.4) for b in buildings] + osm_streets.barred(self._shapes, self._deck_keys)
        for spot in self._shapes.spots:
            if _stands(spot.tags) and spot.tags.get("natural") != "tree":
                radius = next((r for (k, v), (_, _, r) in _SMALL_NODES.items() if spot.tags.get(k) == v), 0.6)
                found.append(disc(*spot.place, max(radius, 0.6) + 0.3))
        return found

    def _street_life(self, options: OsmObjects, occupied: Occupancy) -> None:
        """Add paint, rails, parked cars and people."""
        ways = osm_streets.carriageways(self._shapes, self._deck_keys)
        streets = Streets(self._shapes, ways, osm_streets.junctions(self._shapes))
        placer = ObjectPlacer(
            self._builder, streets, options, occupied, terrain=self._terrain, half_m=self._half_m, lift_m=_LIFT_M
        )
        within = [
            bay
            for area in self._shapes.areas
            if is_on_ground(area.tags)
            for bay in bays(area.polygon, area.key)
            if max(abs(bay.x), abs(bay.y)) < self._half_m - 3.0
        ]
        self._paint("marking", osm_road_details.bay_lines(within), "osm_paint")
        self._paint("crossing", osm_road_details.crossings(self._shapes), "osm_paint")
        self._rails()
        placer.cars(self._notes)
        placer.people(self._notes)
        self._walks = placer.walks

    def _rails(self) -> None:
        box = shapely.box(-self._half_m, -self._half_m, self._half_m, self._half_m)
        for line in self._shapes.lines:
            if (
                not osm_road_details.is_railway(line)
                or line.key in self._deck_keys
                or osm_tags.is_underground(line.tags)
            ):
                continue
            path = shapely.intersection(shapely.LineString(line.points), box)
            self._paint("path", osm_road_details.sleepers(path, line.tags), "osm_concrete")
            high = 0.02 if line.tags["railway"] == "tram" else 0.14
            heads = osm_road_details.rails(path, line.tags)
            self._ridges(self._class(line.tags, "object"), heads, _LIFT_M + high, "osm_steel")

    def _ridges(self, kind: str, quads: list[list[tuple[float, float]]], high_m: float, material: str) -> None:
        """Add quads at a height over the ground, with sides down to it, as one object."""
        if not quads:
            return
        corners = np.array(quads)
        z = self._heights(corners)
        top = np.concatenate([corners, (z + high_m)[:, :, None]], axis=2)
        foot = np.concatenate([corners, z[:, :, None]], axis=2)
        faces = [top[:, [0, 1, 2]], top[:, [0, 2, 3]]]
        for i, j in ((0, 1), (2, 3)):
            faces.append(np.stack([foot[:, i], foot[:, j], top[:, j]], axis=1))
            faces.append(np.stack([foot[:, i], top[:, j], top[:, i]], axis=1))
        self._mesh(self._builder.body(kind), np.concatenate(faces), None, material)

    def _flat(self, kind: str, material: str, polygon: Any, tile_m: float, lift_m: float) -> None:
        corners = self._draped(polygon)
        if not len(corners):
            return
        z = self._heights(corners) + lift_m
        self._mesh(
            self._builder.body(kind), np.concatenate([corners, z[:, :, None]], axis=2), corners / tile_m, material
        )

    def _mesh(self, body: Body, corners: Float64, uv: Float64 | None, material: str) -> None:
        """Add triangles (n, 3, 3) in W to a body, whose own place is subtracted."""
        name = f"osm_area_{self._serial}"
        self._serial += 1
        points = corners.reshape(-1, 3)
        vertex, index = np.unique(points, axis=0, return_inverse=True)
        uvs = None
        if uv is not None:
            first = np.zeros(len(vertex), np.int64)
            first[index.reshape(-1)] = np.arange(len(points))
            uvs = uv.reshape(-1, 2)[first]
        middle = 0.5 * (vertex.min(axis=0) + vertex.max(axis=0))
        self._builder.mesh_file(f"{name}.msh", msh(vertex - middle, index.reshape(-1, 3), uvs, None))
        x, y, z = middle.tolist()
        z -= self._builder.z(0.0, 0.0)  # of the body
        body.geom("mesh", asset=name, material=material, pos=(x, y, z), solid=False)

    def _heights(self, corners: Float64) -> Float64:
        if self._terrain is None:
            return np.zeros(corners.shape[:-1])
        return self._terrain.height(corners.reshape(-1, 2)).reshape(corners.shape[:-1])

    def _draped(self, polygon: Any) -> Float64:
        """Return triangles that cover a polygon, cut along the triangles of the terrain."""
        corners = triangles(polygon)
        if self._terrain is None or not len(corners):
            return corners
        if self._terrain_cells is None:
            t = self._terrain
            n = len(t.heights) - 1
            j, i = np.meshgrid(np.arange(n), np.arange(n))
            x, y = t.low[0] + t.cell_m * j.ravel(), t.low[1] + t.cell_m * i.ravel()
            c = t.cell_m
            a, b = np.stack([x, y], 1), np.stack([x + c, y], 1)
            d, e = np.stack([x + c, y + c], 1), np.stack([x, y + c], 1)
            rings = np.concatenate([np.stack([a, b, d, a], 1), np.stack([a, d, e, a], 1)])
            cells = shapely.polygons(rings)
            self._terrain_cells = (cells, shapely.STRtree(cells))
        cells, tree = self._terrain_cells
        hit = cells[tree.query(polygon, predicate="intersects")]
        pieces = shapely.get_parts(shapely.intersection(hit, polygon))
        found = [triangles(piece) for piece in pieces.tolist() if piece.geom_type == "Polygon" and piece.area > 1e-6]
        return np.concatenate(found) if found else np.zeros((0, 3, 2))

    # --- buildings ----------------------------------------------------------------------------------------------

    def _footprints(self) -> list[Footprint]:
        """Return all buildings; where parts describe at least 90 % of one, these are built instead."""
        wholes, details = [], []
        for area in self._shapes.areas:
            if area.tags.get("building:part", "no") != "no" and "building" not in area.tags:
                details.append(area)
            elif area.tags.get("building", "no") != "no" and not osm_tags.is_underground(area.tags):
                wholes.append(area)
        found = []
        tree = shapely.STRtree([d.polygon for d in details]) if details else None
        covered: set[int] = set()
        for area in wholes:
            inside = []
            if tree is not None:
                for i in tree.query(area.polygon, predicate="intersects").tolist():
                    part = details[i].polygon
                    if part.intersection(area.polygon).area > 0.8 * part.area:
                        inside.append(i)
            if inside:
                covered.update(inside)
                share = union(details[i].polygon for i in inside).intersection(area.polygon).area / area.polygon.area
                if share >= 0.9:
                    continue
                left = area.polygon - union(details[i].polygon for i in inside if _from_ground(details[i].tags))
                found += [
                    (f"{area.key}_{k}" if k else area.key, area.tags, part)
                    for k, part in enumerate(parts(rounded(left)))
                ]
                continue
            found.append((area.key, area.tags, area.polygon))
        found += [(d.key, d.tags, d.polygon) for i, d in enumerate(details) if i in covered or not wholes]
        made = []
        for key, tags, polygon in found:
            if max(abs(polygon.centroid.x), abs(polygon.centroid.y)) > self._half_m:
                self._notes["objects beyond map.radius_m are left out"] += 1
                continue
            if not _simple(polygon):
                self._notes["buildings are too small or too thin and are left out"] += 1
                continue
            footprint, notes = footprint_of(key, tags, rounded(polygon.simplify(0.05)))
            self._notes.update(notes)
            made.append(footprint)
        return made

    def _buildings(self, footprints: list[Footprint]) -> None:
        walled = [f.polygon for f in footprints if f.base_m == 0.0 and not is_open(f.tags)]
        maker = BuildingMaker(self._builder, self._options.seed, walled)
        for number, footprint in enumerate(footprints):
            progress.tell("buildings", number, len(footprints))
            house = osm_tags.is_house(footprint.tags, footprint.polygon.area)
            middle = footprint.polygon.centroid
            corners = coordinates(footprint.polygon.exterior)
            ground = self._heights(corners)
            lowest, highest = float(ground.min()), float(ground.max())
            kind = self._class(footprint.tags, "house" if house else "building")
            body = self._builder.body(kind, (middle.x, middle.y, highest - self._builder.z(middle.x, middle.y)))
            maker.add(body, footprint, highest - lowest + (0.5 if self._terrain is not None else 0.0))

    # --- barriers, plants, furniture ----------------------------------------------------------------------------

    def _barriers(self) -> None:
        gates = {
            spot.node: shapely.Point(spot.place).buffer(1.5)
            for spot in self._shapes.spots
            if spot.tags.get("barrier") in ("gate", "entrance", "lift_gate", "swing_gate", "kissing_gate")
        }
        box = shapely.box(-self._half_m, -self._half_m, self._half_m, self._half_m)
        for line in self._shapes.lines:
            known = osm_tags.BARRIERS.get(line.tags.get("barrier", ""))
            if known is None or osm_tags.is_underground(line.tags):
                continue
            height, thick, material, kind = known
            height = osm_tags.length_m(line.tags.get("height")) or height
            thick = min(osm_tags.length_m(line.tags.get("width")) or thick, 3.0)
            path: Any = shapely.LineString(line.points)
            openings = [gates[node] for node in line.nodes if node in gates]
            if openings:
                path = path - union(openings)
            path = shapely.intersection(path, box)
            x0, y0 = line.points[0]
            body = self._builder.body(self._class(line.tags, kind), (x0, y0, 0.0))
            base = self._builder.z(x0, y0)
            for piece in shapely.get_parts(path).tolist():
                for (ax, ay), (bx, by) in _segments(piece, 6.0 if self._terrain is not None else 1.0e9):
                    dx, dy = bx - ax, by - ay
                    length = sqrt(dx * dx + dy * dy)
                    if length < 0.05:
                        continue
                    z = self._heights(np.array([[ax, ay], [bx, by]]))
                    low, high = float(z.min()) - base, float(z.max()) - base + height
                    body.geom(
                        "box", (0.5 * (length + thick), 0.5 * thick, 0.5 * (high - low)), material=f"osm_{material}",
                        pos=(0.5 * (ax + bx) - x0, 0.5 * (ay + by) - y0, 0.5 * (low + high)),
                        quat=yaw_quat(det_atan2(dy, dx)),
                    )  # fmt: skip

    def _plants(self) -> None:
        b, rng = self._builder, self.rng("trees")
        shapely.prepare(self._built)
        places: list[tuple[float, float, float, Tags]] = []
        for spot in self._shapes.spots:
            if spot.tags.get("natural") == "tree":
                places.append((*spot.place, _tree_size(spot.tags, rng), spot.tags))
        for line in self._shapes.lines:
            if line.tags.get("natural") == "tree_row":
                path = shapely.LineString(line.points)
                for k in range(max(2, ceil(path.length / _ROW_STEP_M))):
                    p = path.interpolate(min(k * _ROW_STEP_M, path.length))
                    places.append((p.x, p.y, _tree_size(line.tags, rng), line.tags))
        box = shapely.box(-self._half_m, -self._half_m, self._half_m, self._half_m)
        options, occupied = self._objects, self._occupied
        wood_step = _WOOD_STEP_M if options is None else _WOOD_STEP_M / sqrt(options.density)
        clear = union(
            shapely.LineString(line.points).buffer(3.0 if options is None else 0.5 * width_m(line) + 1.5)
            for line in self._shapes.lines
            if line.tags.get("highway") in osm_tags.ROADS or line.tags.get("highway") in osm_tags.PATHS
        )
        for area in self._shapes.areas:
            if any(area.tags.get(key) == value for key, value in osm_tags.WOODS):
                within = area.polygon.intersection(box) - clear
                if within.is_empty:
                    continue
                shapely.prepare(within)
                x0, y0, x1, y1 = within.bounds
                wood = self.rng(f"wood.{area.key}")
                for i in range(int((x1 - x0) / wood_step) + 1):
                    for j in range(int((y1 - y0) / wood_step) + 1):
                        x = x0 + (i + wood.unit()) * wood_step
                        y = y0 + (j + wood.unit()) * wood_step
                        if within.contains(shapely.Point(x, y)):
                            places.append((x, y, wood.between(0.8, 1.4), area.tags))
        half = self._half_m
        places = [p for p in places if abs(p[0]) <= half and abs(p[1]) <= half]
        free = [
            p for p in places if p[0] * p[0] + p[1] * p[1] >= 16.0 and not self._built.contains(shapely.Point(p[:2]))
        ]
        free.sort(key=lambda p: p[0] * p[0] + p[1] * p[1])
        if len(free) > self._options.max_trees:
            self._notes["trees beyond map.max_trees are left out, the farthest first"] += (
                len(free) - self._options.max_trees
            )
        shown = free[: self._options.max_trees]
        for number, (x, y, size, tags) in enumerate(shown):
            progress.tell("trees", number, len(shown))
            if occupied is not None:
                is_clear = occupied.is_clear(disc(x, y, _CROWN_M * size))
                if not is_clear or not occupied.is_free(disc(x, y, _TRUNK_M * size)):
                    self._notes["trees would stand in something else and are left out"] += 1
                    continue
                occupied.take(disc(x, y, _CROWN_M * size))
            add_tree(b, rng, x, y, size=size)
            self._rename_class(tags, "tree")
        for spot in self._shapes.spots:
            if spot.tags.get("natural") == "shrub":
                add_bush(b, rng, *spot.place)

    def _rename_class(self, tags: Tags, kind: str) -> None:
        """Give the object just added the user's class for its tags."""
        name = self._class(tags, kind)
        if name != kind:
            self._builder.classify(name, self._builder.last_body)

    def _furniture(self) -> None:
        b = self._builder
        for spot in self._shapes.spots:
            x, y = spot.place
            if x * x + y * y < 9.0 or self._built.contains(shapely.Point(x, y)):
                continue
            self._small(b, spot)

    def _small(self, b: MapBuilder, spot: Spot) -> None:
        x, y = spot.place
        tags = spot.tags
        if tags.get("highway") == "street_lamp":
            add_lamp(b, x, y, height_m=5.0)
            self._rename_class(tags, "lamp")
        elif tags.get("amenity") == "bench":
            heading = osm_tags.direction_deg(tags.get("direction"))
            if heading is None:
                heading = 360.0 * self.rng(spot.key).unit()
            add_bench(b, x, y, (90.0 - heading) * RAD_PER_DEG)
            self._rename_class(tags, "bench")
        elif tags.get("amenity") == "waste_basket":
            add_bin(b, x, y)
            self._rename_class(tags, "bin")
        for (key, value), (kind, height, radius) in _SMALL_NODES.items():
            if tags.get(key) == value:
                height = min(osm_tags.length_m(tags.get("height")) or height, 300.0)
                body = b.body(self._class(tags, kind), (x, y, 0.0))
                material = "osm_steel" if radius < 0.5 else "osm_concrete"
                body.geom("cylinder", (radius, 0.5 * height), pos=(0.0, 0.0, 0.5 * height), material=material)
                return


def _way_area(tags: Tags) -> tuple[str, str]:
    """Return class and material of an area of a road or path; "" if it is none."""
    highway = tags.get("highway", "")
    if tags.get("area") != "yes" or highway not in osm_tags.PATHS | osm_tags.ROADS:
        return "", ""
    default = (osm_tags.PATHS | osm_tags.ROADS)[highway][1] or "paving"
    return ("path" if highway in osm_tags.PATHS else "road"), osm_tags.SURFACES.get(tags.get("surface", ""), default)


def _from_ground(tags: Tags) -> bool:
    return not tags.get("min_height") and not tags.get("building:min_level")


def _simple(polygon: Any) -> bool:
    """Return True for a polygon of some size and width."""
    return bool(polygon.area >= 2.0 and not polygon.buffer(-0.2).is_empty)


def _tree_size(tags: Tags, rng: RandomGenerator) -> float:
    height = osm_tags.length_m(tags.get("height"))
    drawn = rng.between(0.8, 1.3)
    return min(max(height / 8.0, 0.4), 3.5) if height else drawn


def _dashes(path: Any, dash_m: float, gap_m: float, half_m: float) -> list[list[tuple[float, float]]]:
    """Return quads along a line."""
    quads = []
    at = 0.5 * gap_m
    while at + dash_m < path.length:
        a, b = path.interpolate(at), path.interpolate(at + dash_m)
        dx, dy = b.x - a.x, b.y - a.y
        length = sqrt(dx * dx + dy * dy)
        if length > 0.5 * dash_m:
            nx, ny = -dy / length * half_m, dx / length * half_m
            quads.append([(a.x - nx, a.y - ny), (b.x - nx, b.y - ny), (b.x + nx, b.y + ny), (a.x + nx, a.y + ny)])
        at += dash_m + gap_m
    return quads


def _segments(piece: Any, step_m: float) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Return the segments of a line, cut to at most `step_m`."""
    points = [(x, y) for x, y in coordinates(piece).tolist()]
    found = []
    for (ax, ay), (bx, by) in pairwise(points):
        count = max(1, ceil(sqrt((bx - ax) * (bx - ax) + (by - ay) * (by - ay)) / step_m))
        for k in range(count):
            s, t = k / count, (k + 1) / count
            found.append(((ax + s * (bx - ax), ay + s * (by - ay)), (ax + t * (bx - ax), ay + t * (by - ay))))
    return found
