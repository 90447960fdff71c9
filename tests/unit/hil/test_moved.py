"""Old module paths in a user's files: the error names the new one."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from hil.config.companion.clients import make_client_importable
from hil.moved import MOVED

ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize("old", MOVED)
def test_an_old_path_names_a_module_that_exists(old: str) -> None:
    assert find_spec(MOVED[old]) is not None
    with pytest.raises(ImportError) as caught:
        importlib.import_module(old)
    assert str(caught.value) == f"{old} is now {MOVED[old]}: change the import"
    assert caught.value.name == old


@pytest.mark.parametrize("statement", ["import hil.bench", "from hil.bench import run_bench", "from hil import bench"])
def test_every_form_of_import_names_the_new_path(statement: str) -> None:
    with pytest.raises(ImportError, match=r"^hil\.bench is now hil\.run\.bench_run: change the import$"):
        exec(statement)


def test_a_module_inside_an_old_package_names_the_package() -> None:
    with pytest.raises(ImportError, match=r"^hil\.signals is now signals:"):
        importlib.import_module("hil.signals.samples")


def test_a_path_that_never_was_is_not_explained() -> None:
    with pytest.raises(ModuleNotFoundError, match=r"No module named 'hil\.nonsense'"):
        importlib.import_module("hil.nonsense")


def python(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize("conftest", [False, True])
def test_the_old_pytest_plugin(conftest: bool, tmp_path: Path) -> None:
    (tmp_path / "test_nothing.py").write_text("def test_nothing():\n    pass\n")
    options = ["-p", "hil.pytest_plugin"]
    if conftest:
        (tmp_path / "conftest.py").write_text("pytest_plugins = ['hil.pytest_plugin']\n")
        options = []
    done = python("-m", "pytest", "-q", "--rootdir", str(tmp_path), *options, cwd=tmp_path)
    assert done.returncode != 0
    assert "hil.pytest_plugin is now hil.apps.pytest_plugin" in done.stdout + done.stderr


def test_a_module_run_by_its_old_path(tmp_path: Path) -> None:
    done = python("-m", "hil.entry", "check", cwd=tmp_path)
    assert done.returncode != 0
    assert "hil.entry is now hil.cli.entry" in done.stderr


def test_a_companion_client_with_an_old_import(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "my_old_client.py").write_text("from hil.signals.samples import Vec3\n\ndef fly(frame): pass\n")
    monkeypatch.syspath_prepend(tmp_path)
    make_client_importable()
    from hil_companion.catalog import make_cut
    from hil_companion.errors import OptionError

    for name in ("my_old_client:fly", "hil.signals.samples:Vec3"):
        with pytest.raises(OptionError, match=f"^{name}: cannot be imported .hil.signals is now signals: change the"):
            make_cut(name)


def test_a_companion_client_on_the_command_line(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("import hil.missions\n")
    done = python("-m", "hil.cli", "companion", "mine:fly", "--connect", "tcp://127.0.0.1:1", cwd=tmp_path)
    assert done.returncode == 2
    assert "hil.missions is now hil.config.missions" in done.stderr
