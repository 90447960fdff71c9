"""Search path of benches, rigs, scenes, vehicles, missions, campaigns and files of parameters.

They are searched for beside the file that names them, then in the working directory, then in the installed `rigs`
package. A bench can therefore have its own rig beside it, and `hil run` works in an empty folder.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import rigs

_PACKAGE = Path(rigs.__file__).resolve().parent
FOLDERS = {"rig": "", "scene": "scenes", "vehicle": "vehicles", "campaign": "campaigns"}


def default_bench() -> Path | None:
    """Return ./hil.yaml, else the bench file of the installation, else None."""
    for path in (Path("hil.yaml"), _PACKAGE / "benches" / "hil.yaml", _PACKAGE.parent / "hil.yaml"):
        if _is_file(path):
            return path
    return None


def bench_file(path: Path) -> Path:
    """Return `path`, or the file of that path in the installation where none is here, as for a rig or a scene."""
    return path if _is_file(path) or not _is_file(_PACKAGE.parent / path) else _PACKAGE.parent / path


def is_rig(path: Path) -> bool:
    """Return True for a rig's file: one in a folder `rigs` that does not choose a rig."""
    return path.resolve().parent.name == "rigs" and _is_file(path) and not _is_bench(path)


def dashboard_bench() -> Path | None:
    """Return the bench that the dashboard opens with: the user's ./hil.yaml, else one with cameras in the park."""
    default, shown = default_bench(), _PACKAGE / "benches" / "dashboard.yaml"
    installed = (_PACKAGE / "benches" / "hil.yaml", _PACKAGE.parent / "hil.yaml")
    own = default is not None and default.resolve() not in [path.resolve() for path in installed]
    return default if own or not _is_file(shown) else shown


def _is_file(path: Path) -> bool:
    """Return True if `path` exists and is not a folder. `read_yaml` refuses devices and pipes."""
    try:
        return path.exists() and not path.is_dir()
    except PermissionError:
        return True  # `read_yaml` reports it
    except OSError:  # a name that is too long
        return False


def find(kind: str, name: str, beside: Sequence[Path]) -> Path | None:
    """Return a file of a kind of `FOLDERS` by bare name or relative path, of another by path; None if there is none.

    `beside` are the folders to search first.
    """
    for folder in (*beside, Path()):
        for candidate in _candidates(kind, name, folder, folder / "rigs"):
            if _is_file(candidate):
                return candidate
    for candidate in _candidates(kind, name, _PACKAGE.parent, _PACKAGE):
        if _is_file(candidate):
            return candidate
    return None


def _candidates(kind: str, name: str, folder: Path, rigs_folder: Path) -> list[Path]:
    if is_bare(kind, name):
        return [rigs_folder / FOLDERS[kind] / f"{name}.yaml"]
    return [folder / os.path.expanduser(name)]


def is_bare(kind: str, name: str) -> bool:
    """Return True if `name` is a name and not the path of a file. Kinds without a folder have paths only."""
    return kind in FOLDERS and "/" not in name and "\\" not in name and not Path(name).suffix


def available(kind: str, beside: Sequence[Path]) -> list[str]:
    """Return every bare name that `find` would find, sorted."""
    folders = [folder / "rigs" for folder in (*beside, Path())] + [_PACKAGE]
    paths = [path for folder in folders for path in (folder / FOLDERS[kind]).glob("*.yaml")]
    return sorted({path.stem for path in paths if kind != "rig" or not _is_bench(path)})


def _is_bench(path: Path) -> bool:
    """Return True if a file in a folder of rigs is a bench. A bench has the key `rig`, a rig has not."""
    try:
        return any(line.startswith("rig:") for line in path.read_text(encoding="utf-8").splitlines())
    except (OSError, UnicodeDecodeError):
        return False  # `read_yaml` reports it
