"""`make check` runs the tests near a change, the nearest first, and no others."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from tools.check import imports_of, main, near_tests

TREE = {
    "sim/sensors/gps.py": "from signals.noise import NoiseStream",
    "signals/noise.py": "",
    "sim/sensors/imu.py": "",
    "sim/frame/raster.py": "from sim import _kernels",
    "hil/run/use.py": "def f():\n    from sim.sensors import gps",
    "hil/far.py": "import hil.run.use",
    "rigs/jetson/hil_companion/link/client.py": "",
    "lab/rows.py": "",
    "tools/setup_env.py": "",
    "tests/worlds/process.py": "import subprocess",
    "tests/worlds/server.py": "from tests.worlds.process import start",
    "tests/unit/sim/sensors/test_imu.py": "import sim.sensors.imu",
    "tests/unit/sim/frame/test_raster.py": "import sim.frame.raster",
    "tests/unit/hil/test_use.py": "from hil.run import use",
    "tests/unit/hil/test_far.py": "from hil import far",
    "tests/unit/hil/test_process.py": "import subprocess\nimport sim.sensors.gps",
    "tests/unit/hil/test_server.py": "from tests.worlds.server import Server\nimport sim.sensors.gps",
    "tests/unit/rigs/test_client.py": "from hil_companion.link import client  # isort: skip",
    "tests/unit/lab/test_rows.py": "import lab.rows",
    "tests/unit/test_setup.py": "import tools.setup_env",
    "tests/unit/test_docs.py": "",
    "tests/e2e/test_gps.py": "import sim.sensors.gps",
}
IMPORTS = {Path(path): imports_of(source) for path, source in TREE.items()}


def near(*changed: str) -> list[str]:
    return [path.name for path in near_tests(map(Path, changed), IMPORTS)]


def test_the_room_first_and_then_what_imports_it() -> None:
    assert near("sim/sensors/gps.py") == ["test_imu.py", "test_use.py"]


def test_a_changed_test_is_near() -> None:
    assert near("tests/unit/hil/test_far.py") == ["test_far.py"]


@pytest.mark.parametrize(
    ("changed", "tests"),
    [
        ("lab/rows.py", ["test_rows.py"]),
        ("rigs/jetson/hil_companion/link/client.py", ["test_client.py"]),
        ("tools/setup_env.py", ["test_setup.py"]),
        ("docs/start.md", ["test_docs.py"]),
    ],
)
def test_every_package_and_the_book_have_their_tests(changed: str, tests: list[str]) -> None:
    assert near(changed) == tests


def test_native_code_is_part_of_what_python_imports() -> None:
    assert near("sim/native/frame/resolve.hpp") == ["test_raster.py"]
    assert near("sim/native/mixer.hpp") == ["test_raster.py"]


def test_a_file_that_is_no_code_belongs_to_the_nearest_room() -> None:
    assert near("sim/sensors/preset_files/mpu.yaml") == ["test_imu.py"]
    assert near("README.md") == []


def test_what_imports_a_deleted_file_is_near() -> None:
    assert near("sim/deleted.py") == []
    imports = {**IMPORTS, Path("tests/unit/hil/test_old.py"): imports_of("from sim import deleted")}
    assert near_tests([Path("sim/deleted.py")], imports) == [Path("tests/unit/hil/test_old.py")]


@pytest.mark.parametrize(
    ("source", "names"),
    [
        ("import os, numpy as np  # both", {"os", "numpy"}),
        ("from a.b import c, d as e  # isort: skip", {"a.b", "a.b.c", "a.b.d"}),
        ("def f():\n    from a import (\n        b,  # one\n        c,\n    )\n", {"a", "a.b", "a.c"}),
    ],
)
def test_imports_are_found_without_parsing(source: str, names: set[str]) -> None:
    assert imports_of(source) == names


def test_no_import_of_the_tree_is_missed() -> None:
    """A sample of the real files, against Python's own parser."""
    for path in sorted(Path(__file__).parents[3].glob("hil/run/*.py")):
        source = path.read_text("utf-8")
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.ImportFrom):
                assert {f"{node.module}.{alias.name}" for alias in node.names} <= imports_of(source), path
            elif isinstance(node, ast.Import):
                assert {alias.name for alias in node.names} <= imports_of(source), path


@pytest.mark.parametrize(("argument", "status"), [("--help", 0), ("--fast", 2)])
def test_arguments_run_nothing(argument: str, status: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["check.py", argument])
    monkeypatch.setattr("tools.check.changed_files", lambda: pytest.fail("it went on"))
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == status
