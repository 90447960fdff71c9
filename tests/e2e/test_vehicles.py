"""Several vehicles in one run: their own streams, contact between them, a lost autopilot, and the recording."""

from __future__ import annotations

import json
import multiprocessing
import os
import subprocess
import sys
import time
from pathlib import Path
from socket import SOCK_STREAM

import pytest

from hil.config import load_bench
from hil.run.bench_run import RunResult, run_bench
from hil.run.recorder.reading import read_messages
from tests.worlds.bench_process import ROOT, free_port
from tests.worlds.hop_flights import HOP
from tests.worlds.patience import PATIENCE_S

LIMITS = "limits: {max_cross_track_m: null, final_error_m: null, altitude_error_m: null}\n"


def fly(folder: Path, text: str, *, name: str = "run", settings: tuple[str, ...] = ()) -> RunResult:
    (folder / "hop.waypoints").write_text(HOP)
    path = folder / f"{name}.yaml"
    head = (
        "rig: mock\ntick_hz: 100\nmission: hop.waypoints\nautopilot: {transport: loopback}\nrecord: {report: false}\n"
    )
    path.write_text(head + LIMITS + text)
    bench = load_bench(path, settings=settings)
    return run_bench(bench, folder / name, quiet=True)


def digests(result: RunResult) -> dict[str, str]:
    return {name: vehicle["digest"] for name, vehicle in result.run["vehicles"].items()}


@pytest.fixture(scope="module")
def pair(tmp_path_factory) -> RunResult:
    folder = tmp_path_factory.mktemp("pair")
    text = "vehicles: {lead: {}, wing: {vehicle: iris, autopilot: {airframe: iris}}}\nformation: {spacing_m: 4}\n"
    # With limits, so that reaching the last waypoint of the short hop does not end the formation before it is measured.
    limits = ("limits.max_cross_track_m=1", "limits.final_error_m=0.7")
    return fly(folder, text, settings=("record.report=true", *limits))


def test_two_vehicles_fly_in_formation(pair):
    run = pair.run
    assert pair.status == "PASS", run["verdict"]["reasons"]
    rows = {row["name"]: row for row in run["verdict"]["rows"]}
    assert 4.0 < rows["min_distance_m"]["value"] < 6.0
    assert rows["formation_error_m"]["value"] < 1.0
    assert run["mission"]["reached"] == run["mission"]["waypoints"] > 1
    for name, vehicle in run["vehicles"].items():
        own = json.loads((pair.out / name / "run.json").read_text())
        assert own["status"] == vehicle["status"] == "PASS"
        assert (pair.out / name / "flight.tlog").stat().st_size > 1000
    assert "wing/report.html" in (pair.out / "report.html").read_text()


def test_a_formation_at_the_default_rate(tmp_path):
    settings = ("tick_hz=250", "record.mcap=false", "record.tlog=false")
    result = fly(tmp_path, "vehicles: {lead: {}, wing: {}}\nformation: {spacing_m: 4}\n", settings=settings)
    assert result.status == "PASS", result.run["verdict"]["reasons"]


def test_a_vehicle_has_the_streams_of_a_flight_alone(pair, tmp_path):
    """The same digest without the other vehicle, and with a third one far away."""
    text = """
vehicles:
  lead: {}
  wing: {vehicle: iris, autopilot: {airframe: iris}}
  far: {start: {p_W: [200, 0, 0]}, mission_offset_m: [200, 0, 0]}
formation: {spacing_m: 4}
"""
    three = fly(tmp_path, text, name="three")
    ours = digests(pair)
    assert {name: digests(three)[name] for name in ours} == ours
    alone = run_bench(load_bench(pair.out / "wing" / "bench.yaml"), tmp_path / "alone", quiet=True)
    assert alone.run["digest"] == ours["wing"]


def test_the_saved_bench_repeats_the_run_over_a_serial_line(pair, tmp_path):
    bench = load_bench(pair.out / "bench.yaml", settings=["autopilot.transport=pty", "record.report=false"])
    again = run_bench(bench, tmp_path / "again", quiet=True)
    assert again.run["digest"] == pair.run["digest"]


def test_one_recording_holds_every_vehicle_under_its_name(pair):
    messages = list(read_messages(pair.out / "run.mcap"))
    topics = {message.topic for message in messages}
    for name in ("lead", "wing"):
        assert {f"/{name}/imu", f"/{name}/truth/pose", f"/{name}/mavlink/from_autopilot"} <= topics
    assert "/tf" in topics
    assert not any(topic.startswith(("/imu", "/truth")) for topic in topics)
    frames = {message.decode()["transforms[0].child_frame_id"] for message in messages if message.topic == "/tf"}
    assert frames == {"lead/base_link", "wing/base_link"}


