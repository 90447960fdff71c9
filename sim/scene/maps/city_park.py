"""City park: 92 x 92 m of lawn between streets and blocks of flats.

A round walk and four winding paths meet at a paved place, where the vehicle starts. The quarters between them hold, in
an order drawn from the seed, a pond, a playground, a grove and an open lawn. There are benches, lamps, hedges, a hill
and people.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt
from typing import Annotated

from pydantic import Field

from signals._kernel import det_atan2, det_cos, det_sin
from signals.documents.validate import StrictModel
from signals.units import QUARTER_TURN_RAD, TURN_RAD
from sim.scene import surfaces
from sim.scene.maps import textures
from sim.scene.maps.buildings import add_block, building_materials
from sim.scene.maps.ground_details import (
    STREET_WIDTH_M,
    Strip,
    covers,
    ground_materials,
    kerbs,
    puddles,
    spots,
    street,
)
from sim.scene.maps.layout import Layout, Point
from sim.scene.maps.map_builder import Body, MapBuilder, yaw_quat
from sim.scene.maps.meshes import ellipse, ribbon, slab
from sim.scene.maps.objects.animals import add_birds, add_dog
from sim.scene.maps.objects.belongings import add_backpack, add_parasol, add_potted_plant
from sim.scene.maps.people import PersonTraits, add_cyclist, add_still_person, add_walker, add_wheelchair_user
from sim.scene.maps.plants import add_bush, add_hedge, add_tree, plant_materials
from sim.scene.maps.season import Season
from sim.scene.maps.street_clutter import CAR_M, add_clutter, park_cars, square_kerbs
from sim.scene.maps.street_furniture import (
    SEAT_M,
    add_bench,
    add_bin,
    add_lamp,
    add_sandpit,
    add_slide,
    add_swing,
    furniture_materials,
)
from sim.scene.maps.vehicles.kinds import STREET_MIX, add_vehicle
from sim.scene.maps.walk_path import WalkPath
from sim.scene.random_generator import RandomGenerator
from sim.scene.scene_map import SceneMap

_HALF_M = 46.0  # lawn
_PLACE_M = 6.0  # radius of the paved place at the origin
_PATH_HALF_M = 1.2
_PAVEMENT_M = 0.12  # its top
_STREET_M = 52.5  # middle of the street round the park


Point3 = tuple[float, float, float]


class Parameters(StrictModel):
    """Numbers of trees, bushes, people and furniture."""

    trees: Annotated[int, Field(ge=0, le=400)] = 30
    bushes: Annotated[int, Field(ge=0, le=100)] = 8
    benches: Annotated[int, Field(ge=0, le=24)] = 6
    lamps: Annotated[int, Field(ge=0, le=40)] = 8
    walkers: Annotated[int, Field(ge=0, le=60)] = 8
    children: Annotated[int, Field(ge=0, le=20)] = 0
    wheelchairs: Annotated[int, Field(ge=0, le=20)] = 0
    cyclists: Annotated[int, Field(ge=0, le=20)] = 0
    resting_people: Annotated[int, Field(ge=0, le=20)] = 3
    cars: Annotated[int, Field(ge=0, le=40)] = 3
    parked_cars: Annotated[int, Field(ge=0, le=60)] = 5  # besides `cars`
    street_objects: Annotated[int, Field(ge=0, le=60)] = 6  # groups: bins, cones, signs, cabinets, bollards
    hill_m: Annotated[float, Field(ge=0.0, le=8.0)] = 3.5
    season: Season = "summer"


class _Park:
    def __init__(self, parameters: Parameters, seed: int) -> None:
        self.parameters = parameters
        self.seed = seed
        self.builder = MapBuilder("city_park")
        self.layout = Layout()
        self.bare: list[Point] = []  # where the grass is worn off
        self.cars: list[Point] = []
        # Keeps 7 m round the origin free of anything above knee height.
        self.layout.take_disc(0.0, 0.0, 7.0)

    def rng(self, name: str) -> RandomGenerator:
        return RandomGenerator(self.seed, f"city_park.{name}")

    def materials(self) -> None:
        b = self.builder
        plant_materials(b, self.parameters.season)
        furniture_materials(b)
        building_materials(b)
        ground_materials(b)
        for name in ("grass", "gravel", "paving", "water"):
            b.texture(name, textures.png(name))
        b.material("grass", surfaces.GRASS, texture="grass", tile_m=16.0, specular=0.0)
        # Meshes in W have texture coordinates in metres.
        b.material("gravel", surfaces.GRAVEL, texture="gravel", specular=0.0)
        b.material("paving", surfaces.CONCRETE, texture="paving", specular=0.0)
        b.material("pavement", surfaces.CONCRETE, texture="paving", tile_m=4.8, specular=0.0)
        b.material("water", surfaces.WATER, texture="water", specular=0.9, shininess=0.9)
        b.material("kerb", surfaces.STONE, rgb=(0.58, 0.57, 0.54), specular=0.0)

    def paths(self) -> None:
        b, rng = self.builder, self.rng("paths")
        b.ground("plane", (0.0, 0.0, 1.0), material="grass")
        a, c = rng.between(0.0, TURN_RAD), rng.between(0.0, TURN_RAD)
        self.round_walk: list[Point] = []
        for i in range(72):
            angle = TURN_RAD * i / 72
            r = 29.5 + 1.9 * det_sin(3.0 * angle + a) + 1.1 * det_sin(2.0 * angle + c)
            self.round_walk.append((r * det_cos(angle), r * det_sin(angle)))
        self.path_mesh("walk", self.round_walk, _PATH_HALF_M, "gravel", 4.0, closed=True)
        self.layout.take_band(self.round_walk, _PATH_HALF_M + 0.4, closed=True)
        self.spokes: list[list[Point]] = []
        for i, (c_x, s_y) in enumerate(((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))):
            sway = rng.between(1.2, 2.6) * (1.0 if rng.chance(0.5) else -1.0)
            points = []
            for k in range(25):
                out = _PLACE_M - 0.3 + (_HALF_M + 0.4 - _PLACE_M) * k / 24
                side = sway * det_sin(TURN_RAD * k / 24)
                points.append((out * c_x - side * s_y, out * s_y + side * c_x))
            self.spokes.append(points)
            # Slightly above the round walk, so that crossings show one surface.
            self.path_mesh(f"spoke_{i}", points, _PATH_HALF_M, "gravel", 4.0, closed=False, top_m=0.026)
            self.layout.take_band(points, _PATH_HALF_M + 0.4)
        body = b.body("path")
        place = b.mesh("place", slab(ellipse(_PLACE_M, _PLACE_M, 40), -0.05, 0.012, tile_m=4.8))
        body.geom("mesh", asset=place, material="paving", solid=False, part="place")

    def path_mesh(
        self,
        name: str,
        points: list[Point],
        half_m: float,
        material: str,
        tile_m: float,
        *,
        closed: bool,
        top_m: float = 0.02,
    ) -> None:
        mesh = self.builder.mesh(name, ribbon(points, half_m, -0.05, top_m, tile_m=tile_m, closed=closed))
        self.builder.body("path").geom("mesh", asset=mesh, material=material, solid=False)

    def street(self) -> None:
        b, rng = self.builder, self.rng("street")
        s = _STREET_M
        square = [(-s, -s), (s, -s), (s, s), (-s, s)]
        road = b.body("road")
        mesh = b.mesh("street", street(_street_strips(s, 0.015), self.rng("street_looks")))
        road.geom("mesh", asset=mesh, material="street", solid=False, part="lanes")
        for i, ((x0, y0), (x1, y1)) in enumerate(zip(square, [*square[1:], square[0]], strict=True)):
            along_x = y0 == y1
            half = (s - 4.0, 0.06, 0.01) if along_x else (0.06, s - 4.0, 0.01)
            road.geom(
                "box",
                half,
                pos=((x0 + x1) / 2, (y0 + y1) / 2, 0.015),
                material="road_paint",
                solid=False,
                part=f"line_{i}",
            )
        # Boxes: a solid mesh collides as its convex hull, and the hull of a ring is the whole park.
        for middle in (_HALF_M + 1.7, _STREET_M + 4.8):
            body = b.body("pavement")
            for i, (x, y, hx, hy) in enumerate(
                ((0, middle, middle + 1.3, 1.3), (0, -middle, middle + 1.3, 1.3), (middle, 0, 1.3, middle - 1.3),
                 (-middle, 0, 1.3, middle - 1.3))
            ):  # fmt: skip
                body.geom("box", (hx, hy, 0.08), pos=(x, y, 0.04), material="pavement", part=f"side_{i}")
        self.street_details(road)
        for quarter in range(4):
            c, n = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarter]
            along = -54.0
            while along < 44.0:
                bays = 6 + rng.index(4)
                width = 3.0 * bays
                deep = 4
                out = _STREET_M + 6.6 + 1.5 * deep
                middle = along + width / 2
                x, y = out * c - middle * n, out * n + middle * c
                # The long side, x of the block, faces the park.
                place = (x, y, QUARTER_TURN_RAD * (quarter + 1))
                add_block(b, rng, place, (bays, deep, 3 + rng.index(4)), recessed=False)
                along += width + rng.between(3.0, 9.0)
        cars, looks = self.rng("cars"), self.rng("car_looks")
        for i in range(self.parameters.cars):
            quarter, slot = i % 4, i // 4
            c, n = ((0, -1), (1, 0), (0, 1), (-1, 0))[quarter]
            out = _STREET_M - 2.3
            along = -34.0 + 7.0 * slot + cars.between(0.0, 60.0 / (1 + self.parameters.cars // 4))
            cars.unit(), cars.unit()  # drawn for looks once; places of later cars depend on them
            x, y = out * c - along * n, out * n + along * c
            add_vehicle(b, looks, looks.pick(STREET_MIX), (x, y, QUARTER_TURN_RAD * quarter))
            self.cars.append((x, y))

    def street_details(self, road: Body) -> None:
        """Add kerb stones, manhole covers and puddles in the gutters."""
        b, rng = self.builder, self.rng("street_details")
        inner, outer = _HALF_M + 3.0, _STREET_M + 3.5
        edges = [*_edges(_square(inner)), *[(end, begin) for begin, end in _edges(_square(outer))]]
        road.geom("mesh", asset=b.mesh("kerbs", kerbs(edges, 0.12)), material="kerb_stones", solid=False, part="kerbs")
        places, wet = [], []
        for c, n in ((1, 0), (0, 1), (-1, 0), (0, -1)):
            for _ in range(2):
                along, out = rng.between(-44.0, 44.0), _STREET_M + rng.pick((-1.75, 1.75))
                places.append((out * c - along * n, out * n + along * c))
            along, out = rng.between(-40.0, 40.0), _STREET_M + rng.pick((-3.0, 3.0))
            far, wide = rng.between(0.9, 2.2), rng.between(0.25, 0.45)
            wet.append((out * c - along * n, out * n + along * c, wide if c else far, far if c else wide))
        road.geom("mesh", asset=b.mesh("covers", covers(places, 0.018)), material="manhole", solid=False, part="covers")
        mesh = b.mesh("puddles", puddles(wet, 0.019, rng))
        road.geom("mesh", asset=mesh, material="puddle", solid=False, part="puddles")

    def lawn_details(self) -> None:
        """Add wear to the lawn: bare spots under trees and benches, dry patches."""
        b, rng = self.builder, self.rng("lawn_details")
        places = [(x, y, rng.between(0.9, 1.6), 1.0) for x, y in self.bare]
        for _ in range(12):
            x, y = rng.between(-44.0, 44.0), rng.between(-44.0, 44.0)
            places.append((x, y, rng.between(1.2, 3.5), 0.0))
        body = b.body("ground")
        mesh = b.mesh("worn_spots", spots(places, 0.0, rng))
        body.geom("mesh", asset=mesh, material="worn_spot", solid=False, part="spots")

    def hedges(self) -> None:
        b = self.builder
        half = (_HALF_M - 3.5) / 2
        for quarter in range(4):
            c, n = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarter]
            for side in (-1.0, 1.0):
                along = side * (3.0 + half)
                x, y = 45.4 * c - along * n, 45.4 * n + along * c
                add_hedge(b, x, y, QUARTER_TURN_RAD * (quarter + 1), (half, 0.35, 0.5))

    def quarters(self) -> None:
        rng = self.rng("quarters")
        order = rng.shuffled(("pond", "playground", "grove", "lawn"))
        for i, kind in enumerate(order):
            angle = TURN_RAD * (i + 0.5) / 4
            x, y = 17.0 * det_cos(angle), 17.0 * det_sin(angle)
            if kind == "pond":
                self.pond(x, y)
            elif kind == "playground":
                self.playground(x, y, angle)
            elif kind == "grove":
                self.grove = (x, y)
        if self.parameters.hill_m > 0.0:
            angle = TURN_RAD * (rng.index(4) + 0.5) / 4
            self.hill(49.0 * det_cos(angle), 49.0 * det_sin(angle))

    def pond(self, x: float, y: float) -> None:
        b, rng = self.builder, self.rng("pond")
        lumps = [rng.between(-1.0, 1.0) for _ in range(6)]

        def wobble(side: int) -> float:
            angle = TURN_RAD * side / 40
            return (
                1.0
                + 0.05 * lumps[0] * det_sin(2.0 * angle + lumps[1])
                + 0.05 * lumps[2] * det_sin(3.0 * angle + lumps[3])
            )

        shore = ellipse(6.2, 4.9, 40, wobble=wobble)
        body = b.body("water", (x, y, 0.0), yaw_quat(rng.between(0.0, TURN_RAD)))
        body.geom("mesh", asset=b.mesh("pond", slab(shore, -0.05, 0.03, tile_m=5.0)), material="water", part="pond")
        rim = b.mesh("pond_rim", ribbon(shore, 0.28, -0.05, 0.14, tile_m=1.0, closed=True))
        body.geom("mesh", asset=rim, material="kerb", solid=False, part="rim")
        body.geom("cylinder", (0.5, 0.35), pos=(0.0, 0.0, 0.35), material="kerb", part="fountain")
        body.geom("sphere", (0.22,), pos=(0.0, 0.0, 0.85), material="kerb", part="ball")
        self.layout.take_disc(x, y, 7.2)

    def playground(self, x: float, y: float, angle: float) -> None:
        b = self.builder
        add_swing(b, x - 2.6, y - 2.0, angle)
        add_slide(b, x + 2.2, y - 2.4, angle + QUARTER_TURN_RAD * 2.0)
        add_sandpit(b, x + 0.5, y + 2.8, 1.6)
        self.layout.take_disc(x, y, 6.3)

    def hill(self, x: float, y: float) -> None:
        """Add a hill of cosine shape in a corner of the lawn, as a height field."""
        n, half = 33, 9.5
        scale = (_HALF_M - 1.2 - half) / max(abs(x), abs(y))
        x, y = x * scale, y * scale
        rows = []
        for j in range(n):
            v = 2.0 * j / (n - 1) - 1.0
            row = []
            for i in range(n):
                u = 2.0 * i / (n - 1) - 1.0
                r = min(sqrt(u * u + v * v), 1.0)
                row.append(0.5 + 0.5 * det_cos(TURN_RAD / 2 * r))
            rows.append(row)
        b = self.builder
        b.hfield("hill", rows, (half, half, self.parameters.hill_m, 0.1))
        b.material("hill_grass", surfaces.GRASS, texture="grass", tile_m=16.0, specular=0.0)
        # Its rim lies slightly below the lawn, so that no edge shows.
        b.body("hill", (x, y, -0.02)).geom("hfield", asset="hill", material="hill_grass")
        self.layout.take_disc(x, y, half)

    def furniture(self) -> None:
        b, p = self.builder, self.parameters
        self.seats: list[tuple[float, float, float]] = []
        self.benches: list[tuple[float, float, float]] = []
        for i in range(p.benches):
            x, y, heading = self.beside_walk((i + 0.5) / p.benches, 2.75)
            if self.layout.free(x, y, 0.9):
                add_bench(b, x, y, heading)
                self.bare.append((x + 0.5 * det_cos(heading), y + 0.5 * det_sin(heading)))
                self.layout.take_disc(x, y, 1.1)
                self.seats.append((x, y, heading))
                self.benches.append((x, y, heading))
            if i % 2 == 0:
                x, y, _ = self.beside_walk((i + 0.5) / p.benches + 0.013, 2.0)
                if self.layout.free(x, y, 0.3):
                    add_bin(b, x, y)
                    self.layout.take_disc(x, y, 0.4)
        for i in range(p.lamps):
            x, y, _ = self.beside_walk((i + 0.22) / p.lamps, -1.9)
            if self.layout.free(x, y, 0.25):
                add_lamp(b, x, y)
                self.layout.take_disc(x, y, 0.4)

    def beside_walk(self, share: float, outward_m: float) -> Point3:
        """Return a point beside the round walk, and the heading from there to the walk."""
        x, y = self.round_walk[round(share * 72) % 72]
        r = sqrt(x * x + y * y)
        scale = (r + outward_m) / r
        heading = det_atan2(-y * outward_m, -x * outward_m)
        return x * scale, y * scale, heading

    def plants(self) -> None:
        b, p, rng = self.builder, self.parameters, self.rng("plants")
        h = _HALF_M - 2.6
        gx, gy = self.grove
        grove = p.trees // 4
        placed = self.layout.scatter(rng, grove, 2.3, (gx - 7, gy - 7, gx + 7, gy + 7), self.tree(rng), tries=20)
        self.layout.scatter(rng, p.trees - placed, 2.6, (-h, -h, h, h), self.tree(rng))
        self.layout.scatter(rng, p.bushes, 0.9, (-h, -h, h, h), lambda x, y: add_bush(b, rng, x, y))

    def tree(self, rng: RandomGenerator) -> Callable[[float, float], None]:
        def place(x: float, y: float) -> None:
            add_tree(self.builder, rng, x, y)
            self.bare.append((x, y))

        return place

    def people(self) -> None:
        b, p, rng = self.builder, self.parameters, self.rng("people")
        for i in range(p.walkers):
            add_walker(b, rng, self._way(rng, i, (0.9, 1.5)))
        for i in range(p.resting_people):
            if i % 3 != 2 and self.seats:
                x, y, heading = self.seats.pop(rng.index(len(self.seats)))
                add_still_person(b, rng, (x, y, 0.0), heading, seat_m=SEAT_M)
                continue
            self.layout.scatter(
                rng, 1, 0.5, (-25.0, -25.0, 25.0, 25.0),
                lambda x, y: add_still_person(b, rng, (x, y, 0.0), rng.between(0.0, TURN_RAD)),
            )  # fmt: skip

        children, wheels = self.rng("children"), self.rng("wheelchairs")
        for i in range(p.children):
            traits = PersonTraits(height_m=children.between(1.05, 1.40))
            add_walker(b, children, self._way(children, i, (0.6, 1.0)), traits=traits)
        for i in range(p.wheelchairs):
            add_wheelchair_user(b, wheels, self._way(wheels, 2 * i, (0.7, 1.3)))
        cyclists = self.rng("cyclists")
        for i in range(p.cyclists):
            add_cyclist(b, cyclists, self._way(cyclists, 2 * i, (3.0, 6.0), corner_m=5.0))

    def _way(
        self, rng: RandomGenerator, number: int, speed_mps: tuple[float, float], *, corner_m: float = 1.2
    ) -> WalkPath:
        """Draw a path round the park (even numbers) or along one of its spokes."""
        speed = rng.between(*speed_mps)
        lap = rng.unit()
        if number % 2:
            return _along_spoke(self.spokes[(number // 2) % 4], speed, lap, rng)
        # Round the park in either direction, each on a lane of its own.
        lane = rng.between(-0.7, 0.7)
        points = [self._in_lane(point, lane) for point in self.round_walk[::3]]
        if rng.chance(0.5):
            points.reverse()
        return WalkPath(points, speed, corner_m=corner_m, start_lap=lap)

    def objects(self) -> None:
        """Add belongings, animals and parked two-wheelers, after all else, so that nothing else moves."""
        b, rng = self.builder, self.rng("objects")
        for k, (x, y, heading) in enumerate(self.benches):
            c, s = det_cos(heading), det_sin(heading)
            left = 1.05 if k % 2 else -1.05
            px, py = x - left * s, y + left * c
            if k % 3 == 2:
                add_potted_plant(b, rng, (px, py, 0.0))
            else:
                add_backpack(b, rng, (px, py, 0.0), heading + rng.between(-0.5, 0.5))
        turn = TURN_RAD

        def scatter(count: int, radius_m: float, add: Callable[[float, float], None]) -> None:
            self.layout.scatter(rng, count, radius_m, (-27.0, -27.0, 27.0, 27.0), add)

        scatter(2, 1.6, lambda x, y: add_parasol(b, rng, (x, y, 0.0)))
        scatter(2, 0.6, lambda x, y: add_dog(b, rng, (x, y, 0.0), rng.between(0.0, turn)))

        def bicycle(x: float, y: float) -> None:
            add_vehicle(b, rng, "bicycle", (x, y, rng.between(0.0, turn)))

        scatter(3, 0.9, bicycle)

        scatter(3, 0.9, lambda x, y: add_birds(b, rng, (x, y, 0.0)))

    def kerbside(self) -> None:
        """Add rows of parked cars and small objects along the street, after all else, so that nothing else moves."""
        road = Layout()
        for x, y in self.cars:
            road.take_disc(x, y, CAR_M)
        inner = square_kerbs(_HALF_M + 3.0, 6.0, _PAVEMENT_M, street_outside=True)
        outer = square_kerbs(_STREET_M + 3.5, 12.0, _PAVEMENT_M, street_outside=False)
        kerbs = [*inner, *outer]
        park_cars(self.builder, self.rng("parked_cars"), kerbs, road, self.parameters.parked_cars)
        count = self.parameters.street_objects
        add_clutter(self.builder, self.rng("street_objects"), kerbs, self.layout, count, ways=Layout())

    @staticmethod
    def _in_lane(point: Point, lane_m: float) -> Point:
        x, y = point
        r = sqrt(x * x + y * y)
        return x * (1.0 + lane_m / r), y * (1.0 + lane_m / r)


def _square(half_m: float) -> list[Point]:
    """Return the corners of a square, counter-clockwise."""
    return [(-half_m, -half_m), (half_m, -half_m), (half_m, half_m), (-half_m, half_m)]


def _edges(corners: list[Point]) -> list[tuple[Point, Point]]:
    return list(zip(corners, [*corners[1:], corners[0]], strict=True))


def _street_strips(middle_m: float, z_m: float) -> list[Strip]:
    """Return the four sides and the four corners of a street along a square."""
    s, half = middle_m, 0.5 * STREET_WIDTH_M
    strips = []
    for c, n in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        ends = [(s * c - along * n, s * n + along * c) for along in (half - s, s - half, s + half)]
        strips += [Strip(ends[0], ends[1], z_m), Strip(ends[1], ends[2], z_m, crossing=True)]
    return strips


def _along_spoke(spoke: list[Point], speed_mps: float, lap: float, rng: RandomGenerator) -> WalkPath:
    """Return a path out along a spoke on its right and back on its left."""
    out = [spoke[k] for k in range(3, 24, 4)]
    half = 0.45 + 0.25 * rng.unit()
    right, left = [], []
    for k, (x, y) in enumerate(out):
        ax, ay = out[max(k - 1, 0)]
        bx, by = out[min(k + 1, len(out) - 1)]
        dx, dy = bx - ax, by - ay
        scale = half / sqrt(dx * dx + dy * dy)
        right.append((x + dy * scale, y - dx * scale))
        left.append((x - dy * scale, y + dx * scale))
    return WalkPath([*right, *reversed(left)], speed_mps, corner_m=half, start_lap=lap)


def generate(parameters: Parameters, seed: int) -> SceneMap:
    park = _Park(parameters, seed)
    park.materials()
    park.paths()
    park.street()
    park.hedges()
    park.quarters()
    park.furniture()
    park.plants()
    park.people()
    park.objects()
    park.kerbside()
    park.lawn_details()
    park.builder.classify("ground", "ground")
    return park.builder.build()
