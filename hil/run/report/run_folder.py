"""The folder of a run, and the run.json of a run that never began."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import shutil
import stat
import time
from collections.abc import Iterable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

from hil.data_set_files import MANIFEST
from hil.run.report.run_json import run_json_text, write_run_json
from hil.run_files import (
    BENCH_NAME,
    MCAP_NAME,
    PAGE_NAME,
    PEOPLE_NAME,
    RUN_JSON_NAME,
    SEARCH_PICTURE_NAME,
    TIMING_NAME,
    TLOG_NAME,
    TRACE_NAME,
    VIEWS_NAME,
)
from signals._kernel import guard_file
from signals.errors import ConfigError, HilError, OutOfMemory, RecordingError, file_errors
from signals.shortage import CRASHED, OUT_OF_MEMORY

# Files and folders that a run writes. A link in their place is removed first: writing would change what it points to.
_SUFFIXES = (
    *(".csv", ".html", ".json", ".jsonl", ".log", ".mcap", ".parm", ".part", ".plan", ".png", ".tlog", ".txt"),
    *(".waypoints", ".yaml", ".yml", ".xml", ".obj", ".stl", ".msh", ".bin", ".hdr", ".skn"),
    *(".glb", ".osm", ".pbf", ".tif"),
)
_FOLDERS = frozenset({"autopilot", "calibration", "scene_map"})
_RESULTS = (RUN_JSON_NAME, PAGE_NAME, BENCH_NAME)  # what makes a folder one of a run
# Files of companions and searches, which not every run has. A replay takes the answers of the first. Of what clients
# write into their folders the rest stays: the run may read it.
_OF_SOME = (TRACE_NAME, TIMING_NAME, VIEWS_NAME, PEOPLE_NAME, SEARCH_PICTURE_NAME)
_OF_CLIENTS = ("companion_*.log", "companion_*/report*.png")


@contextlib.contextmanager
def locked_folder(out: Path) -> Iterator[None]:
    """Make a folder for results and hold its lock, which the kernel releases when the process ends (flock).

    Raises RecordingError if the folder cannot be used or another process writes into it.
    """
    with file_errors(out, "cannot be used as a folder for results"):
        out.mkdir(parents=True, exist_ok=True)
        folder = os.open(out, os.O_RDONLY | os.O_DIRECTORY)
    try:
        try:
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            text = f"{out}: another run is writing here; wait until it has ended, or name another folder with --out"
            raise RecordingError(text) from None
        except OSError:
            pass  # a file system without locks
        yield
    finally:
        os.close(folder)


def is_under_way(folder: Path) -> bool:
    """Return True while a process of this machine holds the lock of a folder."""
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # a file system without locks
        return False
    finally:
        os.close(descriptor)
    return False


@contextlib.contextmanager
def run_folder(out: Path, vehicles: Iterable[str] | None = None) -> Iterator[None]:
    """Make the folder of a run and those of its `vehicles`, hold their locks, and remove links where the run writes.

    The results of vehicles that an earlier run here had and this one has not are removed (None: they stay). Raises
    RecordingError as `locked_folder` does.
    """
    names = frozenset(vehicles or ())
    with contextlib.ExitStack() as stack:
        stack.enter_context(locked_folder(out))
        _remove_links(out, _FOLDERS | names)
        if vehicles is not None:
            _remove_other_vehicles(out, names)
        for name in names:
            stack.enter_context(run_folder(out / name))
        yield


def _remove_other_vehicles(out: Path, names: frozenset[str]) -> None:
    """Remove the results of vehicles that are not in `names`, so that they do not pass for this run's."""
    try:
        earlier = json.loads((out / RUN_JSON_NAME).read_text())["vehicles"]
    except (OSError, ValueError, LookupError, TypeError):
        return  # no earlier run, or one with a single vehicle
    for name in earlier if isinstance(earlier, dict) else ():
        if name not in names and Path(name).name == name and not (out / name).is_symlink():
            for file in _RESULTS:
                with contextlib.suppress(OSError):
                    (out / name / file).unlink(missing_ok=True)


def remove_earlier(out: Path, vehicles: Iterable[str], kept: Iterable[str]) -> None:
    """Remove report, recordings, and what companions left, of an earlier run in `out`: it would pass for this one's.

    `kept`: files and folders of runs that this run reads. A folder without a run.json, or of a data set, is left alone.
    """
    if not _is_of_a_run(out):
        return
    read = {Path(os.path.realpath(path)) for path in kept}
    for folder in (out, *(out / name for name in vehicles)):
        paths = [folder / name for name in (PAGE_NAME, MCAP_NAME, TLOG_NAME, *_OF_SOME)]
        paths += [path for pattern in _OF_CLIENTS for path in folder.glob(pattern)]
        for path in paths:
            real = Path(os.path.realpath(path))
            linked = path.parent != folder and path.parent.is_symlink()
            if not linked and not read & {real, real.parent}:
                with contextlib.suppress(OSError):
                    path.unlink(missing_ok=True)  # never what a link leads to