def test_contact_fails_the_run_and_says_who_when_and_how_hard(tmp_path):
    """The second vehicle flies the mission of the first, so that both want to be at the same place."""
    text = "vehicles: {a: {}, b: {start: {p_W: [0, 1.2, 0]}}}\nduration_s: 30\n"
    result = fly(tmp_path, text)
    assert result.status == "FAIL"
    assert result.run["contacts"], result.run["verdict"]
    contact = result.run["contacts"][0]
    assert {contact["a"], contact["b"]} == {"a", "b"}
    assert contact["impulse_ns"] > 0.0
    assert any(reason.startswith("a and b touched at ") for reason in result.run["verdict"]["reasons"])


LOSS = "vehicles: {a: {}, b: {autopilot: {faults: {die_at_s: 11}}}}\nformation: {shape: line, spacing_m: 9}\n"


def test_a_vehicle_that_dies_ends_the_run_as_an_error_that_names_it(tmp_path):
    result = fly(tmp_path, LOSS)
    assert result.status == "ERROR"
    assert result.run["error"]["message"].startswith("b: ")
    errors = {name: vehicle["error"]["type"] for name, vehicle in result.run["vehicles"].items()}
    assert errors["a"] == "OtherVehicleFailed"
    assert errors["b"] == result.run["error"]["type"]


def test_an_expendable_vehicle_falls_and_the_others_fly_on(tmp_path):
    result = fly(tmp_path, LOSS, settings=("vehicles.b.autopilot.on_loss=go_on",))
    assert result.status == "PASS", result.run["verdict"]["reasons"]
    a, b = (result.run["vehicles"][name] for name in "ab")
    assert a["status"] == "PASS"
    assert b["lost"]
    assert b["sim_s"] < a["sim_s"]
    assert b["status"] == "FAIL"
    assert b["verdict"]["reasons"][0].startswith("crashed: impact at ")


def test_a_vehicle_that_had_crashed_before_it_was_lost_is_not_expendable(tmp_path):
    text = LOSS.replace("{faults: {die_at_s: 11}}", "{on_loss: go_on, faults: {die_at_s: 8.5}}")
    stops = "vehicles.b.faults.rotors=[{kind: stuck, rotor: 0, at_s: 6, speed_radps: 0}]"
    result = fly(tmp_path, text, settings=(stops,))
    assert result.run["vehicles"]["b"]["lost"]
    assert result.status == "FAIL"
    assert any(reason.startswith("b: crashed: ") for reason in result.run["verdict"]["reasons"])


def test_if_every_vehicle_is_lost_the_run_fails(tmp_path):
    text = "vehicles: {a: {}, b: {}}\nformation: {shape: line, spacing_m: 9}\n"
    result = fly(tmp_path, text, settings=("autopilot.on_loss=go_on", "autopilot.faults.die_at_s=11"))
    assert result.status == "FAIL"
    assert any(reason.startswith("a: crashed") for reason in result.run["verdict"]["reasons"])


def test_a_vehicle_that_has_landed_does_not_empty_its_battery(tmp_path):
    """It lies there for 30 s while the other flies on, and its electronics would need more than is left."""
    text = (ROOT / "rigs" / "vehicles" / "x500.yaml").read_text()
    text = text.replace("capacity_ah: 5.0", "capacity_ah: 0.9").replace("auxiliary_w: 8.0", "auxiliary_w: 900")
    (tmp_path / "small.yaml").write_text(text)
    (tmp_path / "long.waypoints").write_text(HOP.replace("2\t0\t3\t16\t0", "2\t0\t3\t16\t1000"))
    text = """
vehicles: {a: {mission: long.waypoints}, b: {vehicle: small.yaml}}
formation: {shape: line, spacing_m: 9}
physics: {effects: {battery: true}}
duration_s: 60
"""
    result = fly(tmp_path, text)
    assert result.run["error"] is None
    assert result.run["vehicles"]["b"]["status"] == "PASS"


