"""The section `vehicles` of a bench file: one complete bench per vehicle, and what two vehicles cannot share."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from hil.config import Bench, load_bench
from hil.config.checks import autopilot_checks
from hil.config.formation import formation_offsets
from hil.config.group_schema import Formation
from signals.errors import ConfigError
from tests.worlds.bench_process import ROOT

HEAD = "rig: mock\nmission: rigs/missions/rectangle.plan\n"


def load(tmp_path: Path, text: str, *settings: str) -> Bench:
    path = tmp_path / "bench.yaml"
    path.write_text(HEAD + text)
    return load_bench(path, settings=settings)


def problems(tmp_path: Path, text: str, *settings: str) -> str:
    with pytest.raises(ConfigError) as caught:
        load(tmp_path, text, *settings)
    return str(caught.value).replace(f"{tmp_path}/", "")


def test_each_vehicle_has_the_keys_of_the_bench_and_its_own_over_them(tmp_path):
    text = """
limits: {max_cross_track_m: 2}
vehicles:
  lead: {start: {p_W: [0, 0, 0], yaw_deg: 90}}
  second: {start: {p_W: [5, 0, 0]}, vehicle: iris, autopilot: {airframe: iris}, limits: {final_error_m: 1.5}}
"""
    bench = load(tmp_path, text, "limits.altitude_error_m=3", "vehicles.lead.limits.altitude_error_m=4")
    lead, second = bench.vehicles["lead"], bench.vehicles["second"]
    assert list(bench.vehicles) == ["lead", "second"]
    assert (lead.vehicle.name, second.vehicle.name) == ("x500", "iris")
    assert (lead.config.limits.max_cross_track_m, second.config.limits.max_cross_track_m) == (2.0, 2.0)
    assert (lead.config.limits.altitude_error_m, second.config.limits.altitude_error_m) == (4.0, 3.0)
    assert second.config.limits.final_error_m == 1.5
    assert (lead.config.start.yaw_deg, second.config.start.p_W) == (90.0, (5.0, 0.0, 0.0))
    assert [bench.config.autopilot.system_id for bench in bench.vehicles.values()] == [1, 2]
    assert lead.scene is second.scene


def test_what_a_flight_needs_is_asked_of_each_vehicle(tmp_path):
    """Only the keys of the whole bench were looked at: one whose client cannot be found was "ok"."""
    one = "companion: {start: ['nope.nope:X'], control: true}"
    text = f"vehicles:\n  one: {{{one}}}\n  two: {{start: {{p_W: [5, 0, 0]}}}}\n"
    message = "companion.start names a client of the module 'nope.nope', which cannot be found"
    assert f"bench.yaml:4: {message}" in problems(tmp_path, text)
    assert list(load_bench(tmp_path / "bench.yaml", flown=False).vehicles) == ["one", "two"]
    (tmp_path / "one.yaml").write_text(f"rig: mock\n{one}\n")
    file = text.replace(f"{{{one}}}", "one.yaml")
    assert f"one.yaml:2: {message}" in problems(tmp_path, file)
    search = "search: {label: car, camera: cam}, companion: {clients: 1, control: true}"
    search += ", sensors: {cam: {kind: camera, resolution: [64, 48], rate_hz: 5, fov_deg: 60}}"
    found = problems(tmp_path, text.replace(one, search))
    assert "bench.yaml:4: search.label is 'car', of which the scene 'airfield' has no object" in found
    # A key of the whole bench that every vehicle replaces is nobody's, and one that no vehicle replaces is told once.
    both = f"{one}\nvehicles: {{one: {{NONE}}, two: {{start: {{p_W: [5, 0, 0]}}NONE}}}}\n"
    none = "companion: {start: []}"
    assert problems(tmp_path, both.replace("NONE", "")).count(message) == 1
    replaced = both.replace("{NONE", f"{{{none}").replace("NONE", f", {none}").replace(", control: true", "")
    assert list(load(tmp_path, replaced).vehicles) == ["one", "two"]


def test_a_rig_of_one_vehicle_cannot_change_the_world(tmp_path):
    own = "weather: {visibility_m: 200}\nrandomize: {light: true}\nscene: city_park\nmap_seed: 4\n"
    (tmp_path / "own.yaml").write_text("autopilot: {kind: mock}\n" + own)
    text = "vehicles: {a: {}, b: {rig: own.yaml}}\nformation: {spacing_m: 5}\n"
    found = problems(tmp_path, text)
    message = "belongs to the whole bench, and b sets it to another value (write it at the top of the bench file)"
    for line, key in ((2, "weather"), (3, "randomize"), (4, "scene"), (5, "map_seed")):
        assert f"own.yaml:{line}: {key} {message}" in found
    (tmp_path / "own.yaml").write_text("autopilot: {kind: mock}\nweather: {visibility_m: 200}\n")
    bench = load(tmp_path, f"weather: {{visibility_m: 200}}\n{text}")
    assert bench.vehicles["b"].config.weather == bench.config.weather


def test_noise_depends_on_the_name_alone(tmp_path):
    two = load(tmp_path, "vehicles: {a: {}, b: {start: {p_W: [9, 0, 0]}}}")
    three = load(tmp_path, "vehicles: {c: {start: {p_W: [0, 9, 0]}}, b: {start: {p_W: [9, 0, 0]}}, a: {}}")
    for name in ("a", "b"):
        assert two.vehicles[name].config.noise_seed == three.vehicles[name].config.noise_seed
    seeds = {bench.config.noise_seed for bench in three.vehicles.values()}
    assert len(seeds) == 3
    assert load_bench().config.noise_seed == load_bench().config.seed


def test_a_name_with_n_stands_for_count_vehicles(tmp_path):
    text = "count: 3\nvehicles: {drone{n}: {}}\nformation: {shape: line, spacing_m: 4}\n"
    text = text.replace("drone{n}", '"drone{n}"')
    bench = load(tmp_path, text, "count=4", "vehicles.drone{n}.limits.final_error_m=2")
    assert list(bench.vehicles) == ["drone1", "drone2", "drone3", "drone4"]
    assert [b.config.start.p_W[1] for b in bench.vehicles.values()] == [0.0, -4.0, -8.0, -12.0]
    assert {b.config.limits.final_error_m for b in bench.vehicles.values()} == {2.0}


def test_the_shapes_of_a_formation():
    names = list("abcde")

    def places(**settings):
        return [(x, y) for x, y, _ in formation_offsets(Formation(**settings), names).values()]

    assert places(shape="wedge", spacing_m=2.0) == [(0, 0), (-2, 2), (-2, -2), (-4, 4), (-4, -4)]
    assert places(shape="column", spacing_m=2.0) == [(0, 0), (-2, 0), (-4, 0), (-6, 0), (-8, 0)]
    assert places(shape="grid", spacing_m=2.0) == [(0, 0), (0, -2), (0, -4), (-2, 0), (-2, -2)]
    assert places(shape="column", spacing_m=2.0, heading_deg=90.0) == [(0, 0), (0, -2), (0, -4), (0, -6), (0, -8)]
    assert places(shape="line", spacing_m=1.0, offsets_m={"c": (7.0, 8.0, 9.0)})[2] == (7, 8)


def test_a_mission_is_shifted_to_the_place_in_the_formation(tmp_path):
    bench = load(tmp_path, "vehicles: {a: {}, b: {}}\nformation: {shape: line, spacing_m: 10}\n")
    ours, theirs = (bench.vehicles[name].mission.items for name in "ab")
    for a, b in zip(ours, theirs, strict=True):
        if a.lat_degE7:
            # 10 m to the south; a degree of latitude is 111.2 km long here
            assert (a.lat_degE7 - b.lat_degE7) * 1e-7 * 111_190 == pytest.approx(10.0, abs=0.05)
            assert abs(a.lon_degE7 - b.lon_degE7) <= 1
        assert a.alt_m == b.alt_m


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("vehicles: {a: {}, a: {}}", "bench.yaml:3: "),
        ("vehicles: {A: {}}", "bench.yaml:3: vehicles.A cannot be the name of a vehicle"),
        ("vehicles: {replay: {}}", "vehicles.replay cannot be the name of a vehicle: OUT/replay is another folder"),
        ('count: 10\nvehicles: {"abcdefghijklmnopqrstuvwxyz_1234{n}": {}}', "cannot be the name of a vehicle"),
        (
            'count: 60\nvehicles: {"a{n}": {}, "b{n}": {}}',
            "bench.yaml:3: count gives the bench 120 vehicles, and it can have 100",
        ),
        ("vehicles: {a: {seed: 3}}", "bench.yaml:3: vehicles.a.seed belongs to the whole bench, not to one vehicle"),
        ("vehicles: {a: {autopilot: x}}", "bench.yaml:3: autopilot must be a mapping of keys, not 'x'"),
        ("vehicles: {a: bench.yaml}", "bench.yaml:3: vehicles.a names a file with several vehicles: bench.yaml"),
        ("vehicles: {a: 5}", "bench.yaml:3: vehicles.a must be a mapping of keys or the path of a bench file, not 5"),
        ("vehicles: {a: nowhere.yaml}", "bench.yaml:3: vehicles.a names a file that does not exist: nowhere.yaml"),
        (
            "vehicles: {a: {}, b: {}}\nformation:\n  offsets_m: {a: [1, 0, 0]}",
            "bench.yaml:5: formation.offsets_m.a must be [0, 0, 0]: the places of a formation",
        ),
        ('vehicles: {"d{n}": {}}', "stands for several vehicles, and `count` is not set"),
        ("count: 3\nvehicles: {a: {}}", "bench.yaml:3: count has no meaning: no name of a vehicle contains {n}"),
        ("vehicles:\n  a: {}\n  b: {}", "puts b into a, 0.00 m away"),
        (
            "vehicles:\n  a: {}\n  b: {start: {p_W: [0.5, 0, 0]}}",
            "bench.yaml:5: start.p_W puts b into a, 0.50 m away",
        ),
        (
            "autopilot: {instance: 2}\nvehicles: {a: {}, b: {autopilot: {instance: 0}, start: {p_W: [5, 0, 0]}}}",
            "autopilot.instance 0 is also the instance of a",
        ),
        ("vehicles:\n  a: {}\n  b: {mission: null, start: {p_W: [5, 0, 0]}}", "b: nobody flies this vehicle"),
        (
            "vehicles:\n  a: {}\n  b: {rig: px4_hitl, start: {p_W: [5, 0, 0]}}",
            "cannot run twice on one board",
        ),
        (
            "vehicles:\n  a: {}\n  b: {rig: ardupilot_eahrs, start: {p_W: [5, 0, 0]}, autopilot: {port: 'usb:1'}}",
            "bench.yaml:5: autopilot.mavlink_port is not set, and a rig of kind ardupilot_eahrs cannot run twice",
        ),
        (
            "vehicles:\n  a: {}\n  b: {rig: px4_hitl, start: {p_W: [5, 0, 0]}, autopilot: {port: 'usb:1'}}\n"
            "  c: {rig: px4_hitl, start: {p_W: [9, 0, 0]}, autopilot: {port: 'usb:1'}}",
            "autopilot.port usb:1 is also the port of b",
        ),
        (
            "vehicles:\n  a: {}\n  b: {rig: ardupilot_sitl, start: {p_W: [5, 0, 0]}, autopilot: {start: false}}",
            "bench.yaml:5: b: the rig 'ardupilot_sitl' sets tick_hz to 400, and that of a to 250 "
            "(write `tick_hz: 400` at the top of the file: all vehicles share it)",
        ),
        (
            "router: {companion: 'tcp:127.0.0.1:5790'}\nvehicles: {a: {}, b: {start: {p_W: [5, 0, 0]}}}",
            "port 5790 is also used by the router of a",
        ),
        ("vehicles: {a: {limits: {max_cros_track_m: 1}}}", "did you mean 'max_cross_track_m'"),
        (
            "vehicles: {a: {}}\nformation: {offsets_m: {b: [1, 2, 3]}}",
            "bench.yaml:4: formation.offsets_m.b is not a vehicle of this bench",
        ),
    ],
)  # fmt: skip
def test_problems_are_named_with_their_line(tmp_path, text, expected):
    if expected.startswith("autopilot.instance"):
        text = text.replace("instance: 2", "boot_sensors: 20")
    assert expected in problems(tmp_path, text)


@pytest.mark.parametrize(
    "text", ["count: 3", "formation: {}", "group: {min_distance_m: 3}", "autopilot: {on_loss: go_on}"]
)
def test_settings_for_several_vehicles_need_several(tmp_path, text):
    assert f"bench.yaml:3: {text.split(':')[0]}" in problems(tmp_path, text)
    assert "has no meaning for one vehicle" in problems(tmp_path, text)


def test_an_option_for_a_vehicle_that_does_not_exist_is_refused(tmp_path):
    text = problems(tmp_path, "vehicles: {lead: {}}", "vehicles.laed.mission=null")
    assert "vehicles.laed" in text
    assert "is not a vehicle of this bench (did you mean 'lead'?)" in text


def test_one_ground_station_serves_all_and_each_sdk_has_its_port(tmp_path):
    text = "router: {gcs: 'udp:127.0.0.1:14550', sdk: 'udp:127.0.0.1:14540'}\n"
    bench = load(tmp_path, text + "vehicles: {a: {}, b: {start: {p_W: [5, 0, 0]}}}")
    routers = [bench.vehicles[name].config.router for name in "ab"]
    assert [router.gcs for router in routers] == ["udp:127.0.0.1:14550"] * 2
    assert [router.sdk for router in routers] == ["udp:127.0.0.1:14540", "udp:127.0.0.1:14541"]


def test_each_companion_has_its_port(tmp_path):
    def ports(text: str, *settings: str) -> list[int]:
        bench = load(tmp_path, text + "formation: {shape: line}\n", *settings)
        return [vehicle.config.companion.port for vehicle in bench.vehicles.values()]

    three = "vehicles: {a: {}, b: {companion: {port: 7000}}, c: {companion: {rate_hz: 5}}}\n"
    assert ports("companion: {start: [echo]}\n" + three) == [5570, 7000, 5572]
    assert ports("companion: {start: [echo], port: 6000}\n" + three) == [6000, 7000, 6002]
    assert ports("companion: {start: [echo]}\n" + three, "companion.port=0") == [0, 0, 0]
    text = "companion: {clients: 1}\nvehicles: {a: {companion: {port: 7000}}, b: {companion: {port: 7000}}}\n"
    assert "companion.port 7000 is also a companion port of a" in problems(tmp_path, text + "formation: {}\n")


EXAMPLES = re.findall(r"(?ms)^```yaml\n(.*?)^```", (ROOT / "docs" / "vehicles.md").read_text())


@pytest.mark.parametrize("text", EXAMPLES, ids=range(len(EXAMPLES)))
def test_the_examples_of_the_page_load(tmp_path, monkeypatch, text):
    monkeypatch.setattr(autopilot_checks, "program_problem", lambda *_: None)  # there is no firmware here
    path = tmp_path / "bench.yaml"
    path.write_text(text)
    assert len(load_bench(path).vehicles) >= 2


def test_the_file_of_a_vehicle_may_not_name_another_scene(tmp_path):
    (tmp_path / "other.yaml").write_text(f"{HEAD}scene: city_park\n")
    text = "vehicles: {a: other.yaml}\n"
    assert "vehicles.a differs from the bench in scene: " in problems(tmp_path, text)
    assert load(tmp_path, f"scene: city_park\n{text}").vehicles["a"].scene.name == "city_park"
