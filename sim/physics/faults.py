"""Faults of rotors at a simulated time, as data.

    - {kind: efficiency, rotor: 1, at_s: 12.0, factor: 0.7}     thrust and torque fall to 70 %
    - {kind: stuck, rotor: 0, at_s: 12.0, speed_radps: 0}       runs to that speed and ignores commands
    - {kind: lost_blade, rotor: 2, at_s: 12.0, imbalance_gcm: 30}   half the thrust of a two-blade rotor, unbalanced
    - {kind: desync, rotor: 3, at_s: 12.0, for_s: 0.4}          the speed controller loses the rotor, and finds it again

A fault begins at the first tick at or after `at_s` and lasts; only a desync may end, at the first tick at or after
`at_s + for_s`. A later fault of the same rotor replaces the earlier one.

Desynchronisation, for vehicles with `rotor_constants.motor`: a controller without a sensor commutates by the back-EMF.
If it misses a zero crossing, the currents are out of step with the rotor and their torque is 0 in the mean over a turn;
it notices, switches its bridge off and starts anew. Here the motor has no current at all from `at_s` on: the rotor
slows down by its friction and its aerodynamic torque. After `for_s` the controller has found the rotor at whatever
speed it has, and drives it again. The mean torque of 0 and a clean return are an estimate; so is a usual 0.1 to 1 s.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import pydantic
from pydantic import Field

from signals.documents.validate import StrictModel
from signals.time import NS_PER_S
from sim.physics.forces.rotors import RotorConstants
from sim.physics.vehicle import Vehicle

_ALLOWED = {
    "efficiency": {"factor"},
    "stuck": {"speed_radps"},
    "lost_blade": {"blades", "imbalance_gcm"},
    "desync": {"for_s"},
}
_OPTIONS = ("factor", "speed_radps", "blades", "imbalance_gcm", "for_s")
_KGM_PER_GCM = 1e-5
HEALTHY = (1.0, -1.0, 0.0)  # as `RotorFault.rotor_state`


class RotorFault(StrictModel):
    """Fault of one rotor from one instant on."""

    kind: Literal["efficiency", "stuck", "lost_blade", "desync"]
    rotor: Annotated[int, Field(ge=0, le=7)]  # number in the autopilot's control order, 0 first
    at_s: Annotated[float, Field(ge=0.0, le=86_400.0)]
    factor: Annotated[float, Field(ge=0.0, le=1.0)] | None = None  # efficiency: share of thrust and torque that is left
    speed_radps: Annotated[float, Field(ge=0.0, le=10_000.0)] | None = None  # stuck: default 0
    blades: Annotated[int, Field(ge=2, le=8)] | None = None  # lost_blade: number of blades before the loss, default 2
    imbalance_gcm: Annotated[float, Field(ge=0.0, le=1000.0)] | None = None  # lost_blade: mass times arm, default 0
    for_s: Annotated[float, Field(gt=0.0, le=86_400.0)] | None = None  # desync: default for ever

    @pydantic.model_validator(mode="after")
    def _fits_kind(self) -> RotorFault:
        for name in _OPTIONS:
            if getattr(self, name) is not None and name not in _ALLOWED[self.kind]:
                raise ValueError(f"{name} has no meaning for the kind {self.kind!r}")
        if self.kind == "efficiency" and self.factor is None:
            raise ValueError("the kind 'efficiency' needs factor, 0 to 1")
        return self

    def start_tick(self, tick_ns: int) -> int:
        """Return the first tick at or after `at_s`."""
        return -(-round(self.at_s * NS_PER_S) // tick_ns)

    def end_tick(self, tick_ns: int) -> int | None:
        """Return the first tick without the fault; None if it lasts. At least one tick has it."""
        if self.for_s is None:
            return None
        return max(-(-round((self.at_s + self.for_s) * NS_PER_S) // tick_ns), self.start_tick(tick_ns) + 1)

    @property
    def driven(self) -> bool:
        """False for a motor that has no current."""
        return self.kind != "desync"

    @property
    def rotor_state(self) -> tuple[float, float, float]:
        """Remaining share of the thrust 0..1, forced speed [rad/s] or -1, and imbalance [kg m]."""
        if self.kind == "efficiency":
            assert self.factor is not None
            return (self.factor, -1.0, 0.0)
        if self.kind == "stuck":
            return (1.0, self.speed_radps or 0.0, 0.0)
        if self.kind == "desync":
            return HEALTHY
        blades = self.blades or 2
        return ((blades - 1) / blades, -1.0, (self.imbalance_gcm or 0.0) * _KGM_PER_GCM)

    @property
    def text(self) -> str:
        """Text of the event in the recording."""
        thrust_share, speed, imbalance = self.rotor_state
        if self.kind == "efficiency":
            return f"rotor {self.rotor}: efficiency falls to {100 * thrust_share:g} %"
        if self.kind == "stuck":
            return f"rotor {self.rotor}: stuck at {speed:g} rad/s"
        if self.kind == "desync":
            return f"rotor {self.rotor}: the speed controller loses the rotor"
        return (
            f"rotor {self.rotor}: a blade is lost, {100 * thrust_share:g} % of the thrust left, "
            f"imbalance {imbalance:g} kg m"
        )

    @property
    def end_text(self) -> str:
        """Text of the event with which the fault ends."""
        return f"rotor {self.rotor}: the speed controller has found the rotor"


def misfits(faults: Sequence[RotorFault], vehicle: Vehicle) -> list[tuple[int, str, str]]:
    """Return (index, key, message) of faults that do not fit the vehicle: no such rotor, no motor, too much mass."""
    rotors, found = len(vehicle.rotors), []
    for index, fault in enumerate(faults):
        if fault.rotor >= rotors:
            found.append((index, "rotor", f"names rotor {fault.rotor}, but the vehicle has rotors 0 to {rotors - 1}"))
        constants = vehicle.constants_of_rotors[fault.rotor] if fault.rotor < rotors else vehicle.rotor_constants
        if not fault.driven and constants.motor is None:
            found.append(
                (
                    index,
                    "kind",
                    f"is desync, and {vehicle.name} has no rotor_constants.motor that could lose its rotor: its speeds "
                    "follow the commands whatever their torque. Give it a motor, or use stuck with speed_radps: 0",
                )
            )
        most = most_imbalance_gcm(constants, fault.blades or 2)
        if most is not None and (fault.imbalance_gcm or 0.0) > most:
            found.append(
                (
                    index,
                    "imbalance_gcm",
                    f"must be at most {most:.3g} g cm, not {fault.imbalance_gcm:g}: one of {fault.blades or 2} blades "
                    f"of a rotor with {constants.inertia_kgm2:g} kg m2 and {constants.radius_m:g} m has no more",
                )
            )
    return found


def most_imbalance_gcm(c: RotorConstants, blades: int) -> float | None:
    """Return the greatest imbalance by the loss of one blade; None for a rotor without inertia (`inertia_kgm2: 0`).

    A blade of uniform density along the radius R has J_b = m R^2 / 3 and the imbalance m R / 2 = 1.5 J_b / R, with
    J_b = J / blades. A real blade is heavier at the root, so that its imbalance is greater by its inertia: up to twice.
    """
    if c.inertia_kgm2 == 0.0:
        return None
    return 2.0 * 1.5 * c.inertia_kgm2 / blades / c.radius_m / _KGM_PER_GCM


def check_faults(faults: Sequence[RotorFault], vehicle: Vehicle) -> None:
    """Raise ValueError, which names every fault that does not fit the vehicle."""
    problems = misfits(faults, vehicle)
    if problems:
        raise ValueError("; ".join(f"faults[{index}].{key} {message}" for index, key, message in problems))
