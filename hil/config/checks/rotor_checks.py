"""Checks that the rotors of a vehicle can control it, and that the autopilot can be given them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hil.config.airframe_facts import is_plane
from hil.config.multirotor_facts import multirotor_facts
from hil.config.schema import BenchConfig
from signals.documents.validate import Located, at
from signals.errors import Problem
from sim.physics import multirotor
from sim.physics.vehicle import Vehicle

_AXES = ("roll", "pitch", "yaw", "thrust")
_RANK_TOLERANCE = 1e-6  # of the greatest entry of each axis


def control_problems(vehicle: Vehicle, file: Located) -> list[Problem]:
    """Report a vehicle whose rotors cannot lift it, or cannot give roll, pitch, yaw and thrust independently."""
    unfit = multirotor.unfit(vehicle)
    if vehicle.has_wings and unfit is not None:
        from sim.physics import fixed_wing  # loads SciPy's solvers

        unfit = fixed_wing.unfit(vehicle)
        if unfit is None:
            return []
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
    """Report rotors that the autopilot cannot be given."""
    autopilot = config.autopilot
    if is_plane(vehicle):
        from hil.config.fixed_wing_facts import fixed_wing_facts
        from sim.physics.fixed_wing import NoTrimError

        try:
            facts = fixed_wing_facts(vehicle)
        except NoTrimError as error:
            return [at(settings, ("vehicle",), f"cannot fly level: {error}")]
        misfits = autopilot.profile.vehicle_misfits(autopilot, facts)
    elif multirotor.unfit(vehicle) is not None:
        return []
    else:
        misfits = autopilot.profile.vehicle_misfits(autopilot, multirotor_facts(vehicle))
    return [at(settings, misfit.place, misfit.message, misfit.hint) for misfit in misfits]
