"""Suburb of 330 x 320 m in the manner of AirSimNH: streets round eight blocks of family houses, trees, parked cars.

The vehicle starts on the crossing in the middle, with houses for 140 m and more on all four sides; north is +y. Streets
run along the path 125 m north, 130 m west and back that AirSim's example flies 5 m above the ground: a ball of 2 m
radius at that height is free along their middle. Trees keep 15 m from the crossings at its corners, where a vehicle
cuts the corner or overshoots.
"""

from __future__ import annotations

import itertools
from math import pi, sqrt
from typing import Annotated

from pydantic import Field

from signals.documents.validate import StrictModel
from signals.units import QUARTER_TURN_RAD
from sim.scene import surfaces
from sim.scene.maps.ground_details import Strip, covers, street
from sim.scene.maps.layout import Point
from sim.scene.maps.map_builder import yaw_quat
from sim.scene.maps.meshes import Mesh, ribbon
from sim.scene.maps.objects.street_signs import add_stop_sign
from sim.scene.maps.plants import add_bush, add_hedge, add_tree
from sim.scene.maps.season import Season
from sim.scene.maps.street_furniture import add_bin, add_street_lamp
from sim.scene.maps.suburb import FRONT_M, LANE_M, LAWN_M, Lot, Suburb
from sim.scene.maps.vehicles.kinds import add_vehicle
from sim.scene.scene_map import SceneMap

_AVENUES_M = (-130.0, -65.0, 0.0, 65.0, 130.0)  # x of the streets to the north
_STREETS_M = (-125.0, 0.0, 125.0)  # y of the streets to the east
_PATH_CORNERS_M = ((-130.0, 0.0), (-130.0, 125.0), (0.0, 0.0), (0.0, 125.0))
_BEYOND_M = 33.0  # depth of the outer blocks, without their street
_STEP_M = 0.012  # surface of a street
_CARS = ("sedan", "hatchback", "suv")  # each further kind costs 20 ms when the map is made


class Parameters(StrictModel):
    """Numbers of vehicles and plants."""

    parked_vehicles: Annotated[int, Field(ge=0, le=160)] = 50
    cars_on_drives: Annotated[int, Field(ge=0, le=164)] = 36
    trees: Annotated[int, Field(ge=0, le=600)] = 180
    season: Season = "summer"


