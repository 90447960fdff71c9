"""Vehicles of maps: real sizes, closed skins, one instance each, and shapes for contact that follow what is seen."""

from __future__ import annotations

from fnmatch import fnmatchcase

import mujoco
import numpy as np
import pytest

from signals.rotation import NO_TURN
from sim.scene import surfaces
from sim.scene.maps import urban_delivery
from sim.scene.maps.catalog import GENERATORS
from sim.scene.maps.map_builder import MapBuilder
from sim.scene.maps.models import model as shipped
from sim.scene.maps.shipped_mesh import ShippedMesh
from sim.scene.maps.vehicles.kinds import KINDS, add_parts
from sim.scene.maps.vehicles.traffic import DrivenCar
from sim.scene.scene_map import SceneMap, actor_pose

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


def is_bead(mesh: ShippedMesh) -> np.ndarray:
    """Return which triangles are beads on the paint: open sheets of one texture coordinate."""
    uvs = mesh.uvs[mesh.triangles]
    return (uvs == uvs[:, :1]).all(axis=(1, 2))


def is_closed(mesh: ShippedMesh, chosen: np.ndarray | None = None) -> bool:
    """Return True if each edge between places belongs to two of the (chosen) triangles in opposite directions."""
    places: dict[tuple[float, ...], int] = {}
    vertices = [tuple(vertex) for vertex in mesh.vertices.tolist()]
    triangles = mesh.triangles if chosen is None else mesh.triangles[chosen]
    corners = [[places.setdefault(vertices[i], len(places)) for i in triangle] for triangle in triangles]
    edges = [(t[k], t[(k + 1) % 3]) for t in corners for k in range(3)]
    return len(set(edges)) == len(edges) and {(b, a) for a, b in edges} == set(edges)


@pytest.mark.parametrize("kind", KINDS)
def test_size_and_skin(kind: str) -> None:
    for variant in KINDS[kind]:
        parts = shipped(f"vehicles/{variant.name}").by_material()
        points = np.concatenate([mesh.vertices for mesh in parts.values()])
        size = points.max(axis=0) - points.min(axis=0)
        for value, (least, greatest) in zip(size, SIZES[kind], strict=True):
            assert least <= value <= greatest, (variant.name, size)
        assert abs(points[:, 2].min()) < 0.02
        assert is_closed(parts["paint"], ~is_bead(parts["paint"])) != variant.name.endswith("_driver")
        assert is_closed(parts["tyre"])
        # With a driver, and 42 for the gaps and the glass of the roof.
        assert 1_000 <= sum(len(mesh.triangles) for mesh in parts.values()) <= 5_200


def test_beads_of_vans_are_paint_and_lie_on_it() -> None:
    for kind in ("sedan", "van", "lorry"):
        paint = shipped(f"vehicles/{KINDS[kind][0].name}").by_material()["paint"]
        beads = is_bead(paint)
        assert beads.any() == (kind == "van")
        skin = paint.vertices[paint.triangles[~beads]].reshape(-1, 3)
        points = paint.vertices[paint.triangles[beads]].reshape(-1, 3)
        assert ((points > skin.min(axis=0) - 0.02) & (points < skin.max(axis=0) + 0.02)).all()


def stage(kind: str, variant: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    builder = MapBuilder("stage")
    builder.material("floor", surfaces.ASPHALT)
    body = builder.named_body(kind, (0.0, 0.0, 0.0), NO_TURN)
    name = KINDS[kind][2 * variant % len(KINDS[kind])].name
    add_parts(builder, body, shipped(f"vehicles/{name}"), "silver", 0)
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


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("bicycle", "motorcycle")])
def test_contact_shapes_follow_what_is_seen(kind: str) -> None:
    for variant in range(2 if len(KINDS[kind]) > 1 else 1):
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


def turned(q: np.ndarray) -> np.ndarray:
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, q)
    return R.reshape(3, 3)


