"""The examples of CONTRIBUTING.md work as they stand there."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import types
from pathlib import Path
from typing import Any

import nanobind
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

import firmware_bridge._native
import signals._kernel
import sim._kernels
from hil.config import load_bench
from hil.run.bench_run import run_bench
from sim.sensors.kinds import KINDS

TEXT = (Path(__file__).resolve().parents[2] / "CONTRIBUTING.md").read_text()
BLOCKS = re.findall(r"```(?:python|yaml|cpp)\n(?:#!.*?\n)?(?:#|//) (\S+)\n(.*?)```", TEXT, re.DOTALL)
SHORT = ["autopilot.transport=loopback", "record.tlog=false", "record.report=false"]


def module(path: str, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Import the example of that path as a module."""
    (source,) = [source for name, source in BLOCKS if name == path]
    name = path.removesuffix(".py").replace("/", ".")
    made = types.ModuleType(name)
    monkeypatch.setitem(sys.modules, name, made)
    exec(compile(source, path, "exec"), made.__dict__)
    return made


def bench_after(heading: str, folder: Path) -> Path:
    """Write the bench file of the section with that heading."""
    section = TEXT.partition(f"## {heading}\n")[2].partition("\n## ")[0]
    (bench,) = re.findall(r"```yaml\n(# bench\.yaml\n.*?)```", section, re.DOTALL)
    (folder / "bench.yaml").write_text(bench)
    return folder / "bench.yaml"


def test_a_sensor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(KINDS, "tachometer", module("sim/sensors/tachometer.py", monkeypatch).KIND)
    bench = load_bench(bench_after("Add a sensor", tmp_path), settings=[*SHORT, "duration_s=2"])
    result = run_bench(bench, tmp_path / "out", quiet=True)
    assert result.run["error"] is None
    assert result.run["sensors"]["tacho"]["samples"] == 100
    with (tmp_path / "out" / "run.mcap").open("rb") as file:
        messages = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics=["/tacho"])
        values = [message.value for _, _, _, message in messages]
    assert len(values) == 100
    assert values[0] != 0.0


@pytest.mark.slow
def test_a_camera_channel(tmp_path: Path) -> None:
    """In a copy of the tree, an entry and a file: recording, report, data set and companions have the channel."""
    root, tree, sources = Path(__file__).resolve().parents[2], tmp_path / "tree", dict(BLOCKS)
    for package in ("signals", "sim", "firmware_bridge", "hil", "rigs"):
        ignored = shutil.ignore_patterns("__pycache__", "native")
        shutil.copytree(root / package, tree / package, copy_function=os.symlink, ignore=ignored)
    for kernels in (signals._kernel, sim._kernels, firmware_bridge._native):
        built = Path(kernels.__file__)
        (tree / kernels.__name__.partition(".")[0] / built.name).symlink_to(built)
    table = (root / "signals" / "channels.py").read_text()
    (tree / "signals" / "channels.py").unlink()
    (tree / "signals" / "channels.py").write_text(table + sources["signals/channels.py"])
    (tree / "sim" / "frame" / "derived" / "thermal.py").write_text(sources["sim/frame/derived/thermal.py"])

    def python(code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        # Without `site`, which would find the packages of this checkout.
        environment = {**os.environ, "PYTHONPATH": f"{tree}{os.pathsep}{Path(np.__file__).parents[1]}"}
        command = [sys.executable, "-S", "-c", code, *arguments]
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)

    def hil(*arguments: str) -> subprocess.CompletedProcess[str]:
        return python("import sys; from hil.cli.entry import main; sys.exit(main())", *arguments)

    camera = "{preset: camera_320x240, rate_hz: 5, channels: [rgb, thermal, segmentation, instance]}"
    front = ["--set", f"sensors.front={camera}"]
    flight = ["--set", "scene=city_park", "--set", "mission=null", "--set", "duration_s=2", "--out", "out"]
    done = hil("run", *flight, *front)
    assert done.returncode in (0, 1), done.stdout + done.stderr
    assert (tmp_path / "out" / "frame_front.png").stat().st_size > 0
    topics = ["/front/thermal", "/front/segmentation"]
    with (tmp_path / "out" / "run.mcap").open("rb") as file:
        messages = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics=topics)
        pictures = [(channel.topic, message) for _, channel, _, message in messages]
    thermal = [message for topic, message in pictures if topic == topics[0]]
    classes = [message for topic, message in pictures if topic == topics[1]]
    assert len(thermal) == len(classes) == 10
    assert {message.encoding for message in thermal} == {"32FC1"}
    for picture, ids in zip(thermal, classes, strict=True):
        degc, of_class = np.frombuffer(picture.data, "<f4"), np.frombuffer(ids.data, np.uint8)
        assert np.all(degc[of_class == 0] == 15.0)
        assert 15.0 <= degc.min() <= degc.max() < 33.0
    schema = (
        "from firmware_bridge.codecs.companion import topic_schema; from signals.samples import ImageSample;"
        "print(topic_schema(ImageSample, 'thermal').fields['thermal'])"
    )
    assert python(schema).stdout == "('degC', '-')\n"
    misspelled = hil("check", *front, "--set", "sensors.front.channels=[thermel]")
    assert misspelled.returncode == 2
    assert "thermal" in misspelled.stderr
    made = hil("dataset", "--frames", "2", *front, "--out", "data")
    assert made.returncode == 0, made.stdout + made.stderr
    assert len(list((tmp_path / "data").glob("mav0/thermal*/data/*.npy"))) == 2


