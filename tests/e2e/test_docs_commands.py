"""The commands and mission scripts of the book run as printed; some flights are cut short."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from hil.config import load_bench
from hil.run.bench_run import run_bench
from tests.worlds.bench_process import hil
from tests.worlds.docs_blocks import PAGES, ROOT, Block, blocks
from tests.worlds.docs_commands import make_folder, why_not_run

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

# Arguments added to a command, so that it ends soon: those of the first beginning that fits.
SHORTER = {
    ("hil", "run", "rigs/benches/radar_away.yaml"): ["--set", "record.report=false"],
    # The parameters, which this bench tells of, take longer to be read than 3 s.
    ("hil", "run", "rigs/benches/params_file.yaml"): ["--set", "pace=null", "--set", "record.report=false"],
    ("hil", "run"): ["--set", "duration_s=3", "--set", "pace=null", "--set", "record.report=false"],
    ("hil", "dataset"): ["--frames", "2", "--workers", "1"],
}
# Two runs with a companion at its default port cannot be at a time.
PORT = {"companion.md", "explore.md", "people-search.md"}
# A block of these pages is about a run that was flown before it.
BEFORE = {
    "recording.md": ["run", "--set", "duration_s=24", "--set", "sensors.front={preset: camera_320x240, rate_hz: 5}"],
    "ci.md": ["run", "--set", "duration_s=2"],
    "start.md": ["run", "--set", "duration_s=2"],
}
RUNNABLE = [p for p in PAGES if any(not why_not_run(words) for b in blocks(p, "sh") for words in b.commands())]


@pytest.mark.parametrize("page", RUNNABLE, ids=lambda page: page.name)
def test_commands_of_a_page_run(page: Path, tmp_path: Path) -> None:
    make_folder(tmp_path)
    for block in blocks(page, "sh"):
        if page.name in BEFORE:
            assert hil(*BEFORE[page.name], cwd=tmp_path).returncode in (0, 1)
        for line, words in zip(block.lines(), block.commands(), strict=True):
            if why_not_run(words):
                continue
            if words[0] == "hil":
                more = next((more for start, more in SHORTER.items() if tuple(words[: len(start)]) == start), [])
                more = [*more, "--set", "companion.port=0"] if page.name in PORT else more
                done = hil(*words[1:], *more, cwd=tmp_path, timeout=600)
            else:
                path = {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
                shell: dict[str, Any] = {
                    "cwd": tmp_path,
                    "env": os.environ | path,
                    "capture_output": True,
                    "text": True,
                }
                done = subprocess.run(["bash", "-c", line], **shell, check=False)
            cut_short = words[1] in ("run", "campaign")  # a flight that ends early is a FAIL
            shown = f"{block.place}: {' '.join(words)}\n{done.stdout}{done.stderr}"
            assert done.returncode in ((0, 1) if cut_short else (0,)), shown
            assert "Traceback" not in done.stderr, shown


def test_the_flight_with_looser_limits_passes_in_full(tmp_path: Path) -> None:
    make_folder(tmp_path)
    commands = [words for block in blocks(ROOT / "docs/start.md", "sh") for words in block.commands()]
    (words,) = [words for words in commands if "sensors.gps.preset=m8n" in words]
    done = hil(*words[1:], "--set", "record.report=false", cwd=tmp_path, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr


SCRIPTS = blocks(ROOT / "docs/mission-scripts.md", "yaml")


@pytest.mark.parametrize("block", SCRIPTS, ids=lambda block: block.place)
def test_a_mission_script_of_the_book_flies(block: Block, tmp_path: Path) -> None:
    if "on PX4" in block.text:
        pytest.skip("needs PX4: the mock has another failsafe")
    make_folder(tmp_path)
    file = tmp_path / "missions/example.yaml"
    file.write_text(block.text)
    settings = ["autopilot.transport=loopback", "record.report=false", "record.mcap=false", "record.tlog=false"]
    outcome = run_bench(load_bench(mission=str(file), settings=settings), tmp_path / "out", quiet=True)
    assert outcome.status == "PASS", (outcome.run["error"], outcome.run["verdict"]["reasons"])
