"""Imports go one way: hil.signals <- sim, firmware_bridge <- hil. Read from the source, not from what ran."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def imported(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names.add(node.module)
        elif isinstance(node, ast.ImportFrom) and node.level:
            raise AssertionError(f"{path}: relative import; this project names packages in full")
    return names


def sources(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def within(name: str, package: str) -> bool:
    return name == package or name.startswith(package + ".")


@pytest.mark.parametrize("path", sources("hil/signals"), ids=str)
def test_signals_imports_only_stdlib_numpy_and_what_reads_files(path: Path) -> None:
    """The strict reader of users' files is of the leaf too: nothing else there needs a parser and a checker."""
    known = {"numpy", "yaml", "pydantic"} if path.parent.name == "documents" else {"numpy"}
    for name in imported(path):
        top = name.split(".")[0]
        assert top in sys.stdlib_module_names or top in known or within(name, "hil.signals"), name


@pytest.mark.parametrize(("package", "other"), [("sim", "firmware_bridge"), ("firmware_bridge", "sim")])
def test_sides_do_not_know_each_other(package: str, other: str) -> None:
    assert sources(package)
    for path in sources(package):
        for name in imported(path):
            assert not within(name, other), f"{path} imports {name}"
            if within(name, "hil"):
                assert within(name, "hil.signals"), f"{path} imports {name}"


def test_hil_init_is_empty_so_that_the_leaf_stays_a_leaf() -> None:
    assert (ROOT / "hil" / "__init__.py").read_text() == ""
