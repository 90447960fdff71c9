"""Files that tools/art makes: by path below sim/scene/assets, the function that returns the bytes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, get_args

from sim.scene.maps.meshes import Mesh
from sim.scene.maps.objects.animals import BIRD_SCALE
from sim.scene.maps.objects.dog_coat import COATS
from sim.scene.maps.plants.species import SPECIES
from sim.scene.maps.season import Season
from sim.scene.maps.texture_tools import png
from tools.art.glb import Pieces, glb
from tools.art.objects import animals, belongings, bench, dog, street_signs
from tools.art.people import wheelchair
from tools.art.people.body_build import BUILDS
from tools.art.people.body_meshes import PARTS, body_mesh
from tools.art.plants import conifers
from tools.art.plants.branches import branches
from tools.art.plants.cards import FORMS, bough
from tools.art.png import quantised
from tools.art.textures import cloth, facade_tiles, fur, leaves, plain, vehicles
from tools.art.textures.stop_sign import stop_sign
from tools.art.vehicles import catalog as vehicle_models

SEASONS: tuple[Season, ...] = get_args(Season)
_TWIG = 0.007  # least radius of a bare tree's branches, in the size of a bough
# Boughs that trees and bushes have: form, number of variants, and how much the branches of their species droop.
_BOUGHS = (
    ("whole", 2, 0.0), ("lobe_0", 2, 0.0), ("lobe_1", 2, 0.0), ("lobe_2", 2, 0.0),
    ("tall_0", 2, SPECIES["birch"].droop), ("tall_1", 2, SPECIES["birch"].droop), ("bush", 3, 0.0),
)  # fmt: skip
_INSIDE = 0.95  # brightness of the inside of a crown to that of its leaves
_HEDGE = 1.15


def _textures() -> dict[str, Callable[[], bytes]]:
    made: dict[str, Callable[[], Any]] = {name: partial(_drawn, make) for name, make in plain.MAKERS.items()}
    made |= {name: partial(cloth.pixels, name) for name in cloth.MAKERS}
    made |= {f"fur_{name}": partial(fur.coat, name) for name in COATS}
    for season in SEASONS:
        for name, species in SPECIES.items():
            if name != "hedge":
                made[f"leaves_{name}_{season}"] = partial(leaves.leaves, name, season)
            if name not in ("hedge", "pine") and species.leaves(season) is not None:
                made[f"inside_{name}_{season}"] = partial(leaves.foliage, name, season, _INSIDE, 4)
        made[f"foliage_hedge_{season}"] = partial(leaves.foliage, "hedge", season, _HEDGE, 2)
    for style in facade_tiles.STYLES:
        made[f"facade_{style}_upper"] = partial(facade_tiles.upper, style)
        made[f"facade_{style}_ground"] = partial(facade_tiles.ground, style, shops=False)
        made[f"facade_{style}_shops"] = partial(facade_tiles.ground, style, shops=True)
    for number in range(vehicles.PLATES):
        made[f"plate_{number}"] = partial(vehicles.plate, number)
    for number in range(vehicles.BOXES):
        made[f"vehicle_box_{number}"] = partial(vehicles.box_body, number)
    made |= {
        "paint_reflection": vehicles.reflection,
        "vehicle_glass": vehicles.glass,
        "stop_sign": stop_sign,
    }
    return {f"textures/{name}.png": partial(_png, make) for name, make in made.items()}


def _drawn(make: Callable[[], plain.Image]) -> Any:
    return quantised(make())


def _png(make: Callable[[], Any]) -> bytes:
    return png(make(), level=9)  # MuJoCo reads them as fast compressed as not


def _models() -> dict[str, Callable[[], bytes]]:
    made: dict[str, Callable[[], tuple[Pieces, dict[str, Any]]]] = {}
    for name, make in vehicle_models.MODELS.items():
        made[f"vehicles/{name}"] = make
    for build in BUILDS:
        made[f"people/{build}"] = partial(_person, build)
    made["people/wheelchair"] = _wheelchair
    for form, variants, droop in _BOUGHS:
        for variant in range(variants):
            made[f"plants/{form}{'_drooping' if droop else ''}_{variant}"] = partial(_bough, form, variant, droop)
    for variant in range(conifers.VARIANTS):
        made[f"plants/fir_{variant}"] = partial(_conifer, conifers.fir, variant)
        made[f"plants/pine_{variant}"] = partial(_conifer, conifers.pine, variant)
    for kind in BIRD_SCALE:
        made[f"objects/bird_{kind}"] = partial(_object, partial(animals.bird, kind))
    for name, parts in (
        ("dog", dog.dog), ("backpack", belongings.backpack), ("parasol", belongings.parasol),
        ("pot", belongings.pot), ("bench", bench.bench), ("traffic_light", street_signs.signal),
        ("stop_sign", street_signs.stop_sign),
    ):  # fmt: skip
        made[f"objects/{name}"] = partial(_object, parts)
    return {f"models/{name}.glb": partial(_glb, name, make) for name, make in made.items()}


def _glb(name: str, make: Callable[[], tuple[Pieces, dict[str, Any]]]) -> bytes:
    return glb(name.rpartition("/")[2], *make())


def _object(make: Callable[[], dict[str, Mesh]]) -> tuple[Pieces, dict[str, Any]]:
    return {piece: {"": mesh} for piece, mesh in make().items()}, {}


def _person(build: str) -> tuple[Pieces, dict[str, Any]]:
    meshes = {part: body_mesh(part, build) for part in PARTS}
    radius = {part: mesh.radius for part, mesh in meshes.items()}
    return {part: {"": mesh} for part, mesh in meshes.items()}, {"radius": radius}


def _wheelchair() -> tuple[Pieces, dict[str, Any]]:
    made = {"tyres": wheelchair.tyres, "frame": wheelchair.frame, "seat": wheelchair.seat}
    return {piece: {"": make()} for piece, make in made.items()}, {"farthest_m": wheelchair.farthest_m()}


def _bough(form: str, variant: int, droop: float) -> tuple[Pieces, dict[str, Any]]:
    cards, skeleton = bough(form, variant, droop)
    pieces: Pieces = {"leaves": {"": cards}, "wood": {"": branches(skeleton, least_radius=_TWIG)}}
    return pieces, {"core": FORMS[form].core, "axes": FORMS[form].axes}


def _conifer(make: Callable[[int], conifers.Conifer], variant: int) -> tuple[Pieces, dict[str, Any]]:
    pieces = zip(("leaves", "inside", "wood"), make(variant), strict=True)
    return {piece: {"": mesh} for piece, mesh in pieces if mesh is not None}, {}


FILES: dict[str, Callable[[], bytes]] = _textures() | _models()
