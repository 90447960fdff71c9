"""LLVM for Dr.Jit, which compiles the path tracer's kernel: a shared library of the system.

Versions before 17 lack an instruction that Dr.Jit uses, and end the process; they are not tried.
"""

from __future__ import annotations

import glob
import os
import re
from pathlib import Path
from typing import NamedTuple

VARIABLE = "DRJIT_LIBLLVM_PATH"  # read by Dr.Jit
MIN_VERSION = 17
INSTALL = (
    f"install LLVM {MIN_VERSION} or newer (on Debian: apt-get install libllvm19), or set {VARIABLE} to its library"
)
_PATTERNS = (
    "/usr/lib/*/libLLVM*.so*",
    "/usr/lib/libLLVM*.so*",
    "/usr/lib64/libLLVM*.so*",
    "/usr/lib/llvm-*/lib/libLLVM*.so*",
    "/usr/local/lib/libLLVM*.so*",
    "/opt/homebrew/opt/llvm/lib/libLLVM*.dylib",
    "/usr/local/opt/llvm/lib/libLLVM*.dylib",
)
_VERSION = re.compile(r"libLLVM(?:-(\d+))?[^/]*?\.(?:so|dylib)(?:\.(\d+))?")


class Libraries(NamedTuple):
    """Libraries that may work, the newest first, and why others are not tried."""

    usable: list[Path]
    refused: list[str]


def version_of(path: Path) -> int | None:
    """Return the major version in a library's name; None if it has none."""
    found = _VERSION.search(path.name)
    text = (found[1] or found[2]) if found else None
    return int(text) if text is not None else None


def find_libraries(patterns: tuple[str, ...] = _PATTERNS) -> Libraries:
    """Return the libraries named by the environment, or else those of the system."""
    given = os.environ.get(VARIABLE)
    if given:
        path = Path(given)
        return Libraries([path], []) if path.is_file() else Libraries([], [f"{VARIABLE} names no file: {given}"])
    names = [Path(name) for pattern in patterns for name in glob.glob(pattern)]
    by_file: dict[Path, tuple[int, Path]] = {}
    for name in sorted(names):
        if not name.is_file():
            continue
        version = version_of(name) or version_of(name.resolve()) or 0
        by_file.setdefault(name.resolve(), (version, name))
    found = sorted(by_file.values(), key=lambda item: (-item[0], str(item[1])))
    refused = [f"{name} is version {version}" for version, name in found if version < MIN_VERSION]
    return Libraries([name for version, name in found if version >= MIN_VERSION], refused)
