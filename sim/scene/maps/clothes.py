"""Looks of people: build, clothes, hair, bags, drawn by weights, and the parts and materials that they consist of.

Weights and colours are chosen by eye after street scenes: most clothes are dark or neutral. Black cloth, leather and
hair still return 3 to 5 % of the light (a code of some 0.2): darker ones are holes in a picture, without folds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from signals.samples import Vec3
from sim.scene import surfaces
from sim.scene.maps import textures
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.random_generator import RandomGenerator, weighted_pick
from sim.scene.scene_map import Surface

_Weights = dict[str, float]

TOPS: dict[str, Vec3] = {
    "black": (0.22, 0.22, 0.23), "charcoal": (0.32, 0.32, 0.34), "navy": (0.19, 0.23, 0.36),
    "white": (0.88, 0.88, 0.86), "grey": (0.55, 0.56, 0.57), "beige": (0.76, 0.68, 0.55), "olive": (0.37, 0.38, 0.27),
    "burgundy": (0.46, 0.17, 0.20), "sky": (0.50, 0.66, 0.82), "red": (0.74, 0.20, 0.18), "green": (0.22, 0.41, 0.29),
    "mustard": (0.80, 0.60, 0.18), "rose": (0.82, 0.56, 0.60), "teal": (0.18, 0.44, 0.48),
}  # fmt: skip
_TOP_WEIGHTS: _Weights = {
    "black": 0.19, "charcoal": 0.10, "navy": 0.15, "white": 0.13, "grey": 0.11, "beige": 0.07, "olive": 0.05,
    "burgundy": 0.04, "sky": 0.05, "red": 0.04, "green": 0.02, "mustard": 0.02, "rose": 0.02, "teal": 0.01,
}  # fmt: skip
BOTTOMS: dict[str, Vec3] = {
    "denim": (0.30, 0.38, 0.53), "denim_dark": (0.21, 0.26, 0.36), "denim_light": (0.50, 0.59, 0.71),
    "black": TOPS["black"], "charcoal": TOPS["charcoal"], "khaki": (0.58, 0.50, 0.36), "brown": (0.37, 0.29, 0.22),
    "grey_dark": (0.45, 0.46, 0.47),
}  # fmt: skip
_BOTTOM_WEIGHTS: _Weights = {
    "denim": 0.20, "denim_dark": 0.22, "denim_light": 0.06, "black": 0.20, "charcoal": 0.12, "khaki": 0.10,
    "brown": 0.04, "grey_dark": 0.06,
}  # fmt: skip
SKINS: dict[str, Vec3] = {
    "a": (0.90, 0.72, 0.61), "b": (0.82, 0.62, 0.49), "c": (0.70, 0.50, 0.37), "d": (0.50, 0.34, 0.25),
    "e": (0.34, 0.23, 0.17),
}  # fmt: skip
_SKIN_WEIGHTS: _Weights = {"a": 0.34, "b": 0.26, "c": 0.16, "d": 0.14, "e": 0.10}
HAIRS: dict[str, Vec3] = {
    "black": (0.16, 0.145, 0.14), "dark": (0.21, 0.165, 0.14), "brown": (0.31, 0.22, 0.155), "fair": (0.62, 0.48, 0.28),
    "grey": (0.55, 0.55, 0.55), "white": (0.80, 0.79, 0.77), "red": (0.45, 0.20, 0.10),
}  # fmt: skip
_HAIR_WEIGHTS: _Weights = {
    "black": 0.24, "dark": 0.28, "brown": 0.20, "fair": 0.10, "grey": 0.10, "white": 0.05, "red": 0.03,
}  # fmt: skip
_BEARDS = ("black", "dark", "brown")  # colours of hair whose beards the texture has
# Police, and soldiers in plain field dress or in spots: the last one's colour multiplies the pattern.
_UNIFORMS: dict[str, Vec3] = {
    "black": (0.20, 0.20, 0.21), "navy": (0.18, 0.21, 0.29), "field": (0.31, 0.33, 0.25), "spots": (0.99, 1.0, 0.94),
}  # fmt: skip
_DARK_GEAR: dict[str, Vec3] = {"gear_black": (0.19, 0.19, 0.20), "gear_grey": (0.30, 0.31, 0.33)}
_FIELD_GEAR: dict[str, Vec3] = {"gear_green": (0.36, 0.37, 0.28), "gear_tan": (0.60, 0.50, 0.36)}
_SHOES: dict[str, Vec3] = {
    "black": (0.17, 0.17, 0.17), "white": (0.86, 0.86, 0.85), "brown": (0.30, 0.19, 0.12), "grey": (0.35, 0.36, 0.38),
    "navy": (0.18, 0.21, 0.31),
}  # fmt: skip
_SHOE_WEIGHTS: _Weights = {"black": 0.40, "white": 0.20, "brown": 0.18, "grey": 0.12, "navy": 0.10}
_BAGS: dict[str, Vec3] = {
    "black": (0.20, 0.20, 0.21), "grey": (0.36, 0.37, 0.39), "navy": (0.19, 0.24, 0.36), "red": (0.62, 0.18, 0.16),
    "tan": (0.52, 0.36, 0.22), "green": (0.24, 0.34, 0.26),
}  # fmt: skip
_BAG_WEIGHTS: _Weights = {"black": 0.38, "grey": 0.16, "navy": 0.16, "red": 0.08, "tan": 0.14, "green": 0.08}
_SHOPPING: dict[str, Vec3] = {"paper": (0.72, 0.58, 0.42), "white": (0.90, 0.90, 0.89)}

_SIDES = ("l", "r")
_ARM_IN = (0.010, 0.015)  # of men and women: arms closer to the trunk than the joints, share of the height


class Piece(NamedTuple):
    """Mesh of a part (of the models in assets/models/people) on a limb, with the role of its material."""

    limb: str
    part: str
    role: str
    y: float = 0.0  # offset to the left, share of the height


@dataclass(frozen=True)
class Colours:
    """Colours of a person by name, as drawn, or the colours themselves (sRGB codes / 255)."""

    shirt: str | Vec3
    trousers: str | Vec3
    skin: str | Vec3
    hair: str | Vec3


@dataclass(frozen=True)
class Look:
    """Build and parts of a person, and the material of each role."""

    build: str
    pieces: tuple[Piece, ...]
    materials: dict[str, str]


def draw_colours(rng: RandomGenerator, *, soldier: bool) -> Colours:
    """Draw the colours of a person, from four draws."""
    shirt, trousers, skin, hair = (rng.unit() for _ in range(4))
    if soldier:
        uniform = tuple(_UNIFORMS)[int(shirt * len(_UNIFORMS))]
        return Colours(uniform, uniform, weighted_pick(_SKIN_WEIGHTS, skin), weighted_pick(_HAIR_WEIGHTS, hair))
    return Colours(
        weighted_pick(_TOP_WEIGHTS, shirt),
        weighted_pick(_BOTTOM_WEIGHTS, trousers),
        weighted_pick(_SKIN_WEIGHTS, skin),
        weighted_pick(_HAIR_WEIGHTS, hair),
    )


class _Dresser:
    """Collects the pieces and materials of one person."""

    def __init__(self, builder: MapBuilder, rng: RandomGenerator, colours: Colours, name: str) -> None:
        self.builder, self.rng, self.colours, self.name = builder, rng, colours, name
        self.pieces: list[Piece] = []
        self.materials: dict[str, str] = {}
        self.arm_in = _ARM_IN[0]

    def put(self, limb: str, part: str, role: str) -> None:
        self.pieces.append(Piece(limb, part, role))

    def put_both(self, limb: str, part: str, role: str) -> None:
        is_arm = limb in ("upper_arm", "forearm", "hand")
        for side, inwards in zip(_SIDES, (-1.0, 1.0), strict=True):
            self.pieces.append(Piece(f"{limb}_{side}", part, role, inwards * self.arm_in if is_arm else 0.0))

    def paint(
        self, role: str, prefix: str, colour: str | Vec3, table: dict[str, Vec3], surface: Surface, texture: str = ""
    ) -> None:
        """Make the material of a role: shared by name for colours of the table, else of this person only."""
        if isinstance(colour, str):
            name, rgb = f"{prefix}_{colour}", table[colour]
        else:
            name, rgb = f"{self.name}_{role}", colour
        if texture:
            name = f"{name}_{texture.removeprefix('cloth_')}"
            texture = self.builder.texture(texture, textures.png(texture))
        self.materials[role] = self.builder.material(name, surface, rgb=rgb, texture=texture, specular=0.0)

    def skin(self, *, female: bool, beard: bool) -> None:
        c = self.colours
        self.paint("skin", "skin", c.skin, SKINS, surfaces.SKIN)
        face = "face_f" if female else "face_beard" if beard else "face_m"
        self.paint("face", "skin", c.skin, SKINS, surfaces.SKIN, face)
        self.put("head", "head", "face")
        self.put_both("hand", "hand", "skin")

    def shoes(self, colour: str, sole: str) -> None:
        self.paint("shoe", "shoe", colour, _SHOES, surfaces.RUBBER)
        self.put_both("foot", "shoe", "shoe")
        if sole != "black":
            self.paint("sole", "shoe", sole, _SHOES, surfaces.RUBBER)
            self.put_both("foot", "sole", "sole")

    def look(self, build: str) -> Look:
        return Look(build, tuple(self.pieces), self.materials)


def draw_look(
    builder: MapBuilder,
    rng: RandomGenerator,
    colours: Colours,
    *,
    name: str,
    soldier: bool = False,
    child: bool = False,
    sitting: bool = False,
) -> Look:
    """Draw build, clothes, hair and bags from `rng`, and add the materials to the map."""
    dresser = _Dresser(builder, rng, colours, name)
    if soldier:
        return _soldier(dresser)
    female = rng.chance(0.5)
    size = rng.weighted({"slim": 0.32, "mid": 0.48, "stout": 0.20})
    build = "child" if child else f"{'f' if female else 'm'}_{size}"
    dresser.arm_in = _ARM_IN[female and not child]
    beard = rng.chance(0.28) and not child and colours.hair in _BEARDS
    dresser.skin(female=female or child, beard=beard)
    top = _top(dresser, female=female and not child, sitting=sitting)
    if top != "dress":
        _bottom(dresser, shorts=top == "tshirt", skirt=female and not sitting and not child)
    else:
        _legs_below_a_hem(dresser, "top")
    shoe = rng.weighted(_SHOE_WEIGHTS)
    dresser.shoes(shoe, "white" if shoe != "brown" and rng.chance(0.5) else "black")
    _hair(dresser, female=female, child=child)
    _bag(dresser, female=female, sitting=sitting)
    return dresser.look(build)


def _soldier(d: _Dresser) -> Look:
    build = d.rng.weighted({"m_slim": 0.25, "m_mid": 0.55, "m_stout": 0.10, "f_mid": 0.10})
    female = build.startswith("f")
    d.arm_in = _ARM_IN[female]
    d.skin(female=female, beard=d.rng.chance(0.15) and not female and d.colours.hair in _BEARDS)
    uniform = d.colours.shirt
    pattern = "cloth_camouflage" if uniform == "spots" else "cloth_plain"
    d.paint("top", "uniform", uniform, _UNIFORMS, surfaces.CLOTH, pattern)
    d.put("pelvis", "pelvis", "top")
    d.put_both("thigh", "trouser_thigh", "top")
    d.put_both("shank", "bloused_shank", "top")
    d.put("torso", "sweater", "top")
    d.put_both("upper_arm", "sleeve", "top")
    d.put_both("forearm", "cuff", "top")
    gear = _DARK_GEAR if uniform in ("black", "navy") else _FIELD_GEAR
    d.paint("gear", "cloth", d.rng.pick(tuple(gear)), gear, surfaces.CLOTH, "cloth_plain")
    d.put("torso", "vest", "gear")
    d.paint("hair", "hair", d.colours.hair, HAIRS, surfaces.HAIR)
    d.put("head", "hair_short", "hair")
    headgear = d.rng.weighted({"helmet": 0.5, "cap": 0.3, "none": 0.2})
    if headgear != "none":
        d.put("head", headgear, "top" if d.rng.chance(0.6) else "gear")
    d.shoes(d.rng.pick(("black", "brown")), "black")
    d.put_both("shank", "boot_shaft", "shoe")
    return d.look(build)


def _top(d: _Dresser, *, female: bool, sitting: bool) -> str:
    """Dress the trunk and the arms, and return the kind of garment."""
    kinds = {"tshirt": 0.27, "sweater": 0.20, "shirt": 0.13, "jacket": 0.20, "hoodie": 0.12}
    if not sitting:
        kinds |= {"coat": 0.08} | ({"dress": 0.12} if female else {})
    kind = d.rng.weighted(kinds)
    pattern = d.rng.unit()
    texture = "cloth_plain"
    if (kind in ("tshirt", "sweater", "dress") and pattern < 0.14) or (kind == "shirt" and pattern < 0.2):
        texture = "cloth_stripes"
    elif kind == "shirt" and pattern < 0.6:
        texture = "cloth_check"
    d.paint("top", "cloth", d.colours.shirt, TOPS, surfaces.CLOTH, texture)
    mesh = {"tshirt": "shirt", "shirt": "shirt"}.get(kind, kind)
    d.put("torso", mesh, "top")
    if kind in ("jacket", "coat"):
        under = d.rng.weighted({"white": 0.45, "grey": 0.25, "navy": 0.15, "black": 0.15})
        d.paint("under", "cloth", under, TOPS, surfaces.CLOTH, "cloth_plain")
        d.put("torso", f"{kind}_front", "under")
        if kind == "coat":
            d.put_both("thigh", "skirt_leg", "top")
    if kind in ("tshirt", "dress"):
        d.put_both("upper_arm", "short_sleeve", "top")
        d.put_both("upper_arm", "arm", "skin")
        d.put_both("forearm", "forearm", "skin")
    else:
        wide = "wide_" if kind in ("jacket", "coat", "hoodie") else ""
        d.put_both("upper_arm", f"{wide}sleeve", "top")
        d.put_both("forearm", f"{wide}cuff", "top")
    return kind


def _bottom(d: _Dresser, *, shorts: bool, skirt: bool) -> None:
    kind = d.rng.weighted(
        {"slim": 0.38, "trouser": 0.42, "wide": 0.10}
        | ({"shorts": 0.35} if shorts else {})
        | ({"skirt": 0.2} if skirt else {})
    )
    colour = d.colours.trousers
    is_denim = kind != "skirt" and (not isinstance(colour, str) or colour.startswith("denim"))
    d.paint("bottom", "cloth", colour, BOTTOMS, surfaces.CLOTH, "cloth_denim" if is_denim else "cloth_plain")
    if kind == "skirt":
        d.put("pelvis", "skirt", "bottom")
        _legs_below_a_hem(d, "bottom")
        return
    d.put("pelvis", "pelvis", "bottom")
    if kind == "shorts":
        d.put_both("thigh", "shorts_leg", "bottom")
        d.put_both("thigh", "thigh", "skin")
        d.put_both("shank", "shank", "skin")
    else:
        d.put_both("thigh", "trouser_thigh", "bottom")
        d.put_both("shank", f"{kind}_shank", "bottom")


def _legs_below_a_hem(d: _Dresser, skirt: str) -> None:
    """Add bare legs or legs in tights, with the part of the skirt that they push ahead."""
    if all(piece.part != "skirt_leg" for piece in d.pieces):  # a coat has brought them
        d.put_both("thigh", "skirt_leg", skirt)
    role = "skin"
    if d.rng.chance(0.5):
        d.paint("tights", "cloth", "black", TOPS, surfaces.CLOTH)
        role = "tights"
    d.put_both("thigh", "thigh", role)
    d.put_both("shank", "shank", role)


def _hair(d: _Dresser, *, female: bool, child: bool) -> None:
    if female:
        style = d.rng.weighted(
            {"hair_long": 0.28, "hair_bob": 0.20, "hair_bun": 0.16, "hair_tail": 0.22, "hair_full": 0.10, "cap": 0.04}
        )
    else:
        weights = {"hair_short": 0.44, "hair_full": 0.26, "bald": 0.0 if child else 0.12, "cap": 0.11, "beanie": 0.07}
        style = d.rng.weighted(weights)
    d.paint("hair", "hair", d.colours.hair, HAIRS, surfaces.HAIR)
    if style in ("cap", "beanie"):
        d.paint("hat", "cloth", d.rng.weighted(_BAG_WEIGHTS), _BAGS | TOPS, surfaces.CLOTH, "cloth_plain")
        d.put("head", "hair_tail" if female else "hair_short", "hair")
        d.put("head", style, "hat")
    elif style != "bald":
        d.put("head", style, "hair")


def _bag(d: _Dresser, *, female: bool, sitting: bool) -> None:
    kinds = {"none": 0.58, "backpack": 0.20, "shoulder_bag": 0.20 if female else 0.08, "shopping_bag": 0.10}
    kind = "none" if sitting else d.rng.weighted(kinds)
    if kind == "shopping_bag":
        d.paint("bag", "bag", d.rng.pick(tuple(_SHOPPING)), _SHOPPING, surfaces.CLOTH)
        side = d.rng.index(2)
        d.pieces.append(Piece(f"hand_{_SIDES[side]}", kind, "bag", (-d.arm_in, d.arm_in)[side]))
    elif kind != "none":
        d.paint("bag", "bag", d.rng.weighted(_BAG_WEIGHTS), _BAGS, surfaces.CLOTH, "cloth_plain")
        d.put("torso", kind, "bag")
        if kind == "backpack":
            d.put("torso", "straps", "bag")
