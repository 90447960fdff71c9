"""Search path of benches, rigs, scenes, vehicles and missions.

They are looked for beside the file that names them, then in the working directory, then in the installed `rigs`
package. A user's bench can therefore bring its own rig, and `hil run` works in an empty folder.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import rigs

_PACKAGE = Path(rigs.__file__).resolve().parent
FOLDERS = {"rig": "", "scene": "scenes", "vehicle": "vehicles", "mission": "missions"}


def default_bench() -> Path | None:
    """Return ./hil.yaml, else the bench file of the installation, else None."""
    for path in (Path("hil.yaml"), _PACKAGE / "benches" / "hil.yaml", _PACKAGE.parent / "hil.yaml"):
        if _is_file(path):
            return path
    return None


def _is_file(path: Path) -> bool:
    """Return True if `path` exists and is not a folder. The reader refuses devices and pipes, and says why."""
    try:
        return path.exists() and not path.is_dir()
    except PermissionError:
        return True  # the reader reports it
    except OSError:  # a name that is too long
        return False


def find(what: str, name: str, beside: Sequence[Path]) -> Path | None:
    """Return the file of a 'rig', 'scene', 'vehicle' or 'mission' by bare name or relative path, None if there is none.

    `beside` are the folders to search first.
    """
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
    except RuntimeError:  # '~name/...' without such a user
        return []


def is_bare(what: str, name: str) -> bool:
    """Return True if `name` is a name and not the path of a file. Missions have paths only."""
    return what != "mission" and "/" not in name and "\\" not in name and not Path(name).suffix


def available(what: str, beside: Sequence[Path]) -> list[str]:
    """Return every bare name that `find` would find, sorted."""
    folders = [folder / "rigs" for folder in (*beside, Path())] + [_PACKAGE]
    found = [path for folder in folders for path in (folder / FOLDERS[what]).glob("*.yaml")]
    return sorted({path.stem for path in found if what != "rig" or not _names_a_rig(path)})


def _names_a_rig(path: Path) -> bool:
    """Return True if a file beside the rigs is a bench: a bench names its rig, a rig does not."""
    try:
        return any(line.startswith("rig:") for line in path.read_text(encoding="utf-8").splitlines())
    except (OSError, UnicodeDecodeError):
        return False  # the reader reports it
