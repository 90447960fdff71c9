"""Suburb for last-mile delivery, 120 x 120 m: two streets each way, eight blocks of family houses, and a depot.

The vehicle starts on the depot's lot in the middle.
Streets have kerbs, lane dashes and zebra crossings; houses have doors, windows, pitched roofs, fences and gardens.
Drop zones (class `drop_zone`) are marked squares of `zone_m` in gardens: flat, under open sky.
"""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from typing import Annotated

from pydantic import Field

from signals.documents.validate import StrictModel
from signals.units import QUARTER_TURN_RAD, TURN_RAD
from sim.scene import surfaces
from sim.scene.maps.buildings import add_block
from sim.scene.maps.ground_details import Strip, covers, puddles, street
from sim.scene.maps.layout import Layout, Point
from sim.scene.maps.map_builder import yaw_quat
from sim.scene.maps.meshes import ellipse, ribbon
from sim.scene.maps.objects.animals import add_birds, add_dog
from sim.scene.maps.objects.belongings import add_backpack, add_parasol, add_potted_plant
from sim.scene.maps.objects.street_signs import add_stop_sign, add_traffic_light
from sim.scene.maps.people import PersonTraits, add_cyclist, add_still_person, add_walker, add_wheelchair_user
from sim.scene.maps.plants import add_bush, add_tree
from sim.scene.maps.season import Season
from sim.scene.maps.street_clutter import Kerb, add_clutter
from sim.scene.maps.street_furniture import add_bin, add_street_lamp
from sim.scene.maps.suburb import FRONT_M, KERB_M, LANE_M, LAWN_M, Lot, Suburb
from sim.scene.maps.vehicles.kinds import STREET_MIX, add_vehicle
from sim.scene.maps.vehicles.traffic import add_driven_car
from sim.scene.maps.walk_path import WalkPath, there_and_back
from sim.scene.random_generator import RandomGenerator
from sim.scene.scene_map import SceneMap

_STREET_M = 21.0  # distance of the middle of a street from the axes
_EDGE_M = 60.0
_CORNER_M = 4.0  # of a block, without small objects
_INNER_M, _OUTER_M = _STREET_M - LANE_M, _STREET_M + LANE_M


class Parameters(StrictModel):
    """Numbers of drop zones, vehicles, plants and people."""

    drop_zones: Annotated[int, Field(ge=0, le=24)] = 8
    zone_m: Annotated[float, Field(ge=0.5, le=3.0)] = 1.6
    parked_vehicles: Annotated[int, Field(ge=0, le=60)] = 14
    traffic: Annotated[int, Field(ge=0, le=8)] = 0
    trees: Annotated[int, Field(ge=0, le=200)] = 24
    walkers: Annotated[int, Field(ge=0, le=60)] = 8
    children: Annotated[int, Field(ge=0, le=20)] = 0
    wheelchairs: Annotated[int, Field(ge=0, le=20)] = 0
    cyclists: Annotated[int, Field(ge=0, le=20)] = 0
    standing_people: Annotated[int, Field(ge=0, le=40)] = 3
    street_objects: Annotated[int, Field(ge=0, le=60)] = 16  # groups: bins, cones, signs, cabinets, bollards
    season: Season = "summer"


