"""Companion clients by name: the shipped ones, and MODULE:NAME of a user's own."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Iterable, Sequence
from functools import cache
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path

import rigs

CLIENT_PATH = Path(rigs.__file__).resolve().parent / "jetson"  # the folder of the package `hil_companion`


def client_name(cut: str) -> str:
    """Return the name under which a client registers: 'echo' for 'echo', 'fly' for 'my.module:fly'."""
    return cut.rpartition(":")[2]


def make_client_importable() -> None:
    """Make the package `hil_companion` importable."""
    if str(CLIENT_PATH) not in sys.path:
        sys.path.insert(0, str(CLIENT_PATH))


def known_clients() -> tuple[str, ...]:
    """Return the names of the shipped clients."""
    make_client_importable()
    from hil_companion.catalog import SHIPPED

    return tuple(SHIPPED)


def unknown_clients(names: Iterable[str]) -> list[str]:
    """Return the names that are neither a shipped client nor MODULE:NAME."""
    return [name for name in names if name not in known_clients() and ":" not in name]


def missing_modules(names: Iterable[str]) -> list[str]:
    """Return the modules of a user's own clients, named as MODULE:NAME, that cannot be found; imports none."""
    modules, path = [name.rpartition(":")[0] for name in names if ":" in name], _search_path()
    return [module for module in modules if not _specs(module, path)]


def source_files(name: str) -> Sequence[tuple[str, Path]]:
    """Return the Python files of a user's own client by their names: of its package, or beside its module.

    They are listed once in a process: a file that is added later is not among them.
    """
    return _listed(name.rpartition(":")[0], _search_path())


@cache
def _listed(module: str, path: tuple[str, ...]) -> Sequence[tuple[str, Path]]:
    specs = _specs(module, path)
    if not specs:
        return ()
    folders = specs[0].submodule_search_locations
    if folders is not None:
        return sorted((path.relative_to(top).as_posix(), path) for top in map(Path, folders) for path in _all_in(top))
    return sorted((path.name, path) for path in Path(str(specs[0].origin)).parent.glob("*.py"))


def _all_in(folder: Path) -> Iterable[Path]:
    return (path for path in folder.rglob("*.py") if path.is_file())


def _search_path() -> tuple[str, ...]:
    """Return the folders in which a started client looks for its module."""
    given = filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))
    return (os.getcwd(), str(CLIENT_PATH), *given, *sys.path)


def _specs(module: str, folders: Sequence[str]) -> list[ModuleSpec]:
    """Return what a started client would import as `a`, `a.b` ... for the module a.b...; empty if it is not found."""
    path: Sequence[str] | None = folders
    specs: list[ModuleSpec] = []
    for word in module.split("."):
        # By its last word alone: for a folder of a namespace package, a whole name looks up an imported parent.
        spec = None if path is None else PathFinder.find_spec(word, path)
        if spec is None and not specs:  # a hook of an editable installation may know it
            spec = _installed(word)
        if spec is None:
            return []
        specs.append(spec)
        path = None if spec.submodule_search_locations is None else list(spec.submodule_search_locations)
    return specs


def _installed(name: str) -> ModuleSpec | None:
    try:
        return importlib.util.find_spec(name)
    except (ImportError, ValueError):
        return None
