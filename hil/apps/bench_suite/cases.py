"""Modules of the benchmarks: of this package, and of `lab/`, which is in a checkout and not in the wheel.

No file imports `lab`: its cases are found by their place beside the package `hil`.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import hil

_CHECKOUT = Path(hil.__file__).resolve().parents[1]  # or the folder of installed packages
NEEDS_CHECKOUT = "needs a checkout of hil-bench, an installed package lacks its cases"


def is_here(module: str) -> bool:
    """Return False for a module of `lab` in an installation that has none."""
    file = _CHECKOUT / f"{module.replace('.', '/')}.py"
    return not module.startswith("lab.") or ((_CHECKOUT / "pyproject.toml").exists() and file.exists())


def import_case(module: str) -> ModuleType:
    """Return the module of a benchmark that `is_here`."""
    if module.startswith("lab.") and str(_CHECKOUT) not in sys.path:
        sys.path.insert(0, str(_CHECKOUT))  # processes of a benchmark inherit the path
    return import_module(module)
