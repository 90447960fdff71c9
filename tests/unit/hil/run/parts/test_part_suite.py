"""The part `test_suite`, whose program starts an autopilot of its own, and runs that end when the user stops them."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from hil.run.bench_run import run_bench
from hil.run.part import Part
from tests.worlds.bench_files import elsewhere, load
from tests.worlds.bench_process import free_instance

__all__ = ["elsewhere"]

# A SITL of 100 steps behind the JSON link, which then ends with the status in its argument.
SUITE = """
import os, socket, struct, sys
home, model, defaults = os.environ["HIL_HOME"], os.environ["HIL_MODEL"], open(os.environ["HIL_DEFAULTS"]).read()
assert home.endswith(",270.0000") and model == "JSON:127.0.0.1" and "MOT_THST_HOVER" in defaults, (home, model)
link, bench = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), ("127.0.0.1", 9002 + 10 * int(sys.argv[2]))
link.settimeout(1.0)  # the bench listens only after it has started the suite: SITL, too, sends its first packet again
for count in range(100):
    while True:
        link.sendto(struct.pack("<HHI16H", 18458, 400, count, *(16 * [1000])), bench)
        try:
            link.recv(4096)
            break
        except TimeoutError:
            if count:
                raise
    link.settimeout(300.0)
print("the last words")
sys.exit(int(sys.argv[1]))
"""
# The motors at full thrust for 0.7 s, then off: the vehicle falls from some metres.
HARD_LANDING = SUITE.replace("range(100)", "range(1200)").replace(
    "16 * [1000]", "16 * [2000 if 4 < count < 284 else 1000]"
)
BENCH = """rig: ardupilot_sitl
mission: null
start: {yaw_deg: 180}
autopilot: {start: false, instance: %d, mavlink_port: none, on_restart: reset}
record: {mcap: false, tlog: false, report: false}
parts:
  test_suite:
    command: ["%s", suite.py, "%s", "%d"]
"""


def bench(status: int) -> str:
    """Return a bench whose suite ends with this status."""
    instance = free_instance()
    return BENCH % (instance, sys.executable, status, instance)


def run_suite(status: int, out: Path, suite: str = SUITE) -> dict[str, Any]:
    Path("suite.py").write_text(suite, encoding="utf-8")
    return run_bench(load(bench(status)), out, quiet=True).run


@pytest.mark.parametrize("status", [0, 3])
def test_run_ends_with_the_suite_and_is_judged_by_its_status(status: int, tmp_path: Path) -> None:
    run = run_suite(status, tmp_path / "out")
    assert run["error"] is None
    assert run["status"] == ("FAIL" if status else "PASS")
    assert run["test_suite"]["exit_status"] == status
    assert run["sim_s"] == pytest.approx(0.25, abs=0.02)
    assert not run["deterministic"]
    (row,) = [row for row in run["verdict"]["rows"] if row["name"] == "suite_exit_status"]
    assert (row["value"], row["ok"]) == (float(status), not status)
    if status:
        (reason,) = run["verdict"]["reasons"]
        assert "exit status 3" in reason
        assert "the last words" in reason
        assert "test_suite.log" in reason
    assert "the last words" in (tmp_path / "out" / "test_suite.log").read_text()


def test_a_suite_that_ends_before_its_autopilot_came_is_named_at_once(tmp_path: Path) -> None:
    run = run_suite(1, tmp_path / "out", "raise SystemExit('no module named MAVProxy')")
    assert run["error"]["type"] == "LinkClosed"
    assert "ended before an autopilot came" in run["error"]["message"]
    assert "no module named MAVProxy" in run["error"]["message"]
    assert run["wall_s"] < 20.0


def test_a_suite_that_passes_decides_alone_and_a_hard_landing_is_a_warning(tmp_path: Path) -> None:
    run = run_suite(0, tmp_path / "out", HARD_LANDING)
    assert run["mission"]["landing_speed_mps"] > 6.0
    assert (run["status"], run["verdict"]["reasons"]) == ("PASS", [])
    assert run["test_suite"]["impacts"][0]["speed_mps"] == pytest.approx(run["mission"]["landing_speed_mps"], rel=0.01)
    assert all(row["limit"] is None for row in run["verdict"]["rows"] if row["name"] != "suite_exit_status")


def test_limits_and_crashes_that_the_bench_sets_itself_are_judged(tmp_path: Path) -> None:
    Path("suite.py").write_text(HARD_LANDING, encoding="utf-8")
    text = bench(0) + "limits: {landing_speed_mps: 2.5}\n"
    (reason,) = run_bench(load(text), tmp_path / "out", quiet=True).run["verdict"]["reasons"]
    assert "more than the 2.5 m/s allowed" in reason
    config = load(text + "crash: {tilt_deg: 80}\n").config
    assert config.crash is not None
    assert config.limits.final_error_m is None
    assert load(bench(0)).config.crash is None


class Stop(Part):
    """Presses Ctrl-C in tick 40."""

    name = "stop"

    def after_tick(self, tick: int) -> None:
        if tick == 40:
            raise KeyboardInterrupt("stopped by SIGTERM")


@pytest.mark.parametrize("mission", ["null", "rigs/missions/rectangle.plan"])
def test_a_run_without_a_mission_is_ended_as_a_success(mission: str, tmp_path: Path) -> None:
    lines = f"rig: mock\nmission: {mission}\nautopilot: {{transport: loopback}}\n"
    lines += "record: {mcap: false, tlog: false, report: false}\n"
    run = run_bench(load(lines), tmp_path / "out", quiet=True, more=[Stop()]).run
    assert run["sim_s"] == pytest.approx(0.16, abs=0.01)
    if mission == "null":
        assert (run["status"], run["error"]) == ("PASS", None)
        assert run["deterministic"] is False
    else:
        assert (run["status"], run["error"]["type"]) == ("ERROR", "Interrupted")
