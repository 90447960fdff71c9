"""Lint, types, and the unit tests near what changed since `main`: `make check`.

Near are the tests of the room that changed (`tests/unit/sim/sensors` of `sim/sensors/gps.py`), and those that import a
changed module, directly or through one other. Tests that start processes or browsers, and slow ones, are left to
`make test`.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("signals", "sim", "firmware_bridge", "hil", "tests")
_STEPS = 2  # imports between a test and a changed module
_STARTERS = ("subprocess", "playwright", "tests.worlds.bench_process", "tests.worlds.dashboard_page")
_LIMITS = ["-m", "not slow", "-n", "2", "--dist", "worksteal", "-q"]


def name_of(path: Path) -> str:
    """Return the dotted name of a Python file, relative to the root."""
    return ".".join(path.with_suffix("").parts).removesuffix(".__init__")


def imports_of(source: str) -> set[str]:
    """Return the dotted names that a module may import; `from a import b` gives a and a.b."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


def near_tests(changed: Iterable[Path], imports: Mapping[Path, set[str]]) -> list[Path]:
    """Return the test files near changed files. `imports`: what each Python file of the tree imports."""
    files = {name_of(path): path for path in imports}
    reached = {path for path in changed if path in imports}
    rooms = {Path("tests/unit") / path.parent for path in reached if path.parts[0] != "tests"}
    frontier = set(reached)
    for _ in range(_STEPS):
        names = {name_of(path) for path in frontier}
        frontier = {path for path in files.values() if imports[path] & names} - reached
        reached |= frontier
    return sorted(
        path
        for path in imports
        if path.parts[:2] == ("tests", "unit")
        and path.name.startswith("test_")
        and (path in reached or path.parent in rooms)
        and not imports[path].intersection(_STARTERS)
    )


def changed_files(base: str = "main") -> list[Path]:
    """Return the files that differ from where this branch left `base`, with new ones, relative to the root."""
    ask = ["git", "-C", str(ROOT)]
    fork = _lines(*ask, "merge-base", base, "HEAD")[0]
    names = [*_lines(*ask, "diff", "--name-only", fork), *_lines(*ask, "ls-files", "--others", "--exclude-standard")]
    return [Path(name) for name in names]


def _lines(*command: str) -> list[str]:
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()


def main() -> int:
    """Run everything; return the first status that is not 0."""
    paths = [path.relative_to(ROOT) for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    tests = near_tests(changed_files(), {path: imports_of((ROOT / path).read_text("utf-8")) for path in paths})
    here = Path(sys.executable).parent
    commands = [
        [str(here / "ruff"), "check", "."],
        [str(here / "ruff"), "format", "--check", "."],
        [str(here / "mypy")],
    ]
    if tests:
        commands.append([sys.executable, "-m", "pytest", *_LIMITS, *map(str, tests)])
    sys.stdout.write(f"{len(tests)} test files are near the change\n")
    sys.stdout.flush()
    return next((status for command in commands if (status := subprocess.run(command, cwd=ROOT).returncode)), 0)


if __name__ == "__main__":
    sys.exit(main())
