"""Measures and judges what happens between the vehicles of a run, from ground truth.

min_distance_m     Least distance between the centres of any two vehicles of which one is in the air, until either's
                   flight is over: beside a landed or fallen vehicle others may land.
contacts           Contacts between vehicles: when, who, how fast. Judged are those that begin before both flights are
                   over: who touches a landed or fallen vehicle has hit an obstacle.
formation_error_m  Greatest distance between a vehicle and its place in the formation. Measured from the tick at which
                   all are in the air and within the limit (`FORMED_M` if it is null), until one has reached its last
                   waypoint, touches anything, or is lost. One that has reached more than `LATEST` of its waypoints
                   by then has not flown them in formation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hil.config.group_schema import Group
from hil.run.verdict.verdict import Row, rows_within
from signals.samples import TruthState, Vec3
from signals.time import NS_PER_S
from sim.physics.vehicle_group import VehicleContact

FORMED_M = 2.0
LATEST = 0.5
_TOO_LATE = (
    "when all were in place, a vehicle was already within reach of its last waypoint (limits that are null make that "
    "reach wider)"
)
_STRIDE = 10  # ticks between two measurements of the formation


class GroupMeasurement:
    """Measures tick by tick, in time that grows with the square of the number of vehicles."""

    def __init__(
        self,
        names: Sequence[str],
        *,
        offsets_W_m: Mapping[str, Vec3] | None = None,
        formed_m: float | None = None,
        flown_share: Callable[[], float] = lambda: 0.0,
    ) -> None:
        """`offsets_W_m`: places in the formation relative to the first vehicle; None: none is flown.

        `flown_share` returns the greatest share of its waypoints that a vehicle has reached, 1 once one is lost.
        """
        self._names = tuple(names)
        self._over_ns = dict.fromkeys(names, math.inf)  # end of each flight
        self._offsets = None if offsets_W_m is None else np.array([offsets_W_m[name] for name in names])
        self._formed_m = FORMED_M if formed_m is None else formed_m
        self._flown_share = flown_share
        self._formed_at = 0.0  # share flown when all were in place
        self._pairs = np.triu_indices(len(names), 1)
        self._distance2_m2 = np.inf
        self._closest: tuple[int, int, int] | None = None  # time [ns], numbers of both vehicles
        self._formation_m: float | None = None
        self._farthest: tuple[int, int] | None = None  # time [ns], number of the vehicle
        self._formed = self._ended = False
        self._grounded = set(names)  # vehicles that were never in the air
        self._nearest: tuple[float, int] | None = None  # least greatest error of all in the air [m], its vehicle
        self.contacts: list[VehicleContact] = []

    def add(self, truths: Sequence[TruthState], over: Sequence[bool] = ()) -> None:
        """Measure one tick. `truths`: of all vehicles, in the order of their names; `over`: their flights are over."""
        if any(over):
            for name, is_over in zip(self._names, over, strict=True):
                if is_over:
                    self._over_ns[name] = min(self._over_ns[name], truths[0].t_ns)
        p_W = np.array([truth.p_WB for truth in truths])
        first, second = self._pairs
        if len(first):
            apart = p_W[first] - p_W[second]
            standing = np.array([truth.in_contact for truth in truths])
            left_out = standing[first] & standing[second]
            if any(over):
                left_out |= np.array(over)[first] | np.array(over)[second]
            distance2 = np.where(left_out, np.inf, np.einsum("ij,ij->i", apart, apart))
            pair = int(distance2.argmin())
            if distance2[pair] < self._distance2_m2:
                self._distance2_m2 = float(distance2[pair])
                self._closest = truths[0].t_ns, int(first[pair]), int(second[pair])
        if self._offsets is not None and not self._ended and truths[0].tick % _STRIDE == 0:
            self._measure_formation(truths, p_W - p_W[0] - self._offsets)

    def _measure_formation(self, truths: Sequence[TruthState], error_W_m: NDArray[np.float64]) -> None:
        errors_m = np.linalg.norm(error_W_m, axis=1)
        worst = int(errors_m.argmax())
        flying = not any(truth.in_contact for truth in truths)
        if not self._formed:
            self._grounded -= {name for name, truth in zip(self._names, truths, strict=True) if not truth.in_contact}
            self._formed = flying and bool(errors_m[worst] <= self._formed_m)
            if self._formed:
                self._formed_at = self._flown_share()
            if flying and (self._nearest is None or errors_m[worst] < self._nearest[0]):
                self._nearest = float(errors_m[worst]), worst
        elif not (flying and self._flown_share() < 1.0):
            self._ended = True
        elif self._formation_m is None or errors_m[worst] > self._formation_m:
            self._formation_m, self._farthest = float(errors_m[worst]), (truths[0].t_ns, worst)

    @property
    def min_distance_m(self) -> float | None:
        """Least distance so far; None: no vehicle was in the air."""
        return None if self._closest is None else float(np.sqrt(self._distance2_m2))

    def _why_not_formed(self, lost: Collection[str]) -> str:
        if self._grounded:
            grounded = [name for name in self._names if name in self._grounded]
            return ", ".join(
                f"{name} {'was lost before take-off' if name in lost else 'never took off'}" for name in grounded
            )
        if self._nearest is None:
            return "the vehicles were never all in the air"
        error_m, worst = self._nearest
        return f"{self._names[worst]} was {error_m:.1f} m from its place at best while all were in the air"

    def verdict(
        self, limits: Group, max_formation_error_m: float | None, lost: Collection[str] = ()
    ) -> tuple[list[Row], list[str]]:
        """Return the measurements beside their limits, and the reasons for a FAIL. `lost`: names of lost vehicles."""
        rows, reasons = rows_within(("min_distance_m", self.min_distance_m, limits.min_distance_m, "m", True))
        if reasons and self._closest is not None:
            t_ns, a, b = self._closest
            reasons = [f"{reasons[0]}: {self._names[a]} and {self._names[b]} at {t_ns / NS_PER_S:.2f} s"]
        if self._offsets is not None:
            row, why = rows_within(("formation_error_m", self._formation_m, max_formation_error_m, "m", False))
            if why and self._farthest is not None:
                t_ns, worst = self._farthest
                why = [f"{why[0]}: {self._names[worst]} at {t_ns / NS_PER_S:.2f} s"]
            elif why:
                reason = _TOO_LATE if self._formed else self._why_not_formed(lost)
                why = [f"{why[0]}: {reason}"]
            if not why and max_formation_error_m is not None and self._formed_at > LATEST:
                share = f"{self._formed_at:.0%} of the waypoints of one were reached, more than {LATEST:.0%}"
                why = [f"formation_error_m was measured late: when all were in place, {share}"]
                row = [replace(row[0], ok=False)]
            rows, reasons = rows + row, reasons + why
        judged = [c for c in self.contacts if c.t_ns < max(self._over_ns[c.a], self._over_ns[c.b])]
        fails = limits.contact == "fail" and bool(judged)
        rows.append(Row("contacts", float(len(judged)), 0.0 if limits.contact == "fail" else None, "", not fails))
        if fails:
            reasons.append(contact_text(judged[0]))
        return rows, reasons


def contact_text(contact: VehicleContact) -> str:
    """Return who touched whom, when and how hard, in one line."""
    return (
        f"{contact.a} and {contact.b} touched at {contact.t_ns / NS_PER_S:.2f} s, closing at "
        f"{contact.closing_mps:.1f} m/s, impulse {contact.impulse_ns:.2f} N s"
    )
