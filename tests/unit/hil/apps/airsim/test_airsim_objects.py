"""Objects of the scene over a socket: names, poses, scales, spawning; what rays, pictures and vehicles meet."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from hil.apps.airsim.world.objects import present_world, registry, voxel_grid
from lab.airsim_server import RpcFailed
from signals.errors import RecordingError
from sim.physics.vehicle import load_vehicle
from sim.scene.compile.placed_worlds import limit_mesh_cache
from tests.worlds.airsim_server import Client, Served, pose, served, vector, xyz

ONE = {"SettingsVersion": 1.2, "SimMode": "Multirotor", "Vehicles": {"A": {"VehicleType": "SimpleFlight", "Sensors": {
    "Down": {"SensorType": 5, "Enabled": True, "Pitch": -90, "UncorrelatedNoiseSigma": 0.0},
    "Ahead": {"SensorType": 5, "Enabled": True, "UncorrelatedNoiseSigma": 0.0},
    "Scan": {"SensorType": 6, "Enabled": True, "NumberOfChannels": 4, "PointsPerSecond": 20000, "Range": 30,
             "VerticalFOVLower": 0, "VerticalFOVUpper": 2, "DataFrame": "SensorLocalFrame"},
}}}}  # fmt: skip
STAND_M = load_vehicle("x500").standing_height_m
STRAIGHT = {"is_rate": True, "yaw_or_rate": 0.0}


@pytest.fixture(scope="module")
def blocks() -> Iterator[Served]:
    with served(json.dumps(ONE), scene="blocks") as running:
        yield running


@pytest.fixture
def client(blocks: Served) -> Iterator[Client]:
    client = blocks.client()
    client.call("reset")
    client.call("simPause", False)
    yield client
    for name in client.call("simListSceneObjects", "spawned.*"):
        client.call("simDestroyObject", name)
    client.close()


def spawn(client: Client, name: str, asset: str, at: dict[str, Any], scale: tuple[float, ...] = (1.0, 1.0, 1.0)) -> str:
    found: str = client.call("simSpawnObject", name, asset, at, vector(*scale), False)
    return found


def depths(client: Client) -> np.ndarray:
    request = {"camera_name": "0", "image_type": 1, "pixels_as_float": True, "compress": False}
    picture = client.call("simGetImages", [request], "A")[0]
    return np.array(picture["image_data_float"]).reshape(picture["height"], picture["width"])


def test_the_list_holds_the_names_that_airsims_users_know(client: Client) -> None:
    names = client.call("simListSceneObjects")
    assert {"Ground", "OrangeBall", "PulsingCone", "Cone_5", "TemplateCube_Rounded_16", "A"} <= set(names)
    assert len(set(names)) == len(names)
    assert sorted(client.call("simListSceneObjects", "Cylinder_[12]")) == ["Cylinder_1", "Cylinder_2"]
    assert client.call("simListSceneObjects", "Cylinder") == []  # the whole name must match
    assert client.call("simListSceneObjects", "orangeball") == []


def test_the_tag_of_an_object_is_its_class(client: Client) -> None:
    spawn(client, "spawned_car", "sedan", pose(20.0, 0.0, 0.0))
    tags = dict(client.call("simListSceneObjectsTags"))
    assert (tags["OrangeBall"], tags["Ground"], tags["spawned_car"], tags["A"]) == (
        "object", "ground", "vehicle", "drone",
    )  # fmt: skip
    assert client.call("simListSceneObjectsByTag", "veh.*|drone") == ["spawned_car", "A"]
    assert client.call("simListSceneObjectsByTag", "VEHICLE") == []
    assert client.call("simListSceneObjectsByTag") == client.call("simListSceneObjects")


@pytest.mark.parametrize(
    ("place", "turn_deg"),
    [
        ((10.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        ((0.0, 7.0, -7.0), (45.0, 0.0, 90.0)),
        ((-3.0, -3.0, 0.0), (0.0, 0.0, -135.0)),
    ],
)
def test_the_direction_to_an_object_is_pitch_roll_and_yaw_of_unreal(
    client: Client, place: tuple[float, float, float], turn_deg: tuple[float, float, float]
) -> None:
    client.call("simSetVehiclePose", pose(0.0, 0.0, -30.0), True, "A")
    x, y, z = place
    spawn(client, "spawned_mark", "Sphere", pose(x, y, z - 30.0))
    assert xyz(client.call("simFindLookAtRotation", "A", "spawned_mark")) == pytest.approx(turn_deg, abs=1e-4)
    assert xyz(client.call("simFindLookAtRotation", "", "nothing")) == (0.0, 0.0, 0.0)
    with pytest.raises(RpcFailed, match="The vehicles are: A"):
        client.call("simFindLookAtRotation", "Z", "spawned_mark")


@pytest.mark.parametrize("pattern", ["(", "x" * 100_000, "[z-a]", "(a)\\1", "a++", "(?=a)a"])
def test_an_expression_that_is_none_is_an_error(client: Client, pattern: str) -> None:
    with pytest.raises(RpcFailed, match="regular expression"):
        client.call("simListSceneObjects", pattern)


def test_an_unknown_object_has_a_pose_of_nan_and_takes_none(client: Client) -> None:
    found = client.call("simGetObjectPose", "Nothing")
    assert all(math.isnan(x) for x in (*xyz(found["position"]), *found["orientation"].values()))
    assert xyz(client.call("simGetObjectScale", "Nothing")) == (0.0, 0.0, 0.0)
    assert client.call("simSetObjectPose", "Nothing", pose(0, 0, 0), True) is False
    assert client.call("simSetObjectScale", "Nothing", vector(1, 1, 1)) is False
    assert client.call("simDestroyObject", "Nothing") is False


def test_a_moved_object_is_where_it_was_put_for_pictures_rays_and_lidar(client: Client) -> None:
    before = client.call("simGetObjectPose", "OrangeBall")
    old = depths(client)
    try:
        for x in (9.0, 12.0):  # the first change makes the world anew, the second moves an actor
            assert client.call("simSetObjectPose", "OrangeBall", pose(x, 0.0, -0.2), True) is True
            found = client.call("simGetObjectPose", "OrangeBall")["position"]
            assert xyz(found) == pytest.approx((x, 0.0, -0.2), abs=1e-5)
            middle = depths(client)[72, 128]
            assert middle == pytest.approx(x - 2.5, abs=0.5)  # the ball has a radius of 2.5 m
            assert middle < old[72, 128] - 1.0
            client.call("simContinueForTime", 0.2)
            ahead = client.call("getDistanceSensorData", "Ahead", "A")["distance"]
            assert ahead == pytest.approx(x - 2.5, abs=0.1)
            cloud = np.array(client.call("getLidarData", "Scan", "A")["point_cloud"]).reshape(-1, 3)
            straight = cloud[np.abs(cloud[:, 1]) < 0.1]
            assert np.min(straight[straight[:, 0] > 0.0, 0]) == pytest.approx(x - 2.5, abs=0.1)
        client.call("reset")  # puts vehicles back, not objects
        assert client.call("simGetObjectPose", "OrangeBall")["position"]["x_val"] == pytest.approx(12.0)
    finally:
        client.call("simSetObjectPose", "OrangeBall", before, True)
    assert xyz(client.call("simGetObjectPose", "OrangeBall")["position"]) == pytest.approx(xyz(before["position"]))
    assert np.array_equal(depths(client), old)


def test_the_old_place_of_a_moved_object_is_free(client: Client) -> None:
    before = client.call("simGetObjectPose", "OrangeBall")
    x, y, _ = xyz(before["position"])
    site = client.call("getHomeGeoPoint", "A")

    def above(down_m: float) -> dict[str, float]:
        return {
            "latitude": site["latitude"] + x / 111_180.0,
            "longitude": site["longitude"] + y / (111_320.0 * math.cos(math.radians(site["latitude"]))),
            "altitude": site["altitude"] + down_m,
        }

    assert client.call("simTestLineOfSightBetweenPoints", above(20.0), above(0.2)) is False
    client.call("simSetObjectPose", "OrangeBall", pose(x, y + 20.0, -30.0), True)
    assert client.call("simTestLineOfSightBetweenPoints", above(20.0), above(0.2)) is True
    client.call("simSetObjectPose", "OrangeBall", before, True)
    assert client.call("simTestLineOfSightBetweenPoints", above(20.0), above(0.2)) is False


def test_a_line_of_sight_ends_at_the_ground_and_at_spawned_objects(client: Client) -> None:
    home = client.call("getHomeGeoPoint", "A")
    up = {**home, "altitude": home["altitude"] + 50.0}
    assert client.call("simTestLineOfSightToPoint", up, "A") is True
    assert client.call("simTestLineOfSightToPoint", {**home, "latitude": home["latitude"] - 1.0}, "A") is False
    name = spawn(client, "spawned_lid", "Cube", pose(0.0, 0.0, -10.0), (5.0, 5.0, 0.2))
    assert client.call("simTestLineOfSightToPoint", up, "A") is False
    client.call("simDestroyObject", name)
    assert client.call("simTestLineOfSightToPoint", up, "A") is True


@pytest.mark.parametrize(
    ("asset", "scale", "half"),
    [
        ("Cube", (2.0, 1.0, 3.0), (1.0, 0.5, 1.5)),
        ("Sphere", (2.0, 2.0, 2.0), (1.0, 1.0, 1.0)),
        ("Sphere", (4.0, 1.0, 2.0), (2.0, 0.5, 1.0)),
        ("Cylinder", (2.0, 2.0, 5.0), (1.0, 1.0, 2.5)),
        ("Cone", (1.0, 2.0, 3.0), (0.5, 1.0, 1.5)),
    ],
)
def test_a_spawned_shape_has_its_size_along_its_own_axes(
    client: Client, asset: str, scale: tuple[float, ...], half: tuple[float, ...]
) -> None:
    name = spawn(client, f"spawned_{asset}", asset, pose(40.0, -3.0, -30.0), scale)
    assert xyz(client.call("simGetObjectScale", name)) == pytest.approx(scale)
    mesh = next(each for each in client.call("simGetMeshPositionVertexBuffers") if each["name"] == name)
    vertices = np.array(mesh["vertices"]).reshape(-1, 3)  # Unreal's cm: north, east, up
    assert vertices.max(axis=0) == pytest.approx(100.0 * (np.array((40.0, -3.0, 30.0)) + half), rel=0.01)
    assert vertices.min(axis=0) == pytest.approx(100.0 * (np.array((40.0, -3.0, 30.0)) - half), rel=0.01)


def test_an_object_of_the_scene_is_scaled_as_a_whole(client: Client) -> None:
    def size(name: str) -> np.ndarray:
        meshes = [each for each in client.call("simGetMeshPositionVertexBuffers") if each["name"] == name]
        shown = [np.array(each["vertices"]).reshape(-1, 3) for each in meshes]
        near = np.concatenate([each for each in shown if np.abs(each).max() < 1e6])
        return (near.max(axis=0) - near.min(axis=0)) / 100.0

    before = size("Cone_3")
    assert client.call("simSetObjectScale", "Cone_3", vector(2.0, 3.0, 0.5)) is True
    # Its own x axis points east.
    assert size("Cone_3") == pytest.approx(before * (3.0, 2.0, 0.5), rel=1e-4)
    assert client.call("simSetObjectScale", "Cone_3", vector(1.0, 1.0, 1.0)) is True
    assert size("Cone_3") == pytest.approx(before, rel=1e-4)


def test_a_vehicle_lands_on_a_spawned_object_and_collides_with_one_on_its_way(client: Client) -> None:
    client.call("enableApiControl", True, "A")
    client.call("armDisarm", True, "A")
    client.call("takeoff", 20.0, "A")
    floor = spawn(client, "spawned_floor", "Cube", pose(0.0, 0.0, -0.5), (6.0, 6.0, 1.0))
    client.call("land", 30.0, "A")
    height = -client.call("simGetVehiclePose", "A")["position"]["z_val"]
    # The world's origin is that of the standing vehicle, so the floor's top is as much above the ground.
    assert height == pytest.approx(1.0 + STAND_M, abs=0.01)
    assert client.call("simGetCollisionInfo", "A")["object_name"] == floor
    client.call("reset")
    client.call("enableApiControl", True, "A")
    client.call("armDisarm", True, "A")
    client.call("simDestroyObject", floor)
    client.call("takeoff", 20.0, "A")
    wall = spawn(client, "spawned_wall", "Cube", pose(6.0, 0.0, -2.0), (0.5, 8.0, 8.0))
    client.call("simGetCollisionInfo", "A")
    client.call("moveByVelocity", 3.0, 0.0, 0.0, 3.0, 0, STRAIGHT, "A")
    assert client.call("simGetVehiclePose", "A")["position"]["x_val"] < 6.0
    assert client.call("simGetCollisionInfo", "A")["object_name"] == wall
    client.call("simSetObjectPose", wall, pose(0.0, 40.0, -2.0), True)
    client.call("moveByVelocity", 3.0, 0.0, 0.0, 4.0, 0, STRAIGHT, "A")
    assert client.call("simGetVehiclePose", "A")["position"]["x_val"] > 7.0


def test_without_teleport_an_object_stops_at_the_first_contact(client: Client) -> None:
    wall = spawn(client, "spawned_wall", "Cube", pose(10.0, 0.0, -30.0), (1.0, 20.0, 20.0))
    ball = spawn(client, "spawned_ball", "Sphere", pose(0.0, 0.0, -30.0), (2.0, 2.0, 2.0))
    assert client.call("simSetObjectPose", ball, pose(20.0, 0.0, -30.0), False) is True
    assert client.call("simGetObjectPose", ball)["position"]["x_val"] == pytest.approx(8.5, abs=0.01)
    assert client.call("simSetObjectPose", ball, pose(20.0, 0.0, -30.0), False) is False  # it touches the wall
    assert client.call("simSetObjectPose", ball, pose(0.0, 3.0, -30.0), False) is True  # away from it
    assert client.call("simGetObjectPose", ball)["position"]["x_val"] == pytest.approx(0.0, abs=1e-4)
    assert client.call("simSetObjectPose", ball, pose(20.0, 0.0, -30.0), True) is True
    assert client.call("simGetObjectPose", ball)["position"]["x_val"] == pytest.approx(20.0)
    assert client.call("simDestroyObject", wall) is True


def test_names_of_spawned_objects_are_unique(client: Client) -> None:
    names = [spawn(client, "spawned", "Cube", pose(30.0 + 2 * i, 0.0, -30.0)) for i in range(3)]
    assert names == ["spawned", "spawned1", "spawned2"]
    assert set(names) <= set(client.call("simListSceneObjects"))
    assert client.call("simDestroyObject", names[1]) is True
    assert client.call("simDestroyObject", names[1]) is False
    assert names[1] not in client.call("simListSceneObjects")


@pytest.mark.parametrize("asset", ["sedan", "person", "tree", "stop_sign", "PulsingCone", "1M_Cube_Chamfer"])
def test_every_kind_of_asset_is_seen(client: Client, asset: str) -> None:
    assert asset in client.call("simListAssets")
    old = depths(client)
    name = spawn(client, "spawned_asset", asset, pose(7.0, 0.0, 0.0, (math.cos(0.5), 0.0, 0.0, math.sin(0.5))))
    new = depths(client)
    assert np.sum(new < old - 0.1) > 100
    client.call("simDestroyObject", name)
    assert np.array_equal(depths(client), old)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (("simSpawnObject", "spawned", "Nope", pose(0, 0, 0), vector(1, 1, 1), False), "no objects with name Nope"),
        (("simSpawnObject", "spawned", "Cube", pose(0, 0, 0), vector(0, 1, 1), False), "from 0.001 to 1000"),
        (("simSpawnObject", "spawned", "Cube", pose(0, 0, 0), vector(math.nan, 1, 1), False), "not finite"),
        (("simSpawnObject", "spawned", "Cube", pose(1e9, 0, 0), vector(1, 1, 1), False), "outside the world"),
        (("simSpawnObject", "x" * 500, "Cube", pose(0, 0, 0), vector(1, 1, 1), False), "at most 200 characters"),
        (("simSpawnObject", "spawned", "Cube", pose(0, 0, 0), vector(1, 1, 1), False, True), "no blueprints"),
        (("simSpawnObject", "drone:A", "Cube", pose(0, 0, 0), vector(1, 1, 1), False), "are those of vehicles"),
        (("simSetObjectScale", "OrangeBall", vector(-1, 1, 1)), "from 0.001 to 1000"),
        (("simSetObjectScale", "OrangeBall", vector(math.inf, 1, 1)), "not finite"),
        (("simSetObjectPose", "OrangeBall", pose(math.nan, 0, 0), True), "expected a finite number"),
        (
            (
                "simSetObjectPose",
                "OrangeBall",
                {**pose(0, 0, 0), "orientation": dict.fromkeys(("w_val", "x_val", "y_val", "z_val"), 0.0)},
                True,
            ),
            "is not a rotation",
        ),
        (("simCreateVoxelGrid", vector(0, 0, 0), 100, 100, 100, 0.0, "a.binvox"), "no cell"),
        (("simCreateVoxelGrid", vector(0, 0, 0), 10_000, 10_000, 10_000, 0.1, "a.binvox"), "too large"),
        (("simCreateVoxelGrid", vector(0, 0, 0), 10, 10, 10, 1.0, "/etc/passwd"), "end with .binvox"),
        (("simLoadLevel", "Moon"), "hil airsim --scene Moon"),
    ],
)
def test_what_cannot_be_is_a_named_error_and_changes_nothing(client: Client, call: Any, message: str) -> None:
    before = client.call("simListSceneObjects")
    with pytest.raises(RpcFailed, match=message):
        client.call(*call)
    assert client.call("simListSceneObjects") == before


def test_the_ground_and_vehicles_keep_their_size(client: Client, blocks: Served) -> None:
    assert client.call("simSetObjectPose", "Ground", pose(0, 0, 1), True) is False
    assert client.call("simDestroyObject", "Ground") is False
    assert client.call("simSetObjectScale", "A", vector(2, 2, 2)) is False
    assert any("belongs to the ground" in line for line in blocks.log)
    assert client.call("simSetObjectPose", "A", pose(3.0, 1.0, -5.0), True) is True
    assert xyz(client.call("simGetObjectPose", "A")["position"]) == pytest.approx((3.0, 1.0, -5.0), abs=1e-5)


def test_there_is_a_limit_of_spawned_objects(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "MOST_SPAWNED", 4)
    for i in range(4):
        spawn(client, f"spawned_{i}", "Cube", pose(40.0, 2.0 * i, -20.0))
    with pytest.raises(RpcFailed, match="there are 4 spawned objects"):
        spawn(client, "spawned_last", "Cube", pose(0.0, 0.0, -20.0))


def test_far_changes_cost_a_vehicle_nothing_until_it_comes_near(client: Client, blocks: Served) -> None:
    world = blocks.simulation.world
    client.call("simContinueForTime", 0.1)
    before = world.scene
    name = spawn(client, "spawned_far", "Cube", pose(30.0, 0.0, -20.0))
    client.call("simContinueForTime", 0.1)
    assert world.scene is before
    client.call("simSetObjectPose", name, pose(1.5, 0.0, 0.0), True)
    client.call("simContinueForTime", 0.1)
    assert world.scene is not before
    assert name in world.scene.file.cache["world"].instance_names


@pytest.fixture
def files(blocks: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of the files that clients have written."""
    folder = tmp_path / "files"
    monkeypatch.setattr(blocks.simulation.files, "folder", lambda: folder)
    return folder


