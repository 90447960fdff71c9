"""Shrinking against oracles with known causes, its determinism and messages; one failure shrunk by real flights."""

from __future__ import annotations

import json
import shlex
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console
from typer.testing import CliRunner

from hil.apps.campaign.command import CampaignOptions, run_campaign
from hil.apps.campaign.find import command
from hil.apps.campaign.find.command import ShrinkOptions, shrink_case
from hil.apps.campaign.find.missions import write_cut
from hil.apps.campaign.find.parts import data_of, parts_of, without
from hil.apps.campaign.find.shrink import Shrinking, Shrunk, way_of_failing
from hil.apps.campaign.find.trials import Trials
from hil.apps.campaign.flight import Outcome
from hil.apps.campaign.store import Store
from hil.cli.app import app
from hil.config import Bench, load_bench
from hil.config.missions import load_mission
from signals.errors import ConfigError
from tests.worlds.oracle_engine import PASS, OracleEngine, failure

BASE = ("mission=rigs/missions/rectangle.plan", "autopilot.transport=loopback", "wind.steady_W_mps=[0, 0, 0]")
CROSS = "max_cross_track_m"
SENSORS = [
    {"sensor": "baro", "kind": "freeze", "at_s": 5},
    {"sensor": "gps", "kind": "dropout", "at_s": 12, "until_s": 20},
    {"sensor": "mag", "kind": "offset", "value": 1e-5, "at_s": 5},
    {"sensor": "gps", "kind": "offset", "field": "altitude_m", "value": 8, "at_s": 30},
]
CASE = (
    *BASE[:2],
    "wind.steady_W_mps=[8, -3, 0]",
    "wind.turbulence.wind_20ft_mps=7",
    "wind.gusts=" + json.dumps([{"at_s": 9, "velocity_W_mps": [1, 0, 0], "rise_s": 1}]),
    "faults.sensors=" + json.dumps(SENSORS),
    "faults.rotors=" + json.dumps([{"kind": "efficiency", "rotor": 1, "at_s": 12, "factor": 0.8}]),
    "vehicle_settings.mass_kg=2.3",
    "seed=77",
)


def wind_and_dropout(bench: Bench) -> Outcome:
    """Fail with 5 m/s from the west and a GPS dropout of more than 3 s."""
    config = bench.config
    assert config.wind is not None
    dropouts = [f for f in config.faults.sensors if f.sensor == "gps" and f.kind == "dropout"]
    long = any(f.until_s is None or f.until_s - f.at_s > 3.0 for f in dropouts)
    return failure(1.0 + config.wind.steady_W_mps[0] / 10) if long and config.wind.steady_W_mps[0] > 5.0 else PASS


def shrunk(engine: OracleEngine, out: Path, texts: tuple[str, ...] = CASE) -> tuple[Shrunk, Trials]:
    with Store(out) as store:
        trials = Trials(store, engine, None, out)
        (first,) = trials.make([texts])
        found = Shrinking(trials, texts, first.outcome, BASE, out / "shrunk").run("case")
    return found, trials


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> tuple[Shrunk, Trials, OracleEngine]:
    """Return the case shrunk by one worker."""
    engine = OracleEngine(wind_and_dropout)
    return *shrunk(engine, tmp_path_factory.mktemp("alone")), engine


def test_two_causes_of_many_parts_remain(alone: tuple[Shrunk, Trials, OracleEngine]) -> None:
    found, _, engine = alone
    config = load_bench(None, settings=found.texts).config
    (fault,) = config.faults.sensors
    assert (fault.sensor, fault.kind, fault.at_s) == ("gps", "dropout", 12)
    assert 3.0 < fault.until_s - fault.at_s <= 3.0 + 8.0 / 16
    assert config.wind is not None
    east, north, up = config.wind.steady_W_mps
    assert 5.0 < east <= 5.0 + 8.0 / 16
    assert (north, up, config.wind.turbulence, config.wind.gusts) == (0.0, 0.0, None, ())
    assert (config.faults.rotors, config.vehicle_settings, config.seed) == ((), {}, 1)
    assert len(found.remains) == 2, found.remains
    assert found.mission is not None, "no waypoint is needed"
    assert not load_mission(found.mission).waypoints
    assert sorted(Counter(engine.flown).values(), reverse=True)[:2] == [2, 1], "only the first case was flown again"
    assert not any("turbulence" in text or "seed" in text for text in found.texts)
    assert sum("gps" in line for line in found.removed) == 1, "the offset; the dropout stays"


