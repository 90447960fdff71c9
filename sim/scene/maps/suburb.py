"""Parts of suburbs: blocks with pavement, kerb and lawn; lots with a house, a path to its door and fences."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from signals._kernel import det_cos, det_sin
from signals.units import QUARTER_TURN_RAD
from sim.scene import surfaces
from sim.scene.maps import textures
from sim.scene.maps.buildings import add_house, building_materials
from sim.scene.maps.ground_details import ground_materials, spots
from sim.scene.maps.layout import Layout, Point
from sim.scene.maps.map_builder import MapBuilder, yaw_quat
from sim.scene.maps.plants import plant_materials
from sim.scene.maps.season import Season
from sim.scene.maps.street_furniture import furniture_materials
from sim.scene.random_generator import RandomGenerator

LANE_M = 3.5  # width of a lane, half a street
KERB_M = 0.12  # top of the pavement
LAWN_M = 0.14
FRONT_M = 2.2  # width of the pavement


@dataclass(frozen=True)
class Lot:
    """Ground of a house: (x, y) is the middle of its front at the pavement, `heading` points to the street."""

    x: float
    y: float
    heading_rad: float
    width_m: float
    depth_m: float

    def at(self, back_m: float, left_m: float) -> Point:
        """Return the point `back_m` behind the front and `left_m` to the left, seen when facing the street."""
        c, s = det_cos(self.heading_rad), det_sin(self.heading_rad)
        return self.x - back_m * c - left_m * s, self.y - back_m * s + left_m * c


class Suburb:
    """Map under construction: its builder, occupied ground, lots and doors."""

    def __init__(self, name: str, seed: int, season: Season) -> None:
        self.name, self.seed, self.season = name, seed, season
        self.builder = MapBuilder(name)
        self.layout = Layout()
        self.bare: list[Point] = []  # where the grass is worn off
        self.lots: list[Lot] = []
        self.doors: list[tuple[Lot, float, float]] = []  # with the place of each door: behind the front, to the left

    def rng(self, name: str) -> RandomGenerator:
        return RandomGenerator(self.seed, f"{self.name}.{name}")

    def materials(self) -> None:
        self.common_materials("grass", "paving", "gravel")
        self.lawn_materials()
        self.pavement_materials()
        self.fence_materials()

    def common_materials(self, *texture_names: str) -> None:
        """Add the materials of plants, furniture, buildings and streets, and the textures of the ground."""
        b = self.builder
        plant_materials(b, self.season)
        furniture_materials(b)
        building_materials(b)
        ground_materials(b)
        for name in texture_names:
            b.texture(name, textures.png(name))

    def lawn_materials(self) -> None:
        b = self.builder
        b.material("grass", surfaces.GRASS, texture="grass", tile_m=16.0, specular=0.0)
        b.material("lawn", surfaces.GRASS, rgb=(0.98, 1.0, 0.92), texture="grass", tile_m=16.0, specular=0.0)

    def pavement_materials(self) -> None:
        b = self.builder
        b.material("paving", surfaces.CONCRETE, texture="paving", tile_m=4.8, specular=0.0)
        b.material("drive", surfaces.GRAVEL, texture="gravel", tile_m=4.0, specular=0.0)
        b.material("kerb", surfaces.STONE, texture="kerb", tile_m=(8.0, 0.4), specular=0.0)

    def fence_materials(self) -> None:
        b = self.builder
        b.material("fence", surfaces.WOOD, rgb=(0.82, 0.81, 0.78), specular=0.0)
        b.material("fence_brown", surfaces.WOOD, rgb=(0.45, 0.31, 0.20), specular=0.0)

    def block_ground(self, cx: float, cy: float, hx: float, hy: float) -> None:
        """Add pavement, kerb stones and lawn of a block with this middle and these half lengths."""
        b = self.builder
        body = b.body("pavement", (cx, cy, 0.0))
        body.geom("box", (hx, hy, 0.1), pos=(0.0, 0.0, KERB_M - 0.1), material="paving", part="slab")
        for k, (px, py, sx, sy) in enumerate(
            ((0, hy, hx, 0.08), (0, -hy, hx, 0.08), (hx, 0, hy, 0.08), (-hx, 0, hy, 0.08))
        ):
            turn = yaw_quat(0.0 if k < 2 else QUARTER_TURN_RAD)  # the stones lie along x of the box
            at = (px, py, KERB_M - 0.095)
            body.geom("box", (sx, sy, 0.1), pos=at, quat=turn, material="kerb", part=f"kerb_{k}")
        lawn = b.body("lawn", (cx, cy, 0.0))
        lawn.geom(
            "box", (hx - FRONT_M, hy - FRONT_M, 0.1), pos=(0.0, 0.0, LAWN_M - 0.1), material="lawn"
        )  # fmt: skip

    def lawn_details(self) -> None:
        """Add bare spots under trees and dry patches to the lawns."""
        b, rng = self.builder, self.rng("lawn_details")
        places = [(x, y, rng.between(0.8, 1.3), 1.0) for x, y in self.bare]
        for lot in self.lots:
            x, y = lot.at(rng.between(3.0, lot.depth_m - 3.0), rng.between(-0.5, 0.5) * (lot.width_m - 4.0))
            places.append((x, y, rng.between(0.9, 1.7), 0.0))
        mesh = b.mesh("worn_spots", spots(places, LAWN_M, rng))
        b.body("lawn").geom("mesh", asset=mesh, material="worn_spot", solid=False, part="spots")

    def lot(self, rng: RandomGenerator, lot: Lot, number: int) -> None:
        b = self.builder
        half_y = min(lot.width_m / 2 - 1.6, rng.between(3.4, 4.2))
        half_x = rng.between(3.0, 3.8)
        setback = rng.between(5.0, 6.5)
        shift = rng.between(-0.5, 0.5)
        x, y = lot.at(setback + half_x, shift)
        add_house(b, rng, x, y, lot.heading_rad, half_x_m=half_x, half_y_m=half_y)
        self.layout.take_disc(x, y, sqrt(half_x * half_x + half_y * half_y) + 0.4)
        path = b.body("path", (*lot.at(setback / 2, shift), 0.0), yaw_quat(lot.heading_rad))
        path.geom("box", (setback / 2, 0.6, 0.1), pos=(0.0, 0.0, LAWN_M - 0.095), material="drive", solid=False)
        a, c = lot.at(0.0, shift), lot.at(setback, shift)
        self.layout.take_band((a, c), 0.9)
        self.doors.append((lot, setback, shift))
        # A fence towards the left neighbour; some fronts have a hedge.
        if number % 3 != 2:
            self.fence(lot.at(0.4, lot.width_m / 2), lot.at(lot.depth_m - 0.4, lot.width_m / 2), rng)

    def fence(self, start: Point, end: Point, rng: RandomGenerator) -> None:
        b = self.builder
        dx, dy = end[0] - start[0], end[1] - start[1]
        length = sqrt(dx * dx + dy * dy)
        material = rng.pick(("fence", "fence_brown"))
        heading = 0.0 if abs(dx) > abs(dy) else QUARTER_TURN_RAD
        body = b.body("fence", (0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]), LAWN_M), yaw_quat(heading))
        for k, z in enumerate((0.3, 0.62, 0.94)):
            body.geom("box", (length / 2, 0.02, 0.1), pos=(0.0, 0.0, z), material=material, part=f"rail_{k}")
        posts = max(2, round(length / 4.5))
        for k in range(posts + 1):
            body.geom(
                "box",
                (0.05, 0.05, 0.55),
                pos=(length * (k / posts - 0.5), 0.0, 0.55),
                material=material,
                part=f"post_{k}",
            )
        self.layout.take_band((start, end), 0.3)
