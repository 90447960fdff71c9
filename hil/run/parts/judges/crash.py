"""Ends a flight that has crashed, as FAIL, instead of flying on to its time limit. Judged from ground truth.

Only a script with `outcome: crashed` wants the crash: its flight is a FAIL without one.

A vehicle has crashed when

impact   it has been in the air and touches something at more than `impact_mps` (speed of the tick before). A plane
         lands fast: it must lose that much speed within 0.2 s of the touch
tilt     it is in contact and tilted by more than `tilt_deg`, for 1 s or when the flight ends: it lies on its side or
         back
rest     it has been in the air and rests for `rest_s`, armed, more than 5 m from its start and from the end of its
         plan. Only for flights of a plan: where a script or a companion should land is not known

A launcher holds a vehicle as it likes: nothing is a crash before it lets go. The flight goes on for another second, so
that the recording shows the end of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from hil.config import Bench
from hil.config.schema import Crash
from hil.run.part import Part, RunContext
from hil.run.verdict.verdict import AIRBORNE_M, REST_SPEED_MPS, Row, Verdict
from signals.rotation import cos_tilt_of
from signals.samples import Quat, TruthState, Vec3
from signals.time import NS_PER_S
from sim.physics.fixed_wing import is_plane

_LIE_NS = NS_PER_S  # contact and tilt must last this long
_GAP_NS = NS_PER_S // 2  # a vehicle that bounces or trembles is still in contact
_NEAR_M = 5.0
_AFTERMATH_NS = NS_PER_S
_STOP_NS = NS_PER_S // 5  # a plane that hits an obstacle stops within this time; one that slides does not


class CrashPart(Part):
    name = "crash"
    _start_z_m: float  # from `begin` on

    def __init__(
        self,
        limits: Crash,
        *,
        wanted: bool = False,
        lands_fast: bool = False,
        cos_tilt: Callable[[Quat], float] = cos_tilt_of,
    ) -> None:
        """`wanted`: the script of the flight demands the crash (`outcome: crashed`). `lands_fast`: a plane.

        `cos_tilt` returns the cosine of the angle between what is up in the vehicle and the vertical.
        """
        self._cos_tilt = cos_tilt
        self._limits, self._wanted, self._lands_fast = limits, wanted, lands_fast
        self._touch: TruthState | None = None  # of a plane, the tick before its newest touch
        self._min_cos_tilt = -2.0 if limits.tilt_deg is None else math.cos(math.radians(limits.tilt_deg))
        self._rest_ns = None if limits.rest_s is None else round(limits.rest_s * NS_PER_S)
        self._allowed_W: list[Vec3] = []  # places of rest
        self._has_plan = False
        self._airborne = False
        self._previous: TruthState | None = None
        self._contact_ns: int | None = None  # newest contact
        self._tilted_ns: int | None = None  # since then in contact and tilted
        self._resting_ns: int | None = None  # since then at rest and armed
        self._ends_ns: int | None = None
        self._reason: str | None = None
        self._crashed_s: float | None = None  # since the start

    def begin(self, run: RunContext) -> None:
        self._run, self._scheduler = run, run.scheduler
        self._launched = run.physics.launching
        x, y, z = run.physics.state[:3].tolist()
        self._start_z_m = z
        self._has_plan = bool(run.legs)
        self._allowed_W = [(x, y, z), *(leg.end_W for leg in run.legs[-1:])]

    def after_tick(self, tick: int) -> None:  # noqa: ARG002 (the truth has its tick)
        truth = self._scheduler.truth
        if truth is None or self._reason is not None:
            return
        if self._launched and self._run.physics.launching:
            return
        previous, self._previous = self._previous, truth
        if not truth.in_contact:
            self._airborne = self._airborne or truth.p_WB[2] > self._start_z_m + AIRBORNE_M
            if self._contact_ns is None or truth.t_ns - self._contact_ns > _GAP_NS:
                self._contact_ns = self._tilted_ns = self._resting_ns = None
                return
        else:
            self._contact_ns = truth.t_ns
            limit_mps = self._limits.impact_mps
            if self._airborne and limit_mps is not None and previous is not None and not previous.in_contact:
                speed = _speed_mps(previous)
                if self._lands_fast:
                    self._touch = previous
                elif not speed <= limit_mps:
                    self._crashed(truth, speed, f"impact at {speed:.1f} m/s")
                    return
        if self._touch is not None and self._stopped(self._touch, truth):
            return
        self._lies(truth)
        if self._airborne and self._has_plan:
            self._rests(truth)

    def _stopped(self, touch: TruthState, truth: TruthState) -> bool:
        """Return True if a plane has lost more speed since its touch than a landing may take."""
        if truth.t_ns - touch.t_ns > _STOP_NS:
            self._touch = None
            return False
        limit_mps = self._limits.impact_mps
        lost_mps = math.dist(touch.v_WB_W, truth.v_WB_W)
        if limit_mps is None or lost_mps <= limit_mps:
            return False
        self._crashed(
            truth, _speed_mps(touch), f"impact at {_speed_mps(touch):.1f} m/s, of which it lost {lost_mps:.1f}"
        )
        return True

    def _lies(self, truth: TruthState) -> None:
        if self._cos_tilt(truth.q_WB) >= self._min_cos_tilt:
            self._tilted_ns = None
        elif self._tilted_ns is None:
            self._tilted_ns = truth.t_ns
        elif truth.t_ns - self._tilted_ns >= _LIE_NS:
            self._crashed(truth, _speed_mps(truth), "it lies on its side or back")

    def _rests(self, truth: TruthState) -> None:
        armed = self._scheduler.actuators.armed
        if self._rest_ns is None or not armed or _speed_mps(truth) > REST_SPEED_MPS or self._allowed(truth.p_WB):
            self._resting_ns = None
        elif self._resting_ns is None:
            self._resting_ns = truth.t_ns
        elif truth.t_ns - self._resting_ns >= self._rest_ns:
            self._crashed(truth, _speed_mps(truth), "it rests, armed, away from the end of its plan")

    def _allowed(self, p_WB: Vec3) -> bool:
        return any(math.hypot(p_WB[0] - x, p_WB[1] - y) <= _NEAR_M for x, y, _ in self._allowed_W)

    def _crashed(self, truth: TruthState, speed_mps: float, how: str) -> None:
        if self._reason is not None:
            return
        x, y, z = truth.p_WB
        tilt_deg = math.degrees(math.acos(max(-1.0, min(1.0, self._cos_tilt(truth.q_WB)))))
        self._crashed_s = truth.t_ns / NS_PER_S
        self._reason = (
            f"crashed: {how}, {self._crashed_s:.2f} s after the start at ({x:.1f}, {y:.1f}, {z:.1f}) m, "
            f"speed {speed_mps:.1f} m/s, tilt {tilt_deg:.0f} deg"
        )
        self._ends_ns = truth.t_ns + _AFTERMATH_NS
        self._run.event("status" if self._wanted else "error", self._reason)

    def conclude(self, run: RunContext) -> None:
        truth = run.scheduler.truth
        if truth is not None and truth.in_contact and self._tilted_ns is not None:
            self._crashed(truth, _speed_mps(truth), "it lies on its side or back")

    def ended(self) -> bool:
        return self._ends_ns is not None and self._run.now_ns() >= self._ends_ns

    def verdict(self) -> Verdict:
        if not self._wanted:
            return Verdict(causes=[] if self._reason is None else [self._reason])
        row = Row("crashed_after_s", self._crashed_s, None, "s", self._reason is not None)
        return Verdict([row], [] if row.ok else ["the flight ended without the crash that its script expects"])


def _speed_mps(truth: TruthState) -> float:
    return math.hypot(*truth.v_WB_W)


def make(bench: Bench) -> Part:
    assert bench.config.crash is not None
    vehicle = bench.vehicle
    wanted = bench.outcome == "crashed"
    return CrashPart(bench.config.crash, wanted=wanted, lands_fast=is_plane(vehicle), cos_tilt=vehicle.cos_tilt)