class _Suburb(Suburb):
    def __init__(self, parameters: Parameters, seed: int) -> None:
        super().__init__("urban_delivery", seed, parameters.season)
        self.parameters = parameters
        self.layout.take_disc(0.0, 0.0, 6.0)
        self.ways = Layout()  # of people on the pavements

    def materials(self) -> None:
        """Add the materials of suburbs, and those of the depot and the drop zones."""
        b = self.builder
        self.common_materials("grass", "asphalt", "paving", "gravel", "sheet_metal")
        self.lawn_materials()
        b.material("lot_asphalt", surfaces.ASPHALT, rgb=(1.0, 1.0, 1.0), texture="asphalt", tile_m=6.0, specular=0.0)
        self.pavement_materials()
        b.material("zone_white", surfaces.ROAD_PAINT, rgb=(0.88, 0.88, 0.87), specular=0.0)
        b.material("zone_blue", surfaces.ROAD_PAINT, rgb=(0.08, 0.30, 0.72), specular=0.0)
        b.material("zone_orange", surfaces.ROAD_PAINT, rgb=(0.95, 0.45, 0.05), specular=0.0)
        b.material(
            "gate", surfaces.PAINTED_METAL, rgb=(0.34, 0.44, 0.52), texture="sheet_metal", tile_m=1.3, specular=0.3
        )
        self.fence_materials()

    def streets(self) -> None:
        b = self.builder
        b.ground("plane", (0.0, 0.0, 1.0), material="grass")
        reach = _EDGE_M + 4.0
        for axis in range(2):
            for side in (-1.0, 1.0):
                road = b.body("road", _turned(axis, 0.0, side * _STREET_M), yaw_quat(axis * QUARTER_TURN_RAD))
                strips = _street_strips(reach, crossings=axis == 0)
                name = "street_x" if axis == 0 else "street_y"
                mesh = b.mesh(name, street(strips, self.rng(name)))
                road.geom("mesh", asset=mesh, material="street", solid=False, part="lanes")
                x = -reach + 2.0
                i = 0
                while x < reach:
                    if min(abs(abs(x) - _STREET_M), abs(abs(x + 2.0) - _STREET_M)) > LANE_M + 3.0:
                        road.geom(
                            "box",
                            (0.9, 0.06, 0.01),
                            pos=(x, 0.0, 0.012),
                            material="road_paint",
                            solid=False,
                            part=f"dash_{i}",
                        )
                        i += 1
                    x += 6.0
        for side_x in (-1.0, 1.0):
            for side_y in (-1.0, 1.0):
                zebra = b.body("crossing", (side_x * (_INNER_M - 2.0), side_y * _STREET_M, 0.0))
                for k in range(6):
                    y = -LANE_M + 0.55 + 1.16 * k
                    zebra.geom(
                        "box",
                        (1.4, 0.27, 0.01),
                        pos=(0.0, y, 0.013),
                        material="road_paint",
                        solid=False,
                        part=f"bar_{k}",
                    )

    def street_details(self) -> None:
        """Add manhole covers, and puddles in the gutters."""
        b, rng = self.builder, self.rng("street_details")
        places, wet = [], []
        for axis in range(2):
            for side in (-1.0, 1.0):
                for block in range(3):
                    along = (-42.0, 0.0, 42.0)[block] + rng.between(-12.0, 12.0)
                    x, y, _ = _turned(axis, along, side * _STREET_M + rng.pick((-1.75, 1.75)))
                    places.append((x, y))
                along, across = rng.between(-54.0, -30.0), side * _STREET_M + rng.pick((-3.0, 3.0))
                x, y, _ = _turned(axis, along, across)
                far, wide = rng.between(0.9, 2.0), rng.between(0.25, 0.45)
                wet.append((x, y, far if axis == 0 else wide, wide if axis == 0 else far))
        road = b.body("road")
        road.geom("mesh", asset=b.mesh("covers", covers(places, 0.015)), material="manhole", solid=False, part="covers")
        mesh = b.mesh("puddles", puddles(wet, 0.016, rng))
        road.geom("mesh", asset=mesh, material="puddle", solid=False, part="puddles")

    def depot(self) -> None:
        """Add the middle block: a lot at ground level with a start pad, a kerb round it, the depot and its vans."""
        b, rng = self.builder, self.rng("depot")
        lot = b.body("road")
        lot.geom(
            "box", (_INNER_M - 2.4, _INNER_M - 2.4, 0.02), pos=(0.0, 0.0, -0.012), material="lot_asphalt", solid=False
        )
        walk = b.body("pavement")
        h = _INNER_M - FRONT_M / 2
        for i, (x, y, hx, hy) in enumerate(
            (
                (0.0, h, _INNER_M, FRONT_M / 2),
                (0.0, -h, _INNER_M, FRONT_M / 2),
                (-h, 0.0, FRONT_M / 2, h - FRONT_M / 2),
            )
        ):
            walk.geom(
                "box", (hx, hy, KERB_M / 2 + 0.02), pos=(x, y, KERB_M / 2 - 0.02), material="paving", part=f"side_{i}"
            )
        pad = b.body("pad")
        ring = b.mesh("pad_ring", ribbon(ellipse(1.6, 1.6, 32), 0.1, -0.03, 0.014, tile_m=1.0, closed=True))
        pad.geom("mesh", asset=ring, material="zone_white", solid=False, part="ring")
        for part, size, pos in (
            ("left", (0.09, 0.55, 0.01), (-0.4, 0.0, 0.004)),
            ("right", (0.09, 0.55, 0.01), (0.4, 0.0, 0.004)),
            ("bar", (0.31, 0.09, 0.01), (0.0, 0.0, 0.004)),
        ):
            pad.geom("box", size, pos=pos, material="zone_white", solid=False, part=part)
        add_block(b, rng, (-1.0, 11.2, 0.0), (6, 2, 2), recessed=True, street=None, gates=(0, 2, 4))
        for x in (-8.5, -2.5, 3.5):
            gate = b.body("gate", (x, 8.17, 0.0))
            gate.geom("box", (1.3, 0.06, 1.3), pos=(0.0, 0.0, 1.3), material="gate", solid=False)
        self.layout.take_box(-10.6, 7.6, 8.6, 14.8)
        looks = self.rng("depot_vehicles")
        for i in range(4):
            x, y = 12.2, -11.0 + 3.4 * i
            if i < 3:
                add_vehicle(b, looks, "van", (x - 1.0, y, 0.0), paint="white")
            self.layout.take_box(x - 4.0, y - 1.3, x + 2.0, y + 1.3)
            mark = b.body("marking", (11.2, y + 1.7, 0.0))
            mark.geom("box", (2.6, 0.05, 0.01), pos=(0.0, 0.0, 0.005), material="road_paint", solid=False)

    def blocks(self) -> None:
        rng = self.rng("blocks")
        for i in (-1, 0, 1):
            for j in (-1, 0, 1):
                if i == j == 0:
                    continue
                x0, x1 = _span(i)
                y0, y1 = _span(j)
                cx, cy, hx, hy = (x0 + x1) / 2, (y0 + y1) / 2, (x1 - x0) / 2, (y1 - y0) / 2
                self.block_ground(cx, cy, hx, hy)
                # Houses face the street next to the middle block; those of corner blocks face the street along x.
                toward_y = j != 0
                heading = (-QUARTER_TURN_RAD if j > 0 else QUARTER_TURN_RAD) if toward_y else (pi if i > 0 else 0.0)
                length = (x1 - x0) if toward_y else (y1 - y0)
                depth = ((y1 - y0) if toward_y else (x1 - x0)) - 2.0 * FRONT_M
                width = (length - 2.0 * FRONT_M) / 3
                for k in (-1, 0, 1):
                    if toward_y:
                        x, y = cx + k * width, (y0 + FRONT_M if j > 0 else y1 - FRONT_M)
                    else:
                        x, y = (x0 + FRONT_M if i > 0 else x1 - FRONT_M), cy + k * width
                    self.lots.append(Lot(x, y, heading, width, depth))
        for number, lot in enumerate(self.lots):
            self.lot(rng, lot, number)

    def drop_zones(self) -> None:
        b, p, rng = self.builder, self.parameters, self.rng("drop_zones")
        half = p.zone_m / 2
        placed = 0
        for lot in rng.shuffled(self.lots):
            if placed == p.drop_zones:
                break
            for _ in range(30):
                # Zones are in the front garden beside the path, or behind the house.
                back = rng.between(1.6, 3.6) if rng.chance(0.4) else rng.between(16.0, lot.depth_m - 3.0)
                left = rng.between(-1.0, 1.0) * (lot.width_m / 2 - 2.4)
                x, y = lot.at(back, left)
                if not self.layout.free(x, y, half + 1.0):
                    continue
                self.layout.take_disc(x, y, half + 1.6)
                zone = b.body("drop_zone", (x, y, LAWN_M), yaw_quat(lot.heading_rad))
                for part, edge, top, material in (
                    ("border", half, 0.010, "zone_blue"), ("field", 0.86 * half, 0.018, "zone_white"),
                ):  # fmt: skip
                    zone.geom(
                        "box", (edge, edge, 0.01), pos=(0.0, 0.0, top - 0.01), material=material, solid=False, part=part
                    )
                zone.geom(
                    "cylinder",
                    (0.45 * half, 0.01),
                    pos=(0.0, 0.0, 0.016),
                    material="zone_orange",
                    solid=False,
                    part="mark",
                )
                placed += 1
                break

    def furniture(self) -> None:
        b = self.builder
        for axis in range(2):
            for side in (-1.0, 1.0):
                for along in (-48.0, -31.0, 0.0, 31.0, 48.0):
                    x, y, _ = _turned(axis, along + 3.0 * side, side * (_OUTER_M + 0.5))
                    heading = _to_street(axis, side)
                    add_street_lamp(b, x, y, heading)
                    self.layout.take_disc(x, y, 0.3)
        rng = self.rng("bins")
        for lot in self.lots:
            if rng.chance(0.4):
                x, y = lot.at(0.6, lot.width_m / 2 - 1.2)
                if self.layout.free(x, y, 0.3):
                    add_bin(b, x, y)
                    self.layout.take_disc(x, y, 0.4)

    def vehicles(self) -> None:
        """Add cars along the kerbs, clear of crossings."""
        b, rng = self.builder, self.rng("vehicles")
        spots = []
        for axis in range(2):
            for side in (-1.0, 1.0):
                for along in (-54.0, -47.0, -40.0, -33.0, -9.0, -2.0, 5.0, 33.0, 40.0, 47.0, 54.0):
                    for lane in (-1.0, 1.0):
                        spots.append((axis, side, along, lane))
        chosen = rng.shuffled(spots)[: self.parameters.parked_vehicles]
        self.free_spots = [spot for spot in spots if spot not in chosen]
        looks = self.rng("vehicle_looks")
        for axis, side, along, lane in chosen:
            along_m = along + rng.between(-0.6, 0.6)
            rng.unit(), rng.unit()  # drawn for looks once; places of later vehicles depend on them
            kind = looks.pick(STREET_MIX)
            alone = not any((axis, side, along + step, lane) in chosen for step in (-7.0, 7.0))
            large, which = looks.unit(), looks.unit()
            # The streets round the middle block stay wide enough for traffic, and crossings clear.
            if alone and large < 0.35 and abs(along) > 30.0:
                kind = "bus" if which < 0.4 and abs(along) in (40.0, 47.0) else "lorry"
            kerb_m = {"bus": 1.34, "lorry": 1.32, "van": 1.16}.get(kind, 1.15)
            x, y, _ = _turned(axis, along_m, side * _STREET_M + lane * (LANE_M - kerb_m))
            heading = axis * QUARTER_TURN_RAD + (0.0 if lane < 0 else pi)
            add_vehicle(b, looks, kind, (x, y, heading))

    def traffic(self) -> None:
        """Add cars that drive round the middle block, one way, in the middle of the streets."""
        rng = self.rng("traffic")
        first = rng.unit()
        for i in range(self.parameters.traffic):
            add_driven_car(self.builder, rng, _round_the_block(7.0, first + i / self.parameters.traffic))

    def plants(self) -> None:
        b, p, rng = self.builder, self.parameters, self.rng("plants")
        for _ in range(p.trees):
            lot = rng.pick(self.lots)
            for _ in range(20):
                x, y = lot.at(rng.between(3.0, lot.depth_m - 2.0), rng.between(-0.5, 0.5) * (lot.width_m - 4.0))
                if self.layout.free(x, y, 2.2):
                    self.layout.take_disc(x, y, 2.2)
                    add_tree(b, rng, x, y, size=0.85)
                    self.bare.append((x, y))
                    break
        for lot in self.lots:
            x, y = lot.at(rng.between(1.2, 3.8), rng.between(-0.5, 0.5) * (lot.width_m - 2.5))
            if self.layout.free(x, y, 0.8):
                self.layout.take_disc(x, y, 0.8)
                add_bush(b, rng, x, y)

    def signs(self) -> None:
        """Add traffic lights at the crossings, for both directions, and stop signs."""
        b, rng = self.builder, self.rng("signs")
        for side_x in (-1.0, 1.0):
            for side_y in (-1.0, 1.0):
                lit = rng.pick(("red", "green", "red", "amber"))
                kerb = LANE_M + 0.4
                # Before the zebra, to the right of each driver.
                for x, y, heading in (
                    (side_x * (_INNER_M - 3.9), -side_x * kerb, pi if side_x > 0 else 0.0),
                    (side_x * (_INNER_M - 0.3), side_x * kerb, 0.0 if side_x > 0 else pi),
                ):
                    if self.layout.free(x, side_y * _STREET_M + y, 0.25):
                        add_traffic_light(b, x, side_y * _STREET_M + y, heading, lit)
                        self.layout.take_disc(x, side_y * _STREET_M + y, 0.4)
        beside, before = _OUTER_M + 0.45, _OUTER_M + 2.0
        for x, y, heading in (
            (_INNER_M - 0.4, -_INNER_M + 2.9, pi),
            (beside, -before, -QUARTER_TURN_RAD),
            (-beside, before, QUARTER_TURN_RAD),
        ):
            if self.layout.free(x, y, 0.25):
                add_stop_sign(b, x, y, heading)
                self.layout.take_disc(x, y, 0.4)

    def objects(self) -> None:
        """Add what stands in front gardens and at doors, after all else, so that nothing else moves."""
        b, rng = self.builder, self.rng("objects")
        for k, (lot, back, left) in enumerate(rng.shuffled(self.doors)):
            if k < 8:
                for side in (-1.0, 1.0):
                    add_potted_plant(b, rng, (*lot.at(back - 0.35, left + 0.95 * side), LAWN_M))
            elif k < 10:
                add_backpack(b, rng, (*lot.at(back - 0.4, left + 0.8), LAWN_M), lot.heading_rad)

        def in_gardens(
            count: int, radius_m: float, back_m: tuple[float, float], add: Callable[[Point, Lot], None]
        ) -> None:
            for _ in range(count):
                lot = rng.pick(self.lots)
                for _ in range(20):
                    x, y = lot.at(rng.between(*back_m), rng.between(-0.5, 0.5) * (lot.width_m - 2.5))
                    if self.layout.free(x, y, radius_m):
                        self.layout.take_disc(x, y, radius_m)
                        add((x, y), lot)
                        break

        in_gardens(3, 1.6, (13.0, 20.0), lambda p, _: add_parasol(b, rng, (*p, LAWN_M)))
        in_gardens(3, 0.6, (1.2, 4.0), lambda p, _: add_dog(b, rng, (*p, LAWN_M), rng.between(0.0, TURN_RAD)))
        in_gardens(5, 0.9, (1.2, 3.6), lambda p, lot: self.bicycle(rng, p, lot))
        for _ in range(3):
            in_gardens(1, 0.9, (1.0, 4.0), lambda p, _: add_birds(self.builder, rng, (*p, LAWN_M)))
        for axis, side, along, lane in self.free_spots[:2]:
            x, y, _ = _turned(axis, along, side * _STREET_M + lane * (LANE_M - 0.6))
            heading = axis * QUARTER_TURN_RAD + (0.0 if lane < 0 else pi)
            add_vehicle(b, rng, "motorcycle", (x, y, heading))

    def kerbside(self) -> None:
        """Add small objects along the kerbs of the blocks of houses."""
        kerbs = []
        for axis in range(2):
            for side in (-1.0, 1.0):
                for lane in (-1.0, 1.0):
                    for low, high in ((-_EDGE_M, -_OUTER_M), (-_INNER_M, _INNER_M), (_OUTER_M, _EDGE_M)):
                        if lane == -side and low == -_INNER_M:
                            continue  # the depot
                        # The street is at the right of a kerb: that on the left of the street runs along it.
                        begin = low + _CORNER_M if lane > 0.0 else high - _CORNER_M
                        x, y, _ = _turned(axis, begin, side * _STREET_M + lane * LANE_M)
                        heading = axis * QUARTER_TURN_RAD + (0.0 if lane > 0.0 else pi)
                        kerbs.append(Kerb(x, y, heading, high - low - 2.0 * _CORNER_M, KERB_M))
        count = self.parameters.street_objects
        add_clutter(self.builder, self.rng("street_objects"), kerbs, self.layout, count, ways=self.ways)

    def bicycle(self, rng: RandomGenerator, at: Point, lot: Lot) -> None:
        heading = lot.heading_rad + rng.pick((-1.0, 1.0)) * QUARTER_TURN_RAD
        add_vehicle(self.builder, rng, "bicycle", (*at, heading), ground_m=LAWN_M)

    def way(self, rng: RandomGenerator, number: int, speed_mps: tuple[float, float]) -> WalkPath:
        """Draw a path on the pavements (`_way`), and note where it runs."""
        path = _way(rng, number, speed_mps)
        self.ways.take_band([(x, y) for _, x, y, _, _ in path.straights], 0.0, closed=True)
        return path

    def people(self) -> None:
        """Add people on the pavements: round a block, or to and fro along one side."""
        b, p, rng = self.builder, self.parameters, self.rng("people")
        for k in range(p.walkers):
            add_walker(b, rng, self.way(rng, k, (0.9, 1.5)), ground_m=KERB_M)
        for _ in range(p.standing_people):
            lot = rng.pick(self.lots)
            x, y = lot.at(rng.between(1.0, 4.0), rng.between(-3.0, 3.0))
            if self.layout.free(x, y, 0.4):
                self.layout.take_disc(x, y, 0.5)
                add_still_person(b, rng, (x, y, LAWN_M), rng.between(0.0, TURN_RAD))
        children, wheels = self.rng("children"), self.rng("wheelchairs")
        for k in range(p.children):
            traits = PersonTraits(height_m=children.between(1.05, 1.40))
            add_walker(b, children, self.way(children, k, (0.6, 1.0)), ground_m=KERB_M, traits=traits)
        for k in range(p.wheelchairs):
            add_wheelchair_user(b, wheels, self.way(wheels, 2 * k, (0.7, 1.3)), ground_m=KERB_M)
        cyclists = self.rng("cyclists")
        for _ in range(p.cyclists):
            path = _round_the_block(cyclists.between(3.0, 6.0), cyclists.unit(), outwards_m=0.6)
            add_cyclist(b, cyclists, path)