def traffic(seed: int, count: int) -> SceneMap:
    return urban_delivery.generate(urban_delivery.Parameters(traffic=count), seed)


def test_velocities_of_driven_cars_are_the_derivatives_of_their_poses() -> None:
    car = next(actor for actor in traffic(1, 1).actors if isinstance(actor, DrivenCar))
    h = 100_000
    straights = 0
    for t_ns in (0, 3_210_000_000, 9_000_000_000, 14_123_000_000, 21_700_000_000):
        before, now, after = actor_pose(car, t_ns - h), actor_pose(car, t_ns), actor_pose(car, t_ns + h)
        assert np.allclose((after[0] - before[0]) / (2e-9 * h), now[2], atol=1e-4)
        for i in range(len(car.bodies)):
            # R' R^T is the cross-product matrix of the angular velocity.
            rate = (turned(after[1][i]) - turned(before[1][i])) / (2e-9 * h) @ turned(now[1][i]).T
            assert np.allclose((rate[2, 1], rate[0, 2], rate[1, 0]), now[3][i], atol=1e-3)
        assert np.linalg.norm(now[2][0]) <= car.max_speed_mps
        # On straights the tyre's lowest point rests on the road.
        contact = now[2][1:] + np.cross(now[3][1:], [0.0, 0.0, -car.shape.wheel_m])
        if abs(now[3][0, 2]) < 1e-9:
            straights += 1
            assert np.abs(contact).max() < 0.01 * car.path.speed_mps
    assert straights >= 2


def _length_m(kind: str) -> float:
    return float(shipped(f"vehicles/{kind}_driven").facts["length_m"])


def test_bound_of_a_driven_car_holds_it() -> None:
    car = next(actor for actor in traffic(1, 1).actors if isinstance(actor, DrivenCar))
    kind = next(k for k in ("sedan", "hatchback", "estate", "suv") if _length_m(k) == car.shape.length_m)
    points = np.concatenate([mesh.vertices for mesh in shipped(f"vehicles/{kind}_a_driver").by_material().values()])
    for t_ns in (0, 5_000_000_000):
        p, q, _, _ = actor_pose(car, t_ns)
        centre, radius_m = car.bound(t_ns)
        assert np.linalg.norm(p[0] + points @ turned(q[0]).T - centre, axis=1).max() <= radius_m


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_traffic_keeps_clear_of_parked_vehicles_and_of_itself(seed: int) -> None:
    scene_map = traffic(seed, 6)
    model = mujoco.MjModel.from_xml_string(scene_map.mjcf, dict(scene_map.assets))
    data = mujoco.MjData(model)
    cars = [actor for actor in scene_map.actors if isinstance(actor, DrivenCar)]
    moving = {name for car in cars for name in car.bodies}
    parked = []
    for geom in range(model.ngeom):
        name = model.body(model.geom_bodyid[geom]).name
        if (
            model.geom_group[geom] < 3
            and name not in moving
            and name.startswith(("car_", "van_", "bus_", "lorry_", "mot"))
        ):
            parked.append(geom)
    assert len(parked) > 50
    mujoco.mj_kinematics(model, data)
    for k in range(30):
        places = []
        for car in cars:
            p, q, _, _ = actor_pose(car, k * 1_000_000_000)
            R = turned(q[0])
            places.append(p[0])
            for geom in parked:
                centre = data.geom_xpos[geom] + data.geom_xmat[geom].reshape(3, 3) @ model.geom_aabb[geom, :3]
                half = np.abs(R.T @ data.geom_xmat[geom].reshape(3, 3)) @ model.geom_aabb[geom, 3:]
                gap = np.abs(R.T @ (centre - p[0])) - half - [0.5 * car.shape.length_m, 0.5 * car.shape.width_m, 0.0]
                assert max(gap[:2]) > 0.1, (car.name, model.geom(geom).name)
        for i, p in enumerate(places):
            assert all(np.linalg.norm(p - other) > 8.0 for other in places[:i])
