"""Pictures over a socket: image types, formats, cameras, segmentation ids; against each other and a closed form."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.airsim.pictures.palette import AIRSIM_COLOURS, instance_colours
from hil.apps.airsim.pictures.segmentation import initial_id
from lab.airsim_server import RpcFailed
from tests.worlds.airsim_server import Client, Served, pose, served

SCENE, PLANAR, PERSPECTIVE, VIS, DISPARITY, SEGMENTATION, NORMALS, INFRARED = range(8)
SETTINGS = {
    "SettingsVersion": 1.2,
    "SimMode": "Multirotor",
    "CameraDefaults": {
        "CaptureSettings": [
            {"ImageType": kind, "Width": 64, "Height": 48, "FOV_Degrees": 90} for kind in range(1, 8)
        ]
    },
    "Vehicles": {
        "A": {
            "VehicleType": "SimpleFlight",
            "Cameras": {
                "noisy": {"Z": -0.5, "NoiseSettings": [{"ImageType": 0, "Enabled": True}]},
                "tall": {
                    "CaptureSettings": [
                        {"ImageType": kind, "Width": 32, "Height": 64, "FOV_Degrees": 90} for kind in (0, 1, 2)
                    ]
                },
                "wide": {"CaptureSettings": [{"ImageType": 1, "Width": 400, "Height": 250}]},
                "held": {"X": 0.3, "Pitch": -20, "Gimbal": {"Stabilization": 1, "Roll": 0, "Pitch": -20, "Yaw": 0}},
            },
        },
        "B": {"VehicleType": "SimpleFlight", "X": 4},
    },
    "ExternalCameras": {"tower": {"X": 0.7, "Z": -12, "Pitch": -90}},
}  # fmt: skip


@pytest.fixture(scope="module")
def world() -> Iterator[Served]:
    with served(json.dumps(SETTINGS)) as running:
        yield running


@pytest.fixture
def client(world: Served) -> Iterator[Client]:
    client = world.client()
    client.call("reset")
    yield client
    client.close()


def request(camera: str, kind: int, as_float: bool = False, compress: bool = False, **more: Any) -> dict[str, Any]:
    return {"camera_name": camera, "image_type": kind, "pixels_as_float": as_float, "compress": compress, **more}


def one(client: Client, *args: Any, vehicle: str = "A", external: bool = False, **more: Any) -> dict[str, Any]:
    return client.call("simGetImages", [request(*args, **more)], vehicle, external)[0]


def pixels(response: dict[str, Any]) -> NDArray[np.uint8]:
    shape = (response["height"], response["width"], 3)
    return np.frombuffer(response["image_data_uint8"], np.uint8).reshape(shape)


def numbers(client: Client, camera: str, kind: int, **more: Any) -> NDArray[np.float32]:
    response = one(client, camera, kind, True, **more)
    assert response["image_data_uint8"] == b""
    return np.array(response["image_data_float"], np.float32).reshape(response["height"], response["width"])


def place(client: Client, x: float, y: float, z: float, vehicle: str = "A") -> None:
    client.call("simSetVehiclePose", pose(x, y, z), True, vehicle)


def test_a_scene_raw_and_compressed_for_both_clients(client: Client) -> None:
    raw = one(client, "0", SCENE)
    assert (raw["width"], raw["height"], raw["pixels_as_float"], raw["compress"]) == (256, 144, False, False)
    assert raw["image_data_float"] == []
    bgr = pixels(raw)
    rgb = pixels(one(client, "front_center", SCENE, annotation_name=""))
    assert np.array_equal(bgr[:, :, ::-1], rgb)
    coded = one(client, "", SCENE, compress=True)["image_data_uint8"]
    image = cv2.imdecode(np.frombuffer(coded, np.uint8), cv2.IMREAD_UNCHANGED)
    assert image is not None
    assert image.shape == (144, 256, 4)
    assert np.array_equal(image[:, :, :3], bgr)
    assert np.all(image[:, :, 3] == 255)
    assert client.call("simGetImage", "0", SCENE, "A", False) == coded
    assert client.call("simGetImage", 0, SCENE) == coded
    assert client.call("simGetImage", "0", SCENE, "A", "") == coded
    assert bgr[:40].astype(int)[:, :, 0].mean() > bgr[:40].astype(int)[:, :, 2].mean()  # a blue sky


def test_depth_below_a_vehicle_is_its_height(client: Client) -> None:
    place(client, 0.0, 0.0, -20.0)
    height = 20.0 - client.call("simGetVehiclePose", "A")["position"]["z_val"] - 20.0
    planar, perspective = numbers(client, "3", PLANAR), numbers(client, "bottom_center", PERSPECTIVE)
    stand = planar[24, 32] - height
    assert 0.05 < stand < 0.5  # the vehicle's origin is above its feet
    assert planar == pytest.approx(np.full((48, 64), planar[0, 0]), rel=1e-4)
    x, y = np.meshgrid((np.arange(64) - 31.5) / 32.0, (np.arange(48) - 23.5) / 32.0)
    assert perspective == pytest.approx(planar * np.sqrt(1.0 + x**2 + y**2), rel=1e-4)
    assert numbers(client, "3", VIS) == pytest.approx(planar / 100.0, rel=1e-5)
    assert numbers(client, "3", DISPARITY) == pytest.approx(0.125 / planar, rel=1e-5)
    assert pixels(one(client, "3", VIS))[0, 0].tolist() == [int(planar[0, 0] * 2.55)] * 3
    assert numbers(client, "0", PLANAR).max() == 65504.0  # the sky


def test_normals_of_level_ground_point_up(client: Client) -> None:
    place(client, 0.0, 0.0, -20.0)
    up = pixels(one(client, "3", NORMALS, annotation_name=""))
    assert up.reshape(-1, 3).mean(axis=0) == pytest.approx((127.5, 127.5, 255.0), abs=1.5)


def test_types_of_one_view_agree(client: Client) -> None:
    wanted = [request("0", kind, annotation_name="") for kind in range(8)]
    together = client.call("simGetImages", wanted, "A", False)
    for kind, response in enumerate(together):
        assert response["image_type"] == kind
        assert response["image_data_uint8"] == one(client, "0", kind, annotation_name="")["image_data_uint8"]


@pytest.mark.parametrize(
    ("name", "number"),
    [("a", 102), ("Cone_1", 170), ("Cone_2", 170), ("zz", 249), ("kzz", 100), ("Default_Sky", 0), ("7", 5)],
)
def test_initial_ids_are_those_of_airsim(name: str, number: int) -> None:
    assert initial_id(name) == number  # by hand from AirBlueprintLib.h: hash = 5 + letters, then % 256


def test_segmentation_ids_and_their_colours(client: Client) -> None:
    place(client, 0.0, 0.0, -20.0)
    ground = client.call("simGetSegmentationObjectID", "ground")
    assert ground == initial_id("ground") == 148
    found = pixels(one(client, "3", SEGMENTATION))[24, 32]
    assert found[::-1].tolist() == AIRSIM_COLOURS[ground].tolist()
    assert client.call("simSetSegmentationObjectID", "GROUND", 20) is False
    assert client.call("simSetSegmentationObjectID", r"GRO[\w]*", 20, True) is True
    assert client.call("simGetSegmentationObjectID", "ground") == 20
    assert pixels(one(client, "3", SEGMENTATION))[24, 32, ::-1].tolist() == AIRSIM_COLOURS[20].tolist()
    assert pixels(one(client, "3", INFRARED))[24, 32].tolist() == [20, 20, 20]
    assert client.call("simSetSegmentationObjectID", "ground", -1, False) is True
    assert pixels(one(client, "3", SEGMENTATION))[24, 32].tolist() == [0, 0, 0]
    assert client.call("simGetSegmentationObjectID", "nothing") == -1
    client.call("simSetSegmentationObjectID", "ground", ground, False)


def test_segmentation_of_cosys_gives_every_object_its_colour(client: Client) -> None:
    place(client, 0.0, 0.0, -20.0)
    names = client.call("simListInstanceSegmentationObjects")
    number = names.index("ground")
    client.call("simSetSegmentationObjectID", "ground", number)
    colours = instance_colours(len(names))
    assert len(np.unique(colours, axis=0)) == len(names)
    shown = pixels(one(client, "3", SEGMENTATION, annotation_name=""))[24, 32]
    assert shown.tolist() == colours[number].tolist()


def test_a_file_of_cosys_numbers_objects_by_their_place() -> None:
    for version in (1.2, 2.0):
        with served(json.dumps({"SettingsVersion": version, "SimMode": "Multirotor"})) as world:
            client = world.client()
            names = client.call("simListInstanceSegmentationObjects")
            place_in_list = names.index("ground")
            wanted = place_in_list if version >= 2.0 else initial_id("ground")
            for each in (client, world.client()):  # without an effect of the call before
                assert each.call("simGetSegmentationObjectID", "ground") == wanted
            colours = [list(colour.values()) for colour in client.call("simGetInstanceSegmentationColorMap")]
            assert colours == instance_colours(len(names)).tolist()


def test_a_vehicle_sees_the_other_one_but_not_itself(client: Client) -> None:
    place(client, 0.0, 0.0, -10.0)
    place(client, -2.5, 0.0, -10.0, "B")  # 1.5 m north of A
    client.call("simSetSegmentationObjectID", ".*", 1, True)
    client.call("simSetSegmentationObjectID", "A", 7)
    client.call("simSetSegmentationObjectID", "B", 9)
    for camera in ("0", "1", "2", "3", "4"):
        assert 7 not in pixels(one(client, camera, INFRARED))
    seen = pixels(one(client, "0", INFRARED))
    assert 9 in seen
    rows, columns = np.nonzero(seen[:, :, 0] == 9)
    assert (rows.mean(), columns.mean()) == pytest.approx((24.0, 32.0), abs=4.0)
    above = pixels(one(client, "tower", INFRARED, external=True))
    assert {7, 9} <= set(np.unique(above).tolist())


def test_pose_and_field_of_view_of_a_camera(client: Client) -> None:
    place(client, 3.0, 2.0, -10.0)
    info = client.call("simGetCameraInfo", "0", "A")
    assert [info["pose"]["position"][key] for key in ("x_val", "y_val", "z_val")] == pytest.approx([3.46, 2.0, -10.0])
    assert info["fov"] == 90.0
    assert info["proj_mat"]["matrix"][0][1] == pytest.approx(1.0)
    half = math.radians(-45.0)
    pose = {
        "position": {"x_val": 0.0, "y_val": 0.0, "z_val": 0.5},
        "orientation": {"w_val": math.cos(half), "x_val": 0.0, "y_val": math.sin(half), "z_val": 0.0},
    }
    client.call("simSetCameraPose", "4", pose, "A")
    assert client.call("simGetCameraInfo", "4", "A")["pose"]["position"]["z_val"] == pytest.approx(-9.5)
    down = numbers(client, "3", PLANAR)
    assert numbers(client, "4", PLANAR) == pytest.approx(down - 0.5, rel=1e-3)
    response = one(client, "4", PLANAR, True)
    assert response["camera_position"]["z_val"] == pytest.approx(-9.5)
    assert response["camera_orientation"]["y_val"] == pytest.approx(math.sin(half), abs=1e-6)
    client.call("simSetCameraFov", "4", 60.0, "A")
    assert client.call("simGetCameraInfo", "4", "A")["fov"] == 60.0
    f = client.call("simGetFocalLength", "4", "A")
    assert f == pytest.approx(23.76 / 2.0 / math.tan(math.radians(30.0)), rel=1e-6)
    client.call("simSetFocalLength", 2.0 * f, "4", "A")
    wanted = 2.0 * math.degrees(math.atan(0.5 * math.tan(math.radians(30.0))))
    assert client.call("simGetCameraInfo", "4", "A")["fov"] == pytest.approx(wanted, rel=1e-6)


def test_fpv_is_the_front_camera_unless_the_file_has_one_of_that_name(client: Client) -> None:
    front, fpv = (client.call("simGetCameraInfo", name, "A", False) for name in ("front_center", "fpv"))
    assert fpv == front
    own = '{"SettingsVersion": 1.2, "Vehicles": {"A": {"VehicleType": "SimpleFlight", "Cameras": {"fpv": {"X": 2}}}}}'
    with served(own) as world:
        places = [world.client().call("simGetCameraInfo", name, "A", False)["pose"] for name in ("0", "fpv")]
    assert [place["position"]["x_val"] for place in places] == pytest.approx([0.46, 2.0])


def test_a_gimbal_holds_its_angles(client: Client) -> None:
    half = math.radians(20.0)
    q = {"w_val": math.cos(half), "x_val": 0.0, "y_val": math.sin(half), "z_val": 0.0}
    pose = {"position": {"x_val": 0.0, "y_val": 0.0, "z_val": -10.0}, "orientation": q}
    client.call("simSetVehiclePose", pose, True, "A")
    held = client.call("simGetCameraInfo", "held", "A")["pose"]["orientation"]
    angle = math.radians(-10.0)
    expected = [math.cos(angle), 0.0, math.sin(angle), 0.0]
    assert [held[key] for key in ("w_val", "x_val", "y_val", "z_val")] == pytest.approx(expected, abs=1e-6)


def test_a_pose_for_a_camera_on_a_gimbal_sets_the_angles_that_it_holds(client: Client) -> None:
    before = client.call("simGetCameraInfo", "held", "A")["pose"]["orientation"]
    half = math.radians(15.0)
    q = {"w_val": math.cos(half), "x_val": 0.0, "y_val": 0.0, "z_val": math.sin(half)}
    at = {"x_val": 0.3, "y_val": 0.0, "z_val": 0.0}
    try:
        client.call("simSetCameraPose", "held", {"position": at, "orientation": q}, "A")
        place(client, 0.0, 0.0, -10.0)
        found = client.call("simGetCameraInfo", "held", "A")["pose"]["orientation"]
        assert [found[key] for key in q] == pytest.approx(list(q.values()), abs=1e-6)
    finally:
        client.call("simSetCameraPose", "held", {"position": at, "orientation": before}, "A")


def test_the_field_of_view_is_that_of_the_longer_side(client: Client) -> None:
    place(client, 0.0, 0.0, -20.0)
    half = math.radians(-45.0)
    down = {"w_val": math.cos(half), "x_val": 0.0, "y_val": math.sin(half), "z_val": 0.0}
    origin = dict.fromkeys(("x_val", "y_val", "z_val"), 0.0)
    client.call("simSetCameraPose", "tall", {"position": origin, "orientation": down}, "A")
    ratio = numbers(client, "tall", PERSPECTIVE)[-1, 16] / numbers(client, "tall", PLANAR)[-1, 16]
    assert ratio == pytest.approx(math.hypot(1.0, 31.5 / 32.0), rel=0.005)
    matrix = client.call("simGetCameraInfo", "tall", "A")["proj_mat"]["matrix"]
    assert (matrix[0][1], matrix[1][2]) == pytest.approx((2.0, -1.0))


def test_distortion(client: Client) -> None:
    place(client, 0.0, 0.0, -10.0, "B")
    before = numbers(client, "3", PERSPECTIVE, vehicle="B")
    client.call("simSetDistortionParam", "3", "K1", -0.05, "B")
    assert client.call("simGetDistortionParams", "3", "B") == pytest.approx([-0.05, 0.0, 0.0, 0.0, 0.0])
    after = numbers(client, "3", PERSPECTIVE, vehicle="B")
    assert after[24, 32] == pytest.approx(before[24, 32], rel=1e-3)
    assert after[0, 0] > 1.03 * before[0, 0]
    with pytest.raises(RpcFailed, match="two directions share a pixel"):
        client.call("simSetDistortionParam", "3", "K1", -3.0, "B")
    with pytest.raises(RpcFailed, match="K1, K2, K3, P1, P2"):
        client.call("simSetDistortionParam", "3", "K9", 0.1, "B")
    client.call("simSetDistortionParam", "3", "K1", 0.0, "B")


def test_settings_of_the_lens(client: Client) -> None:
    where = ("2", "B", False)
    assert client.call("simSetFilmbackSettings", 36.0, 24.0, *where) == 1.5
    assert "36" in client.call("simGetFilmbackSettings", *where)
    for setter, getter, value in (
        ("simSetFocusDistance", "simGetFocusDistance", 500.0),
        ("simSetFocusAperture", "simGetFocusAperture", 4.0),
        ("simSetFocalLength", "simGetFocalLength", 18.0),
    ):
        client.call(setter, value, *where)
        assert client.call(getter, *where) == pytest.approx(value)
    assert client.call("simGetCameraInfo", *where)["fov"] == pytest.approx(90.0)
    assert "90.0" in client.call("simGetCurrentFieldOfView", *where)
    assert "18.0" in client.call("simGetLensSettings", *where)
    client.call("simEnableManualFocus", True, *where)
    client.call("simEnableFocusPlane", False, *where)
    client.call("simSetPresetLensSettings", "50mm", *where)
    assert client.call("simGetPresetLensSettings", *where) == []
    for setter, value in (("simSetFocalLength", 0.0), ("simSetFocusAperture", -1.0), ("simSetFocusDistance", -1.0)):
        with pytest.raises(RpcFailed):
            client.call(setter, value, *where)
    with pytest.raises(RpcFailed, match="field of view must be"):
        client.call("simSetCameraFov", "2", 180.0, "B")


def test_fog_and_night_change_the_picture(client: Client) -> None:
    place(client, 0.0, 0.0, -20.0)
    clear = pixels(one(client, "0", SCENE)).astype(int)
    client.call("simEnableWeather", True)
    client.call("simSetWeatherParameter", 7, 1.0)
    foggy = pixels(one(client, "0", SCENE)).astype(int)
    assert foggy.std() < 0.5 * clear.std()
    client.call("simEnableWeather", False)
    assert np.array_equal(pixels(one(client, "0", SCENE)), clear)
    client.call("simSetTimeOfDay", True, "2018-02-12 08:00:00")  # UTC: midnight at the origin
    assert pixels(one(client, "0", SCENE)).mean() < 0.4 * clear.mean()
    client.call("simSetTimeOfDay", False)
    assert np.array_equal(pixels(one(client, "0", SCENE)), clear)


def test_noise_is_there_if_asked_for_and_repeats(client: Client) -> None:
    place(client, 0.0, 0.0, -20.0)
    client.call("simPause", True)
    noisy = pixels(one(client, "noisy", SCENE))
    assert np.array_equal(noisy, pixels(one(client, "noisy", SCENE)))
    row = noisy[10].astype(int)
    assert 5.0 < np.abs(np.diff(row, axis=0)).mean() < 60.0
    assert np.abs(np.diff(pixels(one(client, "0", SCENE))[10].astype(int), axis=0)).mean() < 2.0
    client.call("simContinueForTime", 0.02)
    assert not np.array_equal(noisy, pixels(one(client, "noisy", SCENE)))
    client.call("simPause", False)


def test_poses_of_instances(client: Client) -> None:
    place(client, 3.0, 1.0, -20.0)
    names, poses = client.call("simListInstanceSegmentationObjects"), client.call("simListInstanceSegmentationPoses")
    assert len(names) == len(poses)
    position = poses[names.index("A")]["position"]
    assert [position[key] for key in ("x_val", "y_val", "z_val")] == pytest.approx([3.0, 1.0, -20.0], abs=0.3)


def test_the_log_says_once_that_airsims_client_unpacks_many_numbers_slowly(client: Client, world: Served) -> None:
    def told() -> list[str]:
        return [line for line in world.log if "rpc-msgpack" in line]

    numbers(client, "wide", PLANAR, annotation_name="")  # Cosys-AirSim's client stands on rpc-msgpack
    one(client, "wide", PLANAR)  # bytes
    numbers(client, "0", PLANAR)
    assert told() == []
    for _ in range(2):
        assert numbers(client, "wide", PLANAR).size == 100_000
    (line,) = told()
    assert "simGetImages has 100,000 numbers" in line
    assert "docs/airsim.md" in line


def test_older_clients_give_fewer_arguments(client: Client) -> None:
    wanted = [{"camera_id": 0, "image_type": SCENE, "pixels_as_float": False, "compress": False}]
    newest = one(client, "0", SCENE, vehicle="")["image_data_uint8"]
    assert client.call("simGetImages", wanted)[0]["image_data_uint8"] == newest
    assert client.call("simGetImages", wanted, "")[0]["image_data_uint8"] == newest


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (([request("9", SCENE)], "A", False), "A has no camera '9'; its cameras are: front_center"),
        (([request("0", SCENE)], "Z", False), "The vehicles are: A, B"),
        (([request("0", 8)], "A", False), r"8 \(OpticalFlow\) is not drawn here"),
        (([request("0", 99)], "A", False), "ImageType"),
        (([request("0", SCENE)], "A", True), "the external cameras are: tower"),
        (([request("0", SCENE)] * 101, "A", False), "at most 100 elements"),
        ((5, "A", False), "an array of ImageRequest"),
    ],
)
def test_what_cannot_be_drawn_is_refused(client: Client, arguments: tuple[Any, ...], told: str) -> None:
    with pytest.raises(RpcFailed, match=told):
        client.call("simGetImages", *arguments)


@pytest.mark.parametrize("pattern", ["[", "(" * 300])
def test_a_regular_expression_that_is_none_or_too_costly(client: Client, pattern: str) -> None:
    with pytest.raises(RpcFailed, match="regular expression"):
        client.call("simSetSegmentationObjectID", pattern, 1, True)


def test_detections(client: Client) -> None:
    place(client, 0.0, 0.0, -10.0)
    place(client, -1.0, 1.0, -9.5, "B")  # 3 m north, 1 m east, 0.5 m below A
    assert client.call("simGetDetections", "0", PLANAR, "A", False) == []
    client.call("simAddDetectionFilterMeshName", "0", PLANAR, "[AB]", "A", False)
    assert client.call("simGetDetections", "0", PLANAR, "A", False) == []
    client.call("simAddDetectionFilterMeshName", "0", PLANAR, "b*", "A", False)
    (found,) = client.call("simGetDetections", "0", PLANAR, "A", "")
    assert found["name"] == "B"
    relative = found["relative_pose"]["position"]
    assert [relative[key] for key in ("x_val", "y_val", "z_val")] == pytest.approx([2.54, 1.0, 0.5], abs=1e-3)
    low, high = found["box3D"]["min"], found["box3D"]["max"]
    assert low["y_val"] < 1.0 < high["y_val"]
    assert 0.3 < high["y_val"] - low["y_val"] < 1.2
    box = found["box2D"]
    assert box["min"]["x_val"] < 32.0 * (1.0 + 1.0 / 2.54) < box["max"]["x_val"]
    for key, to_low, to_high in (("x_val", "y_val", 32.0), ("y_val", "z_val", 24.0)):
        edges = [
            32.0 * side[to_low] / depth + to_high for side in (low, high) for depth in (low["x_val"], high["x_val"])
        ]
        assert min(edges) - 1.0 <= box["min"][key] < box["max"][key] <= max(edges) + 1.0
    half = math.radians(20.0)
    turned = {"w_val": math.cos(half), "x_val": 0.0, "y_val": 0.0, "z_val": math.sin(half)}
    at = {"x_val": -1.0, "y_val": 1.0, "z_val": -9.5}
    client.call("simSetVehiclePose", {"position": at, "orientation": turned}, True, "B")
    turn = client.call("simGetDetections", "0", PLANAR, "A", "")[0]["relative_pose"]["orientation"]
    assert (turn["w_val"], turn["z_val"]) == pytest.approx((math.cos(half), -math.sin(half)), abs=1e-6)
    home = client.call("getHomeGeoPoint", "A")
    assert found["geo_point"]["altitude"] - home["altitude"] == pytest.approx(9.5, abs=0.3)
    client.call("simSetDetectionFilterRadius", "0", PLANAR, 200.0, "A", False)
    assert client.call("simGetDetections", "0", PLANAR, "A", False) == []
    client.call("simClearDetectionMeshNames", "0", PLANAR, "A", False)
    client.call("simSetDetectionFilterRadius", "0", PLANAR, 2000.0, "A", False)
    assert client.call("simGetDetections", "0", PLANAR, "A", False) == []


def test_a_recording(tmp_path: Path) -> None:
    recorded = [
        {"CameraName": "0", "ImageType": SCENE, "VehicleName": "A"},
        {"CameraName": "3", "ImageType": PLANAR, "PixelsAsFloat": True, "Compress": False, "VehicleName": "A"},
        {"CameraName": "0", "ImageType": SCENE, "Compress": False, "VehicleName": "B"},
    ]
    settings = {**SETTINGS, "Recording": {"RecordInterval": 0.1, "Folder": str(tmp_path), "Cameras": recorded}}
    with served(json.dumps(settings)) as running:
        client = running.client()
        assert client.call("isRecording") is False
        client.call("startRecording")
        assert client.call("isRecording") is True
        client.call("simContinueForTime", 0.5)
        client.call("stopRecording")
        assert client.call("isRecording") is False
        client.call("simContinueForTime", 0.5)
    (folder,) = tmp_path.iterdir()
    header, *lines = (folder / "airsim_rec.txt").read_text().splitlines()
    assert header.split("\t") == [
        "VehicleName", "TimeStamp", "POS_X", "POS_Y", "POS_Z", "Q_W", "Q_X", "Q_Y", "Q_Z", "ImageFile",
    ]  # fmt: skip
    rows = [line.split("\t") for line in lines]
    assert [row[0] for row in rows] == ["A", "B"] * 5
    assert [int(row[1]) - int(rows[0][1]) for row in rows[::2]] == [0, 100, 200, 300, 400]
    scene, depth = rows[0][-1].split(";")
    image = cv2.imread(str(folder / "images" / scene))
    assert image is not None
    assert image.shape == (144, 256, 3)
    head, size, scale, data = (folder / "images" / depth).read_bytes().split(b"\n", 3)
    assert (head, size, scale) == (b"Pf", b"64 48", b"-1")
    assert np.frombuffer(data, "<f4").max() < 65504.0
    raw = cv2.imread(str(folder / "images" / rows[1][-1]))
    assert raw is not None
    assert raw.shape == (144, 256, 3)


def test_a_recording_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    settings = {**SETTINGS, "Recording": {"Folder": str(tmp_path / "file" / "folder")}}
    with served(json.dumps(settings)) as running:
        client = running.client()
        with pytest.raises(RpcFailed, match="set Folder of Recording"):
            client.call("startRecording")
        assert client.call("isRecording") is False


def test_moves_and_pictures_repeat_bit_by_bit() -> None:
    digests = set()
    for _ in range(2):
        with served(json.dumps(SETTINGS)) as running:
            client = running.client()
            client.call("enableApiControl", True, "A")
            client.call("armDisarm", True, "A")
            for speed in (-2.0, 1.0):
                client.call("moveByVelocity", 2.0, 1.0, speed, 0.5, 0, {"is_rate": True, "yaw_or_rate": 20.0}, "A")
                client.call("simGetImages", [request("0", kind, kind in (1, 2)) for kind in range(8)], "A", False)
            assert running.server.digest is not None
            digests.add(running.server.digest.hexdigest())
    assert len(digests) == 1


def test_a_camera_without_a_vehicle_that_flies() -> None:
    with served('{"SettingsVersion": 1.2, "SimMode": "ComputerVision"}') as running:
        client = running.client()
        for height in (5.0, 9.0):
            place(client, 3.0, -2.0, -height, "")
            down = numbers(client, "3", PLANAR, vehicle="")
            assert down.shape == (144, 256)
            assert down == pytest.approx(np.full_like(down, height), abs=0.5)
            response = one(client, "0", SCENE, vehicle="")
            assert response["camera_position"]["z_val"] == pytest.approx(-height)
