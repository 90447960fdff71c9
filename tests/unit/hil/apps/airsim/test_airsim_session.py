"""Methods of the API over a socket: session, state, moves, sensors, surroundings; and the clock `calls`."""

from __future__ import annotations

import gc
import itertools
import json
import math
import resource
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.apps.airsim import simulation
from hil.apps.airsim.settings.sensors import Lidar
from hil.apps.airsim.world.sensors.lidar import in_view, with_range_noise
from lab.airsim_server import RpcFailed
from sim.physics.vehicle import load_vehicle
from sim.world_loader import load_world
from tests.worlds.airsim_server import Client, Served, pose, served, vector, xyz
from tests.worlds.patience import PATIENCE_S

STAND_M = load_vehicle("x500").standing_height_m
NO_LIMIT = 3e38
STRAIGHT = {"is_rate": True, "yaw_or_rate": 0.0}
TWO = {
    "SettingsVersion": 1.2,
    "SimMode": "Multirotor",
    "Vehicles": {
        "A": {
            "VehicleType": "SimpleFlight",
            "Sensors": {
                "Scan": {
                    "SensorType": 6,
                    "Enabled": True,
                    "NumberOfChannels": 16,
                    "PointsPerSecond": 20000,
                    "VerticalFOVLower": -60,
                    "VerticalFOVUpper": -30,
                },
                "Body": {
                    "SensorType": 6, "Enabled": True, "NumberOfChannels": 2, "PointsPerSecond": 2000,
                    "DataFrame": "SensorLocalFrame", "HorizontalFOVStart": -45, "HorizontalFOVEnd": 45,
                },
                "Down": {"SensorType": 5, "Enabled": True, "Pitch": -90, "UncorrelatedNoiseSigma": 0.0},
                "Ahead": {"SensorType": 5, "Enabled": True, "UncorrelatedNoiseSigma": 0.0},
            },
        },
        "B": {"VehicleType": "SimpleFlight", "X": 4, "Y": -2, "Yaw": 90},
    },
}  # fmt: skip


@pytest.fixture(scope="module")
def world() -> Iterator[Served]:
    with served(json.dumps(TWO)) as running:
        yield running


@pytest.fixture
def client(world: Served) -> Iterator[Client]:
    """A client of two vehicles at their starts; only A is ready to fly."""
    client = world.client()
    client.call("reset")
    client.call("simPause", False)
    client.call("simSetWind", vector(0.0, 0.0, 0.0))
    client.call("enableApiControl", True, "A")
    client.call("armDisarm", True, "A")
    yield client
    client.close()


def state(client: Client, vehicle: str = "A") -> dict[str, Any]:
    found: dict[str, Any] = client.call("getMultirotorState", vehicle)
    return found


def position(client: Client, vehicle: str = "A") -> tuple[float, float, float]:
    return xyz(state(client, vehicle)["kinematics_estimated"]["position"])


def take_off(client: Client, vehicle: str = "A") -> None:
    assert client.call("takeoff", 20.0, vehicle) is True


def to(client: Client, x: float, y: float, z: float, vehicle: str = "A") -> int:
    """Send a moveToPosition and return its request."""
    return client.send("moveToPosition", x, y, z, 5.0, NO_LIMIT, 0, STRAIGHT, -1.0, 1.0, vehicle)


# Session


def test_vehicles_and_their_frames(client: Client) -> None:
    assert client.call("listVehicles") == ["A", "B"]
    assert json.loads(client.call("getSettingsString")) == TWO
    for name in ("A", "B", ""):
        assert position(client, name) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    a, b = (client.call("getHomeGeoPoint", name) for name in "AB")
    assert (a["latitude"], a["longitude"], a["altitude"]) == pytest.approx((47.641468, -122.140165, 122.0), abs=1e-5)
    assert (b["latitude"] - a["latitude"]) * 111_200 == pytest.approx(4.0, abs=0.05)
    q = client.call("simGetVehiclePose", "B")["orientation"]
    assert (abs(q["w_val"]), abs(q["z_val"])) == pytest.approx((math.sqrt(0.5), math.sqrt(0.5)), abs=1e-6)


def test_api_control_and_arming(client: Client) -> None:
    assert client.call("isApiControlEnabled", "A") is True
    assert client.call("isApiControlEnabled", "B") is False
    assert client.call("armDisarm", True, "B") is False  # without api control
    with pytest.raises(RpcFailed, match="enableApiControl"):
        client.call("takeoff", 20.0, "B")
    client.call("reset")
    assert client.call("isApiControlEnabled", "A") is False


def test_reset_returns_everything(client: Client) -> None:
    take_off(client)
    client.call("reset")
    assert position(client) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    assert state(client)["landed_state"] == 0
    assert client.call("simGetCollisionInfo", "A")["has_collided"] is False


def test_a_hundred_episodes_leave_no_trace(client: Client) -> None:
    ends = set()
    for _ in range(100):
        client.call("reset")
        client.call("enableApiControl", True, "A")
        client.call("moveByVelocity", 1.0, 0.5, -2.0, 0.2, 0, STRAIGHT, "A")
        ends.add(position(client))
    assert len(ends) == 1


@pytest.mark.parametrize("count", [200, pytest.param(700, marks=pytest.mark.slow)])
def test_hundreds_of_resets_do_not_grow(client: Client, count: int) -> None:
    def episodes(count: int) -> int:
        for _ in range(count):
            client.call("reset")
            client.call("enableApiControl", True, "A")
            client.call("moveByVelocity", 1.0, 0.0, -1.0, 0.02, 0, STRAIGHT, "A")
            client.call("getImuData", "", "A")
        gc.collect()
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return pages * resource.getpagesize()

    before = episodes(300 if count == 700 else 100)
    assert episodes(count) - before < 4 * 2**20


def test_pause_and_continue(client: Client, world: Served) -> None:
    client.call("simPause", True)
    assert client.call("simIsPaused") is True
    before = world.simulation.world.t_ns
    move = client.send("moveByVelocity", 0.0, 0.0, -1.0, 1.0, 0, STRAIGHT, "A")
    client.call("simContinueForTime", 0.5)
    assert world.simulation.world.t_ns - before == 500_000_000
    assert client.call("simIsPaused") is True
    client.call("simContinueForFrames", 10)
    assert world.simulation.world.t_ns - before == 660_000_000
    client.call("simPause", False)
    assert client.join(move) is True
    assert world.simulation.world.t_ns - before == pytest.approx(1e9, abs=5e6)


def test_a_client_may_add_a_vehicle() -> None:
    with served() as world:
        client = world.client()
        assert client.call("simAddVehicle", "New", "simpleflight", pose(3.0, 1.0, 0.0), "") is True
        assert client.call("listVehicles") == ["SimpleFlight", "New"]
        client.call("enableApiControl", True, "New")
        take_off(client, "New")
        assert position(client, "New") == pytest.approx((0.0, 0.0, -2.0), abs=0.2)
        assert position(client, "") == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
        with pytest.raises(RpcFailed, match="there is a vehicle 'New' already"):
            client.call("simAddVehicle", "New", "simpleflight", pose(5.0, 1.0, 0.0), "")
        client.call("simAddVehicle", "Near", "simpleflight", pose(0.0, 0.0, 0.0), "")  # where SimpleFlight stands
        assert position(client, "Near") == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
        assert xyz(client.call("simGetVehiclePose", "Near")["position"]) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
        assert not client.call("simGetCollisionInfo", "Near")["has_collided"]


