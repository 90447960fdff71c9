"""The companion link in the report page and the console summary."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hil.run.companion.files import FrameTimes
from hil.run.report.companion_section import companion_rows, console_rows, section
from hil.run.report.page import Report, write_page
from tests.worlds.run_json_schema import RUN

QUIET = {"p50": None, "p99": None, "max": None}
COMPANION = {
    "time": "latency_true",
    "arrangement": "one_port",
    "rate_hz": 12.5,
    "frames": 900,
    "topics": ["truth"],
    "clients": {
        "<slam>": {
            "control": True,
            "frames": 890,
            "dropped": 10,
            "t1_ms": {"p50": 3.25, "p99": 4.0, "max": 5.0},
            "render_ms": {"p50": 3.0, "p99": 3.5, "max": 4.0},
            "link_ms": {"p50": 0.25, "p99": 0.5, "max": 1.0},
            "t2_ms": {"p50": 41.0, "p99": 55.5, "max": 203.0},
            "t3_ms": {"p50": 1.5, "p99": 2.0, "max": 2.5},
        },
        "echo": {"frames": 900, "dropped": 0, "t1_ms": {"p50": 3.25, "p99": 4.0, "max": 5.0}, "t3_ms": QUIET},
    },
    "refused": ["topic: no topic matches 'fornt/*'"],
}


def _times(rows: int) -> FrameTimes:
    ramp = np.linspace(0.0, 10.0, rows)
    t3_ms = ramp.copy()
    t3_ms[::3] = np.nan
    return FrameTimes(ramp, ramp + 1.0, ramp * 0.1, ramp * 1.1 + 1.0, ramp + 40.0, t3_ms)


def _page(out: Path, run: dict, timing: dict[str, FrameTimes] | None = None) -> str:
    sections = [section(run["companion"])] if "companion" in run else []
    from hil.run.report.pictures import companion_pictures  # matplotlib

    return write_page(out, run, [], Report(companion_pictures(out, timing or {}), sections)).read_text()


def test_the_page_tells_of_every_client(tmp_path: Path) -> None:
    text = _page(tmp_path, RUN | {"companion": COMPANION}, {"<slam>": _times(300), "echo": _times(1)})
    assert "900 frames at 12.5 Hz, latency_true, one port." in text
    assert "&lt;slam&gt; (in control)" in text
    assert "41.00 / 55.50 / 203.00" in text
    assert "no topic matches &#x27;fornt/*&#x27;" in text
    assert (tmp_path / "companion.png").stat().st_size > 20_000
    assert "Times of every frame" in text


def test_the_page_of_a_repetition_has_no_times(tmp_path: Path) -> None:
    traced = COMPANION | {"arrangement": "trace", "clients": {"cut": {"control": True, "frames": 5, "dropped": 0}}}
    text = _page(tmp_path, RUN | {"companion": traced})
    assert "latency_true, trace." in text
    assert not (tmp_path / "companion.png").exists()
    assert "No client connected" in _page(tmp_path, RUN | {"companion": COMPANION | {"clients": {}}})
    assert "Companions" not in _page(tmp_path, RUN)


def test_missing_times_are_drawn_too(tmp_path: Path) -> None:
    nothing = np.full(3, np.nan)
    _page(tmp_path, RUN | {"companion": COMPANION}, {"a": FrameTimes(np.arange(3.0), *[nothing] * 5)})
    assert (tmp_path / "companion.png").exists()


def test_rows() -> None:
    slam, echo = companion_rows(COMPANION)
    assert slam[1:3] == ("890", "10")
    assert slam[6] == "41.00 / 55.50 / 203.00"
    assert echo[-1] == "\N{EN DASH}"
    rows = console_rows(COMPANION)
    assert rows[1:3] == [
        ("  <slam>", "890 frames, 10 dropped"),
        ("", "t1 3.25 (p99 4.00), t2 41.00 (p99 55.50), t3 1.50 (p99 2.00) ms"),
    ]
    assert rows[4] == ("", "t1 3.25 (p99 4.00) ms")
    assert max(len(text) for _, text in rows) < 70
