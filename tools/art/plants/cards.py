"""Leaf cards of a bough: twigs of leaves on triangles.

A bough fills an ellipsoid: a whole crown, one of the lobes of a crown, or a bush. Its lengths are in its longest
horizontal half axis. Its leaves stand in clumps with hollows between them. The corners' normals point away from the
middle of the bough and from that of their clump, so that light and shade show the clumps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from math import sqrt

from signals._kernel import det_cos, det_sin
from signals.rotation import cross, minus, unit
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene.maps.meshes import Mesh, Vec2
from sim.scene.maps.plants.bark import along
from sim.scene.random_generator import RandomGenerator
from tools.art.plants.growth import Skeleton, grow

Normals = Sequence[Vec3]
_GOLDEN = 0.3819660112501051  # of a turn
_STEP = 0.17


@dataclass
class CardMesh(Mesh):
    """Mesh with a normal at each vertex."""

    normals: list[Vec3] = field(default_factory=list)

    @staticmethod
    def empty() -> CardMesh:
        return CardMesh([], [], [])


@dataclass(frozen=True)
class Form:
    """Shape of a bough. `root`: where its branches start; `others`: middles of the boughs beside it."""

    axes: Vec3
    root: Vec3
    cards: int  # of the whole ellipsoid; those within another bough are left out
    card: float  # length of a card
    core: float  # size of the inner body
    clumps: int = 9
    lowest: float = -1.0  # directions below this height have no cards
    others: tuple[Vec3, ...] = ()


_LOBE, _LOBE_ROOT = (1.0, 0.925, 0.79), (-0.5, 0.0, -0.85)
_TALL, _TALL_ROOT = (1.0, 0.925, 1.25), (-0.25, 0.0, -1.2)
# The lobes of a crown are a third of a turn apart, each higher than the last; x points away from the trunk.
FORMS = {
    "whole": Form((1.0, 1.0, 0.85), (0.0, 0.0, -0.95), 64, 0.56, 0.66, clumps=13),
    "lobe_0": Form(_LOBE, _LOBE_ROOT, 50, 0.62, 0.66, others=((-0.76, 0.44, 0.46), (-0.76, -0.44, 0.92))),
    "lobe_1": Form(_LOBE, _LOBE_ROOT, 50, 0.62, 0.66, others=((-0.76, 0.44, 0.46), (-0.76, -0.44, -0.46))),
    "lobe_2": Form(_LOBE, _LOBE_ROOT, 50, 0.62, 0.66, others=((-0.76, 0.44, -0.92), (-0.76, -0.44, -0.46))),
    "tall_0": Form(_TALL, _TALL_ROOT, 50, 0.65, 0.58, others=((-0.42, 0.0, 0.61),)),
    "tall_1": Form(_TALL, _TALL_ROOT, 50, 0.65, 0.58, others=((-0.42, 0.0, -0.61),)),
    "bush": Form((1.0, 0.85, 0.8), (0.0, 0.0, -0.65), 34, 0.62, 0.66, clumps=11, lowest=-0.4),
}
_HOLLOW = 0.62  # cosine between the directions of a clump's middle and of the hollows round it
_CLUMP = 0.55  # place of a clump's middle, as a share of the axes
_INSIDE = 0.84  # size of the part of another bough that hides cards


def fan(mesh: CardMesh, base: Vec3, d: Vec3, facing: Vec3, size: Vec2, number: int, normals: Normals) -> None:
    """Add a triangle of leaves: it grows from `base` along d, its upper side faces `facing`.

    `size`: length and width; a negative width mirrors it. `number`: which fan of the texture. `normals` of base, right
    and left end.
    """
    long, wide = size
    right = unit(cross(d, facing))
    end = along(base, d, long)
    first = len(mesh.vertices)
    mesh.vertices += [base, along(end, right, 0.5 * abs(wide)), along(end, right, -0.5 * abs(wide))]
    near, far = (0.0, 1.0) if number % 2 == 0 else (1.0, 0.0)
    ends = [(far, near), (near, far)]
    mesh.uvs += [(near, near), *(ends if wide > 0.0 else reversed(ends))]
    mesh.normals += normals
    mesh.triangles.append((first, first + 1, first + 2))


def kite(mesh: CardMesh, base: Vec3, d: Vec3, facing: Vec3, size: Vec2, normals: Normals, *, fold: float) -> None:
    """Add a square of leaves that is folded along its twig, the same way. `normals` of base, right, tip and left."""
    long, wide = size
    right = unit(cross(d, facing))
    middle = along(along(base, d, 0.5 * long), cross(right, d), -fold * 0.5 * abs(wide))
    first = len(mesh.vertices)
    mesh.vertices += [
        base, along(middle, right, 0.5 * abs(wide)), along(base, d, long), along(middle, right, -0.5 * abs(wide)),
    ]  # fmt: skip
    sides = [(1.0, 0.0), (0.0, 1.0)]
    right_uv, left_uv = sides if wide > 0.0 else reversed(sides)
    mesh.uvs += [(0.0, 0.0), right_uv, (1.0, 1.0), left_uv]
    mesh.normals += normals
    mesh.triangles += [(first, first + 1, first + 2), (first, first + 2, first + 3)]


def sphere_points(count: int, start: float) -> list[Vec3]:
    """Return evenly spread directions (Fibonacci's lattice), turned about z by `start` turns."""
    points = []
    for k in range(count):
        z = 1.0 - (2.0 * k + 1.0) / count
        r = sqrt(1.0 - z * z)
        angle = TURN_RAD * ((k * _GOLDEN + start) % 1.0)
        points.append((r * det_cos(angle), r * det_sin(angle), z))
    return points


def _hidden(form: Form, n: Vec3) -> bool:
    """Return True if the surface in direction n lies within another bough."""
    for other in form.others:
        u, v, w = ((n[i] * form.axes[i] - other[i]) / form.axes[i] for i in range(3))
        if u * u + v * v + w * w < _INSIDE * _INSIDE:
            return True
    return False


def _random_direction(rng: RandomGenerator) -> Vec3:
    return unit((rng.between(-1.0, 1.0), rng.between(-1.0, 1.0), rng.between(-1.0, 1.0)))


def weighted(*terms: tuple[float, Vec3]) -> Vec3:
    """Return the unit vector along a weighted sum."""
    x = y = z = 0.0
    for w, v in terms:
        x, y, z = x + w * v[0], y + w * v[1], z + w * v[2]
    return unit((x, y, z))


@cache
def bough(form_name: str, variant: int, droop: float) -> tuple[CardMesh, Skeleton]:
    """Return the leaf cards and the branches."""
    form = FORMS[form_name]
    a, b, c = form.axes
    rng = RandomGenerator(variant, f"bough.{form_name}.{droop}")
    directions = [n for n in sphere_points(form.cards, rng.unit()) if n[2] > form.lowest and not _hidden(form, n)]
    # Cards reach out where a clump is, and stay behind between clumps: the outline is uneven.
    clumps = sphere_points(form.clumps, rng.unit())
    targets, middles = [], []
    for x, y, z in directions:
        near, clump = max((x * p[0] + y * p[1] + z * p[2], p) for p in clumps)
        within = min(max((near - _HOLLOW) / (1.0 - _HOLLOW), 0.0), 1.0)
        r = rng.between(0.64, 0.74) + 0.25 * within
        targets.append((r * a * x, r * b * y, r * c * z))
        middles.append((_CLUMP * a * clump[0], _CLUMP * b * clump[1], _CLUMP * c * clump[2]))
    skeleton = grow(form.root, targets, step=_STEP, tip_radius=0.0055, droop=droop)
    cards = CardMesh.empty()
    for k, (n, target) in enumerate(zip(directions, targets, strict=True)):
        out = unit((n[0] / a, n[1] / b, n[2] / c))
        before = skeleton.nodes[skeleton.parent[skeleton.tips[k]]]
        twig = unit(minus(target, before))
        # A card lies along the surface of the crown, tilted at random.
        facing = weighted((1.0, out), (0.60, _random_direction(rng)), (0.15, (0.0, 0.0, 1.0)))
        way = weighted((0.25, twig), (0.85, _random_direction(rng)), (1.0, (0.0, 0.0, -0.15 - 1.6 * droop)))
        d = unit(cross(facing, cross(way, facing)))
        long = form.card * rng.between(0.85, 1.15)
        wide = 1.9 * long * (1.0 if rng.chance(0.5) else -1.0)
        base = along(target, d, -0.6 * long)
        right = unit(cross(d, facing))
        lean = cross(right, d)
        end = along(base, d, long)
        normals = []
        for corner in (base, along(end, right, 0.5 * abs(wide)), along(end, right, -0.5 * abs(wide))):
            away = unit((corner[0] / (a * a), corner[1] / (b * b), (corner[2] + 0.15) / (c * c)))
            mx, my, mz = middles[k]
            apart = unit((corner[0] - mx, corner[1] - my, corner[2] - mz))
            normals.append(weighted((0.5, away), (1.0, apart), (0.30, lean)))
        fan(cards, base, d, facing, (long, wide), k, normals)
    return cards, skeleton