def test_vehicles_at_one_place_start_beside_each_other() -> None:
    settings = {"Vehicles": {name: {"VehicleType": "SimpleFlight", "X": 2} for name in "ABCDEFG"}}
    with served(json.dumps(settings)) as world:
        client = world.client()
        assert sum(line.startswith("warning: vehicle ") for line in world.log) == 6
        assert any("'B' would start inside vehicle 'A', so it starts 0 m north and 1 m" in line for line in world.log)
        places = [xyz(client.call("simGetObjectPose", name, True)["position"]) for name in "ABCDEFG"]
        assert places[:2] == [pytest.approx((2.0, 0.0, 0.0), abs=1e-5), pytest.approx((2.0, 1.0, 0.0), abs=1e-5)]
        assert min(math.dist(a, b) for a, b in itertools.combinations(places, 2)) == pytest.approx(1.0, abs=1e-6)
        client.call("simContinueForTime", 0.1)
        for name in "ABCDEFG":
            assert position(client, name) == pytest.approx((0.0, 0.0, 0.0), abs=1e-4)
            assert not client.call("simGetCollisionInfo", name)["has_collided"]


def test_there_is_a_limit_of_vehicles(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulation, "MOST_VEHICLES", 2)
    with served() as world:
        client = world.client()
        assert client.call("simAddVehicle", "New", "simpleflight", pose(3.0, 1.0, 0.0), "") is True
        with pytest.raises(RpcFailed, match="there are 2 vehicles, as many as there may be"):
            client.call("simAddVehicle", "Third", "simpleflight", pose(9.0, 1.0, 0.0), "")


def test_a_vehicle_stands_on_the_ground_below_its_start() -> None:
    settings = {
        "SettingsVersion": 1.2,
        "SimMode": "Multirotor",
        "Vehicles": {
            "Low": {"VehicleType": "SimpleFlight", "Z": -1},
            "Usual": {"VehicleType": "SimpleFlight", "X": -5, "Z": -2},
            "High": {"VehicleType": "SimpleFlight", "X": 5, "Z": -30},
        },
    }
    with served(json.dumps(settings)) as world:
        client = world.client()
        assert position(client, "Usual") == pytest.approx((0.0, 0.0, 2.0), abs=1e-4)
        assert position(client, "Low") == pytest.approx((0.0, 0.0, 1.0), abs=1e-4)
        assert state(client, "Low")["landed_state"] == 0
        assert position(client, "High") == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
        assert state(client, "High")["landed_state"] == 1
        assert client.call("getHomeGeoPoint", "High")["altitude"] == pytest.approx(152.0, abs=1e-3)


# Moves


def test_a_flight(client: Client) -> None:
    take_off(client)
    assert state(client)["landed_state"] == 1
    assert position(client)[2] == pytest.approx(-2.0, abs=0.2)
    assert client.join(to(client, 8.0, -3.0, -4.0)) is True
    assert position(client) == pytest.approx((8.0, -3.0, -4.0), abs=0.5)
    assert client.call("land", 60.0, "A") is True
    assert position(client)[2] == pytest.approx(0.0, abs=0.05)
    assert state(client)["landed_state"] == 0
    collision = client.call("simGetCollisionInfo", "A")
    assert collision["has_collided"] is True
    assert collision["object_name"] == "ground"
    assert collision["object_id"] == client.call("simGetSegmentationObjectID", "ground")
    assert xyz(collision["normal"]) == (0.0, 0.0, -1.0)
    assert collision["time_stamp"] > 1_700_000_000 * 10**9
    assert client.call("simGetCollisionInfo", "A")["has_collided"] is False  # reading clears it


def test_a_new_move_cancels_the_running_one(client: Client) -> None:
    take_off(client)
    client.call("simPause", True)
    first = to(client, 100.0, 0.0, -4.0)
    second = client.send("moveByVelocity", 0.0, 0.0, 0.0, 0.1, 0, STRAIGHT, "A")
    assert client.join(first) is False
    client.call("simPause", False)
    assert client.join(second) is True


def test_cancel_last_task(client: Client) -> None:
    client.call("simPause", True)
    move = client.send("takeoff", 20.0, "A")
    client.call("cancelLastTask", "A")
    assert client.join(move) is False


def test_others_are_served_during_a_move(client: Client, world: Served) -> None:
    move = client.send("moveByVelocity", 0.0, 0.0, -1.0, 600.0, 0, STRAIGHT, "A")
    other = world.client()
    first_ns = state(other)["timestamp"]
    for _ in range(10):
        assert other.call("ping") is True
    assert state(other)["timestamp"] > first_ns  # the world moves on
    other.call("cancelLastTask", "A")
    assert client.join(move) is False


def test_a_client_that_dies_in_a_move_disturbs_nobody(client: Client, world: Served) -> None:
    dying = world.client()
    dying.call("ping")
    before = world.server.methods.calls.get("simContinueForTime", 0)
    client.call("simPause", True)
    dying.send("takeoff", 20.0, "A")
    dying.send("simContinueForTime", 0.1)
    dying.close()
    end_s = time.monotonic() + PATIENCE_S
    while world.server.methods.calls.get("simContinueForTime", 0) == before:  # it pauses the world when it is over
        assert time.monotonic() < end_s
        client.call("ping")
    client.call("simPause", False)
    assert client.call("moveByVelocity", 0.0, 0.0, -1.0, 2.0, 0, STRAIGHT, "A") is True
    assert client.call("ping") is True


def test_a_vehicle_that_leaves_the_range_ends_its_move_and_is_logged_once(client: Client, world: Served) -> None:
    take_off(client)
    drone = world.simulation.drones["A"]
    before = len(world.log)
    drone.vehicle.place((49_999.9, 0.0, 20.0), v_WB_W=(0.0, 0.0, 0.0))
    assert client.call("moveByVelocity", 0.0, 30.0, 0.0, 20.0, 0, STRAIGHT, "A") is False
    client.call("simContinueForTime", 1.0)
    assert len([line for line in world.log[before:] if "was stopped where it was" in line]) == 1
    assert max(drone.vehicle.truth.rotor_speed_radps) < 100.0


def test_two_vehicles_fly_at_once(client: Client) -> None:
    client.call("enableApiControl", True, "B")
    client.call("armDisarm", True, "B")
    client.call("simPause", True)
    a, b = client.send("takeoff", 20.0, "A"), client.send("takeoff", 20.0, "B")
    client.call("simPause", False)
    assert client.join(a) is True
    assert client.join(b) is True
    assert position(client, "A")[2] == pytest.approx(-2.0, abs=0.2)
    assert position(client, "B")[2] == pytest.approx(-2.0, abs=0.2)


