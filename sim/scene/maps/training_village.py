"""Military training village, about 90 x 90 m: concrete shells with open windows, streets, courtyards, soldiers.

The village spans x and y from -10 to 80. Streets run on a grid that the seed shifts. Buildings stay on the plots
between them, so every street is at least `street_m` wide at every height. Halls, blocks and towers of 12 to 15 m are
obstacles for a flight at 10 m, some of them on the straight line from start (0, 0) to goal (70, 60); the ground within
`clear_m` of both is free. Below the default mission nothing is higher than a house.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from math import sqrt
from typing import Annotated

from pydantic import Field

from signals.documents.validate import StrictModel
from signals.units import QUARTER_TURN_RAD, TURN_RAD
from sim.scene import surfaces
from sim.scene.maps import military, textures
from sim.scene.maps.ground_details import puddles
from sim.scene.maps.layout import Layout, Point, segment_distance
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.objects.animals import add_birds, add_dog
from sim.scene.maps.objects.belongings import add_backpack
from sim.scene.maps.objects.street_signs import add_stop_sign
from sim.scene.maps.people import PersonTraits, add_still_person, add_walker
from sim.scene.maps.plants import add_bush, add_tree, plant_materials
from sim.scene.maps.season import Season
from sim.scene.maps.street_furniture import furniture_materials
from sim.scene.maps.vehicles.kinds import MILITARY_MIX, add_vehicle
from sim.scene.maps.walk_path import there_and_back
from sim.scene.random_generator import RandomGenerator
from sim.scene.scene_map import SceneMap

START: Point = (0.0, 0.0)
GOAL: Point = (70.0, 60.0)
# Route of the default mission (rigs/missions/rectangle.plan, flown at 10 m): only low buildings stand below it.
_LOW_ROUTE: tuple[Point, ...] = ((-20.0, 10.0), (20.0, 10.0), (20.0, 35.0), (-20.0, 35.0), (-20.0, 10.0))
_ROUTE_CLEAR_M = 3.0
_LOW_M, _HIGH_M = -10.0, 80.0
_CELLS = 5


class Parameters(StrictModel):
    """Density of buildings, clutter and people."""

    tall_share: Annotated[float, Field(ge=0.0, le=1.0)] = 0.45
    street_m: Annotated[float, Field(ge=5.0, le=10.0)] = 6.0
    clear_m: Annotated[float, Field(ge=4.0, le=12.0)] = 6.0
    walkers: Annotated[int, Field(ge=0, le=40)] = 6
    standing_people: Annotated[int, Field(ge=0, le=40)] = 4
    outer_trees: Annotated[int, Field(ge=0, le=200)] = 24
    season: Season = "summer"


@dataclass(frozen=True)
class Plot:
    """Axis-aligned rectangle to build on."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def middle(self) -> Point:
        return 0.5 * (self.x0 + self.x1), 0.5 * (self.y0 + self.y1)

    @property
    def half(self) -> Point:
        return 0.5 * (self.x1 - self.x0), 0.5 * (self.y1 - self.y0)

    def distance(self, p: Point) -> float:
        dx = max(self.x0 - p[0], 0.0, p[0] - self.x1)
        dy = max(self.y0 - p[1], 0.0, p[1] - self.y1)
        return float(sqrt(dx * dx + dy * dy))