def _is_of_a_run(folder: Path) -> bool:
    return (folder / RUN_JSON_NAME).is_file() and not (folder / MANIFEST).exists()


def _remove_links(folder: Path, folders: frozenset[str] = _FOLDERS) -> None:
    try:
        for entry in list(os.scandir(folder)):
            if entry.is_dir(follow_symlinks=False):
                if entry.name in folders:
                    _remove_links(Path(entry.path))
            elif entry.name in folders or Path(entry.name).suffix.lower() in _SUFFIXES:
                state = entry.stat(follow_symlinks=False)
                if not stat.S_ISREG(state.st_mode) or state.st_nlink > 1:
                    os.unlink(entry.path)
    except OSError as error:
        path = error.filename or folder
        raise RecordingError(f"{path}: a link where the run writes cannot be removed ({error.strerror})") from error


@contextlib.contextmanager
def new_run_dir(out: Path | None, rig: str, runs: Path = Path("runs")) -> Iterator[Path]:
    """Yield `out`, or a new folder in `runs` to which `runs/latest` points. Raises RecordingError.

    A ConfigError in the block says that no run began: folders that were made for it are removed, and `runs/latest`
    points to where it did.
    """
    wanted = out or runs
    missing = [path for path in (wanted, *wanted.parents) if not os.path.lexists(path)]
    latest, before = runs / "latest", None
    folder = out or _make_folder(rig, runs)
    if out is None:
        missing.insert(0, folder)
        before = _point(latest, folder.name)
    try:
        yield folder
    except ConfigError:
        if out is None and _target(latest) == folder.name:
            _point(latest, before)
        if folder in missing:
            shutil.rmtree(folder, ignore_errors=True)
        for parent in missing:
            with contextlib.suppress(OSError):  # somebody else uses it
                parent.rmdir()
        raise


def _make_folder(rig: str, runs: Path) -> Path:
    """Make a folder in `runs`, named by time and rig. Raises RecordingError."""
    name = re.sub(r"[^A-Za-z0-9_.-]+", "-", Path(rig).stem) or "run"
    stem = f"{time.strftime('%Y%m%d-%H%M%S')}-{name[:80]}"
    with file_errors(runs, "the folder of the run cannot be created", hint="; name another with --out"):
        runs.mkdir(parents=True, exist_ok=True)
        for n in count():
            folder = runs / (f"{stem}-{n}" if n else stem)
            with contextlib.suppress(FileExistsError):
                folder.mkdir()
                break
    return folder


def _target(link: Path) -> str | None:
    try:
        return os.readlink(link)
    except OSError:
        return None


def _point(link: Path, target: str | None) -> str | None:
    """Let a link point to `target` (None: remove it), and return where it did.

    The link is a convenience: a file system without links, or a folder of that name, does not stop a run.
    """
    before = _target(link)
    with contextlib.suppress(OSError):
        link.unlink(missing_ok=True)
        if target is not None:
            link.symlink_to(target)
    return before


def write_unbegun(error: HilError, folder: Path, *, rig: str | None, scene: str | None, seed: int | None) -> None:
    """Write the run.json of a run that never began because of an error, over that of an earlier run.

    The report of that one is removed; its recordings stay, since the refused run may have been told to read them.
    Raises RecordingError if that is not possible, or another run writes into the folder.
    """
    kind = "ConfigError" if isinstance(error, ConfigError) else type(error).__name__
    run = _unbegun(kind, str(error), rig=rig, scene=scene, seed=seed)
    with run_folder(folder):
        if _is_of_a_run(folder):
            with contextlib.suppress(OSError):
                (folder / PAGE_NAME).unlink(missing_ok=True)
        write_run_json(folder / RUN_JSON_NAME, run)


def guard_unbegun(folder: Path, *, rig: str | None, scene: str | None, seed: int | None) -> None:
    """Let a native library that crashes before the run begins leave its run.json."""
    crashed, no_memory = (
        run_json_text(_unbegun(kind, text, rig=rig, scene=scene, seed=seed))
        for kind, text in (("Crashed", CRASHED), (OutOfMemory.__name__, OUT_OF_MEMORY))
    )
    guard_file(str((folder / RUN_JSON_NAME).absolute()), crashed, no_memory)


def _unbegun(kind: str, message: str, *, rig: str | None, scene: str | None, seed: int | None) -> dict[str, Any]:
    unmeasured = {"p50": None, "p99": None, "max": None}
    mission = {"completed": False, "waypoints": 0, "reached": 0, "max_cross_track_m": None, "final_error_m": None}
    return {
        "schema": 1,
        "status": "ERROR",
        "error": {"type": kind, "message": message},
        "digest": "0" * 32,
        "deterministic": False,
        "seed": seed or 0,
        "rig": rig or "",
        "scene": scene or "",
        "sim_s": 0.0,
        "wall_s": 0.0,
        "realtime_factor": 0.0,
        "mission": mission,
        "autopilot": {"kind": "", "steps": 0, "late": 0, "rtt_us": unmeasured},
        "sensors": {},
        "skipped": [],
    }