def test_a_defect_of_one_controller_stops_one_vehicle(client: Client, world: Served) -> None:
    class Broken:
        succeeded = False

        def step(self, state: object) -> None:
            raise ZeroDivisionError

    client.call("enableApiControl", True, "B")
    flight = world.simulation.drones["B"].flight
    assert flight is not None
    results: list[object] = []
    flight.start(Broken(), results.append)
    take_off(client, "A")
    assert results == [False]
    assert any("B: ZeroDivisionError" in line for line in world.log)
    assert client.call("isApiControlEnabled", "B") is False


def test_a_vehicle_that_leaves_the_models_range_is_stopped(client: Client, world: Served) -> None:
    client.call(
        "simSetKinematics", {**pose(49_990.0, 0.0, -40.0), "linear_velocity": vector(150.0, 0.0, 0.0)}, True, "B"
    )
    client.call("simContinueForTime", 0.5)
    assert any("B was stopped where it was" in line for line in world.log)
    assert client.call("ping") is True
    client.call("reset")
    assert position(client, "B") == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


MOVES = [
    ("moveByVelocityZ", 1.0, 0.0, -3.0, 0.5, 0, STRAIGHT),
    ("moveByVelocityBodyFrame", 1.0, 0.0, 0.0, 0.5, 0, STRAIGHT),
    ("moveByVelocityZBodyFrame", 1.0, 0.0, -3.0, 0.5, 0, STRAIGHT),
    ("moveOnPath", [vector(1.0, 0.0, -3.0), vector(2.0, 1.0, -3.0)], 2.0, 30.0, 1, {"is_rate": False}, -1.0, 1.0),
    ("moveToGPS", 47.641478, -122.140165, 125.0, 2.0, 30.0, 0, STRAIGHT, -1.0, 1.0),
    ("moveToZ", -4.0, 1.0, 30.0, STRAIGHT, -1.0, 1.0),
    ("moveByManual", 1.0, 1.0, -3.0, 0.3, 0, STRAIGHT),
    ("rotateToYaw", 90.0, 10.0, 5.0),
    ("rotateByYawRate", 30.0, 0.5),
    ("hover",),
    ("moveByMotorPWMs", 0.6, 0.6, 0.6, 0.6, 0.1),
    ("moveByRollPitchYawZ", 0.05, 0.05, 0.1, -3.0, 0.3),
    ("moveByRollPitchYawThrottle", 0.0, 0.0, 0.0, 0.6, 0.2),
    ("moveByRollPitchYawrateThrottle", 0.0, 0.0, 0.1, 0.6, 0.2),
    ("moveByRollPitchYawrateZ", 0.0, 0.1, 0.1, -3.0, 0.2),
    ("moveByAngleRatesZ", 0.0, 0.0, 0.1, -3.0, 0.2),
    ("moveByAngleRatesThrottle", 0.0, 0.0, 0.1, 0.6, 0.2),
    ("moveByAngleZ", 0.05, 0.05, -3.0, 0.1, 0.3),
    ("moveByAngle", 0.05, 0.05, -3.0, 0.1, 0.3),
    ("moveByAngleThrottle", 0.0, 0.0, 0.6, 0.1, 0.2),
    ("goHome", 60.0),
]


@pytest.mark.parametrize("move", MOVES, ids=lambda move: move[0])
@pytest.mark.parametrize("named", [True, False])
def test_every_move_with_and_without_the_name_of_its_vehicle(
    client: Client, move: tuple[Any, ...], named: bool
) -> None:
    client.call("simSetVehiclePose", pose(0.0, 0.0, -3.0), True, "A")
    client.call("moveToZ", -3.0, 1.0)
    name, *arguments = move
    assert client.call(name, *arguments, *(["A"] if named else [])) is True
    assert all(map(math.isfinite, position(client)))


def test_a_move_to_a_gps_place(client: Client) -> None:
    client.call("moveToZ", -3.0, 2.0)
    client.call("moveToGPS", 47.641468 + 10.0 / 111_194, -122.140165, 127.0, 5.0)
    x, y, z = position(client)
    assert (x, y, z) == pytest.approx((10.0, 0.0, -5.0), abs=0.6)


@pytest.mark.parametrize("name", ["moveByVelocity", "moveToPosition", "moveByMotorPWMs", "moveByRollPitchYawZ"])
def test_a_set_point_that_is_not_finite_is_refused(client: Client, name: str) -> None:
    with pytest.raises(RpcFailed, match=r"argument 1 \(\w+\): expected a finite number, got nan"):
        client.call(name, math.nan, 1.0, 1.0, 1.0, 1.0)


def test_controller_gains(client: Client, world: Served) -> None:
    client.call("setVelocityControllerGains", [0.4, 0.4, 4.0], [0.0, 0.0, 2.0], [0.0] * 3, "A")
    client.call("setAngleRateControllerGains", [0.25] * 3, [0.0] * 3, [1.0] * 3, "A")
    assert any("ki and kd have no effect" in line for line in world.log)
    with pytest.raises(RpcFailed, match="an array of 3 number"):
        client.call("setPositionControllerGains", [0.25], [0.0] * 3, [0.0] * 3, "A")
    client.call("setVelocityControllerGains", [0.2, 0.2, 2.0], [0.0, 0.0, 2.0], [0.0] * 3, "A")


# State


def test_setting_a_pose_and_reading_it(client: Client) -> None:
    half = 0.5 * math.radians(30.0)
    q = (math.cos(half), 0.0, 0.0, math.sin(half))
    client.call("simSetVehiclePose", pose(2.0, -3.0, -10.0, q), True, "A")
    read = client.call("simGetVehiclePose", "A")
    assert xyz(read["position"]) == pytest.approx((2.0, -3.0, -10.0), abs=1e-5)
    assert [read["orientation"][key] for key in ("w_val", "z_val")] == pytest.approx([q[0], q[3]], abs=1e-6)
    nan = math.nan
    client.call("simSetVehiclePose", pose(nan, 7.0, nan, (nan, nan, nan, nan)), True, "A")
    read = client.call("simGetVehiclePose", "A")
    assert xyz(read["position"]) == pytest.approx((2.0, 7.0, -10.0), abs=1e-5)
    assert [read["orientation"][key] for key in ("w_val", "z_val")] == pytest.approx([q[0], q[3]], abs=1e-6)


@pytest.mark.parametrize(
    ("wanted", "told"),
    [
        (pose(1e6, 0.0, 0.0), "A cannot be put there: p_WB"),
        (pose(0.0, 0.0, -5.0, (0.0, 0.0, 0.0, 0.0)), "is not a rotation"),
        (pose(math.inf, 0.0, 0.0), "A cannot be put there: p_WB"),
    ],
)
def test_a_pose_that_is_impossible(client: Client, wanted: dict[str, Any], told: str) -> None:
    with pytest.raises(RpcFailed, match=told):
        client.call("simSetVehiclePose", wanted, True, "A")
    assert position(client) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