def test_the_same_trials_for_five_workers_of_which_some_are_lost(
    alone: tuple[Shrunk, Trials, OracleEngine], tmp_path: Path
) -> None:
    one, first, _ = alone
    many, second = shrunk(OracleEngine(wind_and_dropout, 5, order=2, lost=(2, 3, 11)), tmp_path)
    assert second.asked == first.asked
    assert (many.case, many.removed, many.reduced, many.remains) == (one.case, one.removed, one.reduced, one.remains)


def test_another_failure_does_not_count(tmp_path: Path) -> None:
    """Without the rotor fault the flight fails too, but in another way."""

    def oracle(bench: Bench) -> Outcome:
        return failure() if bench.config.faults.rotors else Outcome("FAIL", ("crashed: impact at 9.1 m/s, 3 s",))

    found, _ = shrunk(OracleEngine(oracle), tmp_path)
    config = load_bench(None, settings=found.texts).config
    assert [fault.rotor for fault in config.faults.rotors] == [1]
    assert config.faults.rotors[0].factor == 1.0, "its size has no influence"
    assert config.faults.sensors == ()


def test_the_waypoint_that_is_needed_remains(tmp_path: Path) -> None:
    third = load_bench(None).mission.waypoints[2].lat_degE7  # type: ignore[union-attr]

    def oracle(bench: Bench) -> Outcome:
        assert bench.mission is not None
        return failure() if any(item.lat_degE7 == third for item in bench.mission.waypoints) else PASS

    found, _ = shrunk(OracleEngine(oracle), tmp_path)
    assert found.mission == (tmp_path / "shrunk" / "case.waypoints").resolve()
    assert {item.lat_degE7 for item in load_mission(found.mission).waypoints} == {third}
    assert any("waypoints" in line for line in found.removed)
    assert not found.remains


def test_a_cut_mission_has_the_items_of_the_whole_one(tmp_path: Path) -> None:
    bench = load_bench(None)
    assert bench.mission is not None
    whole = load_mission(write_cut(bench.mission, bench.mission.waypoints, bench, tmp_path))
    assert list(map(repr, whole.items)) == list(map(repr, bench.mission.items)), "texts, since NaN is not NaN"


