"""People on a map: walking, standing, sitting, cycling. Height, hair and clothes come from the random generator."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from signals.rotation import NO_TURN, product
from signals.samples import Quat, Vec3
from signals.units import QUARTER_TURN_RAD
from sim._kernels import resting_arm, resting_leg
from sim.scene import surfaces
from sim.scene.maps import wheelchair
from sim.scene.maps.clothes import Colours, draw_colours, draw_look
from sim.scene.maps.cyclist import Cyclist, ride
from sim.scene.maps.figure import LIMBS, Figure
from sim.scene.maps.map_builder import Body, MapBuilder, pitch_quat, roll_quat, yaw_quat
from sim.scene.maps.models import model
from sim.scene.maps.vehicles.paints import draw_paint
from sim.scene.maps.vehicles.ridden_bicycle import RiddenBicycle, add_ridden_bicycle
from sim.scene.maps.walk_path import WalkPath
from sim.scene.maps.walker import Roller, Walker
from sim.scene.random_generator import RandomGenerator

Row = list[float]  # one limb: x, y, z, cos and sin of half its pitch, ... (sim/native/gait.hpp)

_ALONG_Y = roll_quat(QUARTER_TURN_RAD)
_ALONG_X = pitch_quat(QUARTER_TURN_RAD)

_HEIGHT_STEP_M = 0.05  # of the meshes: people of nearly the same height share them
_CHILD_M = 1.42  # below this height people have the proportions of a child
_CHILDS_WHEELCHAIR = 1.0 / 1.75  # size for each metre of a child's height
_STRAIGHT = 0.99  # greatest distance of hip and ankle of a person who sits, as a share of the leg


@dataclass(frozen=True)
class PersonTraits:
    """Traits of a person; height and colours are random unless they are given."""

    soldier: bool = False  # in uniform
    height_m: float | None = None
    name: str | None = None  # None: numbered in the order of adding
    colours: Colours | None = None


class _Person:
    """Figure, look and meshes of one person."""

    def __init__(self, builder: MapBuilder, rng: RandomGenerator, traits: PersonTraits, *, sitting: bool) -> None:
        height_m = traits.height_m or rng.between(1.55, 1.93)
        self.figure = Figure(height_m, child=height_m < _CHILD_M)
        colours = traits.colours or draw_colours(rng, soldier=traits.soldier)
        self.name = traits.name or builder.next_name("person", digits=2)
        self._builder = builder
        clothes = rng.branch(f"clothes.{self.name}")
        self._look = draw_look(
            builder, clothes, colours, name=self.name, soldier=traits.soldier, child=self.figure.child, sitting=sitting
        )
        self._meshes = model(f"people/{self._look.build}")
        self._scale = max(1, round(height_m / _HEIGHT_STEP_M)) * _HEIGHT_STEP_M
        self._contact = builder.material("contact", surfaces.CLOTH)

    def reach_m(self) -> dict[str, float]:
        """Return the distance from each limb's origin to its farthest point."""
        reach = self.figure.reach_m()
        radius = self._meshes.facts["radius"]
        for piece in self._look.pieces:
            farthest = self._scale * (radius[piece.part] + abs(piece.y))
            reach[piece.limb] = max(reach[piece.limb], farthest)
        return reach

    @property
    def laden_hand(self) -> str | None:
        """The hand that carries a bag, hand_l or hand_r."""
        return next((p.limb for p in self._look.pieces if p.role == "bag" and p.limb.startswith("hand_")), None)

    @property
    def chair_size(self) -> float:
        """Size of this person's wheelchair; a child has a smaller one."""
        return _CHILDS_WHEELCHAIR * self._scale if self.figure.child else 1.0

    def add_wheelchair(self, body: Body, origin: Vec3) -> None:
        """Add a wheelchair to the body of the pelvis; `origin`: the ground below the hips in the body's frame."""
        b, size = self._builder, self.chair_size
        named = "" if size == 1.0 else f"_{round(100 * size)}"
        made = (
            ("tyres", b.material("chair_tyre", surfaces.RUBBER, rgb=(0.17, 0.17, 0.17), specular=0.0)),
            ("frame", b.material("chair_frame", surfaces.PAINTED_METAL, rgb=(0.30, 0.31, 0.33))),
            ("seat", b.material("chair_seat", surfaces.CLOTH, rgb=(0.20, 0.20, 0.21), specular=0.0)),
        )
        for name, material in made:
            mesh = model("people/wheelchair").mesh(name)
            asset = b.mesh(f"wheelchair_{name}{named}", mesh, scale=size, source=f"wheelchair_{name}")
            body.geom("mesh", asset=asset, material=material, pos=origin, solid=False, part=f"wheelchair_{name}")
        centre, half = wheelchair.BOX
        x, y, z = (a + size * c for a, c in zip(origin, centre, strict=True))
        half_x, half_y, half_z = (size * c for c in half)
        body.proxy("box", (half_x, half_y, half_z), material=self._contact, pos=(x, y, z), part="contact_wheelchair")

    def add_limb(
        self, body: Body, limb: str, pos: Vec3 = (0.0, 0.0, 0.0), quat: Quat = NO_TURN, part: str = ""
    ) -> None:
        """Add a limb's meshes, and the shapes that stand for it in contact, at a pose in the body's frame."""
        cosine, sine = quat[0] * quat[0] - quat[2] * quat[2], 2.0 * quat[0] * quat[2]  # rotates about y
        for shape in self.figure.shapes():
            if shape.limb == limb:
                px, py, pz = shape.pos
                at = (pos[0] + px * cosine + pz * sine, pos[1] + py, pos[2] + pz * cosine - px * sine)
                turn = product(quat, _ALONG_Y if shape.lateral else _ALONG_X if shape.forward else NO_TURN)
                body.proxy(
                    shape.kind, shape.size, material=self._contact, pos=at, quat=turn,
                    part=f"{part}contact_{shape.part}",
                )  # fmt: skip
        for piece in self._look.pieces:
            if piece.limb == limb:
                source = f"{piece.part}_{self._look.build}"
                mesh = self._builder.mesh(
                    f"{source}_{round(100 * self._scale)}", self._meshes.mesh(piece.part),
                    scale=self._scale, source=source,
                )  # fmt: skip
                at = (pos[0], pos[1] + piece.y * self.figure.height_m, pos[2])
                material = self._look.materials[piece.role]
                body.geom("mesh", asset=mesh, material=material, pos=at, quat=quat, solid=False, part=part + piece.part)