class _Village:
    def __init__(self, parameters: Parameters, seed: int) -> None:
        self.parameters = parameters
        self.seed = seed
        self.builder = MapBuilder("training_village")
        self.layout = Layout()
        self.vehicle_looks = self.rng("vehicle_looks")
        for x, y in (START, GOAL):
            self.layout.take_disc(x, y, parameters.clear_m)

    def rng(self, name: str) -> RandomGenerator:
        return RandomGenerator(self.seed, f"training_village.{name}")

    def materials(self) -> None:
        b = self.builder
        military.military_materials(b)
        plant_materials(b, self.parameters.season)
        furniture_materials(b)
        for name in ("earth", "gravel"):
            b.texture(name, textures.png(name))
        b.material("earth", surfaces.SOIL, texture="earth", tile_m=16.0, specular=0.0)
        b.material("track", surfaces.GRAVEL, rgb=(0.86, 0.82, 0.76), texture="gravel", tile_m=4.0, specular=0.0)
        b.material("rut", surfaces.SOIL, rgb=(0.76, 0.74, 0.70), texture="earth", tile_m=8.0, specular=0.0)
        b.material("puddle", surfaces.WATER, rgb=(0.27, 0.24, 0.19), specular=0.9, shininess=0.95)

    def streets(self) -> None:
        """Add streets along the grid lines between the cells, the outer ones included."""
        rng, b = self.rng("streets"), self.builder
        pitch = (_HIGH_M - _LOW_M) / _CELLS
        self.lines: list[list[float]] = []
        for _ in range(2):
            inner = [_LOW_M + pitch * i + rng.between(-2.2, 2.2) for i in range(1, _CELLS)]
            self.lines.append([_LOW_M, *inner, _HIGH_M])
        b.ground("plane", (0.0, 0.0, 1.0), material="earth")
        half = self.parameters.street_m / 2 - 0.4
        middle, reach = 0.5 * (_LOW_M + _HIGH_M), 0.5 * (_HIGH_M - _LOW_M) + 3.0
        for line in self.lines[0]:
            body = b.body("road", (line, middle, 0.0))
            body.geom("box", (half, reach, 0.02), pos=(0.0, 0.0, -0.008), material="track", solid=False, part="lane")
            for i, rut in enumerate((-0.8, 0.8)):
                body.geom("box", (0.16, reach, 0.02), pos=(rut, 0.0, 0.0), material="rut", solid=False, part=f"rut_{i}")
        looks = self.rng("street_looks")
        wet = [
            (looks.pick(self.lines[0]) + looks.pick((-0.8, 0.8)), looks.between(-5.0, 75.0), 0.3, 1.4) for _ in range(5)
        ]
        mesh = b.mesh("puddles", puddles(wet, 0.026, looks))
        b.body("road").geom("mesh", asset=mesh, material="puddle", solid=False, part="puddles")
        for line in self.lines[1]:
            body = b.body("road", (middle, line, 0.0))
            body.geom("box", (reach, half, 0.02), pos=(0.0, 0.0, -0.003), material="track", solid=False, part="lane")

    def plots(self) -> None:
        """Build on every cell; some pairs of neighbours become one long plot for a hall."""
        rng, p = self.rng("plots"), self.parameters
        xs, ys = self.lines
        edge = p.street_m / 2
        taken: set[tuple[int, int]] = set()
        # At least one hall blocks the straight line.
        barred = [
            (i, j)
            for i in range(_CELLS)
            for j in range(_CELLS)
            if _meets_flight_line(plot := Plot(xs[i] + edge, ys[j] + edge, xs[i + 1] - edge, ys[j + 1] - edge))
            and min(plot.distance(START), plot.distance(GOAL)) >= p.clear_m
            and not _meets_low_route(plot)
        ]
        self.bar = rng.pick(barred) if barred and p.tall_share > 0.0 else None
        for j in range(_CELLS):
            for i in range(_CELLS):
                if (i, j) in taken:
                    continue
                plot = Plot(xs[i] + edge, ys[j] + edge, xs[i + 1] - edge, ys[j + 1] - edge)
                if (i, j) == self.bar:
                    self.hall(rng, plot)
                    continue
                on_line = _meets_flight_line(plot)
                tall = rng.unit() < (0.5 + 0.5 * p.tall_share if on_line else p.tall_share) and p.tall_share > 0.0
                if tall and rng.chance(0.3):
                    wide = self._with_neighbour(rng, i, j, taken)
                    if wide is not None:
                        plot = wide
                tall = tall and not _meets_low_route(plot)
                if min(plot.distance(START), plot.distance(GOAL)) < p.clear_m:
                    self.open_ground(rng, plot)
                elif tall:
                    self.tall(rng, plot)
                else:
                    self.low(rng, plot)

    def _with_neighbour(self, rng: RandomGenerator, i: int, j: int, taken: set[tuple[int, int]]) -> Plot | None:
        """Return the cell joined with its neighbour east or north, if that is free and neither is at start or goal."""
        edge = self.parameters.street_m / 2
        xs, ys = self.lines
        di, dj = (1, 0) if rng.chance(0.5) else (0, 1)
        if i + di >= _CELLS or j + dj >= _CELLS or (i + di, j + dj) in (*taken, self.bar):
            return None
        plot = Plot(xs[i] + edge, ys[j] + edge, xs[i + 1 + di] - edge, ys[j + 1 + dj] - edge)
        if min(plot.distance(START), plot.distance(GOAL)) < self.parameters.clear_m:
            return None
        taken.add((i + di, j + dj))
        return plot

    def tall(self, rng: RandomGenerator, plot: Plot) -> None:
        b = self.builder
        (x, y), (hx, hy) = plot.middle, plot.half
        if max(hx, hy) > 10.0 or rng.chance(0.35):
            self.hall(rng, plot)
            return
        if rng.chance(0.6):
            bx, by = min(hx - 0.5, rng.between(3.6, 5.4)), min(hy - 0.5, rng.between(3.6, 5.4))
            ox, oy = rng.between(-1, 1) * (hx - bx), rng.between(-1, 1) * (hy - by)
            military.add_tall_block(b, rng, x + ox, y + oy, bx, by, 4)
            self.layout.take_box(x + ox - bx, y + oy - by, x + ox + bx, y + oy + by)
        else:
            side = 1.0 if rng.chance(0.5) else -1.0
            military.add_water_tower(b, x - side * 0.45 * hx, y)
            self.layout.take_disc(x - side * 0.45 * hx, y, 2.6)
            cx, cy = x + side * (hx - 1.2), y + rng.between(-0.4, 0.4) * hy
            # A chimney only where a vehicle can fly between the two.
            if 1.45 * hx - 1.2 - 1.8 - 1.0 > 4.5:
                military.add_chimney(b, cx, cy, rng.between(12.5, 15.0))
                self.layout.take_disc(cx, cy, 1.2)
        self.clutter(rng, plot, 2)

    def hall(self, rng: RandomGenerator, plot: Plot) -> None:
        """Add a hall that fills the plot."""
        (x, y), (hx, hy) = plot.middle, plot.half
        military.add_hall(self.builder, rng, x, y, hx - 0.4, hy - 0.4, rng.between(12.0, 13.5))
        self.layout.take_box(plot.x0, plot.y0, plot.x1, plot.y1)

    def low(self, rng: RandomGenerator, plot: Plot) -> None:
        """Add a house with a walled courtyard, two small houses, or a container yard."""
        b = self.builder
        (x, y), (hx, hy) = plot.middle, plot.half
        kind = rng.unit()
        if kind < 0.45:
            bx, by = hx * rng.between(0.48, 0.6), hy * rng.between(0.55, 0.85)
            cx, cy = plot.x0 + bx + 0.2, plot.y0 + by + 0.2
            military.add_shell_house(b, rng, cx, cy, bx, by, 1 + rng.index(2))
            self.layout.take_box(cx - bx - 0.3, cy - by - 0.3, cx + bx + 1.4, cy + by + 1.4)
            self.courtyard(rng, plot, cx + bx)
        elif kind < 0.7:
            for side in (-1.0, 1.0):
                bx, by = hx * rng.between(0.34, 0.42), hy * rng.between(0.5, 0.8)
                cx, cy = x + side * (hx - bx - 0.2), y + rng.between(-1, 1) * (hy - by - 0.2)
                military.add_shell_house(b, rng, cx, cy, bx, by, 1 + rng.index(2))
                self.layout.take_box(cx - bx - 0.8, cy - by - 0.8, cx + bx + 0.8, cy + by + 0.8)
        else:
            for row in (-0.55, 0.1, 0.7):
                cy = y + row * hy
                cx = x + rng.between(-1, 1) * max(hx - 3.3, 0.0)
                military.add_container(b, rng, cx, cy, 0.0, stacked=rng.chance(0.5))
                self.layout.take_box(cx - 3.2, cy - 1.4, cx + 3.2, cy + 1.4)
        self.clutter(rng, plot, 3)

    def courtyard(self, rng: RandomGenerator, plot: Plot, house_x1: float) -> None:
        """Add walls of 2.1 m round the rest of the plot, with a gap to walk in."""
        b = self.builder
        gap = 1.6
        for y in (plot.y0 + 0.15, plot.y1 - 0.15):
            half = 0.5 * (plot.x1 - house_x1) - (gap / 2 if y > plot.middle[1] else 0.0)
            if half > 0.4:
                military.add_yard_wall(b, plot.x1 - half, y, half, 0.0, 2.1)
                self.layout.take_box(plot.x1 - 2 * half, y - 0.2, plot.x1, y + 0.2)
        split = rng.between(0.3, 0.7) * (plot.y1 - plot.y0)
        for y0, y1 in ((plot.y0 + 0.3, plot.y0 + split - gap / 2), (plot.y0 + split + gap / 2, plot.y1 - 0.3)):
            if y1 - y0 > 0.6:
                x = plot.x1 - 0.12
                military.add_yard_wall(b, x, 0.5 * (y0 + y1), 0.5 * (y1 - y0), QUARTER_TURN_RAD, 2.1)
                self.layout.take_box(x - 0.2, y0, x + 0.2, y1)

    def open_ground(self, rng: RandomGenerator, plot: Plot) -> None:
        """Add only low objects round start or goal, at a distance."""
        self.clutter(rng, plot, 5)

    def clutter(self, rng: RandomGenerator, plot: Plot, count: int) -> None:
        """Add small objects on the free part of a plot."""
        area = (plot.x0 + 1.0, plot.y0 + 1.0, plot.x1 - 1.0, plot.y1 - 1.0)
        for _ in range(count):
            self.clutter_object(rng, area)

    def clutter_object(self, rng: RandomGenerator, area: tuple[float, float, float, float]) -> None:
        b = self.builder
        heading = QUARTER_TURN_RAD * rng.index(4)

        def car(x: float, y: float) -> None:
            rng.unit()  # drawn for its kind once; later places depend on it
            looks = self.vehicle_looks
            add_vehicle(
                b, looks, looks.pick(MILITARY_MIX), (x, y, heading), paint=looks.pick(("olive", "olive", "sand"))
            )

        kinds: tuple[tuple[float, Callable[[float, float], None]], ...] = (
            (1.2, lambda x, y: military.add_barrels(b, rng, x, y)),
            (2.4, lambda x, y: military.add_sandbags(b, x, y, heading)),
            (1.5, lambda x, y: military.add_crates(b, rng, x, y)),
            (1.6, lambda x, y: military.add_barrier(b, x, y, heading)),
            (2.4, lambda x, y: add_tree(b, rng, x, y, size=0.75)),
            (0.9, lambda x, y: add_bush(b, rng, x, y)),
            (2.7, car),
        )
        radius, place = rng.pick(kinds)
        self.layout.scatter(rng, 1, radius, area, place)

    def surroundings(self) -> None:
        """Add trees round the village."""
        rng, b = self.rng("surroundings"), self.builder
        far = _HIGH_M + 22.0
        near = _LOW_M - 22.0
        for area in (
            (near, near, far, _LOW_M - 6.0), (near, _HIGH_M + 6.0, far, far),
            (near, _LOW_M, _LOW_M - 6.0, _HIGH_M), (_HIGH_M + 6.0, _LOW_M, far, _HIGH_M),
        ):  # fmt: skip
            self.layout.scatter(rng, self.parameters.outer_trees // 4, 2.5, area, lambda x, y: add_tree(b, rng, x, y))

    def people(self) -> None:
        """Add soldiers: patrols along the streets, guards at corners."""
        b, p, rng = self.builder, self.parameters, self.rng("people")
        for _ in range(p.walkers):
            for _ in range(40):
                axis = rng.index(2)
                line = self.lines[axis][1 + rng.index(_CELLS - 1)] + rng.between(-1.2, 1.2)
                begin = rng.between(_LOW_M + 2.0, 50.0)
                end = begin + rng.between(12.0, 30.0)
                a, c = ((line, begin), (line, end)) if axis == 0 else ((begin, line), (end, line))
                # A hall over two cells blocks the street between them.
                if all(self.layout.free(*_between(a, c, k / 24), 0.8) for k in range(25)):
                    path = there_and_back(a, c, rng.between(0.9, 1.5), start_lap=rng.unit())
                    add_walker(b, rng, path, traits=PersonTraits(soldier=rng.chance(0.8)))
                    break
        for _ in range(p.standing_people):
            x = self.lines[0][1 + rng.index(_CELLS - 1)] + rng.pick((-2.3, 2.3))
            y = self.lines[1][1 + rng.index(_CELLS - 1)] + rng.pick((-2.3, 2.3))
            if self.layout.free(x, y, 0.4):
                self.layout.take_disc(x, y, 0.6)
                add_still_person(b, rng, (x, y, 0.0), rng.between(0.0, TURN_RAD), traits=PersonTraits(soldier=True))

    def objects(self) -> None:
        """Add belongings, animals and signs off the streets, after all else, so that nothing else moves."""
        b, rng = self.builder, self.rng("objects")
        turn = TURN_RAD

        def scatter(count: int, radius_m: float, add: Callable[[float, float], None]) -> None:
            for _ in range(count):
                for _ in range(60):
                    x, y = rng.between(_LOW_M, _HIGH_M), rng.between(_LOW_M, _HIGH_M)
                    off_street = min(abs(x - line) for line in self.lines[0]) > 2.6
                    off_street = off_street and min(abs(y - line) for line in self.lines[1]) > 2.6
                    if off_street and self.layout.free(x, y, radius_m):
                        self.layout.take_disc(x, y, radius_m)
                        add(x, y)
                        break

        scatter(4, 0.5, lambda x, y: add_backpack(b, rng, (x, y, 0.0), rng.between(0.0, turn)))
        scatter(2, 0.6, lambda x, y: add_dog(b, rng, (x, y, 0.0), rng.between(0.0, turn)))

        def motorcycle(x: float, y: float) -> None:
            add_vehicle(b, rng, "motorcycle", (x, y, rng.between(0.0, turn)), paint="olive")

        scatter(2, 1.2, motorcycle)

        scatter(3, 0.9, lambda x, y: add_birds(b, rng, (x, y, 0.0)))
        corner = self.parameters.street_m / 2 - 0.25
        for i, j in ((1, 1), (3, 2), (2, 4)):
            x, y = self.lines[0][i] + corner, self.lines[1][j] - corner
            if self.layout.free(x, y, 0.2):
                add_stop_sign(b, x, y, -QUARTER_TURN_RAD)
                self.layout.take_disc(x, y, 0.4)


def _between(a: Point, b: Point, share: float) -> Point:
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])


def _meets_flight_line(plot: Plot) -> bool:
    """Return True if the straight line from start to goal passes over the plot."""
    r = min(plot.half)
    return segment_distance(plot.middle, START, GOAL) < r


def _meets_low_route(plot: Plot) -> bool:
    """Return True if a leg of the low route passes over the plot, or close to it."""
    # The legs run along the axes.
    for (ax, ay), (bx, by) in pairwise(_LOW_ROUTE):
        outside_x = max(plot.x0 - max(ax, bx), min(ax, bx) - plot.x1)
        outside_y = max(plot.y0 - max(ay, by), min(ay, by) - plot.y1)
        if max(outside_x, outside_y) < _ROUTE_CLEAR_M:
            return True
    return False


def generate(parameters: Parameters, seed: int) -> SceneMap:
    village = _Village(parameters, seed)
    village.materials()
    village.streets()
    village.plots()
    village.surroundings()
    village.people()
    village.objects()
    village.builder.classify("ground", "ground")
    return village.builder.build()
