"""Meshes of people: each limb as a loft through cross-sections, for a body 1 m tall, scaled to its height by its user.

Every limb ends in a ball round its joint, as wide as the limb that it meets, so that no gap opens when the joint
bends. Breadths and depths are rounded from the tables of Drillis & Contini 1966 (stature, shoulders, hips) and drawn
by eye in between. Frames as in figure.py.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from tools.art.people import body_head, body_limbs, body_trunk
from tools.art.people.body_build import BUILDS, Build
from tools.art.people.loft import SmoothMesh

_MAKERS: dict[str, Callable[[Build], SmoothMesh]] = {
    "thigh": body_limbs.bare_thigh,
    "shank": body_limbs.shank,
    "trouser_thigh": body_limbs.trouser_thigh,
    "trouser_shank": body_limbs.trouser_shank,
    "slim_shank": lambda build: body_limbs.trouser_shank(build, 0.027, -0.002, 0.038),
    "wide_shank": lambda build: body_limbs.trouser_shank(build, 0.042, -0.012, 0.043),
    "bloused_shank": lambda build: body_limbs.trouser_shank(build, 0.037, 0.06, 0.042),
    "shorts_leg": body_limbs.shorts_leg,
    "shoe": body_limbs.shoe,
    "sole": body_limbs.sole,
    "boot_shaft": body_limbs.boot_shaft,
    "pelvis": body_trunk.pelvis,
    "shirt": body_trunk.shirt,
    "sweater": body_trunk.sweater,
    "jacket": body_trunk.jacket,
    "coat": body_trunk.coat,
    "hoodie": body_trunk.hoodie,
    "dress": body_trunk.dress,
    "skirt": body_trunk.skirt,
    "skirt_leg": body_trunk.skirt_leg,
    "vest": body_trunk.vest,
    "jacket_front": lambda build: body_trunk.front(build, -0.19, 0.012, 0.020),
    "coat_front": lambda build: body_trunk.front(build, 0.02, 0.014, 0.018),
    "arm": body_limbs.bare_arm,
    "sleeve": body_limbs.sleeve,
    "short_sleeve": body_limbs.short_sleeve,
    "forearm": body_limbs.forearm,
    "cuff": body_limbs.long_cuff,
    "wide_sleeve": lambda build: body_limbs.sleeve(build, 0.008),
    "wide_cuff": lambda build: body_limbs.long_cuff(build, 0.008),
    "hand": body_limbs.hand,
    "head": body_head.head,
    "hair_short": body_head.hair_short,
    "hair_full": body_head.hair_full,
    "hair_bob": body_head.hair_bob,
    "hair_long": body_head.hair_long,
    "hair_bun": body_head.hair_bun,
    "hair_tail": body_head.hair_tail,
    "cap": body_head.cap,
    "beanie": body_head.beanie,
    "helmet": body_head.helmet,
    "backpack": body_trunk.backpack,
    "straps": body_trunk.straps,
    "shoulder_bag": body_trunk.shoulder_bag,
    "shopping_bag": body_trunk.shopping_bag,
}
PARTS = tuple(_MAKERS)


@cache
def body_mesh(part: str, build: str) -> SmoothMesh:
    """Return the mesh of a part in the frame of its limb, for a body 1 m tall; `build`: a key of BUILDS."""
    return _MAKERS[part](BUILDS[build])
