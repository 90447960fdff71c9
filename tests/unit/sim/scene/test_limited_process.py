"""Work on a user's file happens in a process with limits."""

from __future__ import annotations

import contextlib
import io
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import mujoco
import pytest

from hil.run.runs.progress import MapProgress
from signals.errors import ConfigError
from sim.physics.contact_model import build_model
from sim.physics.vehicle import load_vehicle
from sim.scene import limited_process, work_progress
from sim.scene.budget import Budget, MapLimits
from sim.scene.limited_process import limited
from sim.scene.scene import load_scene
from sim.scene.work_progress import State
from sim.world_loader import load_world
from tests.worlds.one_crate import crate, error_of
from tests.worlds.patience import PATIENCE_S

EXAMPLES = Path(__file__).parents[4] / "docs" / "examples" / "places"


def test_every_map_from_a_file_is_compiled_in_a_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise AssertionError("MuJoCo compiles a user's map in the bench")

    monkeypatch.setattr(mujoco.MjModel, "from_xml_string", refused)
    (tmp_path / "m.xml").write_text(
        '<mujoco><worldbody><geom type="plane" size="0 0 1"/><geom size="1" pos="9 0 1"/></worldbody></mujoco>'
    )
    (tmp_path / "place.glb").write_bytes(crate(translation=[9, 0, 0]).glb())
    for name in ("m.xml", "place.glb"):
        scene = load_scene(tmp_path / name)
        assert load_world(scene).map.from_file
        assert build_model(scene, load_vehicle("x500"), contact_step_s=0.001).nq == 7


@pytest.mark.parametrize(
    ("mjcf", "message"),
    [
        ('<size memory="20G"/>', r"GB of memory"),
        ('<sensor><user dim="300000000"/></sensor>', r"m\.xml:1: <user> dim is 3e\+08; 1000 is allowed"),
        ('<custom><numeric name="n" size="300000000"/></custom>', r"m\.xml:1: <numeric> size goes beyond 100000"),
        ('<asset><hfield name="h" nrow="4000" ncol="4000" size="1 1 1 1"/></asset>', r"GB of memory with the compiled"),
    ],
)
def test_an_mjcf_file_with_a_large_state_is_refused(mjcf: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text(f'<mujoco>{mjcf}<worldbody><geom size="1"/></worldbody></mujoco>')
    assert re.search(message, error_of(tmp_path / "m.xml"))


def test_what_is_done_with_a_file_cannot_harm_the_bench() -> None:
    little = Budget("place.glb", MapLimits(memory_bytes=2e8))
    assert limited("builtins:len", "four", budget=little, what="reading it") == 4
    with pytest.raises(ConfigError, match=r"place\.glb: needs more than 0\.2 GB of memory for reading it.*_MEMORY_GB"):
        limited("builtins:bytearray", 2_000_000_000, budget=little, what="reading it")
    with pytest.raises(ConfigError, match=r"place\.glb: reading it ended with SIGABRT"):
        limited("os:abort", budget=little, what="reading it")
    with pytest.raises(ConfigError, match=r"place\.glb: cannot be made into a map: ValueError: invalid literal"):
        limited("builtins:int", "x", budget=little, what="reading it")
    assert limited("builtins:len", "still here", budget=little, what="reading it") == 10


def test_processor_time_is_one_limit_for_all_that_is_done() -> None:
    budget = Budget("place.glb", MapLimits(cpu_s=0.5))
    with pytest.raises(ConfigError, match=r"place\.glb: needs more than 0\.5 s of processor time.*HIL_MAP_CPU_S"):
        limited("builtins:sum", range(10**12), budget=budget, what="reading it")


def test_progress_is_shown_while_an_import_takes_long(monkeypatch: pytest.MonkeyPatch) -> None:
    """The display opens after the patience, hears what the process tells, and is closed with the answer."""
    heard: list[State] = []
    titles: list[str] = []

    @contextlib.contextmanager
    def display(title: str) -> Iterator[Callable[[State], None]]:
        titles.append(title)
        yield heard.append
        titles.append("closed")

    little = Budget("city.glb")
    assert limited("tests.worlds.told_work:count", 3, 0.0, budget=little, what="making its map") == 3
    monkeypatch.setattr(work_progress.progress, "display", display)
    monkeypatch.setattr(limited_process, "_PATIENCE_S", PATIENCE_S)
    assert limited("tests.worlds.told_work:count", 3, 0.0, budget=little, what="making its map") == 3
    assert not titles  # too quick to be shown
    monkeypatch.setattr(limited_process, "_PATIENCE_S", 0.0)
    assert limited("tests.worlds.told_work:count", 5, 0.4, budget=little, what="making its map") == 5
    assert titles == ["city.glb", "closed"]
    told = [state for state in heard if state.total]
    assert {state.total for state in told} == {5}
    assert [state.done for state in told] == sorted(state.done for state in told)
    assert {state for state in heard if not state.total} <= {State("making its map")}  # before the first is told
    heard.clear()
    limited("time:sleep", 0.6, budget=little, what="MuJoCo's compiler")
    assert set(heard) == {State("MuJoCo's compiler")}


@pytest.mark.parametrize("is_terminal", [True, False])
def test_a_bar_of_an_import_is_for_terminals_only(is_terminal: bool) -> None:
    class Stream(io.StringIO):
        def isatty(self) -> bool:
            return is_terminal

    stream = Stream()
    with MapProgress("city.glb", stream=stream) as bar:
        bar.show(State("objects", 120, 370))
        bar.show(State("MuJoCo's compiler"))
    assert ("120 of 370 objects" in stream.getvalue()) == is_terminal
    assert ("MuJoCo's compiler" in stream.getvalue()) == is_terminal
    assert is_terminal or not stream.getvalue()


def test_a_geotiff_writes_no_warnings_of_its_library(tmp_path: Path) -> None:
    """libtiff warns of the tags of GeoTIFF on the process's own stderr."""
    path = tmp_path / "alp.tif"
    path.write_bytes((EXAMPLES / "alp.tif").read_bytes())
    command = [sys.executable, "-m", "hil.cli", "check", "--scene", str(path)]
    done = subprocess.run(command, cwd=EXAMPLES.parents[2], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert "TIFF" not in done.stdout
