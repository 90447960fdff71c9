"""The folder of a run, and the run.json of a run that never began."""

from __future__ import annotations

import contextlib
import re
import time
from pathlib import Path

from hil.run.report.run_json import write_run_json
from signals.errors import ConfigError, RecordingError


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


def write_config_error(
    error: ConfigError, folder: Path, *, rig: str | None, scene: str | None, seed: int | None
) -> None:
    """Write the run.json of a run that never began because of a ConfigError, so that callers always find one."""
    unmeasured = {"p50": None, "p99": None, "max": None}
    run = {
        "schema": 1,
        "status": "ERROR",
        "error": {"type": "ConfigError", "message": str(error)},
        "digest": "0" * 32,
        "deterministic": False,
        "seed": seed or 0,
        "rig": rig or "",
        "scene": scene or "",
        "sim_s": 0.0,
        "wall_s": 0.0,
        "realtime_factor": 0.0,
        "mission": {
            "completed": False,
            "waypoints": 0,
            "reached": 0,
            "max_cross_track_m": None,
            "final_error_m": None,
        },
        "autopilot": {"kind": "", "steps": 0, "late": 0, "rtt_us": unmeasured},
        "sensors": {},
        "skipped": [],
    }
    write_run_json(folder / "run.json", run)
