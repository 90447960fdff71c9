"""Domain randomisation: limits, streams that leave each other alone, and what comes of it in worlds and benches."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from hil.config import load_bench, save_bench
from signals.errors import ConfigError
from sim.frame.camera_model import CameraModel
from sim.frame.geometry import FrameGeometry
from sim.frame.renderer import FrameRenderer
from sim.physics.contact_model import build_model
from sim.physics.take_off import take_off_problem
from sim.physics.vehicle import load_vehicle
from sim.randomize.light import black_body, draw_light, draw_weather
from sim.randomize.settings import FEATURES, HazeLimits, LightLimits, NoiseLimits, Randomize, TextureLimits
from sim.randomize.variant import drawn, randomized
from sim.scene.added_object import OBJECT
from sim.scene.appearance import OBJECT_KINDS
from sim.scene.classes import GROUND_CLASSES
from sim.scene.scene import Box, Scene, load_scene, scene_names
from sim.scene.surface_appearance import draw_surface
from sim.scene.weather import Weather
from sim.scene.world import World
from sim.sensors.catalog import PRESETS
from sim.sensors.noise_factor import SCALED, noise_factor, with_noise
from sim.world_loader import load_world
from tests.unit.sim.frame.test_frame_raster import digest, looking, picture
from tests.worlds.cpu_masks import ALL, output_of

SEEDS = range(60)
BOXES = tuple(Box(name=f"box_{i}", center_m=(9.0, 6.0 * i - 12.0, 1.0), size_m=(4.0, 2.0, 2.0)) for i in range(5))
YARD = load_scene("airfield").model_copy(update={"boxes": BOXES})
CAMERA = CameraModel.from_fov(80, 60, 90.0)


def of(seed: int, scene: Scene = YARD, **features: Any) -> tuple[Scene, dict[str, Any]]:
    settings = Randomize.model_validate({"seed": seed, **features})
    made = randomized(scene, settings, 0)
    return made, drawn(made, settings, load_world) or {}


def all_of(seed: int, scene: Scene = YARD) -> tuple[Scene, dict[str, Any]]:
    return of(seed, scene, **dict.fromkeys(FEATURES, True))


def test_off_is_the_scene_itself() -> None:
    assert randomized(YARD, Randomize(), 3) is YARD
    assert drawn(YARD, Randomize(), load_world) is None
    assert Randomize() == load_bench().config.randomize
    assert load_bench().random_choices() is None


def test_the_same_seed_draws_the_same_and_each_seed_something_else() -> None:
    told = [json.dumps(all_of(seed)[1], sort_keys=True) for seed in (1, 2, 3, 1)]
    assert told[0] == told[3]
    assert len(set(told)) == 3


def test_no_feature_changes_what_another_draws() -> None:
    _, everything = all_of(5)
    # Surfaces of added objects are random, too.
    own = {n: surface for n, surface in everything["textures"].items() if not n.startswith(OBJECT)}
    assert own != everything["textures"]
    everything["textures"] = own
    for feature in ("light", "haze", "textures", "people"):
        _, alone = of(5, **{feature: True})
        assert alone == {"seed": 5, feature: everything[feature]}
    # Nor do its limits, nor other surfaces, people or sensors.
    _, other = of(5, light={"brightness": (2.0, 2.0)}, haze=True, textures=True, people=True)
    assert {key: other[key] for key in ("haze", "textures", "people")} == {
        key: everything[key] for key in ("haze", "textures", "people")
    }
    fewer = of(5, YARD.model_copy(update={"boxes": BOXES[3:]}), textures=True)[1]["textures"]
    assert fewer == {name: everything["textures"][name] for name in ("ground", "box_3", "box_4")}
    three = of(5, people={"count": (3, 3), "walking_share": 0.0})[1]["people"]
    four = of(5, people={"count": (4, 4), "walking_share": 0.0})[1]["people"]
    assert four[:3] == three


def test_light_and_haze_keep_to_their_limits_and_use_them() -> None:
    limits = LightLimits()
    lights = [draw_light(limits, seed) for seed in SEEDS]
    for light in lights:
        assert 0.0 <= light.sun_azimuth_deg <= 360.0
        assert 15.0 <= light.sun_elevation_deg <= 75.0
        level = np.add(light.ambient_rgb, np.multiply(light.sun_rgb, light.to_sun_W[2]))
        assert 0.3 < level @ (0.2126, 0.7152, 0.0722) < 1.6
    azimuth, elevation = ([getattr(light, f"sun_{name}_deg") for light in lights] for name in ("azimuth", "elevation"))
    assert len(set(lights)) == len(lights)
    assert np.ptp(azimuth) > 300.0
    assert np.ptp(elevation) > 50.0
    seen = [draw_weather(Weather(), HazeLimits(), seed).visibility_m for seed in SEEDS]
    hazy = [v for v in seen if v is not None]
    assert 10 <= seen.count(None) <= 38  # 40 % of 60
    assert min(hazy) >= 400.0
    assert max(hazy) <= 20_000.0
    assert abs(np.mean(np.log(hazy)) - 0.5 * np.log(400.0 * 20_000.0)) < 0.6  # even in the logarithm: sd 1.13 / 6
    fixed = LightLimits(sun_azimuth_deg=(90.0, 90.0), ambient_share=(1.0, 1.0))
    east = draw_light(fixed, 1)
    assert east.to_sun_W[0] > 0.2
    assert east.to_sun_W[1] == pytest.approx(0.0, abs=1e-9)
    assert east.sun_rgb == (0.0, 0.0, 0.0)  # overcast


def test_a_black_body_is_red_below_and_blue_above_white() -> None:
    # Luminance 1, and white close to its own temperature.
    for kelvin in (2000.0, 4000.0, 6500.0, 12_000.0):
        assert np.dot(black_body(kelvin), (0.2126, 0.7152, 0.0722)) == pytest.approx(1.0)
    assert np.allclose(black_body(6500.0), 1.0, atol=0.06)
    warm, cool = black_body(2856.0), black_body(10_000.0)
    assert warm[0] > 1.5 > 1.0 > warm[2]
    assert cool[2] > 1.3 > cool[0]
    # CIE illuminant A, 2856 K: x 0.4476, y 0.4074.
    r, g, b = warm
    X, Y, Z = (
        0.4124564 * r + 0.3575761 * g + 0.1804375 * b,
        0.2126729 * r + 0.7151522 * g + 0.0721750 * b,
        0.0193339 * r + 0.1191920 * g + 0.9503041 * b,
    )
    assert pytest.approx(0.4476, abs=2e-3) == X / (X + Y + Z)
    assert pytest.approx(0.4074, abs=2e-3) == Y / (X + Y + Z)


def test_surfaces_change_within_their_limits() -> None:
    limits = TextureLimits()
    looks = [draw_surface(limits, seed, name, keeps_hue=False) for seed in range(20) for name in ("grass", "brick")]
    assert all(-20.0 <= look.hue_deg <= 20.0 and 0.7 <= look.scale <= 1.5 for look in looks)
    assert len({look.brightness for look in looks}) == 40
    assert draw_surface(limits, 3, "skin_a", keeps_hue=True).hue_deg == 0.0
    texels = np.random.default_rng(1).integers(40, 200, (16, 8, 3)).astype(np.uint8)
    plain = TextureLimits(hue_deg=(0.0, 0.0), brightness=(1.0, 1.0), contrast=(1.0, 1.0), scale=(1.0, 1.0), shift=False)
    same = draw_surface(plain, 1, "x", keeps_hue=False)
    assert np.abs(same.texels(texels).astype(int) - texels).max() <= 1
    assert same.colour((0.2, 0.4, 0.6)) == pytest.approx((0.2, 0.4, 0.6))
    third = draw_surface(plain.model_copy(update={"hue_deg": (120.0, 120.0)}), 1, "x", keeps_hue=False)
    assert third.colour((0.2, 0.4, 0.6)) == pytest.approx((0.6, 0.2, 0.4))  # red becomes green
    flat = draw_surface(plain.model_copy(update={"contrast": (0.0, 0.0)}), 1, "x", keeps_hue=False)
    assert np.ptp(flat.texels(texels), axis=(0, 1)).max() == 0
    half = draw_surface(plain.model_copy(update={"brightness": (0.5, 0.5)}), 1, "x", keeps_hue=False)
    assert np.abs(half.texels(texels) - 0.5 * texels).max() <= 1.0
    moved = draw_surface(plain.model_copy(update={"shift": True}), 1, "x", keeps_hue=False)
    assert sorted(moved.texels(texels).ravel()) == sorted(same.texels(texels).ravel())
    assert not np.array_equal(moved.texels(texels), same.texels(texels))
    assert np.array_equal(moved.texels(texels, shifts=False), same.texels(texels))


def test_pictures_differ_and_geometry_does_not() -> None:
    pose = looking((-6.0, -2.0, 4.0), (9.0, 0.0, 1.0))
    plain = FrameGeometry(load_world(YARD))
    changed = FrameGeometry(load_world(of(4, textures=True, light=True)[0]))
    views = [FrameRenderer(geometry, CAMERA, shadows=True) for geometry in (plain, changed)]
    assert digest(picture(views[0], pose, "rgb")) != digest(picture(views[1], pose, "rgb"))
    same = ("depth", "segmentation", "instance", "normal", "material")
    assert digest(picture(views[0], pose, *same)) == digest(picture(views[1], pose, *same))


def base_and_peopled(name: str, seed: int) -> tuple[World, World]:
    scene = load_scene(name)
    return load_world(scene), load_world(of(seed, scene, people={"count": (8, 8)})[0])


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name == "urban_delivery" else [])
        for name in scene_names()
        if "walk" not in name  # those are radar_range
    ],
)
def test_people_stand_on_free_ground_and_everything_keeps_its_number(name: str) -> None:
    before, after = base_and_peopled(name, 11)
    n = int(before.model.ngeom)
    for label in ("geom_class", "geom_instance", "geom_surface"):
        assert np.array_equal(getattr(after, label)[:n], getattr(before, label))
    assert after.instance_names[: len(before.instance_names)] == before.instance_names
    people = after.added_people
    assert len(people) >= 6
    assert {after.class_names[k] for k in after.geom_class[n:]} == {"person"}
    assert after.instance_names[len(before.instance_names) :] == tuple(person.name for person in people)
    below = Looking(before)
    by_name = {actor.name: actor for actor in after.map.actors}
    for person in people:
        assert 1.5 <= person.height_m <= 1.95
        ways = [person.at_m[:2]]
        if person.way is not None:
            assert 0.7 <= person.speed_mps <= 1.8
            ways = [by_name[person.name].bound(t_s * 1_000_000_000)[0][:2] for t_s in range(0, 60, 4)]
        for x, y in ways:
            assert x * x + y * y > 5.9**2
            kind, height_m = below.at(x, y)
            assert kind in GROUND_CLASSES
            assert height_m == pytest.approx(person.at_m[2], abs=0.05)


@pytest.mark.parametrize("name", ["city_park", "training_village"])
def test_objects_stand_whole_on_free_ground_and_move_nobody(name: str) -> None:
    scene, people = load_scene(name), {"count": (8, 8)}
    peopled = load_world(of(11, scene, people=people)[0])
    full, told = of(11, scene, people=people, objects={"count": (2 * len(OBJECT_KINDS),) * 2})
    world = load_world(full)
    assert world.added_people == peopled.added_people
    assert world.added_objects == load_world(of(11, scene, people=people, objects={"count": (28, 28)})[0]).added_objects
    assert told["objects"] == [added.as_data() for added in world.added_objects]
    n = int(peopled.model.ngeom)
    for label in ("geom_class", "geom_instance", "geom_surface"):
        assert np.array_equal(getattr(world, label)[:n], getattr(peopled, label))
    assert world.instance_names[len(peopled.instance_names) :] == tuple(added.name for added in world.added_objects)
    below, placed = Looking(peopled), mujoco.MjData(world.model)
    mujoco.mj_kinematics(world.model, placed)
    assert len({added.kind for added in world.added_objects}) > 8
    for added in world.added_objects:
        body = world.model.body(added.name)
        geoms = np.flatnonzero(world.model.geom_bodyid == body.id)
        assert {world.class_names[world.geom_class[geom]] for geom in geoms} == {added.class_name}
        points = np.concatenate([mesh_points(world.model, placed, geom) for geom in geoms])
        assert points[:, 2].min() == pytest.approx(added.at_m[2], abs=0.06)  # it stands on the ground
        for axis in (0, 1):
            for outermost in (points[points[:, axis].argmin()], points[points[:, axis].argmax()]):
                kind, height_m = below.at(*outermost[:2])
                assert kind in GROUND_CLASSES, (added, kind)
                assert height_m == pytest.approx(added.at_m[2], abs=0.05)


def mesh_points(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> np.ndarray:
    """Return the vertices of a mesh geom in W, (n, 3); none of a geom of another kind."""
    mesh = model.geom_dataid[geom]
    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH:
        return np.zeros((0, 3))
    first = model.mesh_vertadr[mesh]
    vertices = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
    return np.asarray(data.geom_xpos[geom] + vertices @ data.geom_xmat[geom].reshape(3, 3).T)


def test_objects_of_each_seed_look_different() -> None:
    coats, paints = set(), set()
    for seed in range(6):
        scene, _ = of(seed, objects={"count": (4, 4), "kinds": ["dog", "sedan"]})
        materials = load_world(scene).map.surfaces
        coats |= {name for name in materials if "fur_" in name}
        paints |= {name for name in materials if "paint" in name}
    assert len(coats) > 2
    assert len(paints) > 2


def test_kinds_of_objects_are_those_asked_for() -> None:
    scene, told = of(5, objects={"count": (12, 12), "kinds": ["dog", "dog", "bird"]})
    kinds = [added["kind"] for added in told["objects"]]
    assert len(kinds) == 12
    assert set(kinds) == {"dog", "bird"}
    assert kinds.count("dog") > kinds.count("bird")
    assert len({added["heading_deg"] for added in told["objects"]}) == 12
    # They are solid, though the scene has no map.
    bare, vehicle = load_scene("airfield"), load_vehicle("x500")
    scene, told = of(5, bare, objects={"count": (12, 12)})
    assert take_off_problem(scene, vehicle) is None
    alone = build_model(bare, vehicle, contact_step_s=0.001)
    assert build_model(scene, vehicle, contact_step_s=0.001).ngeom >= alone.ngeom + len(told["objects"]) > alone.ngeom
    with pytest.raises(ValueError, match="kinds"):
        of(5, objects={"kinds": ["unicorn"]})


class Looking:
    """Straight down, by MuJoCo's rays, at what stands still."""

    def __init__(self, world: World) -> None:
        self._world, self._data = world, mujoco.MjData(world.model)
        mujoco.mj_kinematics(world.model, self._data)

    def at(self, x: float, y: float) -> tuple[str, float]:
        geom = np.zeros(1, np.int32)
        groups = np.array([1, 1, 1, 0, 0, 0], np.uint8)
        origin, down = np.array([x, y, 200.0]), np.array([0.0, 0.0, -1.0])
        distance = mujoco.mj_ray(self._world.model, self._data, origin, down, groups, 1, -1, geom)
        return self._world.class_names[self._world.geom_class[geom[0]]], 200.0 - distance


