"""Checks that the rotors of a vehicle can control it, and that the autopilot can be given them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firmware_bridge.links.ardupilot.frames import Frame, frame_names, frame_of
from hil.config.schema import BenchConfig
from signals.documents.validate import Located, at
from signals.errors import Problem
from sim.physics import multirotor
from sim.physics.vehicle import Vehicle

_AXES = ("roll", "pitch", "yaw", "thrust")
_RANK_TOLERANCE = 1e-6  # of the greatest entry of each axis
_LEAST_UPRIGHT = 0.9  # vertical part of an axis: the rotors of ArduPilot's frames are upright


def control_problems(vehicle: Vehicle, file: Located) -> list[Problem]:
    """Report a vehicle whose rotors cannot lift it, or cannot give roll, pitch, yaw and thrust independently."""
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


def ardupilot_frame(vehicle: Vehicle) -> Frame | None:
    """Return ArduCopter's frame for the rotors of the vehicle, None if it has none."""
    if any(rotor.axis[2] < _LEAST_UPRIGHT for rotor in vehicle.rotors):
        return None
    return frame_of([(rotor.position_m[0], rotor.position_m[1], rotor.spin.sign) for rotor in vehicle.rotors])


def airframe_problems(config: BenchConfig, vehicle: Vehicle, settings: Located) -> list[Problem]:
    """Report rotors that the autopilot cannot be given."""
    autopilot, count = config.autopilot, len(vehicle.rotors)
    if autopilot.kind == "ardupilot_sitl" or (autopilot.kind == "ardupilot_eahrs" and autopilot.binary is not None):
        if ardupilot_frame(vehicle) is None:
            message = f"has rotors for which ArduCopter has no frame: {vehicle.name!r} with {count}"
            hint = f"of so many motors it has {', '.join(frame_names(count)) or 'none'}, with upright rotors"
            return [at(settings, ("vehicle",), message, hint)]
    elif autopilot.is_mock and autopilot.airframe is not None and count != 4:
        message = f"is {autopilot.airframe!r}, a quadrotor, but the vehicle {vehicle.name!r} has {count} rotors"
        return [at(settings, ("autopilot", "airframe"), message, "leave it out: the vehicle's rotors are then taken")]
    return []
