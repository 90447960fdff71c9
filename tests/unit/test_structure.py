"""Rules that keep the product readable: parameters of a function, beginnings of docstrings."""

from __future__ import annotations

import ast
import re
import subprocess
from functools import cache
from pathlib import Path

import pytest

from hil import run_files

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("signals", "sim", "firmware_bridge", "hil", "lab", "rigs", "tools")
MOST_PARAMETERS = 8
Definition = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
HOLDS_STATEMENTS = (ast.stmt, ast.ExceptHandler, ast.match_case)  # an expression holds no definition
QUESTION = re.compile(r"(What|Of|Those|Whether|How|Who|Which|Where|When|Why)\b")
HEAD = re.compile(
    r"\bdef \w+\([\s\S]*?:[ \t]*(?:#.*)?$", re.MULTILINE
)  # from `def` to the first line that ends with a colon
IN_QUOTES = re.compile(r"[\"'][\\\s]*" + QUESTION.pattern)


@cache
def definitions(path: Path) -> list[Definition]:
    """Return the module of a file and every class and function in it."""
    found, blocks = [], [ast.parse(path.read_text())]
    while blocks:
        block = blocks.pop()
        if isinstance(block, Definition):
            found.append(block)
        # Expressions define nothing: only statements, and the parts of statements that hold some, are looked at.
        blocks += [
            n for n in ast.iter_child_nodes(block) if isinstance(n, ast.stmt | ast.ExceptHandler | ast.match_case)
        ]
    return found


def parameters(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Return the number of parameters, `self` and `cls` not counted."""
    arguments = function.args
    names = [a.arg for a in arguments.posonlyargs + arguments.args + arguments.kwonlyargs]
    bound = names[:1] in (["self"], ["cls"])
    return len(names) - bound + (arguments.vararg is not None) + (arguments.kwarg is not None)


def may_have_too_many(source: str) -> bool:
    """Return False if no function has the commas of too many parameters in its first lines: parsing takes longer."""
    return any(head.count(",") >= MOST_PARAMETERS for head in HEAD.findall(source))


def test_a_function_with_too_many_parameters_is_seen_before_parsing() -> None:
    names = [f"p{number}" for number in range(MOST_PARAMETERS + 1)]
    for between in (", ", ",\n    ", ": int = 0, ", ": Callable[[], None],  # why\n    "):
        assert may_have_too_many(f"def f({between.join(names)}) -> None:\n    pass\n")
    assert not may_have_too_many(f"def f({', '.join(names[:-1])}) -> None:\n    pass\n")


def test_names_of_a_runs_files_stand_once() -> None:
    names = [value for name, value in vars(run_files).items() if name.endswith("_NAME")]
    files = [path for package in ("hil", "lab") for path in (ROOT / package).rglob("*.py")]
    spelt = [path.name for path in files for name in names if f'"{name}"' in path.read_text()]
    assert spelt == ["run_files.py"] * len(names)


@pytest.mark.parametrize("package", PACKAGES)
def test_no_function_has_too_many_parameters(package: str) -> None:
    paths = sorted((ROOT / package).rglob("*.py"))
    assert paths
    for path in paths:
        for node in definitions(path) if may_have_too_many(path.read_text()) else ():
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                assert parameters(node) <= MOST_PARAMETERS, f"{path}:{node.lineno}: {node.name}"


def test_docstrings_name_their_subject() -> None:
    tracked = subprocess.run(["git", "ls-files", "*.py"], cwd=ROOT, capture_output=True, text=True, check=False).stdout
    paths = [ROOT / name for name in tracked.splitlines() if (ROOT / name).exists()] or sorted(
        (ROOT / "tests").rglob("*.py")
    )
    wrong = []
    for path in paths:
        if not IN_QUOTES.search(path.read_text()):
            continue  # parsing takes longer
        for node in definitions(path):
            if QUESTION.match(ast.get_docstring(node) or ""):
                wrong.append(f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 1)}")
    assert not wrong, f"docstrings that begin with a question word: {wrong}"
