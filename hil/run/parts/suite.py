"""Runs another project's test suite with the bench as its simulator, and judges by its exit status.

The suite starts its own SITL, which connects to the bench (`autopilot.start: false`). The bench starts the suite before
it waits for the autopilot, and ends when the suite does. The suite's environment names the bench's facts:

HIL_MODEL      `--model` of ArduPilot
HIL_HOME       latitude, longitude [deg], altitude [m MSL] and heading [deg from north] of the start, with commas
HIL_DEFAULTS   file with ArduPilot's parameters for this vehicle and tick, to be loaded after the suite's own

The suite alone decides: some of its tests crash, drift off or land hard on purpose. Limits and crashes are judged only
if the bench sets them itself. A suite may not notice a hard impact, though, so each one is a warning.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, field_validator

from firmware_bridge.links.ardupilot.home_check import home_text
from firmware_bridge.links.child_process import ChildProcess
from hil.config import Bench
from hil.config.schema import Crash
from hil.run.autopilot import installation_of
from hil.run.part import FlightEnded, Part, RunContext
from hil.run.verdict.verdict import Row, Verdict
from signals.documents.validate import Section
from signals.errors import LinkClosed
from signals.samples import TruthState
from signals.time import NS_PER_S

JUDGES_ALONE = True  # see hil.config.checks.part_settings
LOG_NAME = "test_suite.log"
_IMPACT_MPS = Crash().impact_mps or math.inf  # where a crash would be judged
_STEP_M = 1.0  # longer than any tick's way: the vehicle was put back to its start


class Settings(Section):
    command: Annotated[tuple[str, ...], Field(min_length=1)]  # program and arguments
    folder: str = "."  # in which it runs

    @field_validator("folder")
    @classmethod
    def _is_folder(cls, folder: str) -> str:
        if not os.path.isdir(os.path.expanduser(folder)):
            raise ValueError(f"names a folder that does not exist: {folder}")
        return folder


class SuitePart(Part):
    name = "test_suite"

    def __init__(self, bench: Bench, settings: Settings) -> None:
        self._bench, self._settings = bench, settings
        self._process: ChildProcess | None = None
        self._flies = self._ended = False
        self._end_text = ""
        self._status: int | None = None
        self._previous: TruthState | None = None
        self._impacts: list[dict[str, float]] = []

    def open(self, run: RunContext) -> None:
        self._run = run
        bench, out = self._bench, run.out.resolve()
        installation = installation_of(bench, run.physics.state)
        own_env = bench.config.autopilot.profile.suite_env
        env = {"HIL_HOME": home_text(installation.home)} | dict(own_env(installation, out) if own_env else {})
        self._process = ChildProcess(
            list(self._settings.command),
            stderr_path=out / LOG_NAME,
            cwd=Path(os.path.expanduser(self._settings.folder)),
            env=env,
            log_output=True,
            own_group=True,
        )
        self._process.start()

    def begin(self, run: RunContext) -> None:  # noqa: ARG002
        self._flies = True

    def observers(self) -> list[Callable[[TruthState], None]]:
        return [self._watch] if self._bench.config.crash is None else []

    def _watch(self, truth: TruthState) -> None:
        """Warn of an impact that nobody judges."""
        previous, self._previous = self._previous, truth
        if previous is None or previous.in_contact or not truth.in_contact:
            return
        speed_mps = math.hypot(*previous.v_WB_W)
        if speed_mps > _IMPACT_MPS and math.dist(previous.p_WB, truth.p_WB) < _STEP_M:
            t_s = truth.t_ns / NS_PER_S
            self._impacts.append({"t_s": t_s, "speed_mps": speed_mps})
            self._run.say("warning", f"impact at {speed_mps:.1f} m/s, {t_s:.2f} s after the start: the suite judges it")

    def ended(self) -> bool:
        return self._has_ended()

    def link_waits(self) -> None:
        """End a flight whose autopilot has gone with its suite."""
        if not self._has_ended():
            return
        if not self._flies:
            raise LinkClosed("test suite", f"has ended before an autopilot came: {self._end_text}", cause="crashed")
        raise FlightEnded(f"the test suite has ended with exit status {self._status}")

    def _has_ended(self) -> bool:
        process = self._process
        if process is not None and not self._ended and not process.running():
            self._ended = True
            self._status = process.exit_status
            self._end_text = process.describe_end()
        return self._ended

    def close(self) -> None:
        self._has_ended()
        if self._process is not None:
            self._process.close()

    def repeatable(self) -> bool:
        return False

    def phase(self) -> str:
        return "test suite"

    def verdict(self) -> Verdict:
        ok = self._status == 0
        reasons = []
        if not ok:
            how = self._end_text or "it had not ended when the run was stopped or reached duration_s"
            reasons = [f"the test suite failed: {how} ({LOG_NAME})"]
        value = None if self._status is None else float(self._status)
        return Verdict([Row("suite_exit_status", value, 0.0, "", ok)], reasons)

    def run_keys(self) -> dict[str, Any]:
        suite = {"command": list(self._settings.command), "exit_status": self._status, "impacts": self._impacts}
        return {"test_suite": suite}


def make(bench: Bench, settings: Settings) -> Part:
    return SuitePart(bench, settings)
