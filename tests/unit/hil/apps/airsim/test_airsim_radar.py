"""Radars of a bench behind `getRadarData`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hil.apps.airsim.api.catalog import method_table
from hil.apps.airsim.command import Choice, make_simulation
from hil.apps.airsim.rpc.methods import RpcError
from hil.apps.airsim.settings.settings import read_settings

ROOT = Path(__file__).resolve().parents[5]


def test_a_radar_of_the_bench() -> None:
    bench = ROOT / "rigs/benches/radar_towards.yaml"
    simulation = make_simulation(Choice(config=bench), read_settings("{}", "settings.json"), print)
    table = method_table(simulation)
    answer = table.call("getRadarData", [])
    raw = np.frombuffer(answer["raw"], "<u2").reshape(answer["shape"])
    assert raw.ndim == 3
    assert raw.std() > 0.0
    assert len(answer["points"]) % 5 == 0
    again = table.call("getRadarData", ["", ""])
    assert again["raw"] == answer["raw"]
    for _ in range(50):
        simulation.step()
    later = table.call("getRadarData", [simulation.radars.names[0], ""])
    assert later["raw"] != answer["raw"]
    assert later["time_stamp"] > answer["time_stamp"]
    with pytest.raises(RpcError, match="No radar with name rear exist on vehicle SimpleFlight; it has "):
        table.call("getRadarData", ["rear"])


def test_servers_of_the_bench_are_told_to_be_ignored(tmp_path: Path) -> None:
    path, lines = tmp_path / "bench.yaml", list[str]()
    path.write_text("scene: airfield\nfoxglove: {port: 8765}\nros2: {domain: 0}\n")
    make_simulation(Choice(config=path), read_settings("{}", "settings.json"), lines.append).close()
    assert lines == [
        "foxglove.port is ignored: hil airsim serves AirSim's clients only",
        "ros2.domain is ignored: hil airsim serves AirSim's clients only",
    ]


def test_a_bench_without_a_radar() -> None:
    simulation = make_simulation(Choice(scene="airfield"), read_settings("{}", "settings.json"), print)
    with pytest.raises(RpcError, match="add a radar to the sensors of the bench file"):
        method_table(simulation).call("getRadarData", [])
