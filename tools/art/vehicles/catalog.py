"""Models of vehicles: pieces, contact shapes and measures of each."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from sim.scene.maps.meshes import Mesh
from sim.scene.maps.vehicles import bicycle_layout
from tools.art.glb import Pieces
from tools.art.vehicles import bicycle
from tools.art.vehicles.bus import bus_parts, bus_proxies
from tools.art.vehicles.car import car_parts, car_proxies, wheel_centres, wheel_parts
from tools.art.vehicles.car_shape import SHAPES, CarShape, varied
from tools.art.vehicles.lorry import lorry_parts, lorry_proxies
from tools.art.vehicles.motorcycle import motorcycle_parts, motorcycle_proxies
from tools.art.vehicles.paint import reflecting, with_beads
from tools.art.vehicles.parts import BEAD, Parts, Proxy

Made = tuple[Pieces, dict[str, Any]]
_DRIVEN = ("sedan", "hatchback", "estate", "suv")


def _made(pieces: dict[str, Parts], proxies: list[Proxy], **facts: object) -> Made:
    """Return pieces with texture coordinates of paint, hulls as pieces of their own, and the facts."""
    whole: dict[str, Parts] = {piece: _painted(parts) for piece, parts in pieces.items()}
    contacts: list[dict[str, Any]] = []
    for i, proxy in enumerate(proxies):
        if proxy.hull is not None:
            whole[f"contact_{i}"] = {"": proxy.hull}
            contacts.append({"kind": "hull", "piece": f"contact_{i}"})
        else:
            contacts.append({"kind": proxy.kind, "size": proxy.size, "pos": proxy.pos})
    return whole, {"contact": contacts, **facts}


def _painted(parts: Parts) -> Parts:
    """Return the parts with texture coordinates of the paint, and with the beads as a part of it."""
    if "paint" not in parts:
        return parts
    paint = with_beads(reflecting(parts["paint"]), parts.get(BEAD, Mesh.empty()))
    return {name: mesh for name, mesh in parts.items() if name != BEAD} | {"paint": paint}


def _parked(shape: CarShape, spokes: int, driver: bool) -> Made:
    parts = car_parts(shape, spokes=spokes, driver=driver)
    return _made({"body": parts}, car_proxies(shape), **_sizes(shape))


def _driven(shape: CarShape) -> Made:
    pieces = {
        "chassis": car_parts(shape, driver=True, wheels=False),
        "wheel_left": wheel_parts(shape, 5, 1.0),
        "wheel_right": wheel_parts(shape, 5, -1.0),
    }
    return _made(pieces, car_proxies(shape)[:2], **_sizes(shape))


def _sizes(shape: CarShape) -> dict[str, Any]:
    return {
        "length_m": shape.length_m, "width_m": shape.width_m, "height_m": shape.height_m, "wheel_m": shape.wheel_m,
        "wheels_m": wheel_centres(shape),
    }  # fmt: skip


def _whole(parts: Callable[[], Parts], proxies: Callable[[], list[Proxy]]) -> Made:
    return _made({"body": parts()}, proxies())


def _ridden() -> Made:
    pieces = {
        "frame": bicycle.frame_parts(), "saddle": bicycle.saddle_parts(), "wheel": bicycle.wheel_parts(),
        "cranks": bicycle.crank_parts(), "pedal_l": bicycle.pedal_parts(1.0), "pedal_r": bicycle.pedal_parts(-1.0),
    }  # fmt: skip
    sizes = {"length_m": bicycle_layout.LENGTH_M, "width_m": bicycle_layout.WIDTH_M}
    return _made(pieces, bicycle.bicycle_proxies(), **sizes)


MODELS: dict[str, Callable[[], Made]] = {}
for kind, shape in SHAPES.items():
    for end, stretch, rise, spokes in (("a", 1.0, 1.0, 5), ("b", 0.965, 1.02, 10)):
        changed = varied(shape, stretch, rise)
        MODELS[f"{kind}_{end}"] = partial(_parked, changed, spokes, False)
        MODELS[f"{kind}_{end}_driver"] = partial(_parked, changed, spokes, True)
for kind in _DRIVEN:
    MODELS[f"{kind}_driven"] = partial(_driven, SHAPES[kind])
MODELS |= {
    "bus": partial(_whole, bus_parts, bus_proxies),
    "lorry": partial(_whole, lorry_parts, lorry_proxies),
    "bicycle": partial(_whole, bicycle.bicycle_parts, bicycle.bicycle_proxies),
    "motorcycle": partial(_whole, motorcycle_parts, motorcycle_proxies),
    "bicycle_ridden": _ridden,
}
