"""Judges a scripted flight by the measurements that its script declares, taken from ground truth.

    max_tilt_deg        greatest angle between the body's z axis (of a tailsitter x) and the vertical
    max_rate_degps      greatest angular speed
    max_speed_mps       greatest speed
    max_climb_mps       greatest upward speed
    max_sink_mps        greatest downward speed
    min_altitude_m      smallest height above the start
    max_altitude_m      greatest height above the start
    max_distance_m      greatest horizontal distance from the start
    hover_drift_m       greatest horizontal distance from the position at from_s
    height_drift_m      greatest difference in height from the position at from_s
    flight_time_s       from the first lift-off to the last touch-down
    time_to_complete_s  from the start of the run to the last touch-down

All but the last two use the ticks from `from_s` to `to_s`, both included, by default the whole run. A measurement that
has a limit fails if it was never taken (the run ended too early, the vehicle never touched down), if the run ended
before `to_s` and the rest of the window could have broken the limit, and if it is NaN. So does a drift of which the
whole window was on the ground: nothing hovered. A flight that has not ended has no time to complete.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from firmware_bridge.ground_station.actions import Record
from hil.config.missions.script import Expectation
from hil.run.verdict.verdict import AIRBORNE_M, REST_CONTACT_NS, Row, Verdict
from signals.rotation import cos_tilt_of, norm
from signals.samples import Quat, TruthState, Vec3
from signals.time import NS_PER_S

_NEVER_NS = 1 << 62
_NOT_DONE = {
    "waiting": "never ran, its condition was never met",
    "running": "not acknowledged before the run ended",
}


class Measured(NamedTuple):
    """Value of one declared measurement; None if the flight did not yield it."""

    expectation: Expectation
    value: float | None
    lift_off_s: float | None = None
    cut_s: float | None = None  # the run ended then, before the end of the window; None: it did not
    flew: bool = True  # False: the vehicle was on the ground in the whole window


class DeclaredMeasurements:
    """Takes the declared measurements tick by tick, in constant memory and time per tick and declaration."""

    def __init__(self, expectations: Sequence[Expectation], *, cos_tilt: Callable[[Quat], float] = cos_tilt_of) -> None:
        self._expectations = tuple(expectations)
        measures = {**_MEASURES, "max_tilt_deg": lambda truth, _: _degrees(cos_tilt(truth.q_WB))}
        self._windows = [_Window(e, measures[e.measure]) for e in self._expectations if e.measure in measures]
        self._home: Vec3 | None = None
        self._contact = True
        self._lift_off_ns: int | None = None
        self._touch_down_ns: int | None = None
        self._touch_down_up_m = math.inf
        self._contact_ns = 0
        self._last_ns = self._tick_ns = 0

    def add(self, truth: TruthState) -> None:
        """Add the true state of one tick; call it for every tick, in order."""
        home = self._home
        if home is None:
            home = self._home = truth.p_WB
        self._tick_ns, self._last_ns = truth.t_ns - self._last_ns, truth.t_ns
        self._contact_ns = truth.t_ns if truth.in_contact else self._contact_ns
        for window in self._windows:
            if window.begin_ns <= truth.t_ns <= window.end_ns:
                window.add(truth, home)
                window.flew |= truth.t_ns - self._contact_ns > REST_CONTACT_NS  # one at rest trembles
        if truth.in_contact:
            if not self._contact and self._lift_off_ns is not None:
                self._touch_down_ns, self._touch_down_up_m = truth.t_ns, truth.p_WB[2]
        elif truth.p_WB[2] > self._touch_down_up_m + AIRBORNE_M:
            self._touch_down_ns, self._touch_down_up_m = None, math.inf  # it flies on
        elif self._lift_off_ns is None and truth.p_WB[2] > home[2] + AIRBORNE_M:
            self._lift_off_ns = truth.t_ns
        self._contact = truth.in_contact

    def results(self) -> list[Measured]:
        """Return every declared measurement in the order of the script; call it after the flight."""
        windows = {id(window.expectation): window for window in self._windows}
        run_end_ns = self._last_ns + self._tick_ns
        touch_down_ns, lift_off_ns = self._touch_down_ns, self._lift_off_ns
        lift_off_s = None if lift_off_ns is None else lift_off_ns / NS_PER_S
        results: list[Measured] = []
        for e in self._expectations:
            if e.measure == "time_to_complete_s":
                results.append(Measured(e, None if touch_down_ns is None else touch_down_ns / NS_PER_S))
            elif e.measure == "flight_time_s":
                results.append(
                    Measured(
                        e,
                        None
                        if touch_down_ns is None or lift_off_ns is None
                        else (touch_down_ns - lift_off_ns) / NS_PER_S,
                    )
                )
            else:
                cut = e.to_s is not None and run_end_ns < windows[id(e)].end_ns
                window = windows[id(e)]
                cut_s = run_end_ns / NS_PER_S if cut else None
                results.append(Measured(e, window.value, lift_off_s, cut_s, window.flew))
        return results


class _Window:
    """Extreme value of one measurement within its time window."""

    def __init__(self, expectation: Expectation, measure: Callable[[TruthState, Vec3], float]) -> None:
        self.expectation = expectation
        self.begin_ns = 0 if expectation.from_s is None else round(expectation.from_s * NS_PER_S)
        self.end_ns = _NEVER_NS if expectation.to_s is None else round(expectation.to_s * NS_PER_S)
        self.value: float | None = None
        self.flew = False
        self._measure = measure
        self._is_minimum = expectation.measure.startswith("min_")
        self._drift = _is_drift(expectation)
        self._start: Vec3 | None = None

    def add(self, truth: TruthState, home: Vec3) -> None:
        """Add the true state of a tick in the window. `home`: position at the start of the run."""
        if self._drift:
            if self._start is None:
                self._start = truth.p_WB
            home = self._start
        value, so_far = self._measure(truth, home), self.value
        # The comparisons are negated so that a NaN stays.
        if so_far is None or (so_far == so_far and not (value >= so_far if self._is_minimum else value <= so_far)):
            self.value = value


def _is_drift(expectation: Expectation) -> bool:
    return expectation.measure.endswith("_drift_m")


def _degrees(cosine: float) -> float:
    return math.degrees(math.acos(max(-1.0, min(1.0, cosine))))


def _horizontal_m(truth: TruthState, origin: Vec3) -> float:
    return math.hypot(truth.p_WB[0] - origin[0], truth.p_WB[1] - origin[1])


_MEASURES: dict[str, Callable[[TruthState, Vec3], float]] = {
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


def measured_on_ground(declared: Sequence[Measured]) -> list[str]:
    """Describe the measurements with a limit in whose window the vehicle, which flew later or before, did not."""
    return [
        f"{m.expectation.label} was measured on the ground{_when(m)}: its limit says nothing of the flight"
        for m in declared
        if not (m.expectation.at_most is None and m.expectation.at_least is None)
        and m.lift_off_s is not None
        and m.value is not None
        and not (m.flew or _is_drift(m.expectation))
    ]


def judge_script(declared: Sequence[Measured], records: Sequence[Record] = ()) -> Verdict:
    """Return the verdict on the measurements and actions of a script. A required action that never ran fails."""
    rows: list[Row] = []
    reasons: list[str] = []
    for measured in declared:
        row, row_reasons = _row_and_reasons(measured)
        rows.append(row)
        reasons += row_reasons
    for outcome, text in _NOT_DONE.items():
        reasons += [f"{record.name}: {text}" for record in records if record.required and record.outcome == outcome]
    return Verdict(rows, reasons)


def _row_and_reasons(measured: Measured) -> tuple[Row, list[str]]:
    """Return a row of the verdict, with the limit nearer to the value, and the reasons why it fails."""
    e, value = measured.expectation, measured.value
    reasons: list[str] = []
    unit, label = e.unit, e.label
    limits = [limit for limit in (e.at_most, e.at_least) if limit is not None]
    when = _when(measured)
    if value is None:
        if limits:
            reasons.append(
                f"{label} has a limit but was never measured: the run ended too early or without a touch-down"
            )
    else:
        if e.at_most is not None and not value <= e.at_most:
            reasons.append(f"{label} is {value:.3g} {unit}, more than the {e.at_most:g} {unit} allowed{when}")
        if e.at_least is not None and not value >= e.at_least:
            reasons.append(f"{label} is {value:.3g} {unit}, less than the required {e.at_least:g} {unit}{when}")
        if limits and not measured.flew and _is_drift(e):
            reasons.append(f"{label} was measured on the ground{when}: nothing hovered")
        # A maximum can only rise in the rest of the window, a minimum only fall.
        open_limit = e.at_least if e.measure.startswith("min_") else e.at_most
        if open_limit is not None and not reasons and measured.cut_s is not None:
            reasons.append(
                f"{label} was measured only until the run ended at {measured.cut_s:.1f} s{when}: set a to_s within "
                "the flight"
            )
    shown = None
    if limits:
        shown = min(limits, key=lambda limit: abs(limit - value)) if value is not None else limits[0]
    return Row(label, value, shown, unit, not reasons), reasons


def _when(measured: Measured) -> str:
    """Return the window and the take-off, since autopilots take off at different times; "" without a window."""
    e = measured.expectation
    if e.from_s is None and e.to_s is None:
        return ""
    end = "the end" if e.to_s is None else f"{e.to_s:g} s"
    lift_off_s = measured.lift_off_s
    took_off = "it never took off" if lift_off_s is None else f"it took off at {lift_off_s:.1f} s"
    return f" (from {e.from_s or 0.0:g} s to {end}; {took_off})"
