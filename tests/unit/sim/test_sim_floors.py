"""Folders of `sim` import downwards only, and no module of `sim` or `signals` is part of a circle of imports."""

from __future__ import annotations

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]

# Each imports what is before it.
FLOORS = ("scene", "frame", "randomize", "world_loader", "physics", "radar", "gnss", "sensors")


def modules(package: str) -> dict[str, Path]:
    paths = sorted((ROOT / package).rglob("*.py"))
    return {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path for path in paths}


def imports_of(path: Path, known: dict[str, Path]) -> set[str]:
    """Return the modules of `known` that a file imports anywhere: at its top, in functions, for types."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names} | {node.module}
    return names & known.keys()


def test_no_circle_of_modules() -> None:
    known = modules("sim") | modules("signals")
    graph = {name: imports_of(path, known) - {name} for name, path in known.items()}
    assert len(graph) > 100
    TopologicalSorter(graph).prepare()  # raises CycleError, which names the circle


def test_every_folder_has_a_floor() -> None:
    assert {name.split(".")[1] for name in modules("sim") if "." in name} == set(FLOORS)


@pytest.mark.parametrize("floor", FLOORS)
def test_floors_import_downwards_only(floor: str) -> None:
    known = modules("sim")
    above = FLOORS[FLOORS.index(floor) + 1 :]
    for name, path in known.items():
        if name.split(".")[1:2] == [floor]:
            for other in imports_of(path, known):
                assert other.split(".")[1:2] not in [[higher] for higher in above], f"{path} imports {other}"
