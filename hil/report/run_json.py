"""run.json: the machine-readable result of a run, schema 1.

Fixed keys are listed in `SCHEMA`; a run may add others. Numbers are finite: what could not be measured is null.
"""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hil.signals.errors import RecordingError

_NUMBER = (int, float, type(None))  # null: not measured

# Nested key -> allowed types. "*" stands for every key of a mapping whose keys are names.
SCHEMA: dict[str, Any] = {
    "schema": (int,),
    "status": (str,),
    "error": (dict, type(None)),
    "digest": (str,),
    "deterministic": (bool,),
    "seed": (int,),
    "rig": (str,),
    "scene": (str,),
    "sim_s": _NUMBER,
    "wall_s": _NUMBER,
    "realtime_factor": _NUMBER,
    "mission": {
        "completed": (bool,),
        "waypoints": (int,),
        "reached": (int,),
        "max_cross_track_m": _NUMBER,
        "final_error_m": _NUMBER,
    },
    "autopilot": {
        "kind": (str,),
        "steps": (int,),
        "late": (int,),
        "rtt_us": {"p50": _NUMBER, "p99": _NUMBER, "max": _NUMBER},
    },
    "sensors": {"*": {"samples": (int,), "skipped": (int,), "ms": {"p50": _NUMBER, "p99": _NUMBER}}},
    "skipped": (list,),
}
STATUSES = ("PASS", "FAIL", "ERROR")


def finite(value: Any) -> Any:
    """The value with NaN and infinities replaced by None, at any depth; tuples become lists.

    numpy scalars become Python numbers. Raises TypeError for what JSON cannot hold.
    """
    if isinstance(value, bool) or value is None or isinstance(value, (int, str)):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(k): finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(v) for v in value]
    if hasattr(value, "item") and getattr(value, "ndim", 1) == 0:
        return finite(value.item())
    raise TypeError(f"run.json cannot hold a {type(value).__name__}: {value!r}")


def write_run_json(path: Path, run: Mapping[str, Any]) -> None:
    """Write `run` to `path` at once: a reader sees the old file or the whole new one, whatever happens.

    Keys keep their order. Raises RecordingError where the file cannot be written.
    """
    text = json.dumps(finite(run), indent=2, allow_nan=False) + "\n"
    temporary: str | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)  # mkstemp makes it private
        os.replace(temporary, path)
    except OSError as error:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
        raise RecordingError(f"{path}: cannot be written ({error.strerror or error})") from error


def validate_run_json(run: Any) -> list[str]:
    """Everything in which `run` (as read from JSON) departs from the schema; empty when it conforms."""
    if not isinstance(run, dict):
        return ["the file is no JSON object"]
    problems = _check(run, SCHEMA, "")
    problems += _check_finite(run, "")
    if run.get("schema") != 1:
        problems.append(f"schema: must be 1, not {run.get('schema')!r}")
    if run.get("status") not in STATUSES:
        problems.append(f"status: must be one of {', '.join(STATUSES)}, not {run.get('status')!r}")
    error = run.get("error")
    if isinstance(error, dict):
        problems += _check(error, {"type": (str,), "message": (str,)}, "error.")
    if (run.get("status") == "ERROR") != (error is not None):
        problems.append("error: must be there with status ERROR and null without")
    digest = run.get("digest")
    if isinstance(digest, str) and (not digest or any(c not in "0123456789abcdef" for c in digest)):
        problems.append(f"digest: must be lower-case hexadecimal, not {digest!r}")
    return problems


def _check(value: Mapping[str, Any], schema: Mapping[str, Any], where: str) -> list[str]:
    problems: list[str] = []
    wildcard = schema.get("*")
    items = dict.fromkeys(value, wildcard) if wildcard else schema
    for key, kind in items.items():
        path = where + key
        if key not in value:
            problems.append(f"{path}: missing")
        elif isinstance(kind, dict):
            if isinstance(value[key], dict):
                problems += _check(value[key], kind, path + ".")
            else:
                problems.append(f"{path}: must be an object, not {value[key]!r}")
        elif not isinstance(value[key], kind) or (isinstance(value[key], bool) and bool not in kind):
            names = " or ".join("null" if k is type(None) else k.__name__ for k in kind)
            problems.append(f"{path}: must be {names}, not {value[key]!r}")
    return problems


def _check_finite(value: Any, where: str) -> list[str]:
    if isinstance(value, float) and not math.isfinite(value):
        return [f"{where}: {value} is not a finite number"]
    if isinstance(value, dict):
        return [p for k, v in value.items() for p in _check_finite(v, f"{where}.{k}" if where else str(k))]
    if isinstance(value, list):
        return [p for i, v in enumerate(value) for p in _check_finite(v, f"{where}[{i}]")]
    return []