def test_faults_of_the_bench_file_can_be_taken_out(tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(
        "rig: mock\nfaults: {sensors: [{sensor: gps, kind: freeze, at_s: 5}, {sensor: mag, kind: freeze, at_s: 5}]}\n"
    )

    def oracle(bench: Bench) -> Outcome:
        return failure() if any(fault.sensor == "gps" for fault in bench.config.faults.sensors) else PASS

    with Store(tmp_path / "out") as store:
        trials = Trials(store, OracleEngine(oracle), path, tmp_path / "out")
        found = Shrinking(trials, ("seed=3",), failure(), (), tmp_path / "out").run("case")
    assert [f.sensor for f in load_bench(path, settings=found.texts).config.faults.sensors] == ["gps"]


def test_parts_return_to_the_base() -> None:
    base = data_of(["wind.steady_W_mps=[1, 0, 0]", "scene=airfield"])
    case = data_of(["wind.steady_W_mps=[1, 5, 0]", "scene=city_park", "sensors.gps.rate_hz=5"])
    parts = parts_of(case, base)
    assert [part.text for part in parts] == [
        "wind.steady_W_mps[1] = 5",
        'scene = "city_park"',
        "sensors.gps.rate_hz = 5",
    ]
    assert without(case, parts) == base


@pytest.mark.parametrize(
    ("one", "two", "same"),
    [
        (f"{CROSS} is 1.2 m, more than the 1 m allowed", f"{CROSS} is 7e+03 m, more than the 1 m allowed", True),
        (f"{CROSS} is nan m, more than the 1 m allowed", f"{CROSS} is 3 m, more than the 1 m allowed", True),
        (f"{CROSS} is 1.2 m, more than the 1 m allowed", "final_error_m is 1.2 m, more than the 1 m allowed", False),
        (
            "crashed: impact at 7.1 m/s, 3 s after the start at (1.0, -2.0, 0.1) m",
            "crashed: impact at 9 m/s, 4 s",
            True,
        ),
        ("crashed: impact at 7.1 m/s, 3 s after the start", "crashed: it lies on its side or back, 3 s after", False),
        ("reached 1 of 3 waypoints", "reached 0 of 1 waypoints", True),
    ],
)
def test_ways_of_failing(one: str, two: str, same: bool) -> None:
    assert (way_of_failing(Outcome("FAIL", (one,))) == way_of_failing(Outcome("FAIL", (two, "more")))) is same


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return the folder of a campaign with a PASS, an ERROR, an unmet fault, a FLAKE and a failure of no repeat."""
    with Store(tmp_path) as store:
        store.begin_plan(None, BASE)
        store.put("aa01", PASS, CASE)
        store.put("aa02", Outcome("ERROR", error_type="LockstepLost", error="no answer"), CASE)
        store.put("aa03", replace(failure(), reasons=("late",), unmet=("late",)), CASE)
        store.put("bb03", failure(), CASE)
        store.put_check("bb03", "00", "tick 5: imu")
        store.put("cc04", replace(failure(), reasons=("reached 0 of 4 waypoints",)), (*BASE, "duration_s=60"))
    return tmp_path


@pytest.mark.parametrize(
    ("case", "message"),
    [
        ("aa01", "is a PASS: there is no failure"),
        ("aa02", "is an ERROR, which says nothing about the vehicle: LockstepLost: no answer"),
        ("aa03", "aa03 says nothing about the vehicle: late"),
        ("bb", "is a FLAKE, it does not repeat: tick 5: imu"),
        ("aa", "begins 3 cases: aa01, aa02, aa03"),
        ("zz", "is not a case"),
        ("cc04", "does not repeat: it was stored as 'reached 0 of 4 waypoints', and is now PASS"),
    ],
)
def test_a_case_that_cannot_be_shrunk_is_told(
    folder: Path, case: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, "LocalEngine", lambda *_: OracleEngine(lambda _: PASS))
    with pytest.raises(ConfigError, match=message):
        shrink_case(case, ShrinkOptions(folder, workers=1, quiet=True), Console(quiet=True))
    assert not (folder / "shrunk").exists()
    assert not (folder / "work").exists()


def test_the_folder_of_a_case(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match=r"no campaign in campaigns/ has a case that begins with 'aa01'"):
        shrink_case("aa01", ShrinkOptions(), Console(quiet=True))
    with pytest.raises(ConfigError, match="elsewhere holds no campaign"):
        shrink_case("aa01", ShrinkOptions(tmp_path / "elsewhere"), Console(quiet=True))
    assert not (tmp_path / "elsewhere").exists()
    with Store(tmp_path / "campaigns" / "one") as store:
        store.put("aa01", PASS, CASE)
    with pytest.raises(ConfigError, match="is a PASS"):
        shrink_case("aa0", ShrinkOptions(), Console(quiet=True))


def test_a_real_failure_is_shrunk_and_its_command_repeats_it(tmp_path: Path) -> None:
    """The flight ends before the first waypoint whatever else is set: only `duration_s` remains."""
    spec, out = tmp_path / "short.yaml", tmp_path / "out"
    settings = "{mission: rigs/missions/short.waypoints, autopilot: {transport: loopback}, duration_s: 60}"
    spec.write_text(f"settings: {settings}\naxes: {{duration_s: [5], vehicle_settings.mass_kg: [2.1]}}\nkeep: none\n")
    assert run_campaign(spec, CampaignOptions(out=out, quiet=True, workers=1), Console(quiet=True)) == 1
    result = CliRunner().invoke(
        app, ["campaign", "shrink", "", "--out", str(out), "--workers", "1", "--tolerance", "1"]
    )
    assert result.exit_code == 0, result.output
    (path,) = (out / "shrunk").glob("*.json")
    data = json.loads(path.read_text())
    assert data["remains"] == ["duration_s = 5"]
    assert data["removed"][0].startswith("vehicle_settings.mass_kg = 2.1")
    assert data["command"] in result.output.splitlines()
    words = shlex.split(data["command"])
    flown = CliRunner().invoke(app, [*words[1:], "--out", str(tmp_path / "run"), "--quiet"])
    assert flown.exit_code == 1, flown.output
    assert json.loads((tmp_path / "run" / "run.json").read_text())["verdict"]["reasons"][0] == data["smallest_reason"]
