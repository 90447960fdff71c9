"""Measurements that a mission script declares, taken from ground truth, and the verdict on them.

    max_tilt_deg        greatest angle between the body's z axis and the vertical
    max_rate_degps      greatest angular speed
    max_speed_mps       greatest speed
    max_climb_mps       greatest upward speed
    max_sink_mps        greatest downward speed
    min_altitude_m      least height above where the vehicle stood at the start
    max_altitude_m      greatest height above it
    max_distance_m      greatest horizontal distance from it
    hover_drift_m       greatest horizontal distance from where it was at from_s
    height_drift_m      greatest difference in height from there
    flight_time_s       from the first lift-off to the last touch-down
    time_to_complete_s  from the start of the run to the last touch-down

All but the last two look at the ticks from `from_s` to `to_s`, both included; without them at the whole run. What was
never measured (the run ended before, the vehicle never touched down) fails where it has a limit, and so does NaN.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

from firmware_bridge.ground_station.actions import Record
from hil.config.schema import Limits
from hil.missions.script import Expectation, Script
from hil.signals.rotation import norm, upright_of
from hil.signals.samples import TruthState, Vec3
from hil.signals.time import NS_PER_S
from hil.verdict import AIRBORNE_M, Measurements, Row, Verdict, judge

_NEVER_NS = 1 << 62


class Measured(NamedTuple):
    """What came of one declaration; None where the flight did not yield it."""

    expectation: Expectation
    value: float | None


class DeclaredMeasurements:
    """Observes every tick. Constant memory and time per tick and declaration."""

    def __init__(self, expectations: Sequence[Expectation]) -> None:
        self._expectations = tuple(expectations)
        self._windows = [_Window(e) for e in self._expectations if e.measure in _OF_A_TICK]
        self._home: Vec3 | None = None
        self._contact = True
        self._lift_off_ns: int | None = None
        self._touch_down_ns: int | None = None

    def add(self, truth: TruthState) -> None:
        """Look at the truth of one tick; call it for every tick, in order."""
        home = self._home
        if home is None:
            home = self._home = truth.p_WB
        for window in self._windows:
            if window.begin_ns <= truth.t_ns <= window.end_ns:
                window.look(truth, home)
        if truth.in_contact:
            if not self._contact and self._lift_off_ns is not None:
                self._touch_down_ns = truth.t_ns
        elif self._lift_off_ns is None and truth.p_WB[2] > home[2] + AIRBORNE_M:
            self._lift_off_ns = truth.t_ns
        self._contact = truth.in_contact

    def results(self) -> list[Measured]:
        """Every declaration with its value, in the order of the script; ask at the end of the flight."""
        values = {id(window.expectation): window.value for window in self._windows}
        down, up = self._touch_down_ns, self._lift_off_ns
        found: list[Measured] = []
        for e in self._expectations:
            if e.measure == "time_to_complete_s":
                found.append(Measured(e, None if down is None else down / NS_PER_S))
            elif e.measure == "flight_time_s":
                found.append(Measured(e, None if down is None or up is None else (down - up) / NS_PER_S))
            else:
                found.append(Measured(e, values[id(e)]))
        return found


class _Window:
    """One measurement while its window lasts."""

    def __init__(self, expectation: Expectation) -> None:
        self.expectation = expectation
        self.begin_ns = 0 if expectation.from_s is None else round(expectation.from_s * NS_PER_S)
        self.end_ns = _NEVER_NS if expectation.to_s is None else round(expectation.to_s * NS_PER_S)
        self.value: float | None = None
        self._of_a_tick = _OF_A_TICK[expectation.measure]
        self._least = expectation.measure.startswith("min_")
        self._drift = expectation.measure.endswith("_drift_m")
        self._start: Vec3 | None = None

    def look(self, truth: TruthState, home: Vec3) -> None:
        if self._drift:
            if self._start is None:
                self._start = truth.p_WB
            home = self._start
        value, so_far = self._of_a_tick(truth, home), self.value
        # Written so that a NaN once is a NaN for ever.
        if so_far is None or (so_far == so_far and not (value >= so_far if self._least else value <= so_far)):
            self.value = value


def _tilt_deg(truth: TruthState, origin: Vec3) -> float:  # noqa: ARG001
    return math.degrees(math.acos(max(-1.0, min(1.0, upright_of(truth.q_WB)))))


def _horizontal_m(truth: TruthState, origin: Vec3) -> float:
    return math.hypot(truth.p_WB[0] - origin[0], truth.p_WB[1] - origin[1])


_OF_A_TICK: dict[str, Callable[[TruthState, Vec3], float]] = {
    "max_tilt_deg": _tilt_deg,
    "max_rate_degps": lambda truth, _: math.degrees(norm(truth.w_WB_B)),
    "max_speed_mps": lambda truth, _: norm(truth.v_WB_W),
    "max_climb_mps": lambda truth, _: truth.v_WB_W[2],
    "max_sink_mps": lambda truth, _: -truth.v_WB_W[2],
    "min_altitude_m": lambda truth, home: truth.p_WB[2] - home[2],
    "max_altitude_m": lambda truth, home: truth.p_WB[2] - home[2],
    "max_distance_m": _horizontal_m,
    "hover_drift_m": _horizontal_m,
    "height_drift_m": lambda truth, start: abs(truth.p_WB[2] - start[2]),
}


def judge_scripted(
    measured: Measurements,
    limits: Limits,
    script: Script,
    declared: Sequence[Measured],
    records: Sequence[Record] = (),
) -> Verdict:
    """The verdict on a scripted flight: the plan's, unless the script says otherwise, and the script's own.

    With `outcome: aborted` the plan must not have been completed, with `any` it may: limits that only a completed
    plan would yield are then judged where they were measured. A required action that never fell due fails.
    """
    if script.outcome != "complete":
        verdict = judge(replace(measured, called_for=frozenset()), limits)
        verdict = replace(verdict, measurements=measured)
    else:
        verdict = judge(measured, limits)
    reasons, rows = list(verdict.reasons), list(verdict.rows)
    if script.outcome == "aborted" and measured.completed:
        reasons.append("the mission was completed, but the script expects that it is not")
    for expectation, value in declared:
        row, reason = _judged(expectation, value)
        rows.append(row)
        reasons += reason
    reasons += [
        f"{record.name}: never happened, what it waits for did not come"
        for record in records
        if record.required and record.outcome == "waiting"
    ]
    reasons += [
        f"{record.name}: not answered before the run ended"
        for record in records
        if record.required and record.outcome == "running"
    ]
    return Verdict("FAIL" if reasons else "PASS", tuple(reasons), tuple(rows), measured)


def _judged(e: Expectation, value: float | None) -> tuple[Row, list[str]]:
    """A row of the verdict, and the reason why it fails, if it does. The row shows the limit that is nearer."""
    reasons: list[str] = []
    unit, label = e.unit, e.label
    limits = [limit for limit in (e.at_most, e.at_least) if limit is not None]
    if value is None:
        if limits:
            reasons.append(f"{label} has a limit but was never measured: the run did not last, or did not come, so far")
    else:
        if e.at_most is not None and not value <= e.at_most:
            reasons.append(f"{label} is {value:.3g} {unit}, more than the {e.at_most:g} {unit} allowed")
        if e.at_least is not None and not value >= e.at_least:
            reasons.append(f"{label} is {value:.3g} {unit}, less than the {e.at_least:g} {unit} demanded")
    shown = None
    if limits:
        shown = min(limits, key=lambda limit: abs(limit - value)) if value is not None else limits[0]
    return Row(label, value, shown, unit, not reasons), reasons
