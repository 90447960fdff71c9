"""The result of a run on the console: warnings stand with the verdict that they may explain."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from rich.console import Console

from hil.apps.fly.result_table import print_result

GAPS = {"t_s": 60.0, "level": "warning", "text": "the actuator commands stopped 26 times for more than 20 ms"}
LATE = {"t_s": 60.0, "level": "error", "text": "2.6 % of the samples were more than 20 ms late [sic]"}


def run(status: str, warnings: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "status": status,
        "error": None,
        "deterministic": False,
        "digest": "0" * 32,
        "sim_s": 60.0,
        "wall_s": 60.0,
        "realtime_factor": 1.0,
        "mission": {"waypoints": 0, "reached": 0},
        "verdict": {"reasons": ["altitude_error_m is 1.76 m"] if status == "FAIL" else [], "rows": []},
        "warnings": warnings,
    }


def printed(folder: Path, result: dict[str, Any]) -> str:
    out = io.StringIO()
    console = Console(file=out, width=300)
    print_result(result, folder, 61.0, console, console)
    return out.getvalue()


def test_warnings_stand_under_a_fail_as_its_possible_cause(tmp_path: Path) -> None:
    text = printed(tmp_path, run("FAIL", [LATE, GAPS]))
    lines = [line.strip() for line in text.splitlines()]
    reason = lines.index("altitude_error_m is 1.76 m")
    assert lines[reason + 1] == f"error: {LATE['text']} (at 60.0 s)"
    assert lines[reason + 2] == f"warning: {GAPS['text']} (at 60.0 s)"


def test_warnings_stand_with_a_pass_too_each_text_once(tmp_path: Path) -> None:
    rows = [
        GAPS,
        GAPS,
        GAPS | {"vehicle": "lead"},
        *({"t_s": n, "level": "warning", "text": f"{n}"} for n in range(20)),
    ]
    text = printed(tmp_path, run("PASS", rows))
    assert f"warning: {GAPS['text']} (at 60.0 s, 2 times)" in text
    assert f"warning: lead: {GAPS['text']} (at 60.0 s)" in text
    assert "and 10 more warnings, in run.json" in text


def test_a_failsafe_that_is_no_reason_is_told_too(tmp_path: Path) -> None:
    failsafe = {"line": "PX4: Failsafe activated at 50.2 s, mode LAND", "expected": True}
    assert f"{failsafe['line']} (expected)" in printed(tmp_path, run("PASS", []) | {"failsafes": [failsafe]})
    lost = run("ERROR", []) | {"failsafes": [failsafe | {"expected": False}]}
    assert f"  {failsafe['line']}\n" in printed(tmp_path, lost)
    failed = run("FAIL", []) | {"failsafes": [failsafe | {"expected": False}]}
    assert failsafe["line"] not in printed(tmp_path, failed)  # it is among the reasons


def test_only_files_that_exist_are_named(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text("{}")
    assert "(run.json; 61.0 s in all)" in printed(tmp_path, run("PASS", []))
    (tmp_path / "report.html").write_text("")
    assert "(report.html, run.json; 61.0 s in all)" in printed(tmp_path, run("PASS", []))