def add_walker(
    builder: MapBuilder,
    rng: RandomGenerator,
    path: WalkPath,
    *,
    ground_m: float = 0.0,
    traits: PersonTraits = PersonTraits(),
) -> Walker:
    """Add a walking person as an actor of the map. `ground_m`: height of the ground under `path`."""
    person = _Person(builder, rng, traits, sitting=False)
    walker = Walker(person.name, person.figure, path, ground_m=ground_m, reach_m=person.reach_m())
    for limb, body in zip(LIMBS, builder.actor(walker), strict=True):
        person.add_limb(body, limb)
    builder.classify("person", "person_*")
    return walker


def _trunk_rows(figure: Figure, hip_z: float) -> list[Row]:
    heights = (0.0, figure.torso_above_hip_m, figure.head_above_hip_m)
    return [[0.0, 0.0, hip_z + height, 1.0, 0.0] for height in heights]


def _standing(figure: Figure, rng: RandomGenerator, laden: str | None) -> list[Row]:
    """Return the rows of a person who stands; `laden`: the hand in which a bag hangs, whose arm is down."""
    hip_z = figure.ankle_m + 0.992 * figure.leg_m
    rows = _trunk_rows(figure, hip_z)
    shoulder_z = hip_z + figure.shoulder_above_hip_m
    for hand, side in (("hand_l", figure.shoulder_half_m), ("hand_r", -figure.shoulder_half_m)):
        bend = rng.between(0.1, 0.4) if rng.chance(0.6) else 1.6  # this arm down, or its forearm level
        upper_rad, fore_rad = (0.0, -0.05) if hand == laden else (-0.1, -0.1 - bend)
        rows += resting_arm(figure.lengths_m, side, shoulder_z, upper_rad, fore_rad)
    for side in (figure.hip_half_m, -figure.hip_half_m):
        ahead = rng.between(-0.03, 0.05)
        rows += resting_leg(figure.lengths_m, side, hip_z, ahead, figure.ankle_m)
    return rows


