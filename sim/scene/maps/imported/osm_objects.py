"""Parked cars and people of a district, placed by a seed: never in a house, in water or in each other.

Each place has a generator of its own, named by its way and number, so that a change of one way moves nothing elsewhere.
The nearest to the take-off place are kept if there are more than the map may have.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np

from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene.imports import osm_tags
from sim.scene.imports.elevation import Terrain
from sim.scene.imports.osm_parking import ParkingPlace, bays, is_on_ground, street_places
from sim.scene.imports.osm_shapes import Line, Shapes
from sim.scene.imports.shapes import shapely
from sim.scene.map_section import OsmObjects
from sim.scene.maps.imported.imported_map import Walk
from sim.scene.maps.imported.osm_occupancy import Occupancy, disc, rectangle
from sim.scene.maps.imported.walkers import LANE_M
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.people import add_still_person
from sim.scene.maps.vehicles.kinds import STREET_MIX, add_vehicle
from sim.scene.random_generator import RandomGenerator

_CAR_HALF_M = (2.75, 1.1)  # of the longest car, a van, with its mirrors
_CAR_FREE_M, _PERSON_FREE_M = 8.0, 5.0  # round the take-off place
_STEEP_M = 0.35  # greatest difference of the ground under a car
_PERSON_M = 0.5  # radius of the ground of somebody who stands
_EVERY_M = 45.0  # of footways: one person at density 1
_WALK_M = (12.0, 40.0)  # least and greatest length of a walk
_WALK_HALF_M = 0.5 * LANE_M + 0.55  # of the ground that a walk takes


@dataclass(frozen=True)
class Streets:
    """Roads of a district with their widths, and the junctions of these: cars and people keep to them."""

    shapes: Shapes
    carriageways: list[tuple[str, Any]]  # key of the way, polygon
    junctions: Any  # a tree of points


class ObjectPlacer:
    """Places cars and people. `lift_m`: of the roads over the ground."""

    def __init__(
        self,
        builder: MapBuilder,
        streets: Streets,
        options: OsmObjects,
        occupied: Occupancy,
        *,
        terrain: Terrain | None,
        half_m: float,
        lift_m: float,
    ) -> None:
        self._builder, self._streets, self._options = builder, streets, options
        self._occupied, self._terrain, self._half_m, self._lift_m = occupied, terrain, half_m, lift_m
        self.walks: list[Walk] = []
        self._tree = shapely.STRtree([shape for _, shape in streets.carriageways]) if streets.carriageways else None

    def _rng(self, name: str) -> RandomGenerator:
        return RandomGenerator(self._options.seed, f"osm.objects.{name}")

    def _within(self, x: float, y: float, free_m: float) -> bool:
        return max(abs(x), abs(y)) < self._half_m - 3.0 and x * x + y * y > free_m * free_m

    def _ground_m(self, shape: Any) -> tuple[float, float]:
        """Return least and greatest height of the ground at the corners of a shape."""
        if self._terrain is None:
            return 0.0, 0.0
        z = self._terrain.height(shapely.get_coordinates(shape))
        return float(z.min()), float(z.max())

    # --- cars ---------------------------------------------------------------------------------------------------

    def places(self) -> list[ParkingPlace]:
        """Return all places for cars, the nearest first."""
        found = [place for area in self._lots() for place in bays(area.polygon, area.key)]
        for line in self._streets.shapes.lines:
            found += street_places(line, self._streets.junctions)
        found = [place for place in found if self._within(place.x, place.y, _CAR_FREE_M)]
        return sorted(found, key=lambda place: (place.x * place.x + place.y * place.y, place.x, place.y))

    def _lots(self) -> list[Any]:
        areas = self._streets.shapes.areas
        single = [area for area in areas if area.tags.get("amenity") == "parking_space"]
        return [area for area in areas if is_on_ground(area.tags)] + single

    def cars(self, notes: Counter[str]) -> None:
        """Park cars."""
        options, numbers = self._options, Counter[str]()
        count = 0
        for place in self.places():
            number = numbers[place.key]
            numbers[place.key] += 1
            rng = self._rng(f"car.{place.key}.{number}")
            if not rng.chance(min(place.share * options.density, 1.0)):
                continue
            outline = rectangle(place.x, place.y, place.heading_rad, _CAR_HALF_M)
            low, high = self._ground_m(outline)
            if high - low > _STEEP_M or not self._on_no_road(outline, place.key):
                continue
            if not self._occupied.is_free(outline):
                continue
            if count == options.max_cars:
                notes["places of parked cars beyond map.objects.max_cars stay empty, the farthest first"] += 1
                continue
            self._occupied.take(outline)
            count += 1
            at = (place.x, place.y, place.heading_rad + rng.between(-0.02, 0.02))
            add_vehicle(self._builder, rng, rng.pick(STREET_MIX), at, ground_m=low + self._lift_m)

    def _on_no_road(self, outline: Any, key: str) -> bool:
        """Return True if an outline is on no road but that of a key."""
        if self._tree is None:
            return True
        hit = self._tree.query(outline, predicate="intersects").tolist()
        return all(self._streets.carriageways[i][0] == key for i in hit)

    # --- people -------------------------------------------------------------------------------------------------

    def people(self, notes: Counter[str]) -> None:
        """Add people who stand, and on level ground people who walk along footways."""
        spots = sorted(self._spots(), key=lambda s: (s[0] * s[0] + s[1] * s[1], s[0], s[1]))
        count = 0
        for x, y, name, walk in spots:
            if not self._within(x, y, _PERSON_FREE_M):
                continue
            rng = self._rng(f"person.{name}")
            if walk is not None and rng.chance(0.6):
                ground = shapely.LineString(walk).buffer(_WALK_HALF_M, quad_segs=4)
                is_near_start = ground.distance(shapely.Point(0.0, 0.0)) < _PERSON_FREE_M
            else:
                ground, walk, is_near_start = disc(x, y, _PERSON_M), None, False
            if is_near_start or not self._occupied.is_free(ground):
                continue
            if walk is None and not self._on_no_road(ground, ""):
                continue
            if count == self._options.max_people:
                notes["people beyond map.objects.max_people are left out, the farthest first"] += 1
                continue
            self._occupied.take(ground)
            count += 1
            if walk is not None:
                self._builder.classify("person", "person_*")
                self.walks.append(Walk(*walk, self._lift_m, self._options.seed, f"osm.objects.walk.{name}"))
            else:
                at: Vec3 = (x, y, self._ground_m(disc(x, y, 0.1))[1] + self._lift_m)
                add_still_person(self._builder, rng, at, rng.between(0.0, TURN_RAD))

    def _spots(self) -> Iterator[tuple[float, float, str, tuple[tuple[float, float], tuple[float, float]] | None]]:
        """Yield places beside the middle of footways and sidewalks, each with a name, and a walk from there."""
        step = _EVERY_M / max(self._options.density, 1e-6)
        for line in self._streets.shapes.lines:
            for offset in _footways(line):
                left = 0.5 * step  # to the next person
                for i, (a, b) in enumerate(zip(line.points[:-1], line.points[1:], strict=True)):
                    d = np.array(b) - np.array(a)
                    length = sqrt(float(d @ d))
                    d = d / length
                    side = np.array((-d[1], d[0])) * offset
                    while left < length:
                        x, y = (np.array(a) + left * d + side).tolist()
                        walk = None
                        if self._terrain is None and length >= _WALK_M[0]:
                            begin = min(max(left - 0.5 * _WALK_M[1], 1.0), length - 1.0)
                            end = min(left + 0.5 * _WALK_M[1], length - 1.0)
                            p, q = (np.array(a) + t * d + side for t in (begin, end))
                            walk = ((float(p[0]), float(p[1])), (float(q[0]), float(q[1])))
                        yield x, y, f"{line.key}.{offset:g}.{i}.{left:.0f}", walk
                        left += step
                    left -= length


def _footways(line: Line) -> list[float]:
    """Return how far to the left of a way people walk."""
    tags = line.tags
    highway = tags.get("highway", "")
    if tags.get("tunnel", "no") != "no" or tags.get("bridge", "no") != "no" or tags.get("layer", "0") != "0":
        return []
    if highway in ("footway", "path", "pedestrian", "living_street"):
        return [] if tags.get("footway") == "crossing" else [0.0]
    if highway in osm_tags.ROADS:
        out = 0.5 * osm_tags.width_m(tags, osm_tags.ROADS[highway][0]) + 0.9
        sides = {"both": (1.0, -1.0), "yes": (1.0, -1.0), "left": (1.0,), "right": (-1.0,)}
        return [sign * out for sign in sides.get(tags.get("sidewalk", ""), ())]
    return []
