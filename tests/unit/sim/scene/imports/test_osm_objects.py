"""Parked cars, people, road details, bridges and roofs on posts of OpenStreetMap districts."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sim.frame.mujoco_backend import WorldPose
from sim.scene.imports.osm_parking import bays, street_places
from sim.scene.imports.osm_shapes import Line
from sim.scene.imports.shapes import shapely
from sim.scene.world import World
from tests.unit.sim.scene.imports.test_osm_map import extent, geoms_of, square, world_of
from tests.worlds.example_places import _Extract

pytest.importorskip("shapely")
PLACED = ("car", "van", "person", "tree")


def town(**more: str) -> str:
    """Return a quarter with a parking area, streets, footways, a wood, houses, a pond and a wall."""
    out = _Extract()
    out.way([(-90, 20), (0, 20), (90, 20)], highway="secondary", lanes="4", sidewalk="both", width="14")
    out.way([(-60, -80), (-60, 20), (-60, 80)], highway="residential", sidewalk="both", parking__both="lane")
    out.way([(60, -80), (60, 80)], highway="residential", **more)
    out.way([(-85, 40), (85, 40)], highway="footway")
    out.way([(-90, -70), (90, -66)], railway="rail")
    out.ring(square(25, -16, 22, 14), amenity="parking")
    out.ring(square(-30, 45, 10, 7), building="house", building__levels="2")
    out.ring(square(8, -16, 3, 3), building="yes", building__levels="1")  # on the parking area
    out.ring(square(62, 30, 4, 4), building="yes")  # on a street
    out.ring(square(30, 60, 12, 10), natural="water")
    out.ring([(-90, 60), (-70, 60), (-70, 90), (-90, 90)], natural="wood")
    out.way([(30, 30), (50, 48)], barrier="wall")  # across the footway
    out.spot(0, 20, highway="crossing", crossing="zebra")
    for x, y in ((10, 34), (-31, 47), (25, -16), (-41, 47)):
        out.spot(x, y, natural="tree")
    return out.xml()


def solids(world: World, data: mujoco.MjData) -> dict[str, list[tuple[int, np.ndarray, np.ndarray]]]:
    """Return solid geoms with their bounds of every instance that is not ground."""
    found: dict[str, list[tuple[int, np.ndarray, np.ndarray]]] = {}
    for geom in np.flatnonzero(world.model.geom_contype).tolist():
        name = world.instance_names[world.geom_instance[geom]]
        if name == "ground":
            continue
        R = data.geom_xmat[geom].reshape(3, 3)
        centre = data.geom_xpos[geom] + R @ world.model.geom_aabb[geom, :3]
        half = np.abs(R) @ world.model.geom_aabb[geom, 3:]
        found.setdefault(name, []).append((geom, centre - half, centre + half))
    return found


def overlapping(world: World, data: mujoco.MjData) -> list[tuple[str, str]]:
    """Return pairs of instances, at least one of them placed, whose solids are more than 2 cm in each other."""
    pairs = []
    segment = np.zeros(6)
    for (a, geoms_a), (b, geoms_b) in combinations(solids(world, data).items(), 2):
        kinds = {name.split("_")[0] for name in (a, b)}
        if not kinds & set(PLACED) or kinds == {"tree"}:  # crowns of a wood touch
            continue
        for g, low_g, high_g in geoms_a:
            for h, low_h, high_h in geoms_b:
                near = (low_g < high_h).all() and (low_h < high_g).all()
                if near and mujoco.mj_geomDistance(world.model, data, g, h, 0.01, segment) < -0.02:
                    pairs.append((a, b))
    return pairs


def count(world: World, *kinds: str) -> int:
    return sum(name.split("_")[0] in kinds for name in world.instance_names)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_objects_stand_in_nothing_and_have_their_classes(seed: int, tmp_path: Path) -> None:
    world = world_of(tmp_path, town(), radius_m=95, objects=f"{{seed: {seed}, density: 1.5}}")
    data = WorldPose(world).at(0)
    assert not overlapping(world, data)
    assert count(world, "car", "van") > 20
    assert count(world, "person") > 5
    assert len(world.map.actors) > 0
    for name, kind in (("car", "vehicle"), ("person", "person"), ("tree", "tree")):
        of = {world.instance_names[world.geom_instance[g]] for g in geoms_of(world, kind)}
        assert {n for n in world.instance_names if n.split("_")[0] == name} <= of


def test_the_check_for_overlaps_sees_a_car_in_a_house(tmp_path: Path) -> None:
    world = world_of(tmp_path, town(), radius_m=95, objects="{seed: 1}")
    data = WorldPose(world).at(0)
    cars = [b for b in range(world.model.nbody) if world.model.body(b).name.startswith("car_")]
    data.xpos[cars[0]] = (-30.0, 45.0, 0.0)
    moved = world.model.body_pos[cars[0]].copy()
    world.model.body_pos[cars[0]] = (-30.0, 45.0, 0.0)
    mujoco.mj_kinematics(world.model, data)
    assert overlapping(world, data)
    world.model.body_pos[cars[0]] = moved


def test_objects_follow_the_seed_and_are_off_by_default(tmp_path: Path) -> None:
    plain = world_of(tmp_path, town(), radius_m=95)
    assert count(plain, "car", "van", "person") == 0
    first = world_of(tmp_path, town(), radius_m=95, objects="{seed: 1}")
    other = world_of(tmp_path, town(), radius_m=95, objects="{seed: 2}")
    again = world_of(tmp_path, town(name="Lane"), radius_m=95, objects="{seed: 1}")  # not the cached world
    assert again.map.mjcf == first.map.mjcf
    assert other.map.mjcf != first.map.mjcf
    none = world_of(tmp_path, town(), radius_m=95, objects="{max_cars: 3, max_people: 0}")
    assert (count(none, "car", "van"), count(none, "person")) == (3, 0)
    assert any("max_cars stay empty" in note for note in none.map.notes)


def test_no_street_moves_the_cars_of_another(tmp_path: Path) -> None:
    """A street more takes places, and leaves all others where they are."""

    def cars(text: str) -> set[tuple[float, ...]]:
        model = world_of(tmp_path, text, radius_m=95, objects="{seed: 4}").model
        names = [model.body(b).name for b in range(model.nbody)]
        return {tuple(model.body_pos[b].round(6)) for b, n in enumerate(names) if n.startswith(("car_", "van_"))}

    before, after = cars(town()), cars(town().replace('v="lane"', 'v="no"'))
    street = {place for place in before if -64 < place[0] < -56}
    assert street
    assert before - street == after


@pytest.mark.parametrize(
    ("tags", "sides", "offset_m"),
    [
        ({"highway": "residential", "parking:both": "lane"}, {-1.65, 1.65}, 1.65),
        ({"highway": "residential", "parking:left": "on_kerb", "parking:right": "no"}, {3.85}, 3.85),
        ({"highway": "tertiary", "parking:lane:right": "perpendicular"}, {-5.95}, 5.95),
        ({"highway": "residential"}, {-1.65}, 1.65),
        ({"highway": "primary"}, set(), 0.0),
        ({"highway": "residential", "parking:both": "no"}, set(), 0.0),
    ],
)
def test_where_cars_park_along_a_street(tags: dict[str, str], sides: set[float], offset_m: float) -> None:
    """A street to the east, so that its left is north: half the width, less or more the half of a car."""
    line = Line("w1", tags, ((0.0, 0.0), (60.0, 0.0)), (1, 2), closed=False)
    places = list(street_places(line, shapely.STRtree([])))
    assert {round(place.y, 6) for place in places} == sides
    if tags.get("parking:lane:right") == "perpendicular":
        assert np.cos([p.heading_rad for p in places]) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("corners", "places", "heading"),
    [
        (((0, 0), (5, 0), (5, 2.5), (0, 2.5)), [(2.5, 1.25)], (1.0, 0.0)),  # a bay
        (((0, 0), (2.5, 0), (2.5, 5), (0, 5)), [(1.25, 2.5)], (0.0, 1.0)),
        (((0, 0), (18, 0), (18, 2.5), (0, 2.5)), [(3, 1.25), (9, 1.25), (15, 1.25)], (1.0, 0.0)),  # along a kerb
        (((0, 0), (7.8, 0), (7.8, 5), (0, 5)), [(1.3, 2.5), (3.9, 2.5), (6.5, 2.5)], (0.0, 1.0)),  # a row
        (((0, 0), (20, 0), (20, 1.5), (0, 1.5)), [], (1.0, 0.0)),  # too narrow
    ],
)
def test_bays_of_a_parking_area(
    corners: tuple[tuple[float, float], ...], places: list[tuple[float, float]], heading: tuple[float, float]
) -> None:
    found = list(bays(shapely.Polygon(corners), "w1"))
    assert sorted((round(p.x, 6), round(p.y, 6)) for p in found) == places
    for place in found:  # a row's cars stand either way along the heading
        along = np.cos(place.heading_rad) * heading[0] + np.sin(place.heading_rad) * heading[1]
        assert abs(along) == pytest.approx(1.0)


def ray(world: World, start: tuple[float, float, float], way: tuple[float, float, float]) -> tuple[float, str]:
    """Return the distance to what is solid along a ray, and its instance."""
    data, geom = WorldPose(world).at(0), np.full((1, 1), -1, np.int32)
    solid = world.model.geom_group.copy()
    world.model.geom_group[:] = np.where(world.model.geom_contype > 0, 0, 5)
    columns = (np.array(v, float).reshape(3, 1) for v in (start, way))
    groups = np.array([1, 0, 0, 0, 0, 0], np.uint8)
    distance = float(mujoco.mj_ray(world.model, data, *columns, groups, 1, -1, geom))
    world.model.geom_group[:] = solid
    return distance, world.instance_names[world.geom_instance[geom[0, 0]]] if geom[0, 0] >= 0 else ""


def test_a_bridge_is_a_deck_that_can_be_flown_under(tmp_path: Path) -> None:
    out = _Extract()
    out.way([(-60, -40), (60, -40)], highway="primary", bridge="yes", layer="1", lanes="2")
    out.way([(10, -80), (10, 0)], highway="residential")
    out.way([(-30, 30), (-24, 30)], highway="footway", bridge="yes", layer="1")
    world = world_of(tmp_path, out.xml())
    assert ray(world, (10.0, -40.0, 0.5), (0, 0, 1)) == (pytest.approx(4.2), "road_001")  # 5.5 m less a deck of 0.8 m
    assert ray(world, (10.0, -60.0, 2.5), (0, 1, 0))[0] == -1.0 or ray(world, (10.0, -60.0, 2.5), (0, 1, 0))[0] > 40.0
    assert ray(world, (10.0, -40.0, 20.0), (0, 0, -1))[0] == pytest.approx(14.5)
    assert ray(world, (-59.5, -60.0, 2.0), (0, 1, 0))[1].startswith("wall_")  # its abutment
    notes = " / ".join(world.map.notes)
    assert "1 bridges are decks in the air" in notes
    assert "1 short bridges lie on the ground" in notes


def test_a_roof_without_walls_stands_on_posts(tmp_path: Path) -> None:
    out = _Extract()
    out.ring(square(30, 0, 6, 4), building="roof", height="5")
    out.ring(square(40, 0, 4, 4), building="yes", height="6")  # on which one side of it rests
    world = world_of(tmp_path, out.xml())
    data = WorldPose(world).at(0)
    posts = [g for g in range(world.model.ngeom) if world.model.geom_type[g] == mujoco.mjtGeom.mjGEOM_CYLINDER]
    places = data.geom_xpos[posts, :2]
    for corner in ((24.35, 3.65), (24.35, -3.65)):
        assert np.linalg.norm(places - corner, axis=1).min() < 0.05
    assert places[:, 0].max() < 36.0
    for g in posts:
        z = data.geom_xpos[g, 2]
        assert z - world.model.geom_size[g, 1] == pytest.approx(0.0, abs=1e-6)
        assert z + world.model.geom_size[g, 1] == pytest.approx(4.7, abs=1e-6)
    assert ray(world, (20.0, 1.0, 2.0), (1, 0, 0))[0] == pytest.approx(16.0, abs=0.05)  # open up to the building
    edge = [g for g in geoms_of(world, "building") if world.geom_visible[g] and g not in posts]
    assert extent(world, edge)[0][2] == pytest.approx(4.7, abs=1e-3)  # no wall hangs below it


@pytest.mark.parametrize(
    ("tags", "under_m"),
    [
        ({"building": "yes", "height": "12", "min_height": "5"}, 5.0),
        ({"building": "yes", "building__levels": "4", "building__min_level": "2"}, 6.0),
        ({"building": "bridge", "building__levels": "2"}, 4.5),
    ],
)
def test_what_does_not_stand_on_the_ground_is_open_below(tags: dict[str, str], under_m: float, tmp_path: Path) -> None:
    out = _Extract()
    out.ring(square(30, 0, 6, 4), **tags)
    world = world_of(tmp_path, out.xml())
    assert ray(world, (30.0, 0.0, 0.5), (0, 0, 1))[0] == pytest.approx(under_m - 0.5, abs=0.01)
    geoms = [*geoms_of(world, "building"), *geoms_of(world, "house")]
    low, _ = extent(world, [g for g in geoms if world.geom_visible[g]])
    assert low[2] == pytest.approx(under_m, abs=0.01)
    faces = [g for g in geoms if world.model.geom(g).name.endswith("underside")]
    assert len(faces) == 1


@pytest.mark.parametrize(
    ("tags", "base_m", "top_m"),
    [
        ({"height": "4", "min_height": "12"}, 3.5, 4.0),
        ({"height": "6", "min_height": "6"}, 5.5, 6.0),
        ({"building__levels": "2", "building__min_level": "5"}, 5.5, 6.0),
        ({"height": "6", "min_height": "5.9"}, 5.9, 6.4),  # a thin roof: no contradiction
    ],
)
def test_a_base_above_the_top_is_told_and_the_top_counts(
    tags: dict[str, str], base_m: float, top_m: float, tmp_path: Path
) -> None:
    out = _Extract()
    out.ring(square(30, 0, 6, 4), building="yes", roof__shape="flat", **tags)
    world = world_of(tmp_path, out.xml())
    geoms = [g for g in [*geoms_of(world, "building"), *geoms_of(world, "house")] if world.geom_visible[g]]
    low, high = extent(world, geoms)
    assert (low[2], high[2]) == pytest.approx((base_m, top_m), abs=0.01)
    told = "1 buildings state min_height above height: the height counts"
    assert (told in world.map.notes) is (base_m < 5.9)


def test_a_zebra_crossing_and_rails_are_where_their_ways_are(tmp_path: Path) -> None:
    world = world_of(tmp_path, town(), radius_m=95, objects="{seed: 1}")
    low, high = extent(world, geoms_of(world, "crossing"))
    np.testing.assert_allclose(low[:2], (-1.5, 13.25), atol=0.3)
    np.testing.assert_allclose(high[:2], (1.5, 26.75), atol=0.3)
    rails = [g for g in geoms_of(world, "object") if world.geom_visible[g]]
    low, high = extent(world, rails)
    assert high[2] == pytest.approx(0.17, abs=1e-3)
    assert high[1] - low[1] == pytest.approx(4.0 + 1.435 + 0.14, abs=0.15)
