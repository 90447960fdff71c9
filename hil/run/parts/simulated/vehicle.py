"""The simulated vehicle: physics, faults of rotors and surfaces, and gusts."""

from __future__ import annotations

from typing import Any

from hil.config import Bench
from hil.run.loop.restartable_physics import make_physics
from hil.run.part import Part, RunContext
from sim.physics.faults import RotorFault
from sim.physics.surface_faults import SurfaceFault
from sim.physics.vehicle_physics import VehiclePhysics
from sim.scene.wind import GustEvent


class VehiclePart(Part):
    name = "vehicle"

    def __init__(self) -> None:
        self._physics: VehiclePhysics | None = None

    def open(self, run: RunContext) -> None:
        self._physics = run.physics = make_physics(run.bench)

    def inject(self, fault: Any, *, declared: bool) -> bool:  # noqa: ARG002 (makes no difference here)
        if self._physics is None or not isinstance(fault, GustEvent | RotorFault | SurfaceFault):
            return False
        self._physics.inject(fault)
        return True

    def skipped(self, ticks: int) -> list[dict[str, Any]]:  # noqa: ARG002 (counted by the physics itself)
        if self._physics is None:
            return []
        skips = self._physics.skips
        rows: list[dict[str, Any]] = [
            {
                "what": "contact",
                "why": "nothing near enough to touch",
                "saved": f"{skips.skipped} of {skips.skipped + skips.queried + skips.touching} collision queries",
                "ticks_skipped": skips.skipped,
                "ticks_queried": skips.queried,
                "ticks_touching": skips.touching,
            }
        ]
        computed, total = self._physics.actor_poses
        if total:
            saved = f"{total - computed} of {total} poses for contact"
            rows.append({"what": "actors", "why": "too far from the vehicle to touch it", "saved": saved})
        return rows


def make(bench: Bench) -> Part:  # noqa: ARG001
    return VehiclePart()
