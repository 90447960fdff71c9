"""The companion client runs on a Jetson's own Python: Python 3.8, numpy, pyzmq, msgpack, no module of the bench."""

from __future__ import annotations

import ast
import sys
import tomllib
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from tests.worlds.scripted_bench import CLIENT

ALLOWED = {"numpy", "zmq", "msgpack", "hil_companion"}
WITH_OPENCV = {"detect", "explore", "locate", "contact_sheet.py"}
WITH_SCIPY = {"locate/partition.py", "locate/tracks.py"}  # of the extra `detect`
BACKENDS = {
    "detect/backends/onnx_runtime.py": {"onnxruntime"},
    "detect/backends/pytorch.py": {"torch", "onnx", "google"},
}
SOURCES = sorted((CLIENT / "hil_companion").rglob("*.py"))
# Python 3.8 cannot evaluate X | Y and list[X] at import, which happens outside annotations.
BUILTIN_GENERICS = {"dict", "list", "tuple", "set", "frozenset", "type"}
NEWER_CALLS = {"removeprefix", "removesuffix", "bit_count", "pairwise", "is_relative_to"}


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(CLIENT)))
def test_source_is_python_3_8_with_three_packages(path: Path) -> None:
    tree = ast.parse(path.read_text(), feature_version=(3, 8))
    place = path.relative_to(CLIENT / "hil_companion")
    allowed = ALLOWED | ({"cv2"} if place.parts[0] in WITH_OPENCV else set())
    allowed |= {"scipy"} if str(place) in WITH_SCIPY else set()
    allowed |= BACKENDS.get(str(place), set())
    annotations = {id(n) for a in _annotations(tree) for n in ast.walk(a)}
    future = any(isinstance(n, ast.ImportFrom) and n.module == "__future__" for n in tree.body)
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0
        names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        for name in names:
            top = name.split(".")[0]
            assert top in sys.stdlib_module_names or top in allowed, name
        if isinstance(node, ast.Attribute):
            assert node.attr not in NEWER_CALLS, node.attr
        if isinstance(node, ast.Call):
            assert not any(k.arg == "strict" for k in node.keywords), "zip(strict=) is newer than Python 3.8"
        if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name) and node.value.id in BUILTIN_GENERICS:
            assert future, "needs from __future__ import annotations"
            assert id(node) in annotations, f"line {node.lineno}: evaluated at run time"


def test_every_folder_is_among_the_packages_that_pip_installs() -> None:
    listed = tomllib.loads((CLIENT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    assert listed == sorted({".".join(path.relative_to(CLIENT).parent.parts) for path in SOURCES})


def test_modules_import_each_other_in_no_circle() -> None:
    modules = {".".join(path.relative_to(CLIENT).with_suffix("").parts): path for path in SOURCES}
    graph: dict[str, set[str]] = {}
    for module, path in modules.items():
        found = [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.ImportFrom)]
        names = {name for n in found for name in (n.module or "", *(f"{n.module}.{alias.name}" for alias in n.names))}
        graph[module] = names & set(modules)
    assert sum(map(len, graph.values())) > len(modules)
    TopologicalSorter(graph).prepare()  # raises CycleError


def _annotations(tree: ast.AST) -> list[ast.AST]:
    found: list[ast.AST | None] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.arg | ast.AnnAssign):
            found.append(node.annotation)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            found.append(node.returns)
    return [node for node in found if node is not None]
