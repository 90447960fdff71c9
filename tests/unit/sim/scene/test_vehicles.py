"""Vehicles of maps: real sizes, closed skins, one instance each, and shapes for contact that follow what is seen."""

from __future__ import annotations

from fnmatch import fnmatchcase

import mujoco
import numpy as np
import pytest

from sim.scene.maps import surfaces
from sim.scene.maps.catalog import GENERATORS
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.meshes import Mesh
from sim.scene.maps.vehicles.kinds import MODELS, add_vehicle
from sim.scene.random_generator import RandomGenerator

# Length, width over the mirrors and height of common vehicles [m], by data sheets: least and greatest.
SIZES = {
    "sedan": ((4.4, 4.9), (1.9, 2.15), (1.4, 1.53)),
    "hatchback": ((3.9, 4.4), (1.9, 2.1), (1.42, 1.56)),
    "estate": ((4.5, 4.95), (1.9, 2.15), (1.42, 1.56)),
    "suv": ((4.4, 4.8), (2.0, 2.2), (1.6, 1.8)),
    "van": ((4.9, 5.9), (2.2, 2.5), (2.0, 2.6)),
    "lorry": ((7.0, 9.0), (2.5, 3.0), (3.0, 3.8)),
    "bus": ((10.5, 12.2), (2.5, 3.0), (2.9, 3.3)),
    "bicycle": ((1.65, 1.9), (0.55, 0.7), (0.95, 1.15)),
    "motorcycle": ((1.95, 2.25), (0.7, 0.9), (1.05, 1.25)),
}


def is_closed(mesh: Mesh) -> bool:
    """Return True if each edge between places belongs to two triangles in opposite directions."""
    places: dict[tuple[float, ...], int] = {}
    corners = [[places.setdefault(mesh.vertices[i], len(places)) for i in triangle] for triangle in mesh.triangles]
    edges = [(t[k], t[(k + 1) % 3]) for t in corners for k in range(3)]
    return len(set(edges)) == len(edges) and {(b, a) for a, b in edges} == set(edges)


@pytest.mark.parametrize("kind", MODELS)
def test_size_and_skin(kind: str) -> None:
    for model in MODELS[kind]:
        parts = model.parts()
        points = np.array([v for mesh in parts.values() for v in mesh.vertices])
        size = points.max(axis=0) - points.min(axis=0)
        for value, (least, greatest) in zip(size, SIZES[kind], strict=True):
            assert least <= value <= greatest, (model.name, size)
        assert abs(points[:, 2].min()) < 0.02
        assert is_closed(parts["paint"]) != model.name.endswith("_driver")
        assert is_closed(parts["tyre"])
        assert 1_000 <= sum(len(mesh.triangles) for mesh in parts.values()) <= 5_100


def stage(kind: str, variant: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    builder = MapBuilder("stage")
    builder.material("floor", surfaces.ASPHALT)
    add_vehicle(builder, RandomGenerator(1, "test"), kind, 0.0, 0.0, 0.0, variant=variant, driver=0.0)
    scene_map = builder.build()
    model = mujoco.MjModel.from_xml_string(scene_map.mjcf, dict(scene_map.assets))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


def cast(model: mujoco.MjModel, data: mujoco.MjData, group: int, at: np.ndarray, way: np.ndarray) -> float:
    chosen = np.zeros(6, np.uint8)
    chosen[group] = 1
    distance = mujoco.mj_ray(model, data, at, way, chosen, 1, -1, np.zeros(1, np.int32))
    return float(distance) if distance >= 0.0 else np.inf


@pytest.mark.parametrize("kind", [kind for kind in MODELS if kind not in ("bicycle", "motorcycle")])
def test_contact_shapes_follow_what_is_seen(kind: str) -> None:
    for variant in range(2 if len(MODELS[kind]) > 1 else 1):
        model, data = stage(kind, variant)
        half = 0.5 * np.array([sum(limits) / 2 for limits in SIZES[kind]])
        rng = np.random.default_rng(3)
        apart = []
        for _ in range(400):
            # From the sides and from above, across the middle.
            azimuth, up = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, 1.2)
            way = -np.array([np.cos(azimuth) * np.cos(up), np.sin(azimuth) * np.cos(up), np.sin(up)])
            through = np.array(
                [rng.uniform(-0.8, 0.8) * half[0], rng.uniform(-0.5, 0.5) * half[1], rng.uniform(0.4, 0.9) * half[2]]
            )
            at = through - 15.0 * way
            seen, solid = cast(model, data, 0, at, way), cast(model, data, 3, at, way)
            if np.isfinite(seen):
                apart.append(solid - seen)
        # Rays between tyre and arch go on to the far side; elsewhere nothing solid stands out.
        assert np.mean(np.array(apart) < -0.03) < 0.035, kind
        assert np.quantile(apart, 0.9) < 0.1, (kind, np.quantile(apart, (0.5, 0.8, 0.9, 0.95)))


def test_the_suburb_mixes_kinds_each_one_instance() -> None:
    generator = GENERATORS["urban_delivery"]
    bodies = set()
    for seed in (1, 2, 3):
        scene_map = generator.generate(generator.parameters(), seed)
        model = mujoco.MjModel.from_xml_string(scene_map.mjcf, dict(scene_map.assets))
        names = [model.body(i).name for i in range(1, model.nbody)]
        vehicles = [n for n in names if any(fnmatchcase(n, glob) for glob in scene_map.classes["vehicle"])]
        assert len(vehicles) == 14 + 3  # parked, and the depot's
        assert all(model.body(name).parentid == 0 for name in vehicles)
        bodies |= {name.rsplit("_", 1)[0] for name in vehicles}
    assert bodies == {"car", "van", "lorry", "bus"}