_CMAKE = """
cmake_minimum_required(VERSION 3.20)
project(tether LANGUAGES CXX)
set(CMAKE_CXX_STANDARD 20)
find_package(Python 3.11 REQUIRED COMPONENTS Interpreter Development.Module)
find_package(nanobind CONFIG REQUIRED)
nanobind_add_module(tether_kernel STABLE_ABI NB_STATIC module.cpp tether.cpp)
target_include_directories(tether_kernel PRIVATE ROOT/sim/native ROOT/sim/native/forces ROOT/signals/native)
"""
_MODULE = """
#include "force_binding.hpp"
NB_MODULE(tether_kernel, m) {
    nb::module_::import_("sim._kernels");
    for (const ForceBinding *force = ForceBinding::first; force; force = force->next) force->bind(m);
}
"""
_HUNG = """
import sys
sys.path.append(sys.argv[1])
from sim import _kernels
from sim.physics import forces
from tether_kernel import Tether
_kernels.Tether = Tether
forces.__path__.append(sys.argv[1] + "/forces")
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle import load_vehicle
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.scene import load_scene
vehicle = load_vehicle(sys.argv[1] + "/hung.yaml")
bare = vehicle.model_copy(update={"rotors": (), "body_drag_linear_n_per_mps": (5.0, 5.0, 5.0)})
physics = VehiclePhysics(bare, load_scene("airfield"), 4_000_000, start=FlightStart(p_WB=(0.0, 0.0, 6.0)))
for tick in range(5001):
    physics.advance(tick, ())
print(6.0 - physics.truth.p_WB[2], 2.0 + bare.mass_kg * physics.scene.gravity_mps2 / 50.0)
"""