def test_setting_kinematics(client: Client) -> None:
    wanted = {
        **pose(1.0, 2.0, -20.0),
        "linear_velocity": vector(3.0, -1.0, 0.5),
        "angular_velocity": vector(0.1, 0.2, -0.3),
    }
    client.call("simSetKinematics", wanted, True, "A")
    read = client.call("simGetGroundTruthKinematics", "A")
    assert xyz(read["linear_velocity"]) == pytest.approx((3.0, -1.0, 0.5), abs=1e-6)
    assert xyz(read["angular_velocity"]) == pytest.approx((0.1, 0.2, -0.3), abs=1e-6)
    client.call("simContinueForTime", 0.1)
    assert xyz(client.call("getPosition", "A"))[0] == pytest.approx(1.3, abs=0.02)


def test_a_falling_vehicle(client: Client) -> None:
    client.call("reset")
    client.call("simSetVehiclePose", pose(0.0, 0.0, -50.0), True, "B")
    client.call("simContinueForTime", 0.5)
    kinematics = client.call("simGetGroundTruthKinematics", "B")
    assert xyz(kinematics["linear_acceleration"])[2] == pytest.approx(9.6, abs=0.4)
    assert xyz(kinematics["linear_velocity"])[2] == pytest.approx(4.9, abs=0.2)
    x, y, z = xyz(client.call("getImuData", "", "B")["linear_acceleration"])
    assert math.sqrt(x * x + y * y + z * z) < 0.6


def test_the_acceleration_of_a_tilted_vehicle_is_in_the_world(client: Client) -> None:
    client.call("reset")
    client.call("simSetVehiclePose", pose(0.0, 0.0, -50.0, (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)), True, "B")
    client.call("simContinueForTime", 0.1)
    x, y, z = xyz(client.call("simGetGroundTruthKinematics", "B")["linear_acceleration"])
    assert (x, y, z) == pytest.approx((0.0, 0.0, 9.8), abs=0.4)  # as the velocity, though its right side is down


def test_a_vehicle_of_another_type_is_not_added(client: Client, world: Served) -> None:
    assert client.call("simAddVehicle", "C", "submarine", pose(9.0, 9.0, 0.0), "") is False
    assert any("cannot add a vehicle of type 'submarine'" in line for line in world.log)


def test_safety_is_refused(client: Client, world: Served) -> None:
    assert client.call("setSafety", 0, 1.0, 0, 2.0, vector(0.0, 0.0, 0.0), 50.0, -20.0, 0.0, "A") is False
    assert any(line.startswith("setSafety: obstacles and geofences are not watched") for line in world.log)


def test_rotor_states(client: Client) -> None:
    take_off(client)
    states = client.call("getRotorStates", "A")
    assert len(states["rotors"]) == 4
    weight = load_vehicle("x500").mass_kg * 9.80665
    assert sum(rotor["thrust"] for rotor in states["rotors"]) == pytest.approx(weight, rel=0.15)
    assert sum(rotor["torque_scaler"] > 0.0 for rotor in states["rotors"]) == 2


def test_environment(client: Client) -> None:
    found = client.call("simGetGroundTruthEnvironment", "A")
    assert found["geo_point"]["altitude"] == pytest.approx(122.0, abs=1e-3)
    assert found["air_pressure"] == pytest.approx(101_325.0 * (1.0 - 0.0065 * 122.0 / 288.15) ** 5.25588, rel=1e-4)
    assert found["air_density"] == pytest.approx(1.2107, rel=1e-3)
    assert xyz(found["gravity"]) == pytest.approx((0.0, 0.0, 9.80665), abs=1e-5)


def test_old_names_of_2018(client: Client) -> None:
    client.call("simSetPose", pose(0.0, 1.0, -4.0), True)
    assert xyz(client.call("simGetPose")["position"]) == pytest.approx((0.0, 1.0, -4.0), abs=1e-6)
    assert xyz(client.call("getPosition")) == pytest.approx((0.0, 1.0, -4.0), abs=1e-6)
    assert xyz(client.call("getVelocity")) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    assert client.call("getOrientation")["w_val"] == pytest.approx(1.0)
    assert client.call("getCollisionInfo")["has_collided"] is False
    assert client.call("getGpsLocation")["altitude"] == pytest.approx(126.0, abs=1e-3)
    client.call("simContinueForTime", 0.1)
    client.call("simPause", False)
    assert client.call("getLandedState") == 1
    assert client.call("isSimulationMode") is True
    assert client.call("enableApiControl", True) is None
    assert client.call("armDisarm", True) is True
    assert client.call("takeoff", 15.0) is True
    assert client.call("moveToPosition", 0.0, 1.0, -5.0, 5.0, 60.0, 0, STRAIGHT, -1.0, 1.0) is True  # nine arguments
    assert client.call("getMultirotorState")["landed_state"] == 1


def test_vehicles_that_collide(client: Client) -> None:
    client.call("reset")
    client.call("simSetVehiclePose", pose(0.0, 0.0, -20.0), True, "A")
    client.call("simSetVehiclePose", pose(-4.0, 2.0, -22.0), True, "B")  # two metres above A
    wanted = {**pose(-4.0, 2.0, -22.0), "linear_velocity": vector(0.0, 0.0, 8.0)}
    client.call("simSetKinematics", wanted, True, "B")
    client.call("simContinueForTime", 0.6)
    collision = client.call("simGetCollisionInfo", "B")
    assert collision["has_collided"] is True
    assert collision["object_name"] == "A"


def test_a_vehicle_that_is_put_into_the_ground_is_moved_out_of_it(client: Client) -> None:
    client.call("simPause", True)
    client.call("simSetVehiclePose", pose(0.0, 0.0, 0.4), True, "A")
    assert position(client) == pytest.approx((0.0, 0.0, 0.0), abs=0.01)
    collision = client.call("simGetCollisionInfo", "A")
    assert collision["has_collided"] is True
    assert collision["penetration_depth"] == pytest.approx(0.4, abs=0.01)
    client.call("simContinueForTime", 0.2)
    assert position(client) == pytest.approx((0.0, 0.0, 0.0), abs=0.01)


# Sensors


def test_imu_at_rest(client: Client) -> None:
    values = []
    for _ in range(50):
        client.call("simContinueForTime", 0.004)
        values.append(xyz(client.call("getImuData", "", "B")["linear_acceleration"]))
    mean, sigma = np.mean(values, axis=0), np.std(values, axis=0)
    assert mean == pytest.approx((0.0, 0.0, -9.80665), abs=0.03)
    assert sigma == pytest.approx(0.24e-3 * 9.80665 * math.sqrt(250.0), rel=0.4)