def test_people_are_solid_and_leave_room_to_take_off() -> None:
    scene, told = of(11, load_scene("airfield"), people={"count": (8, 8)})
    vehicle = load_vehicle("x500")
    assert take_off_problem(scene, vehicle) is None
    alone = build_model(load_scene("airfield"), vehicle, contact_step_s=0.001)
    assert build_model(scene, vehicle, contact_step_s=0.001).ngeom > alone.ngeom + 8 * 15
    assert len(told["people"]) == 8


HOSTILE = """<mujoco><compiler angle="radian" meshdir="m" texturedir="t"/>
<default><mesh scale="3 3 3"/><geom contype="0" conaffinity="0" group="4" rgba="1 0 0 0.5"/></default>
<asset><material name="floor" rgba="0.3 0.5 0.3 1"/></asset>
<worldbody>
<geom name="floor" type="plane" size="0 0 1" material="floor" group="0" contype="1" rgba="0.5 0.5 0.5 1"/>
<body name="tree" pos="-9 0 1"><geom type="sphere" size="1"/></body>
</worldbody></mujoco>"""


def test_defaults_and_globs_of_a_map_do_not_reach_the_added_people(tmp_path: Path) -> None:
    (tmp_path / "map.xml").write_text(HOSTILE)
    (tmp_path / "s.yaml").write_text(
        "name: s\ndescription: d\nsite: {latitude_deg: 1, longitude_deg: 1, altitude_m: 1}\nground_friction: 0.8\n"
        "map: {mjcf: map.xml, classes: {ground: ['floor'], tree: ['*e*']}}\n"
    )
    base = load_scene(tmp_path / "s.yaml")
    world = load_world(of(2, base, people={"count": (3, 3)}, objects={"count": (3, 3), "kinds": ["sedan"]})[0])
    n = int(load_world(base).model.ngeom)
    assert [world.class_names[k] for k in world.geom_class[:n]] == ["ground", "tree"]
    assert {world.class_names[k] for k in world.geom_class[n:]} == {"person", "vehicle"}
    assert (world.geom_visible[n:] != world.geom_solid[n:]).all()  # meshes are seen, capsules touched
    assert np.abs(world.model.mesh_vert).max() < 4.0
    assert len(world.added_people) <= 3
    assert len(world.added_objects) == 3