GRID = ("simCreateVoxelGrid", vector(0.0, 0.0, 0.0), 2, 2, 2, 1.0)


def test_clients_have_files_written_below_one_folder(client: Client, files: Path) -> None:
    for name in ("new.binvox", str(files / "own.BINVOX"), "../files/new.binvox"):
        assert client.call(*GRID, name) is True
    (files / "inside").mkdir()
    (files / "link").symlink_to(files / "inside")
    assert client.call(*GRID, "link/third.binvox") is True
    written = sorted(str(path.relative_to(files)) for path in files.rglob("*.*"))
    assert written == ["inside/third.binvox", "new.binvox", "own.BINVOX"]


def test_no_other_file_is_written(client: Client, files: Path, tmp_path: Path) -> None:
    outside = tmp_path / "outside.binvox"
    outside.write_text("mine")
    files.mkdir()
    (files / "link.binvox").symlink_to(outside)
    (files / "new_link.binvox").symlink_to(tmp_path / "new.binvox")
    (files / "hard.binvox").hardlink_to(outside)
    (files / "elsewhere").symlink_to(tmp_path)
    (files / "folder.binvox").mkdir()
    os.mkfifo(files / "pipe.binvox")
    before = sorted(tmp_path.rglob("*"))
    for name, told in (
        (str(outside), f"written below {files} alone"),
        ("../outside.binvox", "--files FOLDER"),
        ("elsewhere/outside.binvox", "is elsewhere"),
        ("/dev/null/a.binvox", "is elsewhere"),
        ("link.binvox", "it is a link"),
        ("new_link.binvox", "it is a link"),
        ("hard.binvox", "it is a link"),
        ("folder.binvox", "it is a link, a folder"),
        ("pipe.binvox", "or a device"),
        ("none/a.binvox", "there is no folder"),
        ("a\0.binvox", "cannot be written"),
        ("a" * 300 + ".binvox", "cannot be written"),
    ):
        with pytest.raises(RpcFailed, match="simCreateVoxelGrid") as refused:
            client.call(*GRID, name)
        assert told in str(refused.value)
    assert sorted(tmp_path.rglob("*")) == before
    assert outside.read_text() == "mine"