def test_gps_is_late_and_becomes_accurate() -> None:
    with served() as world:
        client = world.client()
        assert client.call("getGpsData")["gnss"]["fix_type"] == 0
        client.call("simSetVehiclePose", pose(0.0, 0.0, -100.0), True)
        client.call("simContinueForTime", 0.1)
        assert client.call("getGpsData")["gnss"]["geo_point"]["altitude"] == pytest.approx(122.0, abs=0.01)
        client.call("simContinueForTime", 3.9)
        data = client.call("getGpsData")
        gnss = data["gnss"]
        assert gnss["fix_type"] == 3
        assert gnss["time_utc"] == data["time_stamp"] // 1000  # microseconds, as in GpsSimple.hpp
        assert gnss["eph"] == pytest.approx(0.1 + 99.9 * math.exp(-3.8 / 0.9), rel=0.05)
        falling = xyz(client.call("simGetGroundTruthKinematics")["linear_velocity"])[2]
        assert 0.0 < xyz(gnss["velocity"])[2] < falling


def test_a_sample_has_its_own_time_and_does_not_depend_on_who_asked_before() -> None:
    late = ("getBarometerData", ""), ("getMagnetometerData", ""), ("getDistanceSensorData", "Down")
    names = (*late, ("getLidarData", "Scan"), ("getGpsData", ""))
    below = {"camera_name": "bottom_center", "image_type": 5, "pixels_as_float": False, "compress": False}
    answers, pictures = [], []
    for other_asks in (True, False):
        with served(json.dumps(TWO)) as world:
            client = world.client()
            client.call("simSetVehiclePose", pose(0.0, 0.0, -40.0), True, "A")
            client.call("simSetVehiclePose", pose(-3.0, 2.0, -38.0), True, "B")  # one metre ahead of A and two below
            client.call("simPause", True)
            for vehicle in "AB":
                client.call("enableApiControl", True, vehicle)
                client.send("moveByMotorPWMs", 0.4, 0.4, 0.4, 0.4, 10.0, vehicle)
            for duration_s in (0.312, 1.224, 0.064):
                client.call("simContinueForTime", duration_s)
                if other_asks:
                    other = [client.call(name, sensor, "A") for name, sensor in names]
                    client.call("simGetImages", [below], "A")
            start_ns = client.call("getImuData", "", "A")["time_stamp"] - 1_600_000_000
            client.call("simContinueForTime", 0.016)
            answers.append([client.call(name, sensor, "A") for name, sensor in names])
            pictures.append(client.call("simGetImages", [below], "A")[0]["image_data_uint8"])
            stamps = [each["time_stamp"] - start_ns for each in answers[-1]]
            assert stamps == [1_600_000_000] * 4 + [1_400_000_000]
            if other_asks:
                assert other == answers[-1]
            assert client.call("getImuData", "", "A")["time_stamp"] == start_ns + 1_616_000_000
    assert "B" in answers[0][3]["groundtruth"]
    assert answers[0] == answers[1]
    assert len(set(pictures[0])) > 3  # colours of the ground and of B
    assert pictures[0] == pictures[1]


def test_barometer() -> None:
    with served() as world:
        client = world.client()
        before = client.call("getBarometerData")
        assert before["altitude"] == pytest.approx(122.0, abs=1.0)  # AirSim's drift begins at 0
        assert before["qnh"] == pytest.approx(1013.25)
        client.call("simSetVehiclePose", pose(0.0, 0.0, -100.0), True)
        client.call("simContinueForTime", 0.02)
        after = client.call("getBarometerData")
        assert after["altitude"] - before["altitude"] == pytest.approx(100.0, abs=2.0)


def test_barometer_and_magnetometer_are_late_by_their_latency() -> None:
    late = {"Enabled": True, "UpdateLatency": 0.5}
    sensors = {"baro": {"SensorType": 1, **late}, "mag": {"SensorType": 4, **late}}
    drone = {"VehicleType": "SimpleFlight", "Sensors": sensors}
    with served(json.dumps({"SettingsVersion": 1.2, "Vehicles": {"A": drone}})) as world:
        client = world.client()
        client.call("simContinueForTime", 1.0)
        low, level = client.call("getBarometerData"), client.call("getMagnetometerData")
        assert client.call("getImuData")["time_stamp"] - low["time_stamp"] == 500_000_000
        turned = pose(0.0, 0.0, -100.0, (0.0, 0.0, 0.0, 1.0))
        client.call("simSetVehiclePose", turned, True)
        for asked_s, is_late in ((0.4, True), (0.2, False)):
            client.call("simContinueForTime", asked_s)
            climbed_m = client.call("getBarometerData")["altitude"] - low["altitude"]
            north = xyz(client.call("getMagnetometerData")["magnetic_field_body"])[0]
            assert (climbed_m < 50.0) is is_late
            assert (north * xyz(level["magnetic_field_body"])[0] > 0.0) is is_late


def test_magnetometer(client: Client) -> None:
    field = xyz(client.call("getMagnetometerData", "", "A")["magnetic_field_body"])
    assert math.sqrt(sum(x * x for x in field)) == pytest.approx(0.53, abs=0.03)  # Gauss, at Seattle
    assert field[2] > 0.4  # down


def test_distance_sensors(client: Client) -> None:
    client.call("simSetVehiclePose", pose(0.0, 0.0, -9.0), True, "A")
    client.call("simContinueForTime", 0.004)
    client.call("simSetVehiclePose", pose(0.0, 0.0, -9.0), True, "A")
    client.call("simContinueForTime", 0.02)
    z = position(client)[2]
    down = client.call("getDistanceSensorData", "Down", "A")
    assert down["distance"] == pytest.approx(STAND_M - z, abs=0.02)
    assert (down["min_distance"], down["max_distance"]) == pytest.approx((0.2, 40.0))
    assert client.call("getDistanceSensorData", "Ahead", "A")["distance"] == pytest.approx(40.0)


def test_the_noise_of_a_distance_sensor_is_not_cut_off_and_the_bias_of_a_magnetometer_is_drawn() -> None:
    far = {"SensorType": 5, "Enabled": True, "UncorrelatedNoiseSigma": 0.2}
    field = {"SensorType": 4, "Enabled": True, "NoiseSigma": 0.0}
    biased = {**field, "NoiseBias": 0.3}
    vehicle = {"VehicleType": "SimpleFlight", "Sensors": {"Far": far, "Field": field, "Biased": biased}}
    settings = {"SettingsVersion": 1.2, "SimMode": "Multirotor", "Vehicles": {"A": vehicle}}
    with served(json.dumps(settings)) as world:
        client = world.client()
        found = []
        for _ in range(20):
            found.append(client.call("getDistanceSensorData", "Far", "A")["distance"])
            client.call("simContinueForTime", 0.02)
        assert min(found) < 40.0 < max(found)
        plain, other = (
            xyz(client.call("getMagnetometerData", name, "A")["magnetic_field_body"]) for name in ("Field", "Biased")
        )
        bias = [b - a for a, b in zip(plain, other, strict=True)]
        assert all(abs(x) <= 0.3 for x in bias)
        assert len(set(bias)) == 3


