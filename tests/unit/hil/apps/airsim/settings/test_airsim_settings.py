"""settings.json: AirSim's default values, the keys that people write, and every kind of mistake with its line."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hil.apps.airsim.settings.cameras import Capture, camera_name
from hil.apps.airsim.settings.files import find_settings, load_settings
from hil.apps.airsim.settings.scene_names import scene_name
from hil.apps.airsim.settings.sensors import Gps, Imu, Lidar
from hil.apps.airsim.settings.settings import AirSimSettings, read_settings
from signals.errors import ConfigError
from sim.scene.scene import load_scene


def read(text: str) -> AirSimSettings:
    return read_settings(text, "settings.json")


def problems(text: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        read(text)
    return [str(problem).removeprefix("settings.json:") for problem in caught.value.problems]


def test_an_empty_file_is_airsims_default_multirotor() -> None:
    settings = read("{}")
    assert settings.sim_mode == "Multirotor"
    assert settings.default_vehicle == "SimpleFlight"
    assert (settings.port, settings.clock_speed, settings.notes) == (41451, 1.0, ())
    assert (settings.origin.latitude_deg, settings.origin.longitude_deg) == (47.641468, -122.140165)
    vehicle = settings.vehicles["SimpleFlight"]
    assert list(vehicle.cameras) == ["front_center", "front_right", "front_left", "bottom_center", "back_center"]
    assert vehicle.cameras["bottom_center"].rotation_deg == (0.0, -90.0, 0.0)
    assert vehicle.cameras["front_center"].capture(0) == Capture(256, 144, 90.0)
    assert list(vehicle.sensors) == ["barometer", "gps", "imu", "magnetometer"]
    assert [camera_name(name) for name in ("", "0", "1", "2", "3", "4", "own")] == [
        "front_center", "front_center", "front_right", "front_left", "bottom_center",
        "back_center", "own",
    ]  # fmt: skip


def test_computer_vision_has_a_vehicle_without_sensors() -> None:
    vehicle = read('{"SimMode": "ComputerVision"}').vehicles["ComputerVision"]
    assert vehicle.kind == "ComputerVision"
    assert not vehicle.sensors


VEHICLES = """{
  "SettingsVersion": 1.2, // a comment
  "SimMode": "Multirotor",
  "CameraDefaults": {"CaptureSettings": [{"ImageType": 0, "Width": 640, "Height": 480, "FOV_Degrees": 80}], "X": 3},
  "Vehicles": {
    "Zulu": {"VehicleType": "simpleflight", "X": 4, "Y": NaN, "Yaw": 90,
      "Cameras": {
        "0": {"CaptureSettings": [{"ImageType": 1, "Width": 320.0, "Height": 240}]},
        "high": {"X": 0.1, "Z": -1.5, "Pitch": -45},  /* two
        lines */
      },
      "Sensors": {
        "Front": {"SensorType": 6, "Enabled": true, "NumberOfChannels": 4, "VerticalFOVLower": -25, "X": 0.5},
        "Pos": {"SensorType": 3, "Enabled": false},
      },
    },
    "Alpha": {"VehicleType": "PX4Multirotor", "UseSerial": false, "LockStep": true, "Parameters": {"A": 1, "B": 2.5}}
  }
}"""


def test_vehicles_cameras_and_sensors() -> None:
    settings = read(VEHICLES)
    assert list(settings.vehicles) == ["Alpha", "Zulu"]  # sorted, as AirSim keeps them
    alpha, zulu = settings.vehicles.values()
    assert zulu.position_m == (4.0, 0.0, 0.0)
    assert zulu.rotation_deg == (0.0, 0.0, 90.0)
    front = zulu.cameras["front_center"]
    assert (front.capture(0).width_px, front.capture(1).width_px, front.position_m[0]) == (640, 320, 0.46)
    assert zulu.cameras["high"].position_m == (0.1, 0.0, -1.5)
    lidar = zulu.sensors["Front"]
    assert isinstance(lidar, Lidar)
    assert not lidar.in_sensor_frame
    assert (lidar.channels, lidar.vertical_fov_deg, lidar.points_per_second) == (4, (-25.0, -15.0), 100_000)
    # The vehicle's own GPS, though it is off, replaces the default one.
    assert list(zulu.sensors) == ["Front", "Pos", "barometer", "imu", "magnetometer"]
    assert zulu.sensors["Pos"] == Gps(enabled=False)
    assert alpha.kind == "PX4Multirotor"
    assert any("UseSerial" in note for note in settings.notes)
    assert any("Parameters is left out" in note and "autopilot.params" in note for note in settings.notes)
    assert settings.added_vehicle("Later").sensors == settings.added.sensors


def test_default_sensors_replace_the_built_in_ones() -> None:
    settings = read('{"DefaultSensors": {"i": {"SensorType": 2, "Enabled": true, "AngularRandomWalk": 0}}}')
    assert settings.vehicles["SimpleFlight"].sensors == {"i": Imu(angular_random_walk_deg_per_sqrt_h=0.0)}


def test_cosys_airsim_counts_points_by_rotation_and_has_a_quiet_imu() -> None:
    settings = read(
        '{"SettingsVersion": 2.0, "DefaultSensors": {"imu": {"SensorType": 2, "Enabled": true}, "l": {"SensorType": 6,'
        '"Enabled": true, "NumberOfChannels": 32, "RotationsPerSecond": 20, "MeasurementsPerCycle": 1024,'
        '"DataFrame": "VehicleInertialFrame"},'
        '"e": {"SensorType": 7, "Enabled": true}}}'
    )
    imu, lidar = settings.added.sensors["imu"], settings.added.sensors["l"]
    assert isinstance(imu, Imu)
    assert isinstance(lidar, Lidar)
    assert not imu.noisy
    assert lidar.points_per_second == 32 * 1024 * 10
    assert lidar.in_sensor_frame  # Cosys-AirSim has no other frame
    assert "DefaultSensors.e is a sensor of type Echo, which is not simulated" in settings.notes[0]


@pytest.mark.parametrize(("lower", "upper"), [(-15, -45), (-100, 100), (0, 720)])
def test_angles_of_a_lidar_are_taken_as_they_come(lower: float, upper: float) -> None:
    angles = f'"VerticalFOVLower": {lower}, "VerticalFOVUpper": {upper}, "HorizontalFOVStart": -540'
    settings = read('{"DefaultSensors": {"L": {"SensorType": 6, "Enabled": true, ' + angles + "}}}")
    lidar = settings.added.sensors["L"]
    assert isinstance(lidar, Lidar)
    assert (lidar.vertical_fov_deg, lidar.horizontal_fov_deg) == ((lower, upper), (-540.0, 359.0))


def test_unknown_keys_are_told_once_with_the_nearest_and_meaningless_ones_in_one_line() -> None:
    notes = read(
        '{"clockspeed": 2, "ViewMode": "Fpv", "EngineSound": false,\n"Vehicles": {\n'
        '"A": {"VehicleType": "SimpleFlight", "Yawn": 1, "DefaultVehicleState": "Armed"},\n'
        '"B": {"VehicleType": "SimpleFlight", "Yawn": 1}}}'
    ).notes
    assert notes == (
        "settings.json:3: Vehicles.A.Yawn is not a setting of AirSim and is ignored (did you mean 'Yaw'?)",
        "settings.json:1: clockspeed is not a setting of AirSim and is ignored (did you mean 'ClockSpeed'?)",
        "settings.json: without meaning here: DefaultVehicleState, EngineSound, ViewMode",
    )


def test_the_last_of_two_equal_keys_counts() -> None:
    settings = read('{"ClockSpeed": 2,\n"ClockSpeed": 3}')
    assert settings.clock_speed == 3.0
    assert "settings.json:2: 'ClockSpeed' is given twice" in settings.notes[0]


def test_elements_that_are_no_objects_and_empty_sections_are_left_out() -> None:
    settings = read(
        '{"Recording": {"Cameras": ["front_center", {"CameraName": "0"}]}, "ExternalCameras": null,\n'
        '"Vehicles": {"A": {"VehicleType": "SimpleFlight", "Cameras": [], "Sensors": []}}}'
    )
    assert len(settings.recording.images) == 1
    assert len(settings.vehicles["A"].sensors) == 4
    (note,) = settings.notes
    assert "1: Recording.Cameras holds 'front_center', which is left out (an element is an object in braces)" in note


def test_all_mistakes_are_named_at_once_with_their_lines() -> None:
    assert problems(
        """{
  "ClockSpeed": "2", "ApiServerPort": 70000,
  "Wind": {"X": NaN}, "OriginGeopoint": {"Latitude": 1e9},
  "Vehicles": {
    "A": {"VehicleType": "simpleflight", "X": Infinity,
      "Cameras": {"0": {"CaptureSettings": [{"Width": 100000000}]}},
      "Sensors": {"L": {"SensorType": 6, "Enabled": 1}, "M": {}}},
    "B": {"VehicleType": "SimplFlight"}},
  "TimeOfDay": {"StartDateTime": "today"},
  "Recording": {"Cameras": [{"CameraName": "x"}, {"VehicleName": "C"}]}
}"""
    ) == [
        "2: ClockSpeed must be a number, not '2'",
        "2: ApiServerPort must be 1 to 65535, not 70000",
        "3: OriginGeopoint.Latitude must be -89.9 to 89.9, not 1000000000.0",
        "3: Wind.X must be a number, not NaN",
        "5: Vehicles.A.X must be -100000 to 100000, not inf",
        "6: Vehicles.A.Cameras.0.CaptureSettings[0].Width must be 1 to 8192, not 100000000",
        "7: Vehicles.A.Sensors.L.Enabled must be true or false, not 1",
        "7: Vehicles.A.Sensors.M has no SensorType "
        "(1 barometer, 2 IMU, 3 GPS, 4 magnetometer, 5 distance, 6 LiDAR)",
        "8: Vehicles.B.VehicleType has an unknown value: 'SimplFlight' (did you mean 'SimpleFlight'?)",
        "9: TimeOfDay.StartDateTime is not a date and time: 'today' (such as 2018-02-12 15:20:00)",
        "10: Recording.Cameras[0] names the unknown camera 'x' "
        "(known: front_center, front_right, front_left, bottom_center, back_center)",
        "10: Recording.Cameras[1] names the unknown vehicle 'C' (known: A)",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", " is empty"),
        ("[]", "1: must be an object in braces, not []"),
        ('{"a":\n', "2: is not valid JSON: Expecting value"),
        ('{"a": /* 1}', "1: is not valid JSON: Expecting value"),
        ("[" * 100_000, " is nested too deeply"),
        ('{"SimMode": "Car"}', "1: SimMode is Car, which is not simulated here (use Multirotor or ComputerVision)"),
        ('{"Vehicles": {"A": {"VehicleType": "PhysXCar"}}}',
         "1: Vehicles holds no vehicle that SimMode Multirotor creates (one needs VehicleType SimpleFlight or "
         "PX4Multirotor or ArduCopter, and AutoCreate must not be false)"),
        ('{"SettingsVersion": 1, "PX4": {}}', "1: PX4 belongs to files before SettingsVersion 1.2 "
         "(write it below CameraDefaults or Vehicles, as files of SettingsVersion 1.2 have it)"),
    ],
)  # fmt: skip
def test_a_wrong_file(text: str, problem: str) -> None:
    assert problems(text) == [problem]


def test_where_the_file_is_looked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", os.fspath(tmp_path / "home"))
    assert load_settings()[1] == "AirSim's default values"
    documents = tmp_path / "home" / "Documents" / "AirSim"
    documents.mkdir(parents=True)
    (documents / "settings.json").write_text('{"ApiServerPort": 1}')
    assert load_settings()[0].port == 1
    (tmp_path / "settings.json").write_text('{"ApiServerPort": 2}')
    assert find_settings() == Path("settings.json")
    assert load_settings()[0].port == 2
    (tmp_path / "own.json").write_text('{"ApiServerPort": 3}')
    assert load_settings("own.json")[0].port == 3
    assert load_settings('{"ApiServerPort": 4}')[0].port == 4
    with pytest.raises(ConfigError, match=r"absent\.json: no such file"):
        load_settings("absent.json")


def test_scenes_have_the_names_that_users_of_airsim_know() -> None:
    for name, own in (("Blocks", "blocks"), ("AirSimNH", "airsim_nh"), ("LandscapeMountains", "landscape_mountains")):
        assert scene_name(name) == own
        scene = load_scene(scene_name(name))
        assert scene.name == own
        assert scene.site == load_scene("airfield").site  # missions of the bench fly in every scene
    assert scene_name("city_park") == "city_park"