def test_where_there_is_no_free_ground_nothing_is_added() -> None:
    none = {"count": (5, 5), "within_m": 4.0}  # all of it is kept clear
    scene, told = of(2, YARD, people=none, objects=none)
    assert told["people"] == told["objects"] == []
    assert load_world(scene).model is load_world(YARD).model


def test_errors_of_each_sensor_have_a_factor_of_their_own() -> None:
    limits = NoiseLimits(imu=(0.5, 2.0), gps=None)
    factors = {(kind, seed): noise_factor(limits, seed, kind, kind) for kind in SCALED for seed in SEEDS}
    assert all(factors["gps", seed] is None for seed in SEEDS)
    assert noise_factor(limits, 1, "radar", "radar") is None
    drawn_ = np.array([factors["imu", seed] for seed in SEEDS], float)
    assert drawn_.min() >= 0.5
    assert drawn_.max() <= 2.0
    assert abs(np.mean(np.log(drawn_))) < 0.2  # sd 0.4 / sqrt(60)
    assert len({noise_factor(limits, 1, "imu", name) for name in ("a", "b", "c")}) == 3
    for kind, preset in (("imu", "icm20689"), ("gps", "m8n"), ("lidar", "vlp16"), ("camera", "realsense_d435")):
        before = PRESETS[preset].parameters
        after = with_noise(kind, before, 2.0)
        for key in SCALED[kind]:
            assert getattr(after, key) == pytest.approx(2.0 * getattr(before, key))


