"""The result of a run on the console: the timing stands with the verdict that it may explain."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from hil.apps.fly.result_table import print_result

GAPS = {"level": "warning", "text": "the actuator commands stopped 26 times for more than 20 ms"}
LATE = {"level": "error", "text": "2.6 % of the samples were more than 20 ms late [sic]"}


def run(status: str, findings: list[dict[str, str]] | None) -> dict[str, Any]:
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
        "autopilot": {} if findings is None else {"realtime": {"findings": findings}},
    }


def printed(folder: Path, result: dict[str, Any]) -> str:
    out = io.StringIO()
    console = Console(file=out, width=300)
    print_result(result, folder, 61.0, console, console)
    return out.getvalue()


def test_findings_stand_under_a_fail_as_its_possible_cause(tmp_path: Path) -> None:
    text = printed(tmp_path, run("FAIL", [LATE, GAPS]))
    lines = [line.strip() for line in text.splitlines()]
    reason = lines.index("altitude_error_m is 1.76 m")
    assert lines[reason + 1] == "The timing may be the cause:"
    assert lines[reason + 2] == f"error: {LATE['text']}"
    assert lines[reason + 3] == f"warning: {GAPS['text']}"


def test_findings_stand_with_a_pass_too(tmp_path: Path) -> None:
    text = printed(tmp_path, run("PASS", [GAPS]))
    assert "The timing was not good:" in text
    assert GAPS["text"] in text


@pytest.mark.parametrize("findings", [None, []])
def test_good_timing_is_not_mentioned(tmp_path: Path, findings: list[dict[str, str]] | None) -> None:
    assert "The timing" not in printed(tmp_path, run("FAIL", findings))


def test_only_files_that_exist_are_named(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text("{}")
    assert "(run.json; 61.0 s in all)" in printed(tmp_path, run("PASS", None))
    (tmp_path / "report.html").write_text("")
    assert "(report.html, run.json; 61.0 s in all)" in printed(tmp_path, run("PASS", None))
