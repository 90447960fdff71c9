"""The folder of a run, and the run.json of a run that never began."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import stat
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from hil.run.report.run_json import run_json_text, write_run_json
from signals._kernel import guard_file
from signals.errors import ConfigError, HilError, OutOfMemory, RecordingError
from signals.shortage import CRASHED, OUT_OF_MEMORY

# Files and folders that a run writes. A link in their place is removed first: writing would change what it points to.
_SUFFIXES = (
    *(".csv", ".html", ".json", ".jsonl", ".log", ".mcap", ".parm", ".part", ".plan", ".png", ".tlog", ".txt"),
    *(".waypoints", ".yaml", ".yml", ".xml", ".obj", ".stl", ".msh", ".bin", ".hdr", ".skn"),
    *(".glb", ".osm", ".pbf", ".tif"),
)
_FOLDERS = frozenset({"autopilot", "calibration", "scene_map"})
_RESULTS = ("run.json", "report.html", "bench.yaml")  # what makes a folder one of a run


@contextlib.contextmanager
def locked_folder(out: Path) -> Iterator[None]:
    """Make a folder for results and hold its lock, which the kernel releases when the process ends (flock).

    Raises RecordingError if the folder cannot be used or another process writes into it.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        folder = os.open(out, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise RecordingError(f"{out}: cannot be used as a folder for results ({error.strerror or error})") from error
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
        earlier = json.loads((out / "run.json").read_text())["vehicles"]
    except (OSError, ValueError, LookupError, TypeError):
        return  # no earlier run, or one with a single vehicle
    for name in earlier if isinstance(earlier, dict) else ():
        if name not in names and Path(name).name == name and not (out / name).is_symlink():
            for file in _RESULTS:
                with contextlib.suppress(OSError):
                    (out / name / file).unlink(missing_ok=True)


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


def new_run_dir(out: Path | None, rig: str, runs: Path = Path("runs")) -> Path:
    """Return `out`, or a new folder in `runs` to which `runs/latest` then points. Raises RecordingError."""
    if out is not None:
        return out
    name = re.sub(r"[^A-Za-z0-9_.-]+", "-", Path(rig).stem) or "run"
    stem = f"{time.strftime('%Y%m%d-%H%M%S')}-{name[:80]}"
    try:
        runs.mkdir(parents=True, exist_ok=True)
        for n in range(1000):
            folder = runs / (stem if n == 0 else f"{stem}-{n}")
            try:
                folder.mkdir()
            except FileExistsError:
                continue
            latest = runs / "latest"
            # The link is a convenience: a file system without links, or a folder of that name, does not stop a run.
            with contextlib.suppress(OSError):
                latest.unlink(missing_ok=True)
                latest.symlink_to(folder.name)
            return folder
    except OSError as error:
        raise RecordingError(
            f"{runs}: the folder of the run cannot be created ({error.strerror or error}); name another with --out"
        ) from error
    raise RecordingError(f"{runs}: all thousand names of this second are taken; name a folder with --out")


def write_unbegun(error: HilError, folder: Path, *, rig: str | None, scene: str | None, seed: int | None) -> None:
    """Write the run.json of a run that never began because of an error, so that callers always find one.

    Raises RecordingError if that is not possible, or another run writes into the folder.
    """
    kind = "ConfigError" if isinstance(error, ConfigError) else type(error).__name__
    run = _unbegun(kind, str(error), rig=rig, scene=scene, seed=seed)
    with run_folder(folder):
        write_run_json(folder / "run.json", run)


def guard_unbegun(folder: Path, *, rig: str | None, scene: str | None, seed: int | None) -> None:
    """Let a native library that crashes before the run begins leave its run.json."""
    crashed, no_memory = (
        run_json_text(_unbegun(kind, text, rig=rig, scene=scene, seed=seed))
        for kind, text in (("Crashed", CRASHED), (OutOfMemory.__name__, OUT_OF_MEMORY))
    )
    guard_file(str((folder / "run.json").absolute()), crashed, no_memory)


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
