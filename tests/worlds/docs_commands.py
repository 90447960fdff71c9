"""A folder as the book's readers have it, and the commands that no test can run there, each with the reason."""

from __future__ import annotations

import re
import shutil
import struct
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import typer

from hil.apps.campaign.cases.campaign_file import is_campaign_file
from hil.apps.campaign.command import check_campaign
from hil.apps.fly.check import check_bench
from hil.apps.fly.choice import BenchChoice
from hil.cli.app import app
from tests.worlds.docs_blocks import ROOT

# What a command begins with, or has in it, and why no test runs it as printed. Its arguments are checked all the same.
NOT_RUN = {
    r"(sudo|scp|ssh|ping|apt-get|cd ~|echo 1 \|)": "changes the machine, or needs another one",
    r"/opt/hil-companion|.*192\.168\.|hil run \S*two_machines": "needs a Jetson",
    r".*--address": "needs a second machine",
    r"pip install|python -m venv|/tmp/\w+/bin/pip": "needs a package index",
    r"make|source": "is what runs the tests",
    r"cp": "needs an installed wheel: tools/check_wheel.py",
    r"ros2|rviz2": "needs an installation of ROS 2",
    r".*(/dev/tty|px4_hitl|--watch)": "needs a board",
    r".*(px4_sitl|px4\.yaml|px4$)": "needs PX4",
    r".*ardupilot|sim_vehicle\.py": "needs ArduPilot",
    r"hil run --set manual": "needs a gamepad, or a keyboard in a terminal",
    r".*--colour path_traced|.*park\.yaml": "needs Mitsuba: tests/unit/sim/frame, where it is installed",
    r".*--engine ray": "needs Ray: tests/e2e/test_campaign_ray.py and test_dataset_ray.py, where it is installed",
    r"hil bench": "takes minutes: .ci/run has `hil bench all`",
    r"hil detect": "takes hours, or has their results: tests/unit/hil/apps/detect has small ones",
    r"hil companion|python docs/examples/companion": "is the other end of a run: tests/e2e/test_companion_docs.py",
    r"hil run docs/examples/companion": "waits for its client: tests/e2e/test_companion_docs.py",
    r"hil airsim|python hello_drone": "serves until Ctrl-C: tests/e2e/airsim",
    r"hil dash|hil run.* --dash": "serves a page until Ctrl-C: tests/e2e/test_dashboard_server.py",
    r"python docs/examples/gym": "takes minutes: tests/e2e/test_gym_training.py",
    r"cd docs/examples|pytest": "runs in tests/unit/hil/apps/test_pytest_plugin.py",
    r"chmod|hil run --rig betaflight": "runs in tests/e2e/test_contributing.py",
    r"cmake|build/fuzz_frame": "runs in tests/fuzz_frame/test_fuzz_frame.py",
    r"hil campaign (shrink|compare|search)": "needs other flights: tests/e2e/test_campaign_weakness.py has them",
    r"hil identify": "needs flight logs: tests/unit/hil/apps/identify makes some",
    r"hil calibrate": "needs a recording of a sensor: tests/unit/hil/apps/calibrate makes one",
}
_FIRMWARE = {
    "PX4-Autopilot/build/px4_sitl_default/bin/px4": b"SYS_AUTOSTART",
    "old/px4": b"SYS_AUTOSTART",
    "new/px4": b"SYS_AUTOSTART",
    "ardupilot/build/sitl/bin/arducopter": b"ArduCopter V4.7",
    "ardupilot/build/sitl/bin/arduplane": b"ArduPlane V4.7",
}
_CAMPAIGN = "bench: hil.yaml\nsettings: {duration_s: 1}\nrecheck: 0\naxes: {seed: [1, 2]}\n"
_YARD = """<mujoco><asset><material name="plaster"/><material name="foil"/></asset><worldbody>
  <geom name="shed" type="box" size="1 1 1" pos="9 9 1" material="plaster"/>
  <body name="house_a"><geom type="box" size="2 2 2" pos="20 0 2" material="foil"/></body>
  <body name="crane_1"><geom type="box" size="1 1 5" pos="0 20 5"/></body>
</worldbody></mujoco>"""
_FILES = {
    "my_module.py": "",  # a client of docs/companion.md
    "my_bench.yaml": "rig: mock\nsensors: {front: {preset: camera_320x240, rate_hz: 5}}\n",
    "px4.yaml": "rig: px4_sitl\nautopilot: {binary: PX4-Autopilot/build/px4_sitl_default/bin/px4}\n",
    "park.yaml": "scene: city_park\nsensors: {front: {preset: camera_320x240, rate_hz: 10, colour: path_traced}}\n",
    "old.yaml": _CAMPAIGN,
    "new.yaml": _CAMPAIGN,
    "wind.yaml": _CAMPAIGN,
    "yard/yard.xml": _YARD,
}


