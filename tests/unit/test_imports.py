"""Imports go one way, without circles: signals <- sim, firmware_bridge <- hil <- lab; in hil as FLOORS says."""

from __future__ import annotations

import ast
import sys
from collections.abc import Collection, Sequence
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("signals", "sim", "firmware_bridge", "hil", "rigs", "lab")
# The modules of a package from the top down: each may import those to its right, none beside it.
FLOORS: dict[str, Sequence[str]] = {
    "hil": ("cli", "apps", "cluster gym", "run", "config", "own_packages flown_run", "data_set_files run_files"),
    "hil.run": (
        *(
            "replay",
            "bench_run replayed_verdict",
            "stepped",
            "runs",
            "parts",
            "offboard",
            "autopilot",
            "part",
            "feed",
            "follow",
        ),
        *("report", "live companion film"),
        *("sensors flight_logs", "loop", "recorder verdict"),
    ),
    "hil.config": (
        *(
            "load saved",
            "vehicles",
            "loading",
            "checks",
            "airframe_facts",
            "vtol_facts",
            "companion formation multirotor_facts fixed_wing_facts",
            "bench scenes windsock",
        ),
        *("sensors", "missions", "schema", "group_schema", "layers limit_values", "files params_file"),
    ),
    "sim": ("sensors", "gnss", "radar", "physics", "world_loader", "randomize", "frame", "scene"),
}
SCENE_FLOORS = ("compile", "placed", "maps", "imports")  # likewise; the files of sim/scene itself are below all of them


@cache
def import_statements(path: Path) -> list[ast.Import | ast.ImportFrom]:
    """Return the import statements of a file: in functions and for type checkers too."""
    return [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Import | ast.ImportFrom)]


