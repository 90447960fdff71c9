"""Maps that ask for too much are named before MuJoCo compiles them, and compiling can be interrupted."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from hil.config.scenes import read_scene
from signals.errors import ConfigError
from sim.scene.budget import Budget
from sim.scene.compile_process import compile_mjcf
from sim.world_loader import load_world
from tests.worlds.patience import PATIENCE_S, until

SCENE = """name: odd
description: A map of a test
site: {latitude_deg: 47.0, longitude_deg: 8.0, altitude_m: 400.0}
ground_friction: 0.8
map: {mjcf: map.xml}
"""
SPHERE = '<geom size="1"/>'


def scene_with(folder: Path, mjcf: str) -> Path:
    (folder / "map.xml").write_text(f"<mujoco>{mjcf}</mujoco>")
    (folder / "scene.yaml").write_text(SCENE)
    return folder / "scene.yaml"


def in_world(text: str) -> str:
    return f"<worldbody>{text}</worldbody>"


@pytest.mark.parametrize(
    ("mjcf", "message"),
    [
        (in_world(f'<replicate count="100000000">{SPHERE}</replicate>'), "holds 100000000 copies"),
        (
            in_world(f'<replicate count="1000"><replicate count="1000">{SPHERE}</replicate></replicate>'),
            "holds 1000000 copies",
        ),
        ('<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>', "nrow x ncol is 1e"),
        ('<asset><texture type="2d" name="t" builtin="flat" width="99999" height="99999"/></asset>', "texels is"),
        ('<asset><mesh name="m" builtin="sphere" params="100000"/></asset>', "params is 100000"),
        ('<size nuser_geom="100000000"/>', "nuser_geom is 1e"),
    ],
)
def test_a_map_that_asks_for_too_much_is_refused_at_once(mjcf: str, message: str, tmp_path: Path) -> None:
    scene, _ = read_scene(scene_with(tmp_path, mjcf))
    assert scene is not None
    with pytest.raises(ConfigError, match=message):
        load_world(scene)


def test_a_process_of_its_own_compiles_the_same_model() -> None:
    text = f'<mujoco><worldbody><replicate count="9" offset="3 0 0">{SPHERE}</replicate></worldbody></mujoco>'
    ours, direct = compile_mjcf(text, {}, Budget("map.xml")), mujoco.MjModel.from_xml_string(text)
    size = mujoco.mj_sizeModel(direct)
    buffers = [np.empty(size, np.uint8) for _ in range(2)]
    for model, buffer in zip((ours, direct), buffers, strict=True):
        mujoco.mj_saveModel(model, None, buffer)
    assert np.array_equal(*buffers)


def test_an_error_keeps_its_line(tmp_path: Path) -> None:
    text = in_world('<replicate count="20">\n<geom size="x"/></replicate>')
    scene, _ = read_scene(scene_with(tmp_path, text))
    assert scene is not None
    with pytest.raises(ConfigError, match=r"map\.xml:2: MuJoCo cannot compile this map: bad format"):
        load_world(scene)


def test_compiling_is_interrupted_by_a_signal(tmp_path: Path) -> None:
    # MuJoCo takes half a minute or more for so many bodies.
    text = in_world(f'<replicate count="4900" offset="1 0 0"><body>{SPHERE}</body></replicate>')
    command = [sys.executable, "-m", "hil.cli.entry", "view", str(scene_with(tmp_path, text))]
    view = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    children = Path(f"/proc/{view.pid}/task/{view.pid}/children")
    compiling = until(lambda: children.read_text().split())
    view.send_signal(signal.SIGTERM)
    _, error = view.communicate(timeout=PATIENCE_S)
    assert (view.returncode, error) == (3, "error: stopped by SIGTERM\n")
    until(lambda: not any(_runs(pid) for pid in compiling), "the end of the compiling process")


def _runs(pid: str) -> bool:
    """True unless the process has ended; the system may not have collected it yet."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False