def why_not_run(words: Sequence[str]) -> str:
    """Return why a command cannot run as it is printed; empty if it can."""
    line = " ".join(words)
    return next((reason for pattern, reason in NOT_RUN.items() if re.match(pattern, line)), "")


def make_folder(folder: Path) -> None:
    """Fill `folder` with what the pages name: the checkout's files, firmware, and the reader's own files."""
    for name in ("hil.yaml", "rigs", "docs", "tests"):
        (folder / name).symlink_to(ROOT / name)
    for name, marker in _FIRMWARE.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"\x7fELF" + bytes(14) + struct.pack("<H", 62) + marker)
        path.chmod(0o755)
    for name in ("yard.glb", "quarter.osm", "alp.tif"):
        (folder / name).symlink_to(ROOT / "docs/examples/places" / name)
    (folder / "yard").mkdir()
    for name, text in _FILES.items():
        (folder / name).write_text(text)
    presets = ROOT / "sim/sensors/preset_files"
    shutil.copytree(ROOT / "rigs/missions", folder / "missions")
    for name in ("bench.yaml", "quadplane.yaml"):
        shutil.copy(ROOT / "docs/examples/ardupilot_tests" / name, folder)
    shutil.copy(presets / "ms5611.yaml", folder / "my_baro.yaml")
    (folder / "parts").mkdir()
    shutil.copy(presets / "bgt60tr13c.yaml", folder / "parts/my_radar.yaml")


Seen = list[tuple[str, dict[str, Any]]]


@cache  # to make the commands takes as long as to parse thirty lines
def _recording_commands() -> tuple[Any, Seen]:
    """Return the commands of `hil`, which only note their name and values, and the list of what they noted."""
    seen: Seen = []

    def replace(command: Any, name: str) -> None:
        for below, sub in getattr(command, "commands", {}).items():
            replace(sub, f"{name} {below}".strip())
        if not hasattr(command, "commands"):
            command.callback = _recorder(seen, name)

    command = typer.main.get_command(app)
    replace(command, "")
    return command, seen


def parsed(words: Sequence[str]) -> tuple[str, dict[str, Any]]:
    """Return the name and the values of a command line of `hil`, as the real parser sees them, or raise its error."""
    command, seen = _recording_commands()
    seen.clear()
    with command.make_context("hil", list(words[1:])) as context:
        command.invoke(context)
    return seen[0]


def _recorder(seen: Seen, name: str) -> Callable[..., None]:
    return lambda **values: seen.append((name, values))


def check_command(words: Sequence[str]) -> None:
    """Parse a command of `hil`, and check the bench or the campaign that it names. ConfigError, UsageError."""
    name, values = parsed(words)
    file = values.get("file") or values.get("config")
    if file is not None and is_campaign_file(file):
        check_campaign(file)
    elif name in ("run", "check", "dash", "dataset"):
        settings = [text for text in values.get("settings") or () if not text.startswith("dataset.")]
        keys = ("rig", "scene", "mission", "seed")
        check_bench(BenchChoice(file, *(values.get(key) for key in keys), tuple(settings)))
