"""Checks that a vehicle can be controlled by its rotors or its wings, and that the autopilot can be given it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firmware_bridge.autopilots.catalog import PROFILES
from hil.config.checks.unit_checks import unit_problems
from hil.config.checks.wing_checks import wing_problems
from hil.config.fixed_wing_facts import fixed_wing_facts
from hil.config.multirotor_facts import multirotor_facts
from hil.config.schema import BenchConfig
from hil.config.vtol_facts import vtol_facts
from signals.documents.validate import Located, at
from signals.errors import Problem
from sim.physics import fixed_wing, multirotor, vtol
from sim.physics.vehicle import Vehicle

_AXES = ("roll", "pitch", "yaw", "thrust")
_RANK_TOLERANCE = 1e-6  # of the greatest entry of each axis


def control_problems(vehicle: Vehicle, file: Located) -> list[Problem]:
    """Report wings that cannot fly, or rotors that cannot lift the vehicle or give all four axes independently.

    Before these come numbers that no aircraft has, from which the others follow.
    """
    if found := unit_problems(vehicle, file):
        return found
    if vtol.is_vtol(vehicle):
        return wing_problems(vehicle, file) + _rotor_problems(vtol.hovering(vehicle), file)
    if fixed_wing.is_plane(vehicle):
        return wing_problems(vehicle, file)
    return _rotor_problems(vehicle, file)


def _rotor_problems(vehicle: Vehicle, file: Located) -> list[Problem]:
    unfit = multirotor.unfit(vehicle)
    if unfit is not None:
        return [at(file, (unfit[0],), unfit[1])]
    effect = multirotor.effectiveness(vehicle)[[3, 4, 5, 2]]
    greatest = np.max(np.abs(effect), axis=1, keepdims=True)
    rows = np.where(greatest > 1e-9, effect / np.maximum(greatest, 1e-9), 0.0)
    rank = _rank(rows)
    if rank == len(_AXES):
        return []
    bound = [axis for i, axis in enumerate(_AXES) if _rank(np.delete(rows, i, axis=0)) == rank]
    message = f"cannot control the vehicle: {' and '.join(bound)} cannot be commanded alone (rank {rank} of 4)"
    hint = "take four rotors or more, not in one line, of both spins, with moment_ratio_m above 0, or tilt them (axis)"
    return [at(file, ("rotors",), message, hint)]


def _rank(rows: NDArray[np.float64]) -> int:
    return int(np.linalg.matrix_rank(rows, tol=_RANK_TOLERANCE))


def airframe_problems(config: BenchConfig, vehicle: Vehicle, settings: Located) -> list[Problem]:
    """Report a plane or VTOL that the autopilot cannot fly, or rotors that it cannot be given."""
    autopilot = config.autopilot
    if vtol.is_vtol(vehicle):
        if not autopilot.profile.flies_vtols:
            return [_not_flown(config, vehicle, settings, "VTOL", [n for n, p in PROFILES.items() if p.flies_vtols])]
        if control_problems(vehicle, settings):
            return []  # told already
        facts = vtol_facts(vehicle)
        if facts.kind not in autopilot.profile.vtol_kinds:
            able = [n for n, p in PROFILES.items() if p.flies_vtols and facts.kind in p.vtol_kinds]
            return [_not_flown(config, vehicle, settings, facts.kind, able)]
        misfits = autopilot.profile.vehicle_misfits(autopilot, facts)
    elif fixed_wing.is_plane(vehicle):
        if not autopilot.profile.flies_planes:
            return [_not_flown(config, vehicle, settings, "plane", [n for n, p in PROFILES.items() if p.flies_planes])]
        if wing_problems(vehicle, settings):
            return []  # told already
        misfits = autopilot.profile.vehicle_misfits(autopilot, fixed_wing_facts(vehicle))
    elif multirotor.unfit(vehicle) is not None:
        return []
    else:
        misfits = autopilot.profile.vehicle_misfits(autopilot, multirotor_facts(vehicle))
    return [at(settings, misfit.place, misfit.message, misfit.hint) for misfit in misfits]


def _not_flown(config: BenchConfig, vehicle: Vehicle, settings: Located, what: str, able: list[str]) -> Problem:
    kind = config.autopilot.kind
    message = f"{vehicle.name!r} is a {what}, which an autopilot of kind {kind!r} cannot fly here"
    hint = f"kinds that fly {what}s: {', '.join(able)}" if able else f"no kind of autopilot flies {what}s yet"
    return at(settings, ("vehicle",), message, hint)
