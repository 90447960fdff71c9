"""Firs and pines: whorls of boughs on a straight trunk. Lengths are in the height of the crown."""

from __future__ import annotations

from functools import cache

from signals._kernel import det_cos, det_sin
from signals.rotation import unit
from signals.samples import Vec3
from signals.units import TURN_RAD
from sim.scene.maps.meshes import Mesh, revolve
from sim.scene.maps.plants.bark import along, tube
from sim.scene.random_generator import RandomGenerator
from tools.art.plants.cards import CardMesh, kite, weighted

VARIANTS = 3
# Leaves, a body of foliage inside or none, and branches that are seen or none.
Conifer = tuple[Mesh, Mesh | None, Mesh | None]
_RADIUS = 0.26  # at the foot of the crown


@cache
def fir(variant: int) -> Conifer:
    """Return a fir: dense whorls, hanging at the foot and rising towards the top."""
    rng = RandomGenerator(variant, "fir.boughs")
    mesh = CardMesh.empty()
    share = 0.015
    while share < 0.93:
        long = _RADIUS * (1.0 - 0.90 * share) * 1.08
        count = 6 if share < 0.5 else 5 if share < 0.8 else 4
        start = rng.unit()
        for k in range(count):
            turn = TURN_RAD * ((k + 0.5 * rng.between(-0.4, 0.4)) / count + start)
            out = (det_cos(turn), det_sin(turn), 0.0)
            rise = -0.42 + 0.85 * share + rng.between(-0.08, 0.08)
            length = long * rng.between(0.86, 1.12)
            d = unit((out[0], out[1], rise))
            base = (0.0, 0.0, share + 0.04)
            wide = length * 1.15 * (1.0 if rng.chance(0.5) else -1.0)
            normals = _round_axis(base, d, length, rise=0.55)
            kite(mesh, base, d, (0.0, 0.0, 1.0), (length, wide), normals, fold=0.42)
        share += 0.083 * (1.0 - 0.5 * share)
    for k in range(2):
        facing = (1.0, 0.0, 0.0) if k == 0 else (0.0, 1.0, 0.0)
        base = (0.0, 0.0, 0.86)
        kite(
            mesh,
            base,
            (0.0, 0.0, 1.0),
            facing,
            (0.16, 0.07),
            _round_axis(base, (0.0, 0.0, 1.0), 0.16, rise=0.5),
            fold=0.0,
        )
    profile = [(0.03, 0.03), (0.40 * _RADIUS, 0.06), (0.24 * _RADIUS, 0.45), (0.03 * _RADIUS, 0.93)]
    lumps = [[rng.between(0.85, 1.15) for _ in range(8)] for _ in profile]
    inside = revolve(profile, 8, wobble=lambda ring, side: lumps[ring][side])
    # Twigs of the same size along and round the crown: stretched ones look like bark.
    inside.uvs = [(1.5 * u, 6.0 * v) for u, v in inside.uvs]
    return mesh, inside, None


@cache
def pine(variant: int) -> Conifer:
    """Return a young pine: open whorls that rise towards their ends."""
    rng = RandomGenerator(variant, "pine.boughs")
    mesh, wood = CardMesh.empty(), Mesh.empty()
    share = 0.03
    while share < 0.9:
        long = _RADIUS * (1.0 - 0.85 * share) * rng.between(0.95, 1.1)
        count = 5 if share < 0.7 else 4
        start = rng.unit()
        for k in range(count):
            turn = TURN_RAD * ((k + rng.between(-0.2, 0.2)) / count + start)
            out = (det_cos(turn), det_sin(turn), 0.0)
            length = long * rng.between(0.8, 1.1)
            rise = 0.05 + 0.6 * share + rng.between(-0.1, 0.15)
            base = (0.0, 0.0, share)
            d = unit((out[0], out[1], rise))
            elbow = along(base, d, 0.55 * length)
            bent = unit((out[0], out[1], rise + 0.55))
            tube(wood, [base, elbow, along(elbow, bent, 0.35 * length)], [0.007, 0.005, 0.002], 3)
            side = unit((-out[1], out[0], 0.0))
            wide = 0.95 * length * (1.0 if rng.chance(0.5) else -1.0)
            for facing, size in (
                ((0.0, 0.0, 1.0), (0.95 * length, wide)),
                (weighted((1.0, side), (0.3, out)), (0.85 * length, 0.7 * wide)),
            ):
                foot = along(base, d, 0.16 * length)
                lift = weighted((0.75, d), (0.4, bent))
                normals = _round_axis(foot, lift, size[0], rise=0.5)
                kite(mesh, foot, lift, facing, size, normals, fold=-0.25)
        share += 0.105 * (1.0 - 0.45 * share)
    for k in range(3):
        turn = TURN_RAD * k / 3.0
        base = (0.0, 0.0, 0.84)
        normals = _round_axis(base, (0.0, 0.0, 1.0), 0.18, rise=0.5)
        kite(mesh, base, (0.0, 0.0, 1.0), (det_cos(turn), det_sin(turn), 0.0), (0.18, 0.12), normals, fold=0.0)
    return mesh, None, wood


def _round_axis(base: Vec3, d: Vec3, long: float, *, rise: float) -> list[Vec3]:
    """Return the normals of a card: away from the trunk and `rise` upwards."""
    normals = []
    for share in (0.15, 0.5, 1.0, 0.5):
        x, y, _ = along(base, d, share * long)
        out = unit((x, y, 1e-6))
        normals.append(weighted((0.25 + 0.75 * share, out), (rise, (0.0, 0.0, 1.0))))
    return normals
