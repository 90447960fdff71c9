"""Fails a flight whose vehicle touched something and went on: a branch, a wall, a person. From ground truth.

A vehicle flies once it is more than `AIRBORNE_M` above the place where it last rested. Where it then touches something
it lands, if it comes to rest on it for a second: a trembling of half a second does not matter. If it leaves again and
gets `touch_m` away, or falls as far, it has hit something in flight, too slowly for a crash: a real propeller would
have broken. A landing that bounces or slides stays within that.
"""

from __future__ import annotations

import math

from hil.config import Bench
from hil.run.part import Part, RunContext
from hil.run.verdict.verdict import AIRBORNE_M, REST_SPEED_MPS, Verdict
from signals.rotation import norm
from signals.samples import TruthState, Vec3
from signals.time import NS_PER_S

_REST_NS = NS_PER_S  # at rest so long, a vehicle has landed
_GAP_NS = NS_PER_S // 2  # off the ground so shortly, it is still at rest
_LEVEL = 0.5  # least vertical part of the normal of what carries a vehicle at rest


class TouchPart(Part):
    name = "touch"
    _rested_z_m: float  # from `begin` on

    def __init__(self, limit_m: float) -> None:
        """`limit_m`: way from the touch at which it counts."""
        self._limit_m = limit_m
        self._flies = False
        self._resting_ns: int | None = None  # since then at rest
        self._first_z_m = 0.0  # of what was touched, and not yet rested on
        self._touched_W: Vec3 | None = None  # its newest place
        self._touched_ns = 0
        self._what = ""
        self._reason: str | None = None

    def begin(self, run: RunContext) -> None:
        self._run = run
        self._rested_z_m = float(run.physics.state[2])

    def after_tick(self, tick: int) -> None:  # noqa: ARG002 (the truth has its tick)
        truth = self._run.scheduler.truth
        if truth is None or self._reason is not None:
            return
        if truth.in_contact:
            if self._flies:
                self._touches(truth)
            return
        if truth.t_ns - self._touched_ns > _GAP_NS:
            self._resting_ns = None
        if self._touched_W is not None:
            fallen_m = self._first_z_m - truth.p_WB[2]
            if max(math.dist(truth.p_WB, self._touched_W), fallen_m) > self._limit_m:
                self._reason = f"{self._what} and went on; crash.touch_m allows {self._limit_m:g} m"
                self._run.event("error", self._reason)
        self._flies = self._flies or truth.p_WB[2] > self._rested_z_m + AIRBORNE_M

    def _touches(self, truth: TruthState) -> None:
        if self._touched_W is None:
            contact = self._run.physics.contact()
            name = "something" if contact is None or not contact.name else repr(contact.name)
            x, y, z = truth.p_WB
            self._first_z_m = z
            when = f"{truth.t_ns / NS_PER_S:.2f} s after the start"
            self._what = f"touched {name} in flight, {when} at ({x:.1f}, {y:.1f}, {z:.1f}) m,"
        self._touched_W, self._touched_ns = truth.p_WB, truth.t_ns
        if norm(truth.v_WB_W) > REST_SPEED_MPS:
            self._resting_ns = None
        elif self._resting_ns is None:
            self._resting_ns = truth.t_ns
        elif truth.t_ns - self._resting_ns >= _REST_NS and self._is_carried():
            self._flies, self._touched_W, self._rested_z_m = False, None, truth.p_WB[2]

    def _is_carried(self) -> bool:
        contact = self._run.physics.contact()
        return contact is None or contact.normal_W[2] > _LEVEL

    def verdict(self) -> Verdict:
        return Verdict(reasons=[] if self._reason is None else [self._reason])


def make(bench: Bench) -> Part:
    assert bench.config.crash is not None
    assert bench.config.crash.touch_m is not None
    return TouchPart(bench.config.crash.touch_m)