def test_lidar_sees_the_ground(client: Client) -> None:
    client.call("simSetVehiclePose", pose(-20.0, 20.0, -6.0), True, "A")
    client.call("simContinueForTime", 0.104)
    data = client.call("getLidarData", "Scan", "A")
    points = np.array(data["point_cloud"]).reshape(-1, 3)
    x, y, z = xyz(data["pose"]["position"])
    assert (x, y, z) == pytest.approx(position(client), abs=0.01)  # it has begun to fall since
    assert len(points) == len(data["segmentation"]) == 2000
    assert np.abs(points[:, 2] - STAND_M).max() < 0.01  # NED from the start: the ground below it
    ranges = np.linalg.norm(points - (x, y, z), axis=1)
    steepest = math.degrees(math.asin((STAND_M - z) / ranges.min()))
    assert steepest == pytest.approx(60.0, abs=1.0)


def test_points_of_a_lidar_have_the_id_and_the_name_of_their_object(client: Client) -> None:
    client.call("simSetVehiclePose", pose(0.0, 0.0, -5.0), True, "A")
    client.call("simSetVehiclePose", pose(-3.0, 2.0, -4.0), True, "B")  # one metre ahead of A and one below
    assert client.call("simSetSegmentationObjectID", "B", 77, False) is True
    client.call("simContinueForTime", 0.104)
    data = client.call("getLidarData", "Scan", "A")
    height = np.array(data["point_cloud"]).reshape(-1, 3)[:, 2]
    ids, names = np.array(data["segmentation"]), np.array(data["groundtruth"])
    vehicle = names == "B"
    assert 0 < vehicle.sum() < len(names)
    assert (height[vehicle] < STAND_M - 1.0).all()
    assert set(ids[vehicle].tolist()) == {77}
    assert set(names.tolist()) == {"B", "ground"}
    assert set(ids[~vehicle].tolist()) == {client.call("simGetSegmentationObjectID", "ground")}


def test_a_lidar_whose_angles_are_the_other_way_round_sees_the_same() -> None:
    clouds = []
    for angles in ((-60, -30), (-30, -60), (-150, -120), (240, 210)):  # over the top and down behind; a turn on
        scan = {"SensorType": 6, "Enabled": True, "NumberOfChannels": 4, "PointsPerSecond": 4000}
        scan |= dict(zip(("VerticalFOVLower", "VerticalFOVUpper"), angles, strict=True))
        with served(json.dumps({"DefaultSensors": {"L": scan}})) as world:
            data = world.client().call("getLidarData", "L", "")
        points = np.array(data["point_cloud"], np.float32).reshape(-1, 3)
        clouds.append(points[np.lexsort(np.round(points, 3).T)])
    assert len(clouds[0]) > 100
    for cloud in clouds[1:]:
        assert cloud == pytest.approx(clouds[0], abs=2e-3)


def test_lidar_in_its_own_frame_and_field_of_view(client: Client) -> None:
    client.call("simSetVehiclePose", pose(0.0, 0.0, -5.0, (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))), True, "A")
    client.call("simContinueForTime", 0.104)
    points = np.array(client.call("getLidarData", "Body", "A")["point_cloud"]).reshape(-1, 3)
    assert 40 <= len(points) <= 60  # a quarter of 200
    azimuth = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
    assert azimuth.min() >= -45.01
    assert azimuth.max() <= 45.01
    assert (points[:, 2] > 0.0).all()  # down


def test_a_lidar_sees_the_other_vehicle_and_not_its_own(client: Client) -> None:
    client.call("simSetVehiclePose", pose(0.0, 0.0, -5.0), True, "A")
    client.call("simSetVehiclePose", pose(-3.0, 2.0, -4.0), True, "B")  # one metre ahead of A and one below
    client.call("simContinueForTime", 0.104)
    data = client.call("getLidarData", "Scan", "A")
    points = np.array(data["point_cloud"]).reshape(-1, 3)
    above_ground = points[points[:, 2] < STAND_M - 1.0]
    assert len(above_ground) > 0
    assert np.abs(above_ground - (1.0, 0.0, -4.0)).max() < 1.0


def test_a_sensor_that_is_not_there(client: Client) -> None:
    with pytest.raises(RpcFailed, match="No lidar with name Nose exist on vehicle A; it has Body, Scan"):
        client.call("getLidarData", "Nose", "A")
    with pytest.raises(RpcFailed, match="No lidar with name  exist on vehicle B; add one to Sensors of B"):
        client.call("getLidarData", "", "B")


def test_sensors_follow_a_vehicle_that_is_placed_while_time_stands_still(client: Client) -> None:
    client.call("simPause", True)
    for z in (-5.0, -12.0):
        client.call("simSetVehiclePose", pose(-20.0, 20.0, z), True, "A")
        assert client.call("getDistanceSensorData", "Down", "A")["distance"] == pytest.approx(STAND_M - z, abs=1e-3)
        assert xyz(client.call("getLidarData", "Scan", "A")["pose"]["position"])[2] == pytest.approx(z)
        assert abs(client.call("getImuData", "", "A")["angular_velocity"]["x_val"]) < 0.1


# Surroundings


def test_wind_carries_a_vehicle_away(client: Client) -> None:
    client.call("reset")
    client.call("simSetWind", vector(0.0, 10.0, 0.0))
    client.call("simSetVehiclePose", pose(0.0, 0.0, -50.0), True, "B")
    client.call("simContinueForTime", 1.0)
    assert position(client, "B")[1] > 0.1
    with pytest.raises(RpcFailed, match="beyond 100 m/s"):
        client.call("simSetWind", vector(0.0, 101.0, 0.0))


def test_an_external_force_accelerates_every_vehicle() -> None:
    mass_kg, calm = load_vehicle("x500").mass_kg, {"PhysicsEngineName": "FastPhysicsEngine"}
    accelerations = []
    for settings, force in (
        (calm, None),
        (calm, (4.0, -2.0, 3.0)),
        ({"ExternalForce": {"X": 4, "Y": -2, "Z": 3}}, None),
    ):
        with served(json.dumps(settings)) as world:
            client = world.client()
            client.call("simAddVehicle", "B", "simpleflight", pose(0.0, 5.0, 0.0), "")
            if force is not None:
                client.call("simSetExtForce", vector(*force))
            client.call("simSetVehiclePose", pose(0.0, 0.0, -90.0), True, "B")
            client.call("simContinueForTime", 0.004)
            acceleration = client.call("simGetGroundTruthKinematics", "B")["linear_acceleration"]
            accelerations.append(np.array(xyz(acceleration)))
    calm_mps2, called_mps2, given_mps2 = accelerations
    assert called_mps2 - calm_mps2 == pytest.approx(np.array([4.0, -2.0, 3.0]) / mass_kg, abs=1e-3)
    assert np.array_equal(given_mps2, called_mps2)


def test_a_vehicle_holds_its_place_against_a_force(client: Client) -> None:
    take_off(client)
    client.call("simSetExtForce", vector(0.0, 2.0, 3.0))
    client.call("simContinueForTime", 4.0)
    assert position(client) == pytest.approx((0.0, 0.0, -2.0), abs=0.1)
    with pytest.raises(RpcFailed, match="beyond 200 N"):
        client.call("simSetExtForce", vector(0.0, 201.0, 0.0))
    client.call("simSetExtForce", vector(0.0, 0.0, 0.0))


