"""Scripts in the manner of AirSim's examples, run with the real clients of AirSim and Cosys-AirSim."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.worlds.airsim_clients import PYTHONS, client_python, documented_clients
from tests.worlds.airsim_process import AirSimProcess, run_script

pytestmark = pytest.mark.slow  # the first run installs the clients

SETTINGS: dict[str, Any] = {
    "SettingsVersion": 1.2,
    "SimMode": "Multirotor",
    "Vehicles": {
        "Lead": {
            "VehicleType": "SimpleFlight",
            "Sensors": {
                "Scan": {
                    "SensorType": 6,
                    "Enabled": True,
                    "NumberOfChannels": 8,
                    "PointsPerSecond": 8000,
                    "HorizontalFOVStart": 0,
                    "HorizontalFOVEnd": 0,  # a whole turn
                    "VerticalFOVUpper": -30,
                    "VerticalFOVLower": -60,
                },
                "Down": {"SensorType": 5, "Enabled": True, "Pitch": -90},
            },
        },
        "Wing": {"VehicleType": "SimpleFlight", "X": 4, "Y": -3},
    },
}
VISION = {"SettingsVersion": 1.2, "SimMode": "ComputerVision"}
CLIENTS = tuple(documented_clients())
SCRIPTS = ("fly", "path", "lidar", "pause", "reset", "wind", "teleport", "images", "several", "objects")


@pytest.fixture(scope="module", params=CLIENTS)
def client(request: pytest.FixtureRequest) -> str:
    client_python(request.param)
    return request.param


@pytest.fixture(scope="module")
def server(client: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[AirSimProcess]:
    out = tmp_path_factory.mktemp("server")
    with AirSimProcess(out, "--scene", "Blocks", "--clock", "calls", settings=SETTINGS) as running:
        yield running


@pytest.mark.parametrize("python", PYTHONS)
def test_the_documented_lines_give_a_working_client(client: str, server: AirSimProcess, python: str) -> None:
    run_script(client, "client", server, python=python)


@pytest.mark.parametrize("script", SCRIPTS)
def test_a_script_runs_with_a_real_client(client: str, server: AirSimProcess, script: str) -> None:
    run_script(client, script, server)
    assert "defect" not in server.log()


def test_pictures_are_taken_in_computer_vision_mode(client: str, tmp_path: Path) -> None:
    with AirSimProcess(tmp_path, "--scene", "Blocks", "--clock", "calls", settings=VISION) as server:
        run_script(client, "computer_vision", server)


def test_a_flight_follows_the_wall_clock(client: str, tmp_path: Path) -> None:
    with AirSimProcess(tmp_path, "--scene", "Blocks", settings=SETTINGS | {"ClockSpeed": 3}) as server:
        run_script(client, "reset", server)


def test_a_script_repeats_bit_by_bit_on_any_number_of_cores(client: str, tmp_path: Path) -> None:
    cores = sorted(os.sched_getaffinity(0))
    printed, digests = set(), set()
    for k, core in enumerate((None, None, None, cores[0], cores[-1])):
        out = tmp_path / str(k)
        with AirSimProcess(out, "--scene", "Blocks", "--clock", "calls", settings=SETTINGS, core=core) as server:
            printed.add(run_script(client, "mission", server, "--images"))
            report = server.finish()
        digests.add(report["digest"])
        assert not report["unknown"]
    assert len(printed) == 1
    assert len(digests) == 1