def _sitting(figure: Figure, seat_m: float) -> list[Row]:
    hip_z = seat_m + 0.07 * figure.height_m
    rows = _trunk_rows(figure, hip_z)
    shoulder_z = hip_z + figure.shoulder_above_hip_m
    for side in (figure.shoulder_half_m, -figure.shoulder_half_m):
        rows += resting_arm(figure.lengths_m, side, shoulder_z, -0.35, -1.25)
    for side in (figure.hip_half_m, -figure.hip_half_m):
        ahead = 0.93 * figure.thigh_m
        below = sqrt((_STRAIGHT * (figure.thigh_m + figure.shank_m)) ** 2 - ahead * ahead)
        ankle_z = max(figure.ankle_m, hip_z - below)  # the feet of a small person hang above the ground
        rows += resting_leg(figure.lengths_m, side, hip_z, ahead, ankle_z)
    return rows


def add_wheelchair_user(
    builder: MapBuilder,
    rng: RandomGenerator,
    path: WalkPath,
    *,
    ground_m: float = 0.0,
    traits: PersonTraits = PersonTraits(),
) -> Roller:
    """Add a person who rolls along `path` in a wheelchair, as an actor of the map."""
    person = _Person(builder, rng, traits, sitting=True)
    size = person.chair_size
    rows = _seated_rows(person.figure, size)
    hip_z = rows[0][2]
    reach = person.reach_m()
    reach["pelvis"] = max(reach["pelvis"], size * wheelchair.reach_m(hip_z / size))
    roller = Roller(person.name, person.figure, path, rows, ground_m=ground_m, reach_m=reach)
    for limb, body in zip(LIMBS, builder.actor(roller), strict=True):
        person.add_limb(body, limb)
        if limb == "pelvis":
            person.add_wheelchair(body, (0.0, 0.0, -hip_z))
    builder.classify("person", "person_*")
    return roller


def _seated_rows(figure: Figure, size: float) -> list[Row]:
    """Return full rows of a person in a wheelchair of a size, the feet on its footrests."""
    hip_z = size * wheelchair.SEAT_M + 0.055 * figure.height_m
    rows = [[*row, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0] for row in _trunk_rows(figure, hip_z)]
    shoulder_z = hip_z + figure.shoulder_above_hip_m
    for side in (figure.shoulder_half_m, -figure.shoulder_half_m):
        rows += [list(row) for row in resting_arm(figure.lengths_m, 1.12 * side, shoulder_z, 0.10, -1.15)]
    for side in (figure.hip_half_m, -figure.hip_half_m):
        ankle_z = size * wheelchair.FOOTREST_M + figure.ankle_m
        rows += [list(row) for row in resting_leg(figure.lengths_m, 1.3 * side, hip_z, 0.40 * size, ankle_z)]
    return rows


def add_cyclist(
    builder: MapBuilder,
    rng: RandomGenerator,
    path: WalkPath,
    *,
    ground_m: float = 0.0,
    traits: PersonTraits = PersonTraits(),
) -> tuple[Cyclist, RiddenBicycle]:
    """Add a person who rides along `path`, and the bicycle, as two actors of the map."""
    person = _Person(builder, rng, traits, sitting=True)
    riding = ride(person.figure)
    bicycle = RiddenBicycle(f"bicycle_{person.name}", path, riding.size, riding.saddle_m, ground_m=ground_m)
    cyclist = Cyclist(
        person.name, person.figure, riding, path, crank_turns_per_m=bicycle.crank_turns_per_m, ground_m=ground_m,
        reach_m=person.reach_m(),
    )  # fmt: skip
    for limb, body in zip(LIMBS, builder.actor(cyclist), strict=True):
        person.add_limb(body, limb)
    builder.classify("person", "person_*")
    add_ridden_bicycle(builder, bicycle, draw_paint(rng))
    return cyclist, bicycle


def add_still_person(
    builder: MapBuilder,
    rng: RandomGenerator,
    at_m: Vec3,
    heading_rad: float,
    *,
    seat_m: float = 0.0,
    traits: PersonTraits = PersonTraits(),
) -> None:
    """Add a person as one static body: standing at `at_m`, or sitting there on a seat of height `seat_m` (not 0)."""
    person = _Person(builder, rng, traits, sitting=seat_m > 0.0)
    rows = _sitting(person.figure, seat_m) if seat_m else _standing(person.figure, rng, person.laden_hand)
    builder.classify("person", "person_*")
    body = builder.named_body(person.name, at_m, yaw_quat(heading_rad))
    for limb, row in zip(LIMBS, rows, strict=True):
        person.add_limb(body, limb, (row[0], row[1], row[2]), (row[3], 0.0, row[4], 0.0), part=f"{limb}_")