def relative_sigma(noise: Any, light: float) -> float:
    n, r = noise.electrons_at_white, noise.read_noise_electrons
    return float(np.sqrt(n * light + r * r) / n)


def test_a_camera_of_twice_the_noise_has_twice_the_sigma_at_any_light() -> None:
    before = PRESETS["ov9281"].parameters
    after = with_noise("camera", before, 2.0)
    for light in (0.0, 0.02, 0.5, 1.0):
        ratio = relative_sigma(after.noise, light) / relative_sigma(before.noise, light)  # type: ignore[attr-defined]
        assert ratio == pytest.approx(2.0)
    assert with_noise("camera", PRESETS["camera_320x240"].parameters, 1.0).noise is not None  # type: ignore[attr-defined]


FRONT = "sensors.front={preset: camera_320x240, rate_hz: 10}"
EVERYTHING = "randomize={light: true, haze: true, textures: true, people: true, objects: true, noise: true}"


def test_a_saved_bench_draws_the_same_again(tmp_path: Path) -> None:
    bench = load_bench(seed=9, settings=[FRONT, EVERYTHING, "weather.visibility_m=5000"])
    again = load_bench(save_bench(bench, tmp_path))
    assert again.random_choices() == bench.random_choices()
    assert again.scene.light == bench.scene.light
    for name in bench.config.sensors:
        assert again.sensor_parameters(name) == bench.sensor_parameters(name)
    told = bench.random_choices()
    assert told is not None
    assert set(told) == {"seed", *FEATURES}
    assert told["seed"] == 9
    assert set(told["noise"]) == {"imu", "gps", "front"}
    assert bench.sensor_parameters("imu") != bench.config.sensors["imu"].parameters
    other = load_bench(seed=9, settings=[FRONT, EVERYTHING, "randomize.seed=10"])
    assert other.random_choices() != told
    assert json.loads(json.dumps(told)) is not None


