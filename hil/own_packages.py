"""Makes `import sim` and the like mean the packages of this bench, not a user's folder of the same name.

A repository may have `sim/`, `signals.py` or `rigs/` of its own, and pytest or `python -m` put its folder first on the
import path. A finder before all others finds the bench's packages beside `hil`. The parts of `hil` that use them import
this module first; tests that do not use the bench import their own.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType

NAMES = ("signals", "sim", "firmware_bridge", "rigs")
_FOLDER = Path(__file__).absolute().parent.parent  # not resolved: a tree may be made of links to files of another


class PackageCollision(ImportError):
    """This process has imported another package under a name of the bench's packages."""


class _OwnPackages:
    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return where a package of the bench is; their modules are found through it."""
        del path, target
        return PathFinder.find_spec(name, [str(_FOLDER)]) if name in NAMES else None


def claim() -> None:
    """Let the names mean the bench's packages from now on. Raises PackageCollision if one means another already."""
    for name in NAMES:
        loaded = sys.modules.get(name)
        if loaded is None:
            continue
        file = getattr(loaded, "__file__", None) or next(iter(getattr(loaded, "__path__", [])), "")
        if not Path(file).absolute().is_relative_to(_FOLDER / name):
            raise PackageCollision(
                f"hil-bench has a package {name!r}, and this process has already imported another one of that name "
                f"({file}); rename that one, or import it by a longer name (mypackage.{name})"
            )
    sys.meta_path.insert(0, _OwnPackages())


claim()
