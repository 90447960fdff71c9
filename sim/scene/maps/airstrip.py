"""Airfield for planes: a paved runway between meadows, with hangar, fence, windsock, and trees beyond its end.

The runway leads east from 10 m behind the start, heading 090; the scene's file declares it as `runway`. North of it are
apron and hangar, south of it a windsock and a circuit of 2 km over fields, hedges and groves. Nothing solid stands
within 35 m of its centre line, within 75 m of the line of its approach for 400 m before it, and within 60 m of that
of its departure up to the trees 110 m behind its end.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from signals._kernel import det_atan2, det_cos, det_sin
from signals.documents.validate import StrictModel
from signals.rotation import product
from signals.units import QUARTER_TURN_RAD, TURN_RAD
from sim.scene import surfaces
from sim.scene.maps import textures
from sim.scene.maps.layout import Layout
from sim.scene.maps.map_builder import Body, MapBuilder, pitch_quat, yaw_quat
from sim.scene.maps.meshes import gabled, revolve
from sim.scene.maps.plants import add_hedge, add_tree, plant_materials
from sim.scene.maps.season import Season
from sim.scene.random_generator import RandomGenerator
from sim.scene.scene_map import SceneMap

BEGIN_M, LENGTH_M, WIDTH_M = -10.0, 400.0, 18.0
END_M = BEGIN_M + LENGTH_M
_TREES_M = 110.0  # beyond the end
_GROVE = 6  # trees that stand together
_FIELD_M = 1100.0  # half the extent of the fields, around the middle of the runway
_MIDDLE_M = BEGIN_M + 0.5 * LENGTH_M
_PAINT_M = 0.005  # half thickness of what is painted on the ground; its top is 3 mm (runway) and 5 mm (paint) over it
# Strokes of digits in a cell of 1 x 2: x0, y0, x1, y1.
_DIGITS = {
    "0": ((0, 0, 0, 2), (1, 0, 1, 2), (0, 0, 1, 0), (0, 2, 1, 2)),
    "2": ((0, 2, 1, 2), (1, 1, 1, 2), (0, 1, 1, 1), (0, 0, 0, 1), (0, 0, 1, 0)),
    "7": ((0, 2, 1, 2), (1, 0, 1, 2)),
    "9": ((0, 1, 0, 2), (1, 0, 1, 2), (0, 2, 1, 2), (0, 1, 1, 1), (0, 0, 1, 0)),
}
_CROPS = {
    "meadow": (0.92, 1.00, 0.86), "pasture": (0.80, 0.92, 0.70),
    "wheat": (1.00, 0.90, 0.55), "maize": (0.62, 0.80, 0.46),
}  # fmt: skip


class Parameters(StrictModel):
    """Numbers of plants, and the wind that the windsock shows."""

    trees: Annotated[int, Field(ge=0, le=400)] = 60
    hedges: Annotated[int, Field(ge=0, le=100)] = 24
    end_trees: Annotated[int, Field(ge=0, le=60)] = 18
    wind_from_deg: Annotated[float, Field(ge=0.0, lt=360.0)] = 80.0
    wind_mps: Annotated[float, Field(ge=0.0, le=20.0)] = 4.0
    season: Season = "summer"


class _Airstrip:
    def __init__(self, parameters: Parameters, seed: int) -> None:
        self.parameters, self.seed = parameters, seed
        self.builder = MapBuilder("airstrip")
        self.layout = Layout()
        self.layout.take_box(BEGIN_M - 60.0, -35.0, END_M + 60.0, 35.0)
        self.layout.take_box(END_M, -60.0, END_M + _TREES_M, 60.0)
        self.layout.take_box(BEGIN_M - 400.0, -75.0, BEGIN_M, 75.0)

    def rng(self, name: str) -> RandomGenerator:
        return RandomGenerator(self.seed, f"airstrip.{name}")

    def materials(self) -> None:
        b = self.builder
        plant_materials(b, self.parameters.season)
        for name in ("grass", "earth", "clean_asphalt", "concrete", "sheet_metal"):
            b.texture(name, textures.png(name))
        b.material("grass", surfaces.GRASS, texture="grass", tile_m=16.0, specular=0.0)
        for name, rgb in _CROPS.items():
            b.material(name, surfaces.GRASS, rgb=rgb, texture="grass", tile_m=24.0, specular=0.0)
        b.material("soil", surfaces.SOIL, texture="earth", tile_m=12.0, specular=0.0)
        b.material("asphalt", surfaces.ASPHALT, texture="clean_asphalt", tile_m=6.0, specular=0.0)
        b.material("apron", surfaces.CONCRETE, texture="concrete", tile_m=5.0, specular=0.0)
        b.material("road_paint", surfaces.ROAD_PAINT, rgb=(0.88, 0.88, 0.86), specular=0.0)
        b.material("sheet", surfaces.PAINTED_METAL, rgb=(0.55, 0.62, 0.68), texture="sheet_metal", specular=0.2)
        b.material("roof_sheet", surfaces.PAINTED_METAL, rgb=(0.42, 0.44, 0.46), specular=0.2)
        b.material("gate_dark", surfaces.PAINTED_METAL, rgb=(0.16, 0.18, 0.20), specular=0.1)
        b.material("steel", surfaces.METAL, rgb=(0.62, 0.63, 0.64), specular=0.4, shininess=0.5)
        b.material("post_wood", surfaces.WOOD, rgb=(0.42, 0.33, 0.24), specular=0.0)
        b.material("sock_red", surfaces.CLOTH, rgb=(0.85, 0.22, 0.10), specular=0.0)
        b.material("sock_white", surfaces.CLOTH, rgb=(0.90, 0.90, 0.88), specular=0.0)

    def ground(self) -> None:
        """Add the meadow, and fields of other colours upon it, which only cameras and LiDARs see."""
        b, rng = self.builder, self.rng("fields")
        b.ground("plane", (0.0, 0.0, 1.0), material="grass")
        b.classify("grass", "ground")
        body = b.named_body(b.next_name("field"), (0.0, 0.0, 0.0), yaw_quat(0.0))
        b.classify("grass", "field_*")
        cell = 220.0
        count = int(_FIELD_M / cell)
        kinds = (*_CROPS, "soil")
        for i in range(-count, count + 1):
            for j in range(-count, count + 1):
                x, y = _MIDDLE_M + i * cell, j * cell
                half_x, half_y = 0.5 * cell - rng.between(1.0, 5.0), 0.5 * cell - rng.between(1.0, 5.0)
                kind = rng.pick(kinds)
                if abs(j) < 1 and abs(x - _MIDDLE_M) < 0.5 * LENGTH_M + 300.0:
                    continue  # the airfield itself is meadow
                body.geom("box", (half_x, half_y, _PAINT_M), pos=(x, y, -0.003), material=kind, solid=False)

    def runway(self) -> None:
        b = self.builder
        strip = b.body("runway", (_MIDDLE_M, 0.0, -0.002))
        strip.geom("box", (0.5 * LENGTH_M, 0.5 * WIDTH_M, _PAINT_M), material="asphalt", solid=False, part="strip")
        paved = b.body("pavement")
        for x, y, half_x, half_y in ((60.0, 24.0, 5.0, 15.1), (70.0, 62.0, 35.0, 23.0)):  # taxiway, apron
            paved.geom("box", (half_x, half_y, _PAINT_M), pos=(x, y, -0.0022), material="apron", solid=False)
        marks = b.body("marking")
        side = 0.5 * WIDTH_M - 0.6
        self._line(marks, BEGIN_M, side, END_M, side, 0.3)
        self._line(marks, BEGIN_M, -side, END_M, -side, 0.3)
        for begin, sign, name in ((BEGIN_M, 1.0, "09"), (END_M, -1.0, "27")):
            for k in range(8):  # threshold
                y = (k - 3.5) * 1.8 + (0.4 if k > 3 else -0.4)
                self._line(marks, begin + sign * 3.0, y, begin + sign * 15.0, y, 0.9)
            self._number(marks, name, begin + sign * 20.0, sign)
        x = BEGIN_M + 36.0
        while x + 12.0 < END_M - 34.0:
            self._line(marks, x, 0.0, x + 12.0, 0.0, 0.3)
            x += 20.0

    def _line(self, body: Body, x0: float, y0: float, x1: float, y1: float, width_m: float) -> None:
        half = (0.5 * max(abs(x1 - x0), width_m), 0.5 * max(abs(y1 - y0), width_m), _PAINT_M)
        body.geom("box", half, pos=(0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.0), material="road_paint", solid=False)

    def _number(self, body: Body, name: str, begin_m: float, sign: float) -> None:
        """Paint two digits, 6 m high, to be read by who comes in over that end."""
        for k, digit in enumerate(name):
            left = 3.2 - 3.8 * k  # of the digit, to the left of the flight direction
            for x0, y0, x1, y1 in _DIGITS[digit]:
                u0, u1 = begin_m + sign * 3.0 * y0, begin_m + sign * 3.0 * y1
                v0, v1 = sign * (left - 2.4 * x0), sign * (left - 2.4 * x1)
                self._line(body, u0, v0, u1, v1, 0.6)

    def hangar(self) -> None:
        b = self.builder
        x, y, half_x, half_y, wall, rise = 70.0, 98.0, 15.0, 12.0, 6.0, 3.0
        body = b.body("hall", (x, y, 0.0))
        body.geom("box", (half_x, half_y, 0.5 * wall), pos=(0.0, 0.0, 0.5 * wall), material="sheet", part="walls")
        roof = b.mesh("hangar_roof", gabled(half_x + 0.4, half_y + 0.4, 0.05, rise, tile_m=2.0))
        body.geom("mesh", asset=roof, pos=(0.0, 0.0, wall), material="roof_sheet", part="roof")
        body.geom(
            "box", (9.0, 0.03, 2.4), pos=(0.0, -half_y - 0.02, 2.4), material="gate_dark", solid=False, part="gate"
        )
        self.layout.take_box(x - 25.0, y - 70.0, x + 45.0, y + 22.0)

    def fence(self) -> None:
        """Add posts and rails north of the apron, along 160 m."""
        b = self.builder
        y, begin, end = 122.0, -10.0, 150.0
        body = b.body("fence", (0.0, y, 0.0))
        count = 41
        for k in range(count):
            x = begin + (end - begin) * k / (count - 1)
            body.geom("cylinder", (0.05, 0.65), pos=(x, 0.0, 0.65), material="post_wood", part=f"post_{k}")
        for k, z in enumerate((0.5, 1.1)):
            half = (0.5 * (end - begin), 0.02, 0.05)
            body.geom("box", half, pos=(0.5 * (begin + end), 0.0, z), material="post_wood", part=f"rail_{k}")
        self.layout.take_box(begin, y - 3.0, end, y + 3.0)

    def windsock(self) -> None:
        """Add pole and sock, which points away from the wind and hangs the more, the weaker the wind is."""
        b, p = self.builder, self.parameters
        x, y, top = 30.0, -42.0, 6.0
        pole = b.body("pole", (x, y, 0.0))
        pole.geom("cylinder", (0.06, 0.5 * top), pos=(0.0, 0.0, 0.5 * top), material="steel", part="mast")
        to = (p.wind_from_deg / 360.0 + 0.5) * TURN_RAD
        yaw = det_atan2(det_cos(to), det_sin(to))
        droop = max(0.05, 1.0 - p.wind_mps / 8.0) * 0.8 * QUARTER_TURN_RAD  # stretched from 15 knots on (ICAO)
        c, s = det_cos(droop), det_sin(droop)
        bands = 5
        for k in range(bands):
            r0, r1, length = 0.30 - 0.035 * k, 0.30 - 0.035 * (k + 1), 0.48
            asset = b.mesh(f"sock_{k}", revolve([(r0, 0.0), (r0, 0.0), (r1, length), (r1, length)], 16))
            along = 0.15 + 0.48 * k
            body = b.named_body(
                b.next_name("windsock"),
                (x + along * c * det_cos(yaw), y + along * c * det_sin(yaw), top - 0.1 - along * s),
                _turned(yaw, droop),
            )
            body.geom("mesh", asset=asset, material="sock_red" if k % 2 == 0 else "sock_white", solid=False)
        b.classify("windsock", "windsock_*")
        self.layout.take_disc(x, y, 4.0)

    def plants(self) -> None:
        b, p, rng = self.builder, self.parameters, self.rng("plants")
        for k in range(p.end_trees):
            x = END_M + _TREES_M + rng.between(4.0, 26.0)
            y = (k - 0.5 * (p.end_trees - 1)) * 7.5 + rng.between(-2.0, 2.0)
            if self.layout.free(x, y, 2.0):
                self.layout.take_disc(x, y, 2.0)
                add_tree(b, rng, x, y, size=1.25)
        hedges = self.rng("hedges")
        for _ in range(p.hedges):
            x, y = _MIDDLE_M + hedges.between(-600.0, 600.0), hedges.pick((-1.0, 1.0)) * hedges.between(110.0, 600.0)
            half = (hedges.pick((20.0, 35.0)), 0.8, hedges.pick((0.8, 1.2)))
            if self.layout.free(x, y, half[0] + 2.0):
                self.layout.take_disc(x, y, half[0] + 2.0)
                add_hedge(b, x, y, hedges.pick((0.0, QUARTER_TURN_RAD)), half)
        trees = self.rng("trees")

        area = (-700.0, -600.0, 1100.0, 600.0)
        groves = (p.trees + _GROVE - 1) // _GROVE
        for grove in range(groves):
            for _ in range(40):
                x, y = trees.between(area[0], area[2]), trees.between(area[1], area[3])
                if self.layout.free(x, y, 22.0):
                    self.grove(trees, x, y, min(_GROVE, p.trees - _GROVE * grove))
                    break

    def grove(self, rng: RandomGenerator, x: float, y: float, count: int) -> None:
        """Add trees within 20 m of a place."""
        self.layout.scatter(
            rng, count, 2.6, (x - 14.0, y - 14.0, x + 14.0, y + 14.0),
            lambda u, v: add_tree(self.builder, rng, u, v, size=rng.between(0.9, 1.5)),
        )  # fmt: skip


def _turned(yaw_rad: float, droop_rad: float) -> tuple[float, float, float, float]:
    """Return the rotation that turns z to a direction so far round from x, and so far below the horizon."""
    return product(yaw_quat(yaw_rad), pitch_quat(QUARTER_TURN_RAD + droop_rad))


def generate(parameters: Parameters, seed: int) -> SceneMap:
    airstrip = _Airstrip(parameters, seed)
    airstrip.materials()
    airstrip.ground()
    airstrip.runway()
    airstrip.hangar()
    airstrip.fence()
    airstrip.windsock()
    airstrip.plants()
    return airstrip.builder.build()
