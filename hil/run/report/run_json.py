"""run.json: the machine-readable result of a run, schema 1.

Numbers are finite: a value that was not measured is null.
"""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from signals.errors import RecordingError


def finite(value: Any) -> Any:
    """Return the value with NaN and infinities replaced by None, at any depth.

    Tuples become lists, numpy scalars Python numbers. Raises TypeError for types that JSON does not have.
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


def run_json_text(run: Mapping[str, Any]) -> str:
    """Return the content of a run.json. Keys keep their order."""
    return json.dumps(finite(run), indent=2, allow_nan=False) + "\n"


def write_run_json(path: Path, run: Mapping[str, Any]) -> None:
    """Write `run` to `path` atomically: a reader sees the old file or the whole new one.

    Raises RecordingError if the file cannot be written.
    """
    text = run_json_text(run)
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