def test_a_voxel_grid_holds_the_ground_and_what_stands_on_it(
    client: Client, files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(voxel_grid, "_LINES_AT_ONCE", 50)
    spawn(client, "spawned_cube", "Cube", pose(2.0, -3.0, -2.0), (2.0, 2.0, 2.0))
    file = files / "map.binvox"
    assert client.call("simCreateVoxelGrid", vector(0.0, 0.0, -2.0), 12, 10, 8, 0.5, str(file)) is True
    header, _, data = file.read_bytes().partition(b"data\n")
    assert b"dim 24 16 20" in header
    runs = np.frombuffer(data, np.uint8).reshape(-1, 2)
    cells = np.repeat(runs[:, 0], runs[:, 1]).reshape(20, 16, 24).astype(bool)  # east, up, north
    stand_m = 0.25  # about the height of the vehicle's origin, which is that of the world
    middles = [0.5 * (np.arange(n) - n // 2) for n in (20, 16, 24)]
    east, up, north = np.meshgrid(middles[0], middles[1] + 2.0, middles[2], indexing="ij")
    inside = (np.abs(north - 2.0) < 0.9) & (np.abs(east + 3.0) < 0.9) & (np.abs(up - 2.0) < 0.9)
    assert np.all(cells[inside])
    assert np.all(cells[np.abs(up + stand_m) < 0.1])
    assert not np.any(cells[(up > 0.2) & (np.abs(north - 2.0) > 1.3)])


def test_the_extents_hold_the_map(client: Client) -> None:
    low, high = client.call("simGetWorldExtents")
    home = client.call("getHomeGeoPoint", "A")
    assert low["latitude"] < home["latitude"] < high["latitude"]
    assert low["longitude"] < home["longitude"] < high["longitude"]
    assert 100.0 < 111_180.0 * (high["latitude"] - low["latitude"]) < 1000.0


def test_what_has_no_meaning_here_says_so(client: Client, blocks: Served) -> None:
    assert client.call("simSwapTextures", "tag", 0, 0, 0) == []
    assert client.call("simSetObjectMaterial", "OrangeBall", "Gold", 0) is False
    assert client.call("simSetObjectMaterialFromTexture", "OrangeBall", "a.png", 0) is False
    assert client.call("simSetLightIntensity", "Sun", 2.0) is False
    assert client.call("simLoadLevel", "Blocks") is True
    assert any(line.startswith("simSetLightIntensity does nothing: no scene has lights") for line in blocks.log)


def test_a_scene_of_boxes_takes_objects_too() -> None:
    with served(json.dumps(ONE)) as world:
        client = world.client()
        before = depths(client)
        name = spawn(client, "cube", "Cube", pose(8.0, 0.0, 0.0))
        assert depths(client)[72, 128] == pytest.approx(7.5, abs=0.5)
        client.call("simContinueForTime", 0.1)
        assert client.call("getDistanceSensorData", "Ahead", "A")["distance"] == pytest.approx(7.5, abs=0.05)
        assert client.call("simDestroyObject", name) is True
        assert np.array_equal(depths(client), before)


def test_the_same_calls_give_the_same_digest() -> None:
    digests = set()
    for _ in range(2):
        with served(json.dumps(ONE)) as world:
            client = world.client()
            client.call("enableApiControl", True, "A")
            client.call("armDisarm", True, "A")
            client.call("takeoff", 20.0, "A")
            spawn(client, "wall", "tree", pose(4.0, 0.0, 0.0))
            client.call("moveByVelocity", 3.0, 0.0, 0.0, 2.0, 0, STRAIGHT, "A")
            client.call("simSetObjectPose", "wall", pose(2.0, 0.0, 0.0), False)
            client.call("simContinueForTime", 0.5)
            depths(client)
            assert client.call("simGetCollisionInfo", "A")["object_name"] == "wall"
            assert world.server.digest is not None
            digests.add(world.server.digest.hexdigest() + world.truths.hexdigest())
    assert len(digests) == 1


def test_a_world_that_cannot_be_made_ends_no_clock(
    client: Client, blocks: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = present_world.with_objects

    def fail_with_copies(base: Any, moved: Any, added: Any) -> Any:
        if any(each.actor.name == "spawned_bad" for each in added):
            raise RecordingError("holds more than 256 different surfaces")
        return made(base, moved, added)

    monkeypatch.setattr(present_world, "with_objects", fail_with_copies)
    name = spawn(client, "spawned_bad", "Cube", pose(0.5, 0.0, -0.5))
    client.call("simContinueForTime", 0.1)
    assert client.call("simListSceneObjects", name) == []
    assert any(f"{name} is taken away" in line for line in blocks.log)


def test_an_object_with_too_many_surfaces_is_refused(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "MAX_SURFACES", 1)
    with pytest.raises(RpcFailed, match="more than 1 different surfaces"):
        spawn(client, "spawned_bad", "Cube", pose(5.0, 0.0, -0.5))
    assert client.call("simListSceneObjects", "spawned_bad") == []


def test_poses_of_the_scene_do_not_have_the_last_digits_of_a_machine(blocks: Served) -> None:
    for name in blocks.simulation.objects.names:
        found = blocks.simulation.objects.find(name)
        assert found is not None
        if found.mover is None and found.actor is None:
            assert all(round(x, 12) == x for x in (*found.p_W, *found.q_W)), name


def test_a_destroyed_object_has_no_id_and_no_pose_and_leaves_the_numbers_of_others() -> None:
    with served(json.dumps({"SettingsVersion": 1.2, "SimMode": "Multirotor"}), scene="blocks") as world:
        client = world.client()
        before = client.call("simListInstanceSegmentationObjects")
        assert client.call("simDestroyObject", "OrangeBall") is True
        after = client.call("simListInstanceSegmentationObjects")
        assert after == before
        poses = client.call("simListInstanceSegmentationPoses")
        without = [name for name, each in zip(after, poses, strict=True) if math.isnan(each["position"]["x_val"])]
        assert without == ["OrangeBall"]
        assert client.call("simGetSegmentationObjectID", "OrangeBall") == -1
        assert client.call("simSetSegmentationObjectID", "OrangeB.*", 7, True) is False


@pytest.mark.skipif(not hasattr(mujoco, "mj_getCache"), reason="this version of MuJoCo does not tell its cache")
def test_meshes_of_all_scales_are_not_kept(client: Client) -> None:
    cache = mujoco.mj_getCache()
    capacity, size, spare = mujoco.mj_getCacheCapacity(cache), mujoco.mj_getCacheSize(cache), 2 << 20
    limit_mesh_cache(spare)
    try:
        for k in range(4):  # 0.9 MB each
            name = spawn(client, "spawned_person", "person", pose(9.0, 3.0, 0.0), (1.0, 1.0, 1.0 + 0.01 * k))
            depths(client)
            client.call("simDestroyObject", name)
        assert mujoco.mj_getCacheSize(cache) <= size + spare
    finally:
        mujoco.mj_setCacheCapacity(cache, capacity)