def test_a_killed_run_names_its_vehicles(tmp_path):
    """Another run into the same folder must know them to remove their results, and a replay to repeat them."""
    process = multiprocessing.get_context("spawn").Process(target=fly, args=(tmp_path, LOSS))
    process.start()
    saved = tmp_path / "run" / "b" / "flight.tlog"
    while process.is_alive() and not saved.exists():
        time.sleep(0.01)
    process.kill()
    process.join()
    run = json.loads((tmp_path / "run" / "run.json").read_text())
    assert run["error"]["type"] == "Killed"
    errors = {name: vehicle["error"]["type"] for name, vehicle in run["vehicles"].items()}
    assert errors == {"a": "Killed", "b": "Killed"}


FIVE = """
vehicles: {a: {}, b: {}, c: {}, d: {vehicle: hexa_x}, e: {}}
formation: {shape: grid, spacing_m: 4}
sensors:
  imu: {preset: icm20689}
  gps: {preset: here_plus, rate_hz: 10}
  baro: {preset: ms5611, rate_hz: 50}
  mag: {preset: ist8310, rate_hz: 50}
  front: {kind: camera, resolution: [64, 48], fov_deg: 90, rate_hz: 10, channels: [rgb, depth, instance]}
  lidar: {preset: vlp16, rate_hz: 10, subsweeps: 2}
"""


@pytest.mark.slow
def test_five_vehicles_that_see_each_other_have_one_digest(tmp_path):
    """Over runs, transports and numbers of processors.

    With the usual limits: with none, the margin of a waypoint reaches from the hop's end to its beginning.
    """
    usual = ("limits.max_cross_track_m=1", "limits.altitude_error_m=1")
    runs = [fly(tmp_path, FIVE, name="first", settings=usual)]
    runs.append(fly(tmp_path, FIVE, name="pty", settings=(*usual, "autopilot.transport=pty")))
    processors = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(processors)})
    try:
        runs.append(fly(tmp_path, FIVE, name="one_processor", settings=usual))
    finally:
        os.sched_setaffinity(0, processors)
    assert {run.status for run in runs} == {"PASS"}, runs[0].run["verdict"]["reasons"]
    assert len({run.run["digest"] for run in runs}) == 1
    assert min(run.run["vehicles"]["e"]["sensors"]["front"]["samples"] for run in runs) > 100


PILOT = "companion: {start: [waypoints], control: true, rate_hz: 25}\n"


def test_each_vehicle_has_its_companion(tmp_path):
    ports = [free_port(SOCK_STREAM) for _ in "ab"]
    text = (
        PILOT
        + "vehicles:\n"
        + "".join(f"  {name}: {{companion: {{port: {port}}}}}\n" for name, port in zip("ab", ports, strict=True))
    )
    result = fly(tmp_path, text + "formation: {shape: line, spacing_m: 5}\n")
    assert result.status == "PASS", result.run["verdict"]["reasons"]
    for name in "ab":
        own = json.loads((result.out / name / "run.json").read_text())
        assert own["companion"]["clients"]["waypoints"]["finished"]


PROGRAM = """
import sys, threading
from hil_companion import Desired, run

def pilot(north_m, height_m):
    def fly(frame):
        return Desired(land=True) if frame.t_ns > 8e9 else Desired(p_W=(0.0, north_m, height_m), yaw_rad=0.0)
    return fly

for address, place in zip(sys.argv[1:], ((0.0, 2.0), (-6.0, 3.0))):
    options = {"name": "fleet", "topics": ["truth"], "control": True}
    threading.Thread(target=run, args=(pilot(*place), address), kwargs=options).start()
"""


def test_one_program_commands_two_vehicles(tmp_path):
    ports = [free_port(SOCK_STREAM) for _ in "ab"]
    (tmp_path / "fleet.py").write_text(PROGRAM)
    addresses = [f"tcp://127.0.0.1:{port}" for port in ports]
    environment = os.environ | {"PYTHONPATH": str(ROOT / "rigs" / "jetson")}
    client = subprocess.Popen([sys.executable, str(tmp_path / "fleet.py"), *addresses], env=environment)
    try:
        own = [f"{name}: {{companion: {{port: {port}}}}}" for name, port in zip("ab", ports, strict=True)]
        text = "companion: {clients: 1, control: true, arrangement: one_port}\nduration_s: 40\n"
        text += f"vehicles: {{{', '.join(own)}}}\nformation: {{shape: line, spacing_m: 6, max_error_m: null}}\n"
        result = fly(tmp_path, text, settings=("mission=null",))
        assert client.wait(PATIENCE_S) == 0
    finally:
        client.kill()
        client.wait()
    assert result.status == "PASS", result.run["verdict"]["reasons"]
    assert all(vehicle["mission"]["landed"] for vehicle in result.run["vehicles"].values())