def test_car_calls_say_that_there_are_no_cars(client: Client) -> None:
    for call in (("setCarControls", {"throttle": 1.0}, "A"), ("getCarControls", ""), ("getCarState",)):
        with pytest.raises(RpcFailed, match="there are no cars here; the vehicles are A, B: take MultirotorClient"):
            client.call(*call)


def test_a_refused_move_is_told_where_join_does_not(client: Client, world: Served) -> None:
    """The client's `.join()` drops the error of a reply, so the log, the report and the page have it."""
    before = world.server.methods.refused.get("takeoff", 0)
    for _ in range(2):
        with pytest.raises(RpcFailed, match="enableApiControl"):
            client.call("takeoff", 20.0, "B")
    told = [line for line in world.log if f"{client.socket.getsockname()[1]}: " in line]
    assert len(told) == 1
    assert "'takeoff'" in told[0]
    assert "call enableApiControl(True) first" in told[0]
    assert told[0].endswith("The script's .join() does not tell; .get() in its place raises this.")
    assert world.server.methods.refused["takeoff"] == before + 2
    _, severity, text = world.simulation.drone("B").texts[-1]
    assert (severity, text[:20]) == (4, "takeoff was refused:")


def test_weather_and_time_of_day_are_kept(client: Client, world: Served) -> None:
    around = world.simulation.surroundings
    client.call("simEnableWeather", True)
    client.call("simSetWeatherParameter", 7, 0.3)
    assert around.weather_enabled is True
    assert around.weather[7] == pytest.approx(0.3)
    client.call("simSetTimeOfDay", True, "2018-02-12 15:20:00", False, 10.0, 60.0, True)
    assert around.clock is not None
    assert around.clock.hour == 15
    with pytest.raises(RpcFailed, match="is not a date and time; write it as 2018-02-12 15:20:00"):
        client.call("simSetTimeOfDay", True, "noon")
    for _ in range(2):  # a value beyond the range counts as its end, as in AirSim
        client.call("simSetWeatherParameter", 1, 7.0)
    assert around.weather[1] == 1.0
    assert [line for line in world.log if "7 counts as 1" in line] == world.log[-1:]
    with pytest.raises(RpcFailed, match="expected WeatherParameter"):
        client.call("simSetWeatherParameter", 12, 0.5)
    client.call("simSetTimeOfDay", True, "2018-07-12 15:20:00", True, 1.0, 60.0, True)
    assert around.clock == datetime(2018, 7, 12, 14, 20, tzinfo=UTC)  # summer time
    client.call("simSetTimeOfDay", False)
    assert around.clock is None


def test_drawings_are_counted(client: Client, world: Served) -> None:
    drawings, points = world.simulation.drawings, [vector(0.0, 0.0, -1.0), vector(1.0, 0.0, -1.0)]
    client.call("simPlotPoints", points, [1.0, 0.0, 0.0, 1.0], 10.0, 0.05, False)
    client.call("simPlotLineStrip", points, [1.0, 0.0, 0.0, 1.0], 5.0, -1.0, True)
    client.call("simPlotArrows", points, points, [1.0, 0.0, 0.0, 1.0], 5.0, 2.0, -1.0, False)
    client.call("simPlotStrings", ["a", "b"], points, 5.0, [1.0, 0.0, 0.0, 1.0], -1.0)
    client.call("simContinueForTime", 0.1)
    client.call("simPlotTransforms", [pose(0.0, 0.0, 0.0)], 5.0, 5.0, -1.0, False)
    client.call("simPlotTransformsWithNames", [pose(0.0, 0.0, 0.0)], ["here"])
    client.call("simFlushPersistentMarkers")
    assert drawings.counts == {"points": 1, "line_strip": 1, "arrows": 1, "strings": 1, "transforms": 2}
    with pytest.raises(RpcFailed, match="as many of both"):
        client.call("simPlotStrings", ["a"], points)


def test_a_time_of_day_without_a_start_is_that_of_the_wall_clock() -> None:
    settings = '{"SettingsVersion": 1.2, "SimMode": "ComputerVision", "TimeOfDay": {"Enabled": true}}'
    with served(settings, clock="wall") as world:
        assert world.client().call("ping") is True
        start = world.simulation.surroundings.clock
        assert start is not None
        assert abs(start.timestamp() - time.time()) < 3600.0


def test_a_beam_on_the_edge_of_the_field_of_view_counts_at_any_range() -> None:
    settings = Lidar(channels=1, points_per_second=80, rate_hz=10.0, horizontal_fov_deg=(-45.0, 45.0))
    ranges_m = np.geomspace(0.1, 90.0, 500)
    edge = [[s * r, t * r, 0.0] for r in ranges_m / math.sqrt(2.0) for s, t in ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0))]
    points = np.array(edge, np.float32)
    points[:, 1] = np.nextafter(points[:, 1], np.sign(points[:, 1]) * np.float32(1e9))  # a rounding outwards
    assert len(in_view(points, np.zeros(len(points), np.uint16), settings)[0]) == 1000


# Computer vision


@pytest.mark.parametrize("mode", ['"ComputerVision"', '"Multirotor", "PhysicsEngineName": "ExternalPhysicsEngine"'])
def test_a_vehicle_without_physics_takes_no_impossible_pose(mode: str) -> None:
    with served(f'{{"SettingsVersion": 1.2, "SimMode": {mode}}}') as world:
        client = world.client()
        for value in (math.inf, 1e30):
            with pytest.raises(RpcFailed, match="cannot be put there: p_WB"):
                client.call("simSetVehiclePose", pose(value, 0.0, 0.0), True, "")
        assert xyz(client.call("simGetVehiclePose", "")["position"]) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


def test_computer_vision_vehicles_stand_where_they_are_put() -> None:
    with served('{"SettingsVersion": 1.2, "SimMode": "ComputerVision"}') as world:
        client = world.client()
        client.call("simSetVehiclePose", pose(5.0, 1.0, -7.0), True, "")
        client.call("simContinueForTime", 0.2)
        assert xyz(client.call("simGetVehiclePose", "")["position"]) == pytest.approx((5.0, 1.0, -7.0), abs=1e-6)
        assert client.call("isApiControlEnabled", "") is False
        client.call("enableApiControl", True, "")  # examples do so in any mode
        with pytest.raises(RpcFailed, match=r"takeoff needs a vehicle that flies.*set SimMode to Multirotor"):
            client.call("takeoff", 20.0, "")
        client.call("reset")
        assert xyz(client.call("simGetVehiclePose", "")["position"]) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


