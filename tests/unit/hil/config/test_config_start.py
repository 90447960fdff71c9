"""The section `start`: where the vehicle stands at the start of a run, and its heading."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from hil.config.schema import Start
from hil.run.autopilot import home_of
from hil.run.companion import link
from hil.run.loop.restartable_physics import make_physics
from signals.errors import LinkClosed
from signals.rotation import yaw_of
from tests.worlds.bench_files import elsewhere, load, refused

__all__ = ["elsewhere"]
OFF = (0.0,) * 4
YARD = """name: yard
description: A flat roof beside the origin
site: {latitude_deg: 47.4, longitude_deg: 8.5, altitude_m: 488.0}
ground_friction: 0.8
boxes:
  - {name: roof, center_m: [20.0, 0.0, 1.5], size_m: [6.0, 6.0, 3.0]}
"""


def yard(start: str) -> str:
    Path("yard.yaml").write_text(YARD, encoding="utf-8")
    return f"scene: ./yard.yaml\nstart: {start}\n"


@pytest.mark.parametrize("vehicle", ["x500", "iris", "racer"])
@pytest.mark.parametrize("on_restart", ["error", "reset"])
def test_vehicle_stands_at_rest_where_it_is_told_and_looks_there(vehicle: str, on_restart: str) -> None:
    lines = f"rig: ardupilot_sitl\nvehicle: {vehicle}\n"
    lines += f"autopilot: {{start: false, on_restart: {on_restart}}}\n"
    bench = load(lines + yard("{p_W: [20.0, 1.0, 3.0], yaw_deg: 90}"))
    physics = make_physics(bench)
    truth = physics.advance(0, OFF)
    assert truth.in_contact
    assert truth.p_WB[:2] == pytest.approx((20.0, 1.0), abs=1e-4)
    assert truth.p_WB[2] == pytest.approx(3.0 + bench.vehicle.standing_height_m, abs=1e-3)
    assert math.degrees(yaw_of(truth.q_WB)) == pytest.approx(90.0, abs=0.01)
    for tick in range(1, 500):
        after = physics.advance(tick, OFF)
    assert after.p_WB == pytest.approx(truth.p_WB, abs=1e-5)
    latitude, longitude, altitude, heading = home_of(bench.scene.site, physics.state)
    assert heading == pytest.approx(0.0, abs=0.01) or heading == pytest.approx(360.0, abs=0.01)
    assert (longitude - 8.5) * 111_320.0 * math.cos(math.radians(47.4)) == pytest.approx(20.0, rel=0.01)
    assert (latitude - 47.4) * 111_170.0 == pytest.approx(1.0, rel=0.01)
    assert altitude == pytest.approx(491.0 + bench.vehicle.standing_height_m, abs=0.01)


def test_without_the_section_nothing_changes() -> None:
    bench = load("rig: mock\n")
    assert bench.config.start == Start()
    state = make_physics(bench).state.tolist()
    assert state[:2] == [0.0, 0.0]
    assert state[3:7] == [1.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ("{p_W: [20.0, 0.0, 0.0]}", "no room to take off: the vehicle at (20, 0, 0) would stand"),
        ("{p_W: [20.0, 0.0, 0.0]}", "the topmost solid surface there is at z = 3.00 m"),
        ("{p_W: [0.0, 0.0, 5.0]}", "no ground to take off from: nothing solid is under (0, 0, 5)"),
        ("{p_W: [0.0, 0.0, 5.0]}", "the topmost solid surface there is at z = 0.00 m"),
        ("{p_W: [1e6, 0.0, 0.0]}", "start.p_W"),
        ("{yaw_deg: 400}", "start.yaw_deg must be"),
        ("{yaw: 40}", "start.yaw: unknown key"),
    ],
)
def test_a_start_that_is_no_free_ground_is_refused_where_it_is_written(start: str, message: str) -> None:
    (problem,) = refused(yard(start))
    assert problem.startswith("b.yaml:2: ")
    assert message in problem


def test_a_start_in_the_air_over_the_plain_airfield_is_refused() -> None:
    (problem,) = refused("rig: mock\nstart: {p_W: [5.0, 0.0, 1.0]}\n")
    assert "no ground to take off from" in problem


@pytest.mark.parametrize("own", [False, True])
def test_clients_that_localise_themselves_learn_the_start(
    own: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings: list[dict[str, Any]] = []

    def start(_cut: str, _address: str, _out: Path, given: dict[str, Any], _keys: Path | None) -> Any:
        settings.append(given)
        if len(settings) == 2:
            raise LinkClosed("companion", "it is not there")
        return SimpleNamespace(running=False, bad_end=lambda: None, close=lambda: None)

    monkeypatch.setattr(link, "StartedClient", start)
    mine = "{name: detect, settings: {start: [1, 2, 3, 0]}}" if own else "detect"
    text = f"start: {{p_W: [3.0, -4.0, 0.0], yaw_deg: 180}}\ncompanion: {{port: 0, start: [echo, {mine}]}}\n"
    bench = load(text)
    companion = link.CompanionLink(
        bench.config, tmp_path, waypoints_W=(), on_event=lambda *_: None, standing_height_m=0.25
    )
    with pytest.raises(LinkClosed):
        companion.open()
    companion.close()
    assert "start" not in settings[0]
    expected = [1, 2, 3, 0] if own else [3.0, -4.0, 0.25, math.pi]
    assert settings[1]["start"] == pytest.approx(expected)
