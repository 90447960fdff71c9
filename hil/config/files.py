"""Where benches, rigs, scenes, vehicles and missions are looked for.

In this order: beside the file that names them, in the working directory, in the installed `rigs` package. So a
bench of your own can bring a rig of its own, and `hil run` works in an empty folder.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import rigs

_PACKAGE = Path(rigs.__file__).resolve().parent
FOLDERS = {"rig": "", "scene": "scenes", "vehicle": "vehicles", "mission": "missions"}


def default_bench() -> Path | None:
    """The bench file that is meant when none is named: ./hil.yaml, else the one that came with the installation."""
    for path in (Path("hil.yaml"), _PACKAGE / "benches" / "hil.yaml", _PACKAGE.parent / "hil.yaml"):
        if _is_file(path):
            return path
    return None


def _is_file(path: Path) -> bool:
    """Whether there is something to read: a device or a pipe is refused where it is read, with the reason."""
    try:
        return path.exists() and not path.is_dir()
    except PermissionError:
        return True  # said where it is read
    except OSError:  # a name that is too long
        return False


def find(what: str, name: str, beside: Sequence[Path]) -> Path | None:
    """The file of a `what` ('rig', 'scene', ...): a bare name or a path, relative to the places above."""
    for folder in (*beside, Path()):
        for candidate in _candidates(what, name, folder, folder / "rigs"):
            if _is_file(candidate):
                return candidate
    for candidate in _candidates(what, name, _PACKAGE.parent, _PACKAGE):
        if _is_file(candidate):
            return candidate
    return None


def _candidates(what: str, name: str, folder: Path, rigs_folder: Path) -> list[Path]:
    if is_bare(what, name):
        return [rigs_folder / FOLDERS[what] / f"{name}.yaml"]
    try:
        return [folder / Path(name).expanduser()]
    except RuntimeError:  # '~nobody/...': no such user
        return []


def is_bare(what: str, name: str) -> bool:
    """Whether `name` is a name and not the path of a file. Missions have paths only."""
    return what != "mission" and "/" not in name and "\\" not in name and not Path(name).suffix


def available(what: str, beside: Sequence[Path]) -> list[str]:
    """Every name that `find` would find, sorted."""
    folders = [folder / "rigs" for folder in (*beside, Path())] + [_PACKAGE]
    found = [path for folder in folders for path in (folder / FOLDERS[what]).glob("*.yaml")]
    return sorted({path.stem for path in found if what != "rig" or not _names_a_rig(path)})


def _names_a_rig(path: Path) -> bool:
    """Whether a file beside the rigs is a bench, which says on which of them it flies."""
    try:
        return any(line.startswith("rig:") for line in path.read_text(encoding="utf-8").splitlines())
    except (OSError, UnicodeDecodeError):
        return False  # said where it is read
