"""Loading a bench: the merging of its layers, and every kind of mistake with its exact place."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from firmware_bridge.mock_pixhawk.faults import KINDS as FAULT_KINDS
from firmware_bridge.mock_pixhawk.faults import parse_fault
from hil.config import load_bench, resolved_yaml, save_bench
from signals.documents.yaml_lines import parse_yaml
from signals.errors import ConfigError
from sim.physics.vehicle import VEHICLE_DIR
from sim.sensors.catalog import KINDS
from tests.worlds.bench_files import elsewhere, load, refused  # noqa: F401 (the fixture is for every test)

REPOSITORY = Path(__file__).resolve().parents[4]


def test_the_default_bench_is_found_from_anywhere() -> None:
    bench = load_bench()
    assert bench.config.rig == "mock"
    assert bench.config.tick_ns == 4_000_000
    assert bench.mission is not None
    assert len(bench.mission.waypoints) == 6
    assert bench.files["bench"] == REPOSITORY / "hil.yaml"
    sensors = bench.config.autopilot_sensors()
    assert sensors == {"imu": "imu", "gps": "gps", "barometer": "baro", "magnetometer": "mag"}


def test_a_map_on_the_command_line_takes_the_place_of_a_map_made_from_a_seed() -> None:
    quarter = REPOSITORY / "docs" / "examples" / "places" / "quarter.osm"
    village = REPOSITORY / "rigs" / "explore.yaml"
    assert load_bench(village).config.map_seed == 1
    bench = load_bench(village, scene=str(quarter))
    assert (bench.scene.name, bench.config.map_seed) == ("quarter", None)
    assert bench.config.goal is not None
    alp = REPOSITORY / "docs" / "examples" / "places" / "alp.tif"
    assert load_bench(village, settings=[f"scene={alp}"]).config.map_seed is None  # as a Gymnasium environment says it
    with pytest.raises(ConfigError, match="map_seed"):  # asked for at the same time
        load_bench(village, scene=str(quarter), settings=["map_seed=2"])


def test_limits_that_no_flight_breaks_are_refused_at_their_line() -> None:
    limits = "limits: {max_cross_track_m: 1.0e+9, landed_tilt_deg: 180}\ncrash:\n  impact_mps: 1000\n"
    assert refused(limits + "plane_limits:\n  stalled_s: 1.0e+6\n") == [
        "b.yaml:1: limits.max_cross_track_m: 1e+09 m is too wide to judge a flight: write less than 1000 m, or null",
        "b.yaml:1: limits.landed_tilt_deg: 180 deg is too wide to judge a flight: write less than 180 deg, or null",
        "b.yaml:3: crash.impact_mps: 1000 m/s is too wide to judge a flight: write less than 50 m/s, or null",
        "b.yaml:5: plane_limits.stalled_s: 1e+06 s is too wide to judge a flight: write less than 3600 s, or null",
    ]
    more = "follow: {position_max_m: 1000, attitude_rms_deg: 400}\nplane_limits: {airspeed_margin: 1.0e-9}\n"
    assert refused(more) == [
        "b.yaml:1: follow.position_max_m: 1000 m is too wide to judge a flight: write less than 1000 m, or null",
        "b.yaml:1: follow.attitude_rms_deg: 400 deg is too wide to judge a flight: write less than 180 deg, or null",
        "b.yaml:2: plane_limits.airspeed_margin must be at least 0.5, not 1e-09",
    ]
    assert load("limits: {max_cross_track_m: 900, landed_tilt_deg: null}\n").config.limits.landed_tilt_deg is None


def test_a_goal_at_which_the_vehicle_starts_is_refused() -> None:
    goal = "companion: {{start: [explore], control: true}}\ngoal: {{p_W: [3, 4, 2], within_m: 6, outcome: {}}}\n"
    (problem,) = refused(goal.format("goal"))
    assert (
        problem
        == "b.yaml:2: goal.within_m is 6 m, and the start is 5.0 m from the goal: nothing would have to be flown"
    )
    assert load(goal.format("no_path")).config.goal is not None


def test_an_empty_file_is_a_bench_with_the_standard_sensors() -> None:
    bench = load("")
    assert list(bench.config.sensors) == ["imu", "gps", "baro", "mag"]
    assert bench.mission is None


def test_later_layers_win_and_mappings_merge() -> None:
    text = "seed: 5\nautopilot: {boot_sensors: 7}\n" + SENSORS + "  baro: {preset: ms5611, rate_hz: 25}\n"
    bench = load(text, seed=6, settings=["seed=7", "sensors.baro.rate_hz=10", "autopilot.params.MPC_XY_P=1"])
    assert bench.config.seed == 7
    assert bench.config.autopilot.boot_sensors == 7
    assert bench.config.autopilot.transport == "pty"
    assert bench.config.autopilot.params == {"MPC_XY_P": 1.0}
    assert list(bench.config.sensors) == ["imu", "gps", "baro", "mag"]
    assert bench.config.sensors["baro"].rate_hz == 10.0
    assert load(text, seed=6).config.seed == 6


def test_a_rig_beside_the_bench_file_is_preferred_and_its_sensors_can_be_removed() -> None:
    Path("rigs").mkdir()
    Path("rigs/mine.yaml").write_text(
        "autopilot: {kind: mock, airframe: iris}\nvehicle: iris\n"
        "sensors:\n  imu: {preset: icm20689}\n  gps: {preset: m8n, rate_hz: 5}\n"
    )
    bench = load("rig: mine\nsensors: {gps: null}\n")
    assert bench.vehicle.name == "iris"
    assert list(bench.config.sensors) == ["imu", "baro", "mag"]
    assert load("", rig="mine").config.sensors["gps"].preset == "m8n"
    assert load("", settings=["rig=mine"]).config.rig == "mine"


SENSORS = "sensors:\n  imu: {preset: icm20689}\n"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("sed: 1\n", "b.yaml:1: sed: unknown key (did you mean 'seed'?)"),
        ("seed: '1'\n", "b.yaml:1: seed must be a whole number, not '1' (leave the quotes away)"),
        ("seed: true\n", "b.yaml:1: seed must be a whole number, not true"),
        ("seed: -1\n", "b.yaml:1: seed must be at least 0, not -1"),
        ("\ntick_hz: 99\n", "b.yaml:2: tick_hz must be at least 100 Hz, not 99"),
        ("tick_hz: 1001\n", "b.yaml:1: tick_hz must be at most 1000 Hz, not 1001"),
        ("sensors:\n  lidar: {preset: vlp16, rate_hz: 0.4}\n",
         "b.yaml:2: sensors.lidar.rate_hz must be at least 0.5 Hz, not 0.4 Hz "
         "(a sweep takes its whole period, and its points state times within 2.1 s)"),
        ("sensors:\n  spin: {preset: navtech_cts350x, rate_hz: 0.4}\n",
         "b.yaml:2: sensors.spin.rate_hz must be at least 0.5 Hz, not 0.4 Hz "
         "(a sweep takes its whole period, and its points state times within 2.1 s)"),
        (f"seed: {2**63}\n", f"b.yaml:1: seed must be at most {2**63 - 1}, not {2**63}"),
        (
            "tick_hz: 300\n",
            "b.yaml:1: tick_hz: 300 Hz is not a whole number of nanoseconds per tick; the nearest that is: 320 Hz",
        ),
        ("duration_s: .nan\n", "b.yaml:1: duration_s must be a finite number in s, not nan"),
        ("duration_s: 0\n", "b.yaml:1: duration_s must be above 0 s, not 0"),
        ("pace: fast\n", "b.yaml:1: pace must be a number, not 'fast'"),
        (
            "record:\n  mcap: yes\n",
            "b.yaml:2: record.mcap must be true or false, not 'yes' (write true or false)",
        ),
        ("autopilot:\n  transport: ptty\n",
         "b.yaml:2: autopilot.transport must be 'pty' or 'loopback', not 'ptty' (did you mean 'pty'?)"),
        ("autopilot:\n  params: {lower: 1}\n",
         "b.yaml:2: autopilot.params: 'lower' cannot be a parameter: 1 to 16 of A-Z, 0-9 and _"),
        ("autopilot: {start: false}\n",
         "b.yaml:1: autopilot.start is false, but autopilot.port is not set"),
        ("router:\n  gcs: localhost\n",
         "b.yaml:2: router.gcs: must look like udp:127.0.0.1:14550 (clients listen there), udpin:127.0.0.1:14551 or"
         " tcp:127.0.0.1:5790 (they connect to the bench), not 'localhost'"),
        ("rig: moc\n", "b.yaml:1: rig is unknown: 'moc' (did you mean 'mock'?)"),
        ("rig: 5\n", "b.yaml:1: rig must be text, not 5 (put it in quotes)"),
        ("vehicle: x50\n", "b.yaml:1: vehicle is unknown: 'x50' (did you mean 'x500'?)"),
        ("mission: gone.plan\n",
         "b.yaml:1: mission names a file that does not exist: gone.plan (looked beside . and in the installed rigs)"),
        ("scene: ./a.folder\n", "b.yaml:1: scene names a folder, not a file: ./a.folder"),
        ("scene: N47E008.hgt\n",
         "N47E008.hgt: is not a known kind of scene: .hgt (known: .yaml, .xml, .mjcf, .glb, .gltf, .osm, .osm.xml,"
         " .pbf, .tif, .tiff; export a model as .glb, convert heights: gdal_translate IN OUT.tif, an extract: osmium"
         " cat IN -o OUT.osm)"),
        ("- a\n", "b.yaml:1: must be a mapping of keys, not [\"a\"]"),
        ("sensors: []\n", "b.yaml:1: sensors must be a mapping of names to sensors, not []"),
        ("sensors: {imu: null}\n", "b.yaml:1: sensors must hold an imu that feeds the flight controller"),
        ("sensors: {gps: {preset: here_plus, rate_hz: .nan}}\n",
         "b.yaml:1: sensors.gps.rate_hz must be a finite number in Hz, not nan"),
        (SENSORS + "  rtk: {preset: here_plus}\n", "b.yaml:3: sensors.rtk.rate_hz is missing"),
        (SENSORS + "  gps: {preset: here_plsu, rate_hz: 5}\n",
         "b.yaml:3: sensors.gps.preset is unknown: 'here_plsu' (did you mean 'here_plus'?)"),
        (SENSORS + "  b: {kind: barometr, rate_hz: 5}\n",
         "b.yaml:3: sensors.b.kind is unknown: 'barometr' (did you mean 'barometer'?)"),
        (SENSORS + "  b:\n    rate_hz: 5\n",
         f"b.yaml:3: sensors.b needs a preset or a kind (kinds: {', '.join(KINDS)})"),
        (SENSORS + "  gps:\n    preset: ms5611\n    kind: gps\n    rate_hz: 5\n",
         "b.yaml:5: sensors.gps.kind is 'gps', but the preset 'ms5611' is of kind 'barometer'"),
        (SENSORS + "  gps:\n    preset: here_plus\n    rate_hz: 5\n    latncy_s: 5\n",
         "b.yaml:6: sensors.gps.latncy_s: unknown key (did you mean 'latency_s'?)"),
        (SENSORS + "  gps:\n    preset: here_plus\n    rate_hz: 5\n    latency_s: 5\n",
         "b.yaml:6: sensors.gps.latency_s must be at most 2 s, not 5"),
        (SENSORS + "  gps: {preset: here_plus, rate_hz: 251}\n",
         "b.yaml:3: sensors.gps.rate_hz must be at most the tick's rate, 250 Hz, not 251 Hz"
         " (lower it or raise tick_hz)"),
        ("sensors:\n  imu: {preset: icm20689, rate_hz: 100}\n",
         "b.yaml:2: sensors.imu.rate_hz must be the tick's rate, 250 Hz, not 100 Hz"
         " (an imu is read at every tick: leave rate_hz out)"),
        (SENSORS + "  imu2: {preset: icm20689, autopilot: true}\n  imu3: {preset: icm20689, autopilot: true}\n",
         "b.yaml:4: sensors.imu3.autopilot is true, but 'imu2' already feeds the flight controller as its imu"),
    ],
)  # fmt: skip
def test_every_mistake_is_named_with_its_line(text: str, problem: str) -> None:
    Path("a.folder").mkdir()
    Path("N47E008.hgt").write_bytes(b"\x01\xf4" * 8)
    assert refused(text) == [problem]


@pytest.mark.parametrize(
    ("setting", "problem"),
    [
        ("autopilot.prot=1", "--set autopilot.prot: unknown key (did you mean 'autopilot.port'?)"),
        ("seed.x=1", "--set seed.x: seed has no keys below it (seed is 2)"),
        ("seed", "--set seed: has no value (write --set seed=VALUE)"),
        ("=1", "--set =1: has an empty key (write --set section.key=VALUE)"),
        ("sensors.gps.rate_hz=[1", "--set sensors.gps.rate_hz: is not valid YAML: expected ',' or ']', but got"
         " '<stream end>' while parsing a flow sequence"),
        ("sensors.gps.rate_hz=-5", "--set sensors.gps.rate_hz: must be above 0 Hz, not -5"),
    ],
)  # fmt: skip
def test_mistakes_of_the_command_line_are_named_as_such(setting: str, problem: str) -> None:
    assert refused("seed: 2\n", settings=[setting]) == [problem]


def test_mistakes_in_other_files_are_named_there() -> None:
    Path("rigs/scenes").mkdir(parents=True)
    Path("rigs/vehicles").mkdir()
    Path("rigs/bad.yaml").write_text("pace: 0\nrig: mock\n")
    Path("rigs/scenes/bad.yaml").write_text("name: bad\ndescription: ''\nsite: {latitude_deg: 95}\nground_frction: 1\n")
    original = (REPOSITORY / "rigs/vehicles/x500.yaml").read_text()
    Path("rigs/vehicles/bad.yaml").write_text(original.replace("mass_kg: 2", "mass_kg: -2"))
    line = original[: original.index("mass_kg")].count("\n") + 1
    found = refused("scene: bad\nvehicle: bad\nrig: bad\n")
    assert "rigs/bad.yaml:1: pace must be above 0, not 0" in found
    assert "rigs/bad.yaml:2: rig does not belong in a rig's file" in found
    assert "rigs/scenes/bad.yaml:3: site.latitude_deg must be at most 89.9 deg, not 95" in found
    assert "rigs/scenes/bad.yaml:3: site.longitude_deg is missing" in found
    assert "rigs/scenes/bad.yaml:4: ground_frction: unknown key (did you mean 'ground_friction'?)" in found
    assert f"rigs/vehicles/bad.yaml:{line} " not in found
    assert any(p.startswith(f"rigs/vehicles/bad.yaml:{line}: mass_kg must be above 0.001 kg, not -2") for p in found)


@pytest.mark.parametrize(("latitude", "longitude", "field"), [(85, 140, "0.4"), (89, 10, "2.3"), (-64, 136, "0.3")])
def test_a_site_at_a_magnetic_pole_is_refused_where_it_is_written(latitude: int, longitude: int, field: str) -> None:
    Path("pole.yaml").write_text(
        "name: pole\ndescription: ''\nground_friction: 1\n"
        f"site: {{latitude_deg: {latitude}, longitude_deg: {longitude}, altitude_m: 100}}\n"
    )
    assert refused("scene: pole.yaml\n") == [
        f"pole.yaml:4: site lies at a magnetic pole: the horizontal field at {latitude}, {longitude} is {field} uT, and"
        " a compass needs 3 uT (choose a site farther from the magnetic poles)"
    ]


def test_all_problems_come_at_once_and_in_order() -> None:
    found = refused(
        "seed: x\n\nscene: nowhere\nmission: m.plan\nsensors:\n  imu: {preset: icm20689}\n"
        "  gps: {preset: m8n, rate_hz: 300, sats: 3}\nlimits: {final_error_m: -1}\n",
        settings=["pace=-1"],
    )
    assert [p.split(":")[1] for p in found[:-1]] == ["1", "3", "4", "7", "8"]
    assert found[-1] == "--set pace: must be above 0, not -1"


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"\xff\xfe\x00", "is not text"), (b"a: \x00\n", "is a binary file"), (b"x" * 5_000_000, "is 5.0 MB long")],
)
def test_files_that_are_not_text(content: bytes, words: str) -> None:
    Path("b.yaml").write_bytes(content)
    with pytest.raises(ConfigError, match=words):
        load_bench("b.yaml")


def test_missing_file_and_folder() -> None:
    with pytest.raises(ConfigError, match=r"gone.yaml: no such file"):
        load_bench("gone.yaml")
    with pytest.raises(ConfigError, match="is a folder"):
        load_bench(Path.cwd())


TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
NUMBER = st.floats(min_value=1e-6, max_value=100, allow_nan=False)


ODD_SETTINGS = given(
    description=st.sampled_from(
        ["on", "1e3", "0x10", "1:30", "null", "~", "010", ".5", "- a", "#", "<<", "", "a\x85b", "\u2028"]
    )
    | TEXT,
    params=st.dictionaries(st.from_regex(r"[A-Z0-9_]{1,16}", fullmatch=True), st.floats(-1e30, 1e30), max_size=4),
    seed=st.integers(0, 2**63 - 1),
    noise=NUMBER,
    tick_hz=st.sampled_from([100, 125, 250, 500, 1000]),
)


def check_reading_back(description: str, params: dict[str, float], seed: int, noise: float, tick_hz: int) -> None:
    config = load(f"seed: {seed}\ntick_hz: {tick_hz}\n", settings=[f"sensors.gps.horizontal_noise_m={noise!r}"]).config
    # Names that the mock does not have are refused, but must be written so that they read back as text.
    named = config.model_copy(update={"autopilot": config.autopilot.model_copy(update={"params": params})})
    assert parse_yaml(resolved_yaml(named), "f").data["autopilot"]["params"] == params
    autopilot = config.autopilot.model_copy(update={"params": {"MPC_XY_P": min(5.0, max(0.1, noise))}})
    config = config.model_copy(update={"description": description, "autopilot": autopilot})
    assert load(resolved_yaml(config)).config == config


@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@ODD_SETTINGS
def test_resolved_settings_read_back_unchanged(**drawn: Any) -> None:
    check_reading_back(**drawn)


@pytest.mark.slow
@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@ODD_SETTINGS
def test_many_resolved_settings_read_back_unchanged(**drawn: Any) -> None:
    check_reading_back(**drawn)


def test_a_saved_bench_needs_only_its_folder(tmp_path: Path) -> None:
    Path("rigs/missions").mkdir(parents=True)
    Path("rigs/mine.yaml").write_text("autopilot: {params: {MPC_XY_P: 1}}\n")
    Path("rigs/missions/m.plan").write_bytes((REPOSITORY / "rigs/missions/rectangle.plan").read_bytes())
    bench = load("rig: mine\nmission: rigs/missions/m.plan\n")
    saved = save_bench(bench, tmp_path / "run")
    Path("rigs/mine.yaml").write_text("autopilot: {params: {MPC_XY_VEL_MAX: 4}}\n")
    Path("rigs/missions/m.plan").unlink()
    again = load_bench(saved)
    assert again.config.autopilot.params == {"MPC_XY_P": 1.0}
    assert again.mission is not None
    assert bench.mission is not None
    assert str(again.mission.items) == str(bench.mission.items)  # NaN differs from itself, its text does not
    assert (again.vehicle, again.scene) == (bench.vehicle, bench.scene)
    with pytest.raises(ConfigError, match="--rig"):
        load_bench(saved, rig="mock")


def test_faults_are_written_as_the_mock_reads_them() -> None:
    faults = load("autopilot: {faults: {die_at_s: 12.5, noise_at_s: 3}}\n").config.autopilot.faults
    assert [tuple(parse_fault(text)) for text in faults.texts()] == [("die", 12_500_000), ("noise", 3_000_000)]
    assert {name.removesuffix("_at_s") for name in type(faults).model_fields} == set(FAULT_KINDS)


@pytest.mark.parametrize("name", ["n" * 300 + ".plan", "~nosuchuser/x.plan", "a/" * 3000 + "x.plan"])
def test_impossible_file_names_are_problems(name: str) -> None:
    assert "b.yaml:1: mission names a file that does not exist" in refused(f"mission: {name}\n")[0]
    for option in ("rig", "scene", "vehicle"):
        assert refused(f"{option}: {name}\n")


def test_a_mission_that_is_a_pipe_is_refused() -> None:
    os.mkfifo("m.plan")
    assert refused("mission: m.plan\n") == ["m.plan: is not a regular file but a device, a pipe or a socket"]


def test_thousands_of_problems_are_cut_short() -> None:
    found = refused("".join(f"unknown_{n}: 1\n" for n in range(2_000)))
    assert len(found) == 101
    assert found[-1] == "and: 1900 more problems"


def test_deep_settings_are_problems() -> None:
    assert "nested too deeply" in refused("", settings=[".".join("a" * 3000) + "=1"])[0]


def test_parameters_of_the_mock_are_checked_where_they_are_written() -> None:
    assert refused("autopilot:\n  params:\n    MPC_XY_PP: 1\n    MPC_XY_P: 99\n") == [
        "b.yaml:3: autopilot.params.MPC_XY_PP is unknown to the mock autopilot (did you mean 'MPC_XY_P'?)",
        "b.yaml:4: autopilot.params.MPC_XY_P cannot be 99: it is outside 0.1 .. 5",
    ]
    found = refused("", settings=["autopilot.params.NOPE=1"])
    assert found[0].startswith("--set autopilot.params.NOPE: is unknown to the mock autopilot")


def test_a_mission_needs_the_sensors_to_fly_it() -> None:
    text = "sensors: {gps: {preset: m8n}, baro: null, mag: null}\nmission: rigs/missions/rectangle.plan\n"
    words = "b.yaml:1: sensors must hold a barometer and a magnetometer that feeds the flight controller"
    assert refused(text)[0].startswith(words)
    load(text.replace("mission:", "description:"))


def test_a_rigs_file_is_found_from_anywhere_and_is_a_bench_of_defaults_on_that_rig() -> None:
    Path("empty.yaml").write_text("{}")
    bench = load_bench("rigs/mock_hitl.yaml")
    assert Path(bench.config.rig).name == "mock_hitl.yaml"
    assert bench.config.autopilot.kind == "mock_hitl"
    assert (
        bench.config.model_copy(update={"rig": "mock_hitl"}) == load_bench(Path("empty.yaml"), rig="mock_hitl").config
    )


def test_sensors_merge_with_the_standard_ones_as_options_do() -> None:
    lidar = load("sensors:\n  range: {preset: tfmini, rate_hz: 20}\n").config.sensors
    assert list(lidar) == ["imu", "gps", "baro", "mag", "range"]
    slow = load("sensors: {gps: {rate_hz: 5}}\n").config.sensors
    assert slow == load("", settings=["sensors.gps.rate_hz=5"]).config.sensors
    assert (slow["gps"].preset, slow["gps"].rate_hz) == ("here_plus", 5.0)
    # A kind without a preset has no parameters but its own.
    assert refused("sensors: {gps: {kind: gps}}\n")[0] == "b.yaml:1: sensors.gps.horizontal_noise_m is missing"


def test_a_sensor_of_another_name_takes_the_place_of_the_standard_one_of_its_kind() -> None:
    own = load("sensors:\n  rtk: {preset: m8n, rate_hz: 5}\n").config.sensors
    assert list(own) == ["imu", "baro", "mag", "rtk"]
    assert own["rtk"].autopilot
    beside = load("sensors:\n  rtk: {preset: m8n, rate_hz: 5, autopilot: false}\n").config.sensors
    assert beside["gps"].autopilot
    assert not beside["rtk"].autopilot


def test_settings_of_the_vehicle_are_merged_over_its_file_and_saved_with_the_bench(tmp_path: Path) -> None:
    changed = load_bench(None, settings=["vehicle_settings={mass_kg: 2.5, battery: {cells: 6}}"])
    plain = load_bench(None)
    assert changed.vehicle.mass_kg == 2.5
    assert changed.vehicle.battery is not None
    assert plain.vehicle.battery is not None
    assert changed.vehicle.battery == plain.vehicle.battery.model_copy(update={"cells": 6})
    assert changed.vehicle.rotors == plain.vehicle.rotors
    again = load_bench(save_bench(changed, tmp_path))
    assert again.vehicle == changed.vehicle


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("vehicle_settings.mas_kg=2", "did you mean 'mass_kg'"),
        ("vehicle_settings.mass_kg=-2", "mass_kg must be above"),
        ("vehicle_settings=3", "must be a mapping"),
    ],
)
def test_a_wrong_setting_of_the_vehicle_is_named(setting: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        load_bench(None, settings=[setting])
    assert "--set vehicle_settings" in str(caught.value)


def test_a_wrong_value_in_a_list_of_a_vehicle_is_one_problem(tmp_path: Path) -> None:
    text = (VEHICLE_DIR / "x500.yaml").read_text()
    for right, wrong, problem in (
        ("spin: cw}\n", "spin: left}\n", "rotors[2].spin must be 'ccw' or 'cw', not 'left'"),
        ("kgm2: [0.023891, ", "kgm2: [.nan, ", "inertia_kgm2[0] must be a finite number in kg m2, not nan"),
    ):
        (tmp_path / "mine.yaml").write_text(text.replace(right, wrong, 1))
        with pytest.raises(ConfigError) as error:
            load_bench(settings=[f"vehicle={tmp_path / 'mine.yaml'}"])
        assert [p.message for p in error.value.problems] == [problem]


LONG = "a" * 300


@pytest.mark.parametrize(
    ("text", "key"),
    [
        (f"follow: {{log: {LONG}.ulg}}", "follow.log"),
        (f"follow: {{columns: {LONG}}}", "follow.columns"),
        ("follow: {log: ~nobody-of-that-name/a.ulg}", "follow.log"),
        (f"companion: {{start: [echo], trace: {LONG}}}", "companion.trace"),
        (f"rig: px4_sitl\nautopilot: {{binary: /{LONG}}}", "autopilot.binary"),
        ("rig: px4_sitl\nautopilot: {binary: ~nobody-of-that-name/px4}", "autopilot.binary"),
        (f"vehicles: {{b: {LONG}.yaml}}", "vehicles.b"),
        ("parts: {test_suite: {command: [ls], folder: nowhere}}", "parts.test_suite.folder"),
        ("parts: {test_suite: {command: [ls], folder: ~nobody-of-that-name}}", "parts.test_suite.folder"),
        ("mission: m.yaml", "plan"),
    ],
)
def test_a_name_that_no_file_can_have_is_of_a_file_that_does_not_exist(text: str, key: str) -> None:
    """It was a defect of the bench, status 3, and a folder of a test suite was made."""
    Path("m.yaml").write_text(f"plan: {LONG}.plan\n")
    told = refused(text + "\n")
    assert any(
        re.search(rf"\.yaml:\d+: {key}:? names a (file|program|folder) that does not exist: ", line) for line in told
    )