def test_weather_of_the_bench_lies_over_the_scene_and_haze_over_both() -> None:
    assert load_bench(settings=["weather.visibility_m=800"]).scene.extinction_per_m == pytest.approx(3.912 / 800.0)
    clear = load_bench(settings=["weather.visibility_m=800", "randomize.haze={clear_share: 1}"])
    assert clear.scene.extinction_per_m == 0.0


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("randomize.light=3", "must be true or false, not 3"),
        ("randomize.lihgt=true", "did you mean 'randomize.light'"),
        ("randomize.haze={visibility_m: [9000, 100]}", r"must be \[least, greatest\], not \[9000, 100\]"),
        ("randomize.people={count: [0, 900]}", "must be within 0 and 60"),
        ("randomize.people={clear_m: 1}", "clear_m must be at least 4"),
        ("randomize.textures={hue: [0, 1]}", "unknown key"),
        ("randomize.noise={imu: [0, 1]}", "must be within 0.01 and 100"),
        ("randomize.seed=-1", "randomize.seed: must be at least 0"),
        ("weather={visibility_m: 1}", "visibility_m must be at least 10"),
    ],
)
def test_wrong_settings_are_reported(setting: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        load_bench(settings=[setting])


def test_errors_beyond_what_a_sensor_may_have_are_reported() -> None:
    noisy = "sensors.imu.accel_scale_error=0.19"
    with pytest.raises(ConfigError, match="narrow the limits"):
        load_bench(settings=[noisy, "randomize.noise={imu: [50, 60]}"])


SCRIPT = """
import hashlib, json
from sim.frame.camera_model import CameraModel
from sim.frame.geometry import FrameGeometry
from sim.frame.renderer import FrameRenderer
from sim.randomize.variant import drawn, randomized
from sim.randomize.settings import Randomize
from sim.scene.scene import load_scene
from sim.world_loader import load_world
from tests.unit.sim.frame.test_frame_raster import digest, looking, picture

settings = Randomize.everything(6)
scene = randomized(load_scene("radar_range"), settings, 0)
renderer = FrameRenderer(FrameGeometry(load_world(scene)), CameraModel.from_fov(80, 60, 90.0), shadows=True)
shown = digest(picture(renderer, looking((-6.0, -9.0, 4.0), (9.0, 0.0, 1.0)), "rgb"))
print(hashlib.sha256(json.dumps(drawn(scene, settings, load_world)).encode()).hexdigest(), shown)
"""


def test_an_older_processor_draws_the_same() -> None:
    assert output_of(SCRIPT) == output_of(SCRIPT, ALL | {"HIL_ISA": "base"})