def _round_the_block(speed_mps: float, start_lap: float, *, outwards_m: float = 0.0) -> WalkPath:
    """Return a path on the streets round the middle block, `outwards_m` from their middle."""
    s = _STREET_M + outwards_m
    return WalkPath(
        [(-s, -s), (s, -s), (s, s), (-s, s)], speed_mps, corner_m=6.5, start_lap=start_lap, max_yaw_rate_radps=0.9
    )


def _way(rng: RandomGenerator, number: int, speed_mps: tuple[float, float]) -> WalkPath:
    """Draw a path round a block (even numbers) or to and fro along one of its sides."""
    blocks = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]
    i, j = blocks[rng.index(len(blocks))]
    inset = 1.1 + rng.between(-0.2, 0.3)
    (x0, x1), (y0, y1) = _span(i), _span(j)
    x0, x1, y0, y1 = x0 + inset, x1 - inset, y0 + inset, y1 - inset
    speed, lap = rng.between(*speed_mps), rng.unit()
    if number % 2:
        return there_and_back((x0 + 1.0, y0), (x1 - 1.0, y0), speed, lane_m=0.5, start_lap=lap)
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    return WalkPath(corners[:: 1 if rng.chance(0.5) else -1], speed, corner_m=1.0, start_lap=lap)


