"""A bench that was sent to another machine is the same bench: it has the same identity, or flies the same flight."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from hil.apps.campaign.engines import ray_node
from hil.apps.campaign.engines.packer import Packer
from hil.apps.campaign.engines.parcel import Parcel, packed_recording, write_bench
from hil.apps.campaign.engines.ray_node import Order, fly_parcel
from hil.apps.campaign.flight import Job, fly
from hil.apps.campaign.identity import case_id
from hil.cluster.program import OtherProgram, Program
from hil.cluster.trees import unpack_tree
from hil.config import load_bench

MAP = """<mujoco><worldbody><geom type="plane" size="50 50 1"/>
<geom type="box" pos="9 9 1" size="1 1 1"/></worldbody></mujoco>"""
SCENE = """
name: own
description: a plane and a box
site: {latitude_deg: 47.397742, longitude_deg: 8.545594, altitude_m: 488.0}
ground_friction: 0.8
map: {mjcf: own.xml}
"""
GROUP = """
rig: mock
mission: rigs/missions/short.waypoints
vehicles: {a: {}, b: {start: {p_W: [6, 0, 0]}, mission_offset_m: [6, 0, 0]}}
"""


def sent(packer: Packer, bench: Path | None, texts: tuple[str, ...], node: Path) -> tuple[Parcel, Path]:
    """Return the parcel of a bench, and the bench's file on a node."""
    parcel = packer.pack(Job("a", None, texts, "out"), load_bench(bench, settings=texts))
    trees = node / "trees"
    trees.mkdir(parents=True, exist_ok=True)
    for name in parcel.trees:
        unpack_tree(name, trees, lambda name=name: packer.archives[name])  # type: ignore[misc]
    return parcel, write_bench(parcel, node / "bench", trees)


def test_a_bench_with_a_script(tmp_path: Path) -> None:
    texts = ("mission=rigs/missions/rectangle_gust.yaml", "seed=7")
    packer = Packer()
    parcel, there = sent(packer, None, texts, tmp_path)
    assert case_id(load_bench(there)) == case_id(load_bench(None, settings=texts))
    assert parcel.job.bench is None
    assert not any(str(Path.cwd()) in content.decode() for content in parcel.files.values()), "no path of the sender"
    sent(packer, None, (*texts, "seed=8"), tmp_path / "second")
    assert len(packer.archives) == 1, "the scene is packed once"


def test_a_map_of_one_s_own_and_several_vehicles(tmp_path: Path) -> None:
    here = tmp_path / "here"
    here.mkdir()
    for name, text in {"own.xml": MAP, "own.yaml": SCENE, "bench.yaml": GROUP + "scene: own.yaml\n"}.items():
        (here / name).write_text(text)
    _, there = sent(Packer(), here / "bench.yaml", (), tmp_path / "node")
    first = fly(Job("a", str(here / "bench.yaml"), ("duration_s=1",), str(tmp_path / "first")))
    for path in here.iterdir():
        path.unlink()
    second = fly(Job("a", str(there), ("duration_s=1",), str(tmp_path / "second")))
    assert first.status == second.status == "FAIL", first.error + second.error
    assert first.digest == second.digest


def test_firmware_goes_with_its_start_scripts_and_comes_back_by_its_name(tmp_path: Path) -> None:
    build = tmp_path / "build"
    (build / "bin").mkdir(parents=True)
    (build / "etc" / "init.d-posix" / "airframes").mkdir(parents=True)
    (build / "etc" / "init.d-posix" / "rcS").write_text("#!/bin/sh\n")
    (build / "etc" / "init.d-posix" / "airframes" / "10016_none_iris").write_text("")
    binary = build / "bin" / "px4"
    binary.write_text("#!/bin/sh\n")
    binary.chmod(0o755)
    (build / "bin" / "px4-commander").symlink_to("px4")
    texts = ("rig=px4_sitl", f"autopilot.binary={binary}")
    packer = Packer()
    parcel, there = sent(packer, None, texts, tmp_path / "node")
    bench = load_bench(there)
    assert case_id(bench) == case_id(load_bench(None, settings=texts))
    copy = Path(str(bench.config.autopilot.binary))
    assert copy.read_bytes() == binary.read_bytes()
    assert stat.S_IMODE(copy.stat().st_mode) & 0o100
    assert (copy.parent / "px4-commander").resolve() == copy.resolve()
    assert (copy.parent.parent / "etc" / "init.d-posix" / "rcS").is_file()
    assert len(parcel.trees) == 2, "scene and firmware"

    recording = packed_recording(there.parent, tmp_path / "node" / "trees")
    packer.unpack_recording(recording, tmp_path / "back")
    assert str(binary) in (tmp_path / "back" / "bench.yaml").read_text()
    assert str(tmp_path / "node") not in (tmp_path / "back" / "bench.yaml").read_text()


def test_a_node_with_another_program_refuses(tmp_path: Path) -> None:
    parcel = Packer().pack(Job("a", None, (), "out"), load_bench(None))
    with pytest.raises(OtherProgram):
        fly_parcel(parcel, {}, Order(Program("0" * 32), 0, 1, None), "here")


def test_folders_of_killed_flights_are_removed(tmp_path: Path) -> None:
    gone, own, other = tmp_path / "999999999-a", tmp_path / f"{os.getpid()}-b", tmp_path / "notes"
    for folder in (gone, own, other):
        folder.mkdir()
    ray_node._remove_abandoned(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([own.name, other.name])