def test_external_physics_reports_collisions() -> None:
    settings = {"SettingsVersion": 1.2, "SimMode": "Multirotor", "PhysicsEngineName": "ExternalPhysicsEngine"}
    with served(json.dumps(settings)) as world:
        client = world.client()
        client.call("simSetVehiclePose", pose(0.0, 0.0, -3.0), False, "")
        assert client.call("simGetCollisionInfo", "")["has_collided"] is False
        client.call("simSetVehiclePose", pose(0.0, 0.0, 0.05), False, "")
        collision = client.call("simGetCollisionInfo", "")
        assert collision["object_name"] == "ground"
        assert collision["penetration_depth"] == pytest.approx(0.05, abs=1e-4)
        client.call("simContinueForTime", 0.1)
        assert xyz(client.call("simGetVehiclePose", "")["position"]) == pytest.approx((0.0, 0.0, 0.05), abs=1e-6)


def test_a_collision_names_the_object_and_its_id() -> None:
    settings = {"SettingsVersion": 1.2, "SimMode": "Multirotor", "PhysicsEngineName": "ExternalPhysicsEngine"}
    with served(json.dumps(settings), scene="blocks") as world:
        client = world.client()
        body = load_world(world.simulation.scene).model.body("TemplateCube_Rounded_7")
        x, y, z = body.pos.tolist()
        assert client.call("simSetSegmentationObjectID", "TemplateCube_Rounded_7", 42, False) is True
        for point_W, name, number in (((x, y, z + 0.5), body.name, 42), ((0.0, 0.0, -0.05), "Ground", None)):
            client.call("simSetVehiclePose", pose(*world.simulation.drone("").origin.from_W(point_W)), False, "")
            collision = client.call("simGetCollisionInfo", "")
            assert collision["object_name"] == name
            assert collision["object_id"] == client.call("simGetSegmentationObjectID", name)
            assert number is None or collision["object_id"] == number
        assert client.call("simGetCollisionInfo", "")["object_id"] == -1


def test_a_vehicle_that_pushes_a_wall_collides_again_and_again() -> None:
    settings = {"SettingsVersion": 1.2, "SimMode": "Multirotor"}
    with served(json.dumps(settings), scene="blocks") as world:
        client = world.client()
        name = "TemplateCube_Rounded_7"
        x, y, z = load_world(world.simulation.scene).model.body(name).pos.tolist()
        north, east, down = world.simulation.drone("").origin.from_W((x, y - 8.0, z + 5.0))
        client.call("enableApiControl", True, "")
        client.call("simSetVehiclePose", pose(north, east, down), True, "")
        push = client.send("moveByVelocity", 2.0, 0.0, 0.0, 8.0, 0, STRAIGHT, "")
        client.call("simContinueForTime", 5.0)
        for _ in range(3):
            collision = client.call("simGetCollisionInfo", "")
            assert (collision["has_collided"], collision["object_name"]) == (True, name)
            client.call("simContinueForTime", 0.5)
        client.call("simPause", False)
        client.join(push)


def test_a_vehicle_that_stands_or_takes_off_does_not_collide(client: Client) -> None:
    client.call("simContinueForTime", 0.5)
    client.call("simPause", False)
    take_off(client)
    assert client.call("simGetCollisionInfo", "A")["has_collided"] is False


def test_without_collisions_a_vehicle_stands_at_its_start_and_passes_through_everything_later() -> None:
    vehicle = {"VehicleType": "SimpleFlight", "EnableCollisions": False}
    settings = {"SettingsVersion": 1.2, "SimMode": "Multirotor", "Vehicles": {"A": vehicle}}
    with served(json.dumps(settings)) as world:
        client = world.client()
        client.call("simContinueForTime", 1.0)
        client.call("simPause", False)
        assert position(client) == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
        client.call("enableApiControl", True)
        take_off(client)
        assert client.join(to(client, 0.0, 0.0, 4.0)) is True
        assert position(client) == pytest.approx((0.0, 0.0, 4.0), abs=0.1)
        assert client.call("simGetCollisionInfo", "A")["has_collided"] is False
        client.call("reset")
        assert position(client) == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
        client.call("simContinueForTime", 1.0)
        assert position(client) == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)


def test_noise_of_a_lidar_grows_with_the_distance() -> None:
    settings = Lidar(range_m=100.0, noise_m=0.02, noise_scale=3.0)
    for r_m in (0.0, 50.0, 100.0):
        rays = np.random.default_rng(1).normal(size=(20_000, 3))
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        noisy = with_range_noise(((r_m + 1.0) * rays).astype(np.float32), "a", 3, settings)
        error_m = np.sum(noisy * rays, axis=1) - (r_m + 1.0)
        assert abs(np.mean(error_m)) < 0.001
        assert np.std(error_m) == pytest.approx(0.02 * (1.0 + 2.0 * (r_m + 1.0) / 100.0), rel=0.03)
        assert np.abs(np.cross(noisy, rays)).max() < 1e-4


# Clocks


def script(client: Client) -> None:
    """Fly as a user's script does, every move joined."""
    client.call("enableApiControl", True, "")
    client.call("armDisarm", True, "")
    client.call("takeoff", 20.0, "")
    client.call("moveByVelocity", 2.0, 1.0, -0.5, 1.5, 0, STRAIGHT, "")
    client.call("getImuData", "", "")
    client.call("rotateToYaw", 60.0, 10.0, 5.0, "")
    client.call("simPause", True)
    client.call("simContinueForTime", 0.25)
    client.call("simPause", False)
    client.call("getBarometerData", "", "")
    client.call("simGetCollisionInfo", "")
    client.call("getMultirotorState", "")


def test_calls_give_one_digest() -> None:
    digests = set()
    for _ in range(3):
        with served() as world:
            client = world.client()
            script(client)
            assert world.server.digest is not None
            digests.add((world.server.digest.hexdigest(), world.truths.hexdigest(), world.simulation.world.tick))
    assert len(digests) == 1


def test_with_calls_time_stands_still_while_nobody_waits(client: Client, world: Served) -> None:
    take_off(client)
    before = world.simulation.world.tick
    for _ in range(50):
        client.call("ping")
    assert world.simulation.world.tick == before


def test_the_wall_clock_runs_at_clock_speed() -> None:
    with served('{"SettingsVersion": 1.2, "SimMode": "Multirotor", "ClockSpeed": 10}', clock="wall") as world:
        client = world.client()
        began = time.perf_counter()
        first_ns = client.call("getMultirotorState")["timestamp"]
        now_ns, elapsed_s = first_ns, 0.0
        while now_ns - first_ns <= 2_000_000_000 and elapsed_s < PATIENCE_S:
            now_ns, elapsed_s = client.call("getMultirotorState")["timestamp"], time.perf_counter() - began
        assert now_ns - first_ns > 2_000_000_000
        # Never ahead; on a loaded machine it may be behind, and catch up with a quarter of a second.
        assert (now_ns - first_ns) / 1e9 <= 10.0 * (elapsed_s + 0.25) + 0.01
        client.call("simPause", True)
        paused_ns = client.call("getMultirotorState")["timestamp"]
        assert client.call("getMultirotorState")["timestamp"] == paused_ns
        client.call("simContinueForTime", 0.1)
        assert client.call("getMultirotorState")["timestamp"] - paused_ns == 100_000_000
