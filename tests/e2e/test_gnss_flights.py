"""Flights of the mock under a sky: an open one changes nothing, a jammer costs the position, a spoofer is followed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mcap.reader import make_reader

from tests.worlds.bench_files import flown

GPS = "sensors:\n  gps: {preset: here_plus, rate_hz: 10, sky: %s}\n"
BRIEF = "record: {mcap: false, tlog: false, report: false}\nduration_s: 32\n"


def fly(folder: Path, text: str) -> dict[str, Any]:
    text = f"rig: mock\nmission: rigs/missions/rectangle.plan\nautopilot: {{transport: loopback}}\n{text}"
    return flown(folder, text).run


def test_a_short_jamming_is_flown_through_and_recorded(tmp_path: Path) -> None:
    jammer = "{kind: jammer, sensor: gps, at_s: 40, until_s: 41.5, place_m: [0, 0, 2], power_dbm: 40}"
    run = fly(tmp_path, GPS % "{}" + f"faults:\n  sensors:\n    - {jammer}\n")
    assert run["status"] == "PASS"
    gnss = run["gnss"]["gps"]
    assert set(gnss["fixes"]) == {"no fix", "RTK float", "RTK fixed"}
    assert 15 <= gnss["fixes"]["no fix"] <= 27
    assert gnss["satellites"]["min"] == 0
    assert any(row["what"] == "gps: rays to satellites" for row in run["skipped"])
    assert (tmp_path / "out/sky_gps.png").stat().st_size > 10_000
    with (tmp_path / "out/run.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    counts = {summary.channels[k].topic: n for k, n in summary.statistics.channel_message_counts.items()}
    assert counts["/gps/sky"] == gnss["samples"]


def test_a_long_jamming_ends_in_the_failsafe(tmp_path: Path) -> None:
    jammer = "{kind: jammer, sensor: gps, at_s: 20, place_m: [0, 0, 2], power_dbm: 40}"
    run = fly(tmp_path, GPS % "{}" + f"faults:\n  sensors:\n    - {jammer}\n{BRIEF}")
    assert run["error"] is None
    assert any("no valid position" in failsafe["text"] for failsafe in run["failsafes"])


def test_a_spoofer_pulls_the_vehicle_away(tmp_path: Path) -> None:
    spoofer = "{kind: spoofer, sensor: gps, at_s: 20, place_m: [0, 0, 2], power_dbm: 20, velocity_mps: [0, 1, 0]}"
    run = fly(tmp_path, GPS % "{}" + f"faults:\n  sensors:\n    - {spoofer}\n{BRIEF}")
    assert run["status"] == "FAIL"
    assert run["error"] is None
    assert run["mission"]["max_cross_track_m"] > 3.0
    assert run["gnss"]["gps"]["spoofed"] > 10


def test_under_an_open_sky_the_vehicle_flies_the_same(tmp_path: Path) -> None:
    tracks = []
    for name, sky in (("without", "null"), ("with", "{}")):
        (tmp_path / name).mkdir()
        run = fly(tmp_path / name, GPS % sky + BRIEF)
        tracks.append((run["mission"], run["sim_s"]))
    assert tracks[0] == tracks[1]
    assert tracks[0][0]["reached"] > 0
