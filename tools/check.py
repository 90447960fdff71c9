"""Types, and the unit tests near what changed since `main`: `make check`, after its lint.

Near are the tests of the room that changed (`tests/unit/sim/sensors` of `sim/sensors/gps.py`), and those that import a
changed module, directly or through one other. The nearest are run first, until `LIMIT_S` is over or `MOST_FILES` are
reached; what is left out then is printed. Tests that start processes or browsers, and slow ones, are left to
`make test`.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("signals", "sim", "firmware_bridge", "hil", "lab", "rigs", "tools", "tests")
LIMIT_S = 22.0  # no test begins later: the last ones and pytest's end need the rest of half a minute
MOST_FILES = 60  # collecting more costs more time than is then left to run them

_BASES = ("main", "origin/main")
_STEPS = 2  # imports between a test and a changed module
_STARTERS = {"subprocess", "multiprocessing", "playwright", "playwright.sync_api"}
# What C++ of a folder is linked into; `make setup`, which goes before, builds it.
_NATIVE = {"sim": "sim._kernels", "signals": "signals._kernel", "firmware_bridge": "firmware_bridge._native"}
_OF_PAGES = Path("tests/unit/test_docs.py")
_OF_THE_TREE = tuple(Path("tests/unit") / name for name in ("test_imports.py", "test_autopilot_kinds.py"))
_OPTIONS = ["-m", "not slow", "-p", "tools.time_limit", "-n", "2", "--dist", "loadfile", "--no-loadscope-reorder", "-q"]
_IMPORT = re.compile(
    r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)|import[ \t]+([^\n]*))", re.MULTILINE
)
_COMMENT = re.compile(r"#.*")


def name_of(path: Path) -> str:
    """Return the name by which a file is imported: of a C++ file, that of the extension that it is a part of."""
    if "native" in path.parts:
        return _NATIVE.get(path.parts[0], "")
    parts = path.with_suffix("").parts
    parts = parts[2:] if parts[:2] == ("rigs", "jetson") else parts
    return ".".join(parts).removesuffix(".__init__")


def imports_of(source: str) -> set[str]:
    """Return the dotted names that a module may import; `from a import b` gives a and a.b.

    By pattern: parsing the whole tree takes 30 times as long. An example in a docstring counts, too.
    """
    names: set[str] = set()
    for package, members, modules in _IMPORT.findall(source):
        listed = _COMMENT.sub("", members or modules).strip("() \n").split(",")
        words = {entry.split()[0] for entry in listed if entry.strip()}
        names |= {package, *(f"{package}.{word}" for word in words)} if package else words
    return names


def near_tests(changed: Iterable[Path], imports: Mapping[Path, set[str]]) -> list[Path]:
    """Return the test files near changed files, the nearest first. `imports`: what each Python file imports."""
    tests = [path for path in imports if path.parts[:2] == ("tests", "unit") and path.name.startswith("test_")]
    changed = set(changed)
    rooms = {_room(path, {test.parent for test in tests}) for path in changed if path.parts[0] != "tests"}
    distance = {test: 0 for test in tests if test in changed or test.parent in rooms}
    reached, names = set(changed), {name_of(path) for path in changed if path.suffix == ".py" or "native" in path.parts}
    for step in range(1, _STEPS + 1):
        frontier = {path for path, used in imports.items() if used & names} - reached
        distance |= {path: step for path in frontier if path in tests and path not in distance}
        reached |= frontier
        names = {name_of(path) for path in frontier}
    if any(path.parts[0] == "docs" for path in changed):
        distance.setdefault(_OF_PAGES, 1)
    if any(path.suffix == ".py" for path in changed):
        distance |= {path: _STEPS for path in _OF_THE_TREE if path in imports and path not in distance}
    # Of two equally near, the one that imports less is about fewer things, and costs less.
    starters = _starters(imports)
    return sorted(distance.keys() - starters, key=lambda path: (distance[path], len(imports.get(path, ())), path))


def _room(path: Path, folders: set[Path]) -> Path | None:
    """Return the folder of the tests of a file: of the nearest folder above it that has some."""
    parts = [part for part in path.parts if part not in ("native", "jetson", "hil_companion")]
    rooms = (Path("tests/unit", *parts[:end]) for end in range(len(parts) - 1, 0, -1))
    return next((room for room in rooms if room in folders), None)


def _starters(imports: Mapping[Path, set[str]]) -> set[Path]:
    """Return the files of the tests that start processes, themselves or by what they import of the tests."""
    helpers = {path for path in imports if path.parts[0] == "tests"}
    found: set[Path] = set()
    names = set(_STARTERS)
    while more := {path for path in helpers - found if imports[path] & names}:
        found |= more
        names |= {name_of(path) for path in more}
    return found


def changed_files(root: Path = ROOT) -> list[Path]:
    """Return the files that differ from where this branch left `main`, with new ones, relative to the root.

    A clone of another branch has `origin/main` only. Ends the program with the remedy if there is neither.
    """
    ask = ["git", "-C", str(root)]
    forks = (subprocess.run([*ask, "merge-base", base, "HEAD"], capture_output=True, text=True) for base in _BASES)
    fork = next((found.stdout.strip() for found in forks if found.returncode == 0), None)
    if fork is None:
        raise SystemExit(
            f"make check: {root} has no commit in common with {' or '.join(_BASES)}, so what changed is unknown: "
            "fetch it (git fetch --unshallow origin main:main), or run `make lint` and `make test`"
        )
    names = [*_lines(*ask, "diff", "--name-only", fork), *_lines(*ask, "ls-files", "--others", "--exclude-standard")]
    return [Path(name) for name in names]


def _lines(*command: str) -> list[str]:
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def _tell_tests(tests: Sequence[Path]) -> None:
    _say(f"{len(tests)} test files are near the change")
    if left := tests[MOST_FILES:]:
        _say(f"the farthest {len(left)} are left to `make test`: {', '.join(path.stem for path in left)}")


def main() -> int:
    """Run everything; return the first status that is not 0."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter).parse_args()
    end_s = time.time() + LIMIT_S
    here = Path(sys.executable).parent
    changed = changed_files()
    types = subprocess.Popen([here / "mypy"], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    paths = [path.relative_to(ROOT) for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    tests = near_tests(changed, {path: imports_of((ROOT / path).read_text("utf-8")) for path in paths})
    _tell_tests(tests)
    status = 0
    if tests:
        pytest = [sys.executable, "-m", "pytest", *_OPTIONS, *map(str, tests[:MOST_FILES])]
        status = subprocess.run(pytest, cwd=ROOT, env={**os.environ, "HIL_CHECK_END_S": f"{end_s:.3f}"}).returncode
    said, _ = types.communicate()
    _say(said.rstrip())
    return types.returncode or status


if __name__ == "__main__":
    sys.exit(main())
