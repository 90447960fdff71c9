"""The benchmarks: each module with a `TITLE`, in this package or in `lab/`, which a checkout has and the wheel has not.

No file imports `lab`: it is found by its place beside the package `hil`. Titles are read without an import, since some
modules import what only their benchmark needs.
"""

from __future__ import annotations

import re
import sys
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType

import hil
from signals.errors import ConfigError

_CHECKOUT = Path(hil.__file__).resolve().parents[1]  # or the folder of installed packages
NEEDS_CHECKOUT = "needs a checkout of hil-bench, an installed package lacks its cases"
_TITLE = re.compile(r'^TITLE = "', re.MULTILINE)


def has_lab() -> bool:
    """Return False in an installation, which has no `lab`."""
    return (_CHECKOUT / "pyproject.toml").exists() and (_CHECKOUT / "lab").is_dir()


@cache
def benchmarks() -> dict[str, str]:
    """Return the module of each benchmark of this machine by its name, that of the file; in the order of names.

    Raises ConfigError for two of one name.
    """
    folders = {__package__: Path(__file__).parent} | ({"lab": _CHECKOUT / "lab"} if has_lab() else {})
    found: dict[str, str] = {}
    files: dict[str, Path] = {}
    for package, folder in folders.items():
        for file in sorted(folder.rglob("*.py")):
            parts = file.relative_to(folder).with_suffix("").parts
            if any(part.startswith(".") for part in parts) or not _has_title(file):
                continue
            if file.stem in files:
                message = f"is a second benchmark {file.stem!r}, beside {files[file.stem]}"
                raise ConfigError.at(str(file), message, "rename one of them")
            files[file.stem] = file
            found[file.stem] = ".".join((package, *parts))
    return dict(sorted(found.items()))


def _has_title(file: Path) -> bool:
    """Return False also for a file that cannot be read: it is no benchmark, and hinders no other."""
    try:
        return _TITLE.search(file.read_text(encoding="utf-8")) is not None
    except (OSError, UnicodeDecodeError):
        return False


def import_case(module: str) -> ModuleType:
    """Return the module of a benchmark."""
    if module.startswith("lab.") and str(_CHECKOUT) not in sys.path:
        sys.path.insert(0, str(_CHECKOUT))  # processes of a benchmark inherit the path
    return import_module(module)