@pytest.mark.slow
def test_a_force(tmp_path: Path) -> None:
    """Build the example beside the kernels, and hang a body without rotors from its line: it rests at l + m g / k."""
    root, build = Path(__file__).resolve().parents[2], tmp_path / "build"
    (tmp_path / "forces").mkdir()
    sources = dict(BLOCKS)
    (tmp_path / "tether.cpp").write_text(sources["sim/native/forces/tether.cpp"])
    (tmp_path / "forces" / "tether.py").write_text(sources["sim/physics/forces/tether.py"])
    hung = sources["vehicle.yaml"].replace("[0, 0, 0]", "[0, 0, 6]")
    (tmp_path / "hung.yaml").write_text((root / "rigs/vehicles/x500.yaml").read_text() + hung)
    (tmp_path / "CMakeLists.txt").write_text(_CMAKE.replace("ROOT", str(root)))
    (tmp_path / "module.cpp").write_text(_MODULE)
    tools = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    configure = ["cmake", "-G", "Ninja", "-S", str(tmp_path), "-B", str(build), f"-DPython_EXECUTABLE={sys.executable}"]
    configure.append(f"-Dnanobind_DIR={nanobind.cmake_dir()}")
    for command in (configure, ["cmake", "--build", str(build)]):
        subprocess.run(command, env=tools, check=True, capture_output=True, text=True)
    (built,) = build.glob("tether_kernel*.so")
    shutil.copy(built, tmp_path)
    command = [sys.executable, "-c", _HUNG, str(tmp_path)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    sunk_m, expected_m = (float(word) for word in done.stdout.split())
    assert sunk_m == pytest.approx(expected_m, rel=1e-6)


def test_a_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module("hil/run/parts/ceiling.py", monkeypatch)
    bench = load_bench(bench_after("Add a part", tmp_path), settings=[*SHORT, "duration_s=25", "record.mcap=false"])
    result = run_bench(bench, tmp_path / "out", quiet=True)
    assert result.run["error"] is None
    assert result.run["ceiling"]["above_s"] > 1.0
    assert any(reason.endswith("s above 8 m") for reason in result.run["verdict"]["reasons"])
    assert any(row["name"] == "above_ceiling_s" and not row["ok"] for row in result.run["verdict"]["rows"])


_TREE = ("signals", "sim", "firmware_bridge", "hil", "rigs")
_IN_THE_COPY = """
import sys
sys.meta_path = [finder for finder in sys.meta_path if not type(finder).__name__.startswith("ScikitBuild")]
sys.path.insert(0, sys.argv.pop(1))
from hil.cli.entry import main
main()
"""


@pytest.mark.slow
def test_an_autopilot(tmp_path: Path) -> None:
    """Follow the recipe in a copy of the tree: three files and a rig, and `hil` knows, checks and flies the kind."""
    root, tree = Path(__file__).resolve().parents[2], tmp_path / "tree"
    for package in _TREE:
        shutil.copytree(root / package, tree / package, ignore=shutil.ignore_patterns("__pycache__", "native"))
    shutil.copy(root / "hil.yaml", tree)
    for kernel in (sim._kernels, signals._kernel, firmware_bridge._native):
        shutil.copy(kernel.__file__, tree / kernel.__name__.partition(".")[0])
    written = {name: source for name, source in BLOCKS if "betaflight" in name}
    assert len(written) == 4
    for name, source in written.items():
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        (tree / name).write_text(source)
    fake = tree / "tests/worlds/fake_betaflight.py"
    fake.write_text(f"#!{sys.executable}\n{fake.read_text()}")
    fake.chmod(0o755)

    def hil(*arguments: str) -> tuple[int, str]:
        command = [sys.executable, "-c", _IN_THE_COPY, str(tree), *arguments, "--rig", "betaflight_sitl"]
        done = subprocess.run(command, cwd=tree, capture_output=True, text=True, check=False)
        return done.returncode, " ".join((done.stdout + done.stderr).split())

    status, said = hil("check")
    assert status == 2, said
    assert "autopilot.binary must name your own build of the firmware" in said
    assert "mission needs MAVLink, which betaflight_sitl does not speak" in said
    own = ["--set", f"autopilot.binary={fake}", "--set", "mission=null", "--set", "duration_s=6"]
    status, said = hil("check", *own)
    assert status == 0, said
    status, said = hil("check", *own, "--set", "autopilot.airframe=iris")
    assert (status, "autopilot.airframe: has no meaning for betaflight_sitl" in said) == (2, True), said
    runs = []
    for number in range(2):
        status, said = hil("run", *own, "--out", str(tmp_path / str(number)))
        assert status == 0, said
        runs.append(json.loads((tmp_path / str(number) / "run.json").read_text()))
    assert runs[0]["autopilot"]["kind"] == "betaflight_sitl"
    assert runs[0]["autopilot"]["steps"] == 6 * 250
    assert runs[0]["digest"] == runs[1]["digest"]
    with (tmp_path / "0" / "run.mcap").open("rb") as file:
        poses = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics=["/truth/pose"])
        heights_m = [pose.pose.position.z for _, _, _, pose in poses]
    assert heights_m[-1] == pytest.approx(2.0, abs=0.1)