class _Neighbourhood(Suburb):
    def __init__(self, parameters: Parameters, seed: int) -> None:
        super().__init__("airsim_nh", seed, parameters.season)
        self.parameters = parameters
        self.drives: list[tuple[float, float, float]] = []  # x, y and heading of the cars' places

    def streets(self) -> None:
        """Add the streets as one mesh each of asphalt and markings, with gaps in the markings at crossings."""
        b = self.builder
        b.ground("plane", (0.0, 0.0, 1.0), material="grass")
        b.material("line_paint", surfaces.ROAD_PAINT, rgb=(0.78, 0.78, 0.76), specular=0.0)
        west, east = _AVENUES_M[0] - LANE_M - _BEYOND_M, _AVENUES_M[-1] + LANE_M + _BEYOND_M
        south, north = _STREETS_M[0] - LANE_M - _BEYOND_M, _STREETS_M[-1] + LANE_M + _BEYOND_M
        strips, dashes = [], Mesh.empty()
        for y in _STREETS_M:
            cuts = [west, *(x + side for x in _AVENUES_M for side in (-LANE_M, LANE_M)), east]
            for i, (x0, x1) in enumerate(itertools.pairwise(cuts)):
                strips.append(Strip((x0, y), (x1, y), _STEP_M, crossing=i % 2 == 1))
                if i % 2 == 0:
                    _add_dashes(dashes, (x0, y), (x1, y))
        for x in _AVENUES_M:
            cuts = [south, *(y + side for y in _STREETS_M for side in (-LANE_M, LANE_M)), north]
            for i, (y0, y1) in enumerate(itertools.pairwise(cuts)):
                if i % 2 == 0:
                    strips.append(Strip((x, y0), (x, y1), _STEP_M))
                    _add_dashes(dashes, (x, y0), (x, y1))
        road = b.body("road")
        mesh = b.mesh("streets", street(strips, self.rng("streets")))
        road.geom("mesh", asset=mesh, material="street", solid=False, part="lanes")
        b.body("marking").geom(
            "mesh", asset=b.mesh("dashes", dashes), material="line_paint", solid=False, part="dashes"
        )
        rng = self.rng("street_details")
        places = [
            (x + rng.pick((-1.75, 1.75)), y + rng.between(12.0, 113.0))
            for x in _AVENUES_M
            for y in _STREETS_M[:-1]
            for _ in range(3)
        ]
        road.geom("mesh", asset=b.mesh("covers", covers(places, 0.015)), material="manhole", solid=False, part="covers")

    def blocks(self) -> None:
        """Add the blocks between the streets with houses back to back, and houses across each outer street."""
        rng = self.rng("lots")
        columns = [(left + LANE_M, right - LANE_M) for left, right in itertools.pairwise(_AVENUES_M)]
        rows = [(south + LANE_M, north - LANE_M) for south, north in itertools.pairwise(_STREETS_M)]
        for (x0, x1), (y0, y1) in itertools.product(columns, rows):
            self.block_ground(0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5 * (x1 - x0), 0.5 * (y1 - y0))
            depth = 0.5 * (x1 - x0) - FRONT_M
            self.row((x0 + FRONT_M, y0), (x0 + FRONT_M, y1), pi, depth, 7)
            self.row((x1 - FRONT_M, y0), (x1 - FRONT_M, y1), 0.0, depth, 7)
        for front, heading, side in (
            (_STREETS_M[0] - LANE_M, QUARTER_TURN_RAD, -1.0), (_STREETS_M[-1] + LANE_M, -QUARTER_TURN_RAD, 1.0),
        ):  # fmt: skip
            for x0, x1 in columns:
                self.block_ground(0.5 * (x0 + x1), front + side * 0.5 * _BEYOND_M, 0.5 * (x1 - x0), 0.5 * _BEYOND_M)
                y = front + side * FRONT_M
                self.row((x0, y), (x1, y), heading, _BEYOND_M - 2.0 * FRONT_M, 3)
        for front, heading, side in (
            (_AVENUES_M[0] - LANE_M, 0.0, -1.0), (_AVENUES_M[-1] + LANE_M, pi, 1.0),
        ):  # fmt: skip
            for y0, y1 in rows:
                self.block_ground(front + side * 0.5 * _BEYOND_M, 0.5 * (y0 + y1), 0.5 * _BEYOND_M, 0.5 * (y1 - y0))
                x = front + side * FRONT_M
                self.row((x, y0), (x, y1), heading, _BEYOND_M - 2.0 * FRONT_M, 7)
        for number, lot in enumerate(self.lots):
            self.lot(rng, lot, number)
        for lot in self.lots:
            self.drive(lot)

    def row(self, begin: Point, end: Point, heading: float, depth: float, count: int) -> None:
        """Add `count` lots side by side along a pavement, without the pavements at both ends."""
        (x0, y0), (x1, y1) = begin, end
        length = abs(x1 - x0) + abs(y1 - y0)
        ux, uy = (x1 - x0) / length, (y1 - y0) / length
        width = (length - 2.0 * FRONT_M) / count
        for k in range(count):
            along = FRONT_M + (k + 0.5) * width
            self.lots.append(Lot(x0 + along * ux, y0 + along * uy, heading, width, depth))

    def drive(self, lot: Lot) -> None:
        """Add a driveway beside the house."""
        length, left = 11.5, 2.6 - 0.5 * lot.width_m
        body = self.builder.body("path", (*lot.at(0.5 * length, left), 0.0), yaw_quat(lot.heading_rad))
        body.geom("box", (0.5 * length, 1.45, 0.1), pos=(0.0, 0.0, LAWN_M - 0.095), material="paving", solid=False)
        self.layout.take_band((lot.at(0.0, left), lot.at(length, left)), 1.7)
        x, y = lot.at(4.4, left)
        self.drives.append((x, y, lot.heading_rad))

    def vehicles(self) -> None:
        """Add cars at the kerbs, away from crossings, and on driveways."""
        b, rng = self.builder, self.rng("vehicles")
        places = []
        for x, y in itertools.product(_AVENUES_M, _STREETS_M[:-1]):
            places += [(x, y + 16.0 + 7.0 * k, True) for k in range(14)]
        for y in _STREETS_M:
            places += [(x + 16.0 + 7.0 * k, y, False) for x in _AVENUES_M[:-1] for k in range(5)]
        for x, y, north in rng.shuffled(places)[: self.parameters.parked_vehicles]:
            kind, lane = rng.pick(_CARS), rng.pick((-1.0, 1.0))
            across, along = lane * (LANE_M - 1.15), rng.between(-0.6, 0.6)
            if north:
                place = (x + across, y + along, QUARTER_TURN_RAD * lane)
            else:
                place = (x + along, y + across, 0.0 if lane < 0.0 else pi)
            add_vehicle(b, rng, kind, place, driver=0.0)
        for x, y, heading in rng.shuffled(self.drives)[: self.parameters.cars_on_drives]:
            turned = heading + (pi if rng.chance(0.6) else 0.0)
            add_vehicle(b, rng, rng.pick(_CARS), (x, y, turned), ground_m=LAWN_M, driver=0.0)

    def furniture(self) -> None:
        """Add street lamps behind the pavements, stop signs and bins."""
        b = self.builder
        beside = LANE_M + FRONT_M + 0.3
        for x, y in itertools.product(_AVENUES_M, _STREETS_M[:-1]):
            for k, along in enumerate((20.0, 48.0, 77.0, 105.0)):
                side = 1.0 if k % 2 else -1.0
                self.lamp(x + side * beside, y + along, pi if side > 0.0 else 0.0)
        for x, y in itertools.product(_AVENUES_M[:-1], _STREETS_M):
            for along, side in ((18.0, -1.0), (47.0, 1.0)):
                self.lamp(x + along, y + side * beside, -side * QUARTER_TURN_RAD)
        for x, (south, north) in itertools.product(_AVENUES_M, itertools.pairwise(_STREETS_M)):
            for y, side in ((south, 1.0), (north, -1.0)):
                sx, sy = x - side * (LANE_M + 0.5), y + side * (LANE_M + 2.4)
                add_stop_sign(b, sx, sy, side * QUARTER_TURN_RAD)
        rng = self.rng("bins")
        for lot in self.lots:
            x, y = lot.at(0.6, 0.5 * lot.width_m - 1.2)
            if rng.chance(0.3) and self.layout.free(x, y, 0.3):
                add_bin(b, x, y)
                self.layout.take_disc(x, y, 0.4)

    def lamp(self, x: float, y: float, heading: float) -> None:
        if self.layout.free(x, y, 0.3):
            add_street_lamp(self.builder, x, y, heading)
            self.layout.take_disc(x, y, 0.4)

    def plants(self) -> None:
        b, rng = self.builder, self.rng("plants")
        # Trees keep away from the corners of the path, where a vehicle cuts or overshoots.
        for _ in range(self.parameters.trees):
            lot = rng.pick(self.lots)
            for _ in range(20):
                x, y = lot.at(rng.between(3.4, lot.depth_m - 2.0), rng.between(-0.5, 0.5) * (lot.width_m - 4.0))
                clear = min(sqrt((x - cx) * (x - cx) + (y - cy) * (y - cy)) for cx, cy in _PATH_CORNERS_M) > 15.0
                if clear and self.layout.free(x, y, 2.2):
                    self.layout.take_disc(x, y, 2.2)
                    add_tree(b, rng, x, y, size=0.9)
                    self.bare.append((x, y))
                    break
        for number, lot in enumerate(self.lots):
            x, y = lot.at(rng.between(1.2, 3.8), rng.between(-0.5, 0.5) * (lot.width_m - 2.5))
            if self.layout.free(x, y, 0.8):
                self.layout.take_disc(x, y, 0.8)
                add_bush(b, rng, x, y)
            left = 0.25 * lot.width_m
            x, y = lot.at(0.5, left)
            if number % 4 == 1 and self.layout.free(x, y, 1.6):
                add_hedge(b, x, y, lot.heading_rad + QUARTER_TURN_RAD, (1.6, 0.3, 0.5))


def _add_dashes(mesh: Mesh, begin: Point, end: Point) -> None:
    """Add dashes of 1.8 m every 6 m along a street, none within 3 m of its ends."""
    (x0, y0), (x1, y1) = begin, end
    length = abs(x1 - x0) + abs(y1 - y0)
    ux, uy = (x1 - x0) / length, (y1 - y0) / length
    at = 3.0
    while at + 4.8 < length:
        points = [(x0 + s * ux, y0 + s * uy) for s in (at, at + 1.8)]
        dash = ribbon(points, 0.06, _STEP_M - 0.006, _STEP_M + 0.01, tile_m=2.0, closed=False)
        first = len(mesh.vertices)
        mesh.vertices += dash.vertices
        mesh.uvs += dash.uvs
        mesh.triangles += [(i + first, j + first, k + first) for i, j, k in dash.triangles]
        at += 6.0


def generate(parameters: Parameters, seed: int) -> SceneMap:
    suburb = _Neighbourhood(parameters, seed)
    suburb.materials()
    suburb.streets()
    suburb.blocks()
    suburb.vehicles()
    suburb.furniture()
    suburb.plants()
    suburb.lawn_details()
    suburb.builder.classify("ground", "ground")
    return suburb.builder.build()
