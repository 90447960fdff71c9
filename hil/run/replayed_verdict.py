"""The verdict of the run that a replay repeats, carried into the replay's own run.json.

A replay repeats what the recording and the trace contain. Its verdict is computed anew, so a reason for a FAIL that
came from elsewhere would be missing in it, and an error of the bench, such as a full disk, does not happen again. The
replay's run.json therefore has the key `replays` with the verdict of the recorded run. An identical replay never passes
where the recorded run failed, and no replay passes where it ended as ERROR: a run without a verdict cannot be repeated
into a PASS.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hil.run.report.page import amend_page
from hil.run.report.run_json import write_run_json
from hil.run_files import PAGE_NAME, RUN_JSON_NAME
from signals.errors import file_errors

_NOT_REPEATED = "in the run that this one replays, and not repeated"


def carry_verdict(recorded_dir: Path, fresh_dir: Path, *, identical: bool) -> str:
    """Write the verdict of the recorded run into run.json of the fresh one, and return it in words.

    Empty if the recorded run passed, or a folder has no run.json. Raises RecordingError.
    """
    recorded, fresh = read_run(recorded_dir), read_run(fresh_dir)
    if not recorded or not fresh:
        return ""
    status, error, reasons = recorded.get("status"), recorded.get("error"), _reasons(recorded)
    replays = {"status": status, "error": error, "reasons": reasons}
    causes = [f"{error.get('type')}: {error.get('message')}"] if isinstance(error, dict) else reasons
    if fresh.get("status") == "PASS" and (status == "ERROR" or (identical and status == "FAIL")):
        words = "the run that this one replays ended as ERROR" if status == "ERROR" else _NOT_REPEATED
        carried = [f"{words}: {cause}" for cause in causes or ["no cause recorded"]]
        fresh["status"], fresh["verdict"] = "FAIL", {**fresh.get("verdict", {}), "reasons": carried}
        with file_errors(fresh_dir / PAGE_NAME):
            amend_page(fresh_dir, fresh)
    write_run_json(fresh_dir / RUN_JSON_NAME, {**fresh, "replays": replays})
    if status == "PASS":
        return ""
    return f"the run that was replayed: {status}" + (f" ({'; '.join(causes)})" if causes else "")


def read_run(folder: Path) -> dict[str, Any]:
    """Return the content of a folder's run.json; empty if it has none that can be read."""
    try:
        run = json.loads((folder / RUN_JSON_NAME).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return run if isinstance(run, dict) else {}


def _reasons(run: dict[str, Any]) -> list[str]:
    verdict = run.get("verdict")
    reasons = verdict.get("reasons") if isinstance(verdict, dict) else None
    return [str(reason) for reason in reasons] if isinstance(reasons, list) else []