@cache
def imported(path: Path) -> frozenset[str]:
    """Return the absolute names that a file imports anywhere."""
    names: set[str] = set()
    for node in import_statements(path):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        else:
            assert not node.level, f"{path}: relative import; this project names packages in full"
            names |= {str(node.module)} | {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(names)


def sources(package: str) -> list[Path]:
    """Return the Python files of a package, sorted. Fails if there is none."""
    found = sorted((ROOT / package).rglob("*.py"))
    assert found, package
    return found


def within(name: str, package: str) -> bool:
    return name == package or name.startswith(package + ".")


def module_name(path: Path) -> str:
    """Return the name under which a file is imported; `hil_companion` is a root of its own, as on the companion."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    parts = parts[2:] if parts[:2] == ("rigs", "jetson") else parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def used_modules(path: Path, modules: Collection[str]) -> set[str]:
    """Return those of `modules` that a file imports; of a package only where a name is not one of its modules."""
    used: set[str] = set()
    for node in import_statements(path):
        if isinstance(node, ast.Import):
            used |= {alias.name for alias in node.names}
        else:
            package = str(node.module)
            members = {f"{package}.{alias.name}" for alias in node.names}
            used |= {member if member in modules else package for member in members}
    return used & set(modules)


def circles(graph: dict[str, set[str]]) -> list[set[str]]:
    """Return the sets of modules that import each other, directly or not."""
    reached = {start: set(following) for start, following in graph.items()}
    for middle in graph:
        for start in graph:
            if middle in reached[start]:
                reached[start] |= reached[middle]
    in_a_circle = [module for module in graph if module in reached[module]]
    found = {frozenset(b for b in in_a_circle if b in reached[a] and a in reached[b]) for a in in_a_circle}
    return [set(members) for members in found]


@pytest.mark.parametrize("path", sources("signals"), ids=str)
def test_signals_imports_only_stdlib_numpy_and_what_reads_files(path: Path) -> None:
    """The strict reader of users' files is of the leaf too: nothing else there needs a parser and a checker."""
    known = {"numpy", "yaml", "pydantic", "pydantic_core"} if path.parent.name == "documents" else {"numpy"}
    for name in imported(path):
        top = name.split(".")[0]
        assert top in sys.stdlib_module_names or top in known or within(name, "signals"), name


@pytest.mark.parametrize(("package", "other"), [("sim", "firmware_bridge"), ("firmware_bridge", "sim")])
def test_sides_do_not_know_each_other(package: str, other: str) -> None:
    for path in sources(package):
        for name in imported(path):
            assert not within(name, other), f"{path} imports {name}"
            assert not within(name, "hil"), f"{path} imports {name}"


@pytest.mark.parametrize("floor", [*SCENE_FLOORS, ""])
def test_the_floors_of_a_scene_import_downwards_only(floor: str) -> None:
    above = SCENE_FLOORS[: SCENE_FLOORS.index(floor)] if floor else SCENE_FLOORS
    for path in sources(f"sim/scene/{floor}") if floor else sorted((ROOT / "sim/scene").glob("*.py")):
        for name in imported(path):
            assert not any(within(name, f"sim.scene.{higher}") for higher in above), f"{path} imports {name}"


def test_every_folder_of_a_scene_is_a_floor_or_holds_no_code() -> None:
    folders = {path.relative_to(ROOT / "sim/scene").parts[0] for path in sources("sim/scene")}
    assert {name for name in folders if not name.endswith(".py")} == set(SCENE_FLOORS)


@pytest.mark.parametrize("package", PACKAGES)
def test_the_product_does_not_need_its_tools(package: str) -> None:
    """`tools` is not in the wheel."""
    for path in sources(package):
        assert not any(within(name, "tools") for name in imported(path)), path


@pytest.mark.parametrize("package", FLOORS)
def test_floors_import_downwards_only(package: str) -> None:
    """No module imports one of a floor above its own, nor another of its own floor."""
    floor_of = {name: number for number, names in enumerate(FLOORS[package]) for name in names.split()}
    prefix = f"{package}."
    for path in sources(package.replace(".", "/")):
        if module_name(path) == package:
            continue
        own = module_name(path).removeprefix(prefix).split(".")[0]
        assert own in floor_of, f"{path}: which floor of {package} is it on?"
        for name in imported(path):
            other = name.removeprefix(prefix).split(".")[0]
            if name.startswith(prefix) and other in floor_of and other != own:
                assert floor_of[other] > floor_of[own], f"{path} imports {name}"


def test_no_app_imports_another() -> None:
    """The command line joins apps, such as a flight and its page; what two of them share is on a floor below."""
    for path in sources("hil/apps"):
        parts = module_name(path).split(".")
        for name in imported(path):
            assert not within(name, "hil.apps") or name.split(".")[:3] == parts[:3], f"{path} imports {name}"


def test_lab_is_above_apps_and_nothing_imports_it() -> None:
    """`hil bench` finds its cases by their file: the wheel has none of them."""
    for path in sources("lab"):
        for name in imported(path):
            assert not within(name, "hil.cli"), f"{path} imports {name}"
            assert not within(name, "tests"), f"{path} imports {name}"
    for package in PACKAGES[:-1]:
        for path in sources(package):
            assert not any(within(name, "lab") for name in imported(path)), f"{path} imports lab"


def test_nothing_in_hil_imports_the_environments() -> None:
    for path in sources("hil"):
        if ROOT / "hil/gym" not in path.parents:
            assert not any(within(name, "hil.gym") for name in imported(path)), f"{path} imports hil.gym"


def test_no_circle_of_modules() -> None:
    modules = {module_name(path): path for package in PACKAGES for path in sources(package)}
    graph = {name: used_modules(path, modules) - {name} for name, path in modules.items()}
    assert circles(graph) == []


def test_packages_of_the_airsim_server_import_one_way() -> None:
    prefix = "hil.apps.airsim."
    graph: dict[str, set[str]] = {}
    for path in sources("hil/apps/airsim"):
        used = {name.removeprefix(prefix).split(".")[0] for name in imported(path) if name.startswith(prefix)}
        name = module_name(path).removeprefix(prefix).split(".")[0]
        graph.setdefault(name, set()).update(used - {name})
    assert len(graph) > 7
    assert circles(graph) == []


def test_a_circle_is_found() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a"}}) == [{"b", "c"}]