def _street_strips(reach_m: float, *, crossings: bool) -> list[Strip]:
    """Return a street along x with its two crossings, which only the streets along x draw."""
    cuts = (-reach_m, -_OUTER_M, -_INNER_M, _INNER_M, _OUTER_M, reach_m)
    strips = []
    for i in range(5):
        if i % 2 == 0 or crossings:
            strips.append(Strip((cuts[i], 0.0), (cuts[i + 1], 0.0), 0.012, crossing=i % 2 == 1))
    return strips


def _turned(axis: int, along: float, across: float) -> tuple[float, float, float]:
    """Return a point of a street along x (axis 0) or, turned a quarter to the left, along y (axis 1)."""
    return (along, across, 0.0) if axis == 0 else (-across, along, 0.0)


def _to_street(axis: int, side: float) -> float:
    """Return the heading from the outer kerb of a street to its middle."""
    across = -side
    return axis * QUARTER_TURN_RAD + (QUARTER_TURN_RAD if across > 0 else -QUARTER_TURN_RAD)


def _span(index: int) -> tuple[float, float]:
    """Return the extent of a column or row of blocks."""
    return {-1: (-_EDGE_M, -_OUTER_M), 0: (-_INNER_M, _INNER_M), 1: (_OUTER_M, _EDGE_M)}[index]


def generate(parameters: Parameters, seed: int) -> SceneMap:
    suburb = _Suburb(parameters, seed)
    suburb.materials()
    suburb.streets()
    suburb.depot()
    suburb.blocks()
    suburb.drop_zones()
    suburb.furniture()
    suburb.vehicles()
    suburb.plants()
    suburb.people()
    suburb.signs()
    suburb.objects()
    suburb.kerbside()
    suburb.traffic()
    suburb.street_details()
    suburb.lawn_details()
    suburb.builder.classify("ground", "ground")
    return suburb.builder.build()
