"""The bench's packages are its own in a repository that has `sim/`, `rigs/` and `signals.py` too."""

from __future__ import annotations

import importlib.metadata
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.worlds.bench_process import ROOT

# As an installed wheel: without the finder of an editable installation, which comes before the import path.
INSTALLED = "import sys; sys.meta_path = [f for f in sys.meta_path if 'Redirect' not in type(f).__name__]; "
CHILD = re.compile(r'sys\.executable,\s*"(-\w)"')


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    for name in ("sim/__init__.py", "rigs/__init__.py", "signals.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("MINE = True\n")
    return tmp_path


def python(folder: Path, code: str) -> subprocess.CompletedProcess[str]:
    begin = f"{INSTALLED}sys.path[:0] = [{str(folder)!r}, {str(ROOT)!r}]; "
    return subprocess.run([sys.executable, "-c", begin + code], cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("part", ["hil.run", "hil.cli", "hil.cluster"])
def test_the_bench_finds_its_own_packages(repository: Path, part: str) -> None:
    done = python(
        repository, f"import {part}, sim, signals, rigs; print(sim.__file__, signals.__file__, rigs.__file__)"
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [str(ROOT / name / "__init__.py") for name in ("sim", "signals", "rigs")]


def test_tests_that_do_not_use_the_bench_import_their_own(repository: Path) -> None:
    done = python(repository, "import hil.apps.pytest_plugin, sim, signals; print(sim.MINE, signals.MINE)")
    assert done.stdout.split() == ["True", "True"], done.stderr


def test_a_name_that_is_taken_already_is_told(repository: Path) -> None:
    done = python(repository, "import signals, hil.run")
    assert "PackageCollision: hil-bench has a package 'signals'" in done.stderr
    assert str(repository / "signals.py") in done.stderr
    assert "rename that one" in done.stderr


def test_no_child_takes_modules_from_the_working_directory() -> None:
    """-P, or -I, which includes it."""
    found = [
        (path.name, option)
        for package in ("hil", "sim", "signals", "firmware_bridge")
        for path in (ROOT / package).rglob("*.py")
        for option in CHILD.findall(path.read_text())
    ]
    assert len(found) >= 10
    assert {option for _, option in found} <= {"-P", "-I"}, found


def test_licences_that_oblige_are_named() -> None:
    text = (ROOT / "docs/scope.md").read_text()
    for requirement in importlib.metadata.requires("hil-bench") or []:
        name = re.match(r"[\w-]+", requirement)
        if name is None or "extra ==" in requirement:
            continue
        data = importlib.metadata.metadata(name[0])
        licence = " ".join([data.get("License") or "", *(data.get_all("Classifier") or [])])
        if re.search(r"\bLGPL|Lesser General Public", licence):
            assert f"`{name[0]}`" in text
