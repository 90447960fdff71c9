"""The vehicle file's content with the fitted numbers in place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.apps.identify.fit import parameters as at
from sim.physics.forces.air_moment import AirMoment
from sim.physics.vehicle import Vehicle

_NEGLIGIBLE = 1e-12


def fitted_vehicle(vehicle: Vehicle, unknowns: Sequence[at.Unknown], s: NDArray[np.float64]) -> Vehicle:
    """Return a vehicle with the unknowns at s. Drag and the like below zero, which a file cannot say, becomes zero.

    The file's origin is its centre of mass: an offset of that moves rotors, feet and hull instead.
    """
    p = at.values(unknowns[: at.VEHICLE_COUNT], s[: at.VEHICLE_COUNT])

    def positive(i: int) -> float:
        return max(float(p[i]), 0.0)

    ix, iy, iz = (float(x) for x in p[at.INERTIA : at.INERTIA + 3])
    most = 0.999
    ix, iy, iz = min(ix, most * (iy + iz)), min(iy, most * (ix + iz)), min(iz, most * (ix + iy))
    offset = p[at.CENTRE : at.CENTRE + 3]

    def moved(point: Sequence[float]) -> tuple[float, ...]:
        return tuple(float(x - o) for x, o in zip(point, offset, strict=True))

    constants: dict[str, Any] = {
        "thrust_coefficient_n_per_radps2": float(p[at.THRUST]),
        "moment_ratio_m": float(p[at.MOMENT_RATIO]),
        "inertia_kgm2": float(p[at.ROTOR_INERTIA]),
        "drag_kg_per_rad": positive(at.ROTOR_DRAG),
        "axial_drag_kg_per_rad": positive(at.AXIAL_DRAG),
        "time_constant_up_s": float(np.clip(p[at.TAU_UP], 1e-3, 1.0)),
        "time_constant_down_s": float(np.clip(p[at.TAU_DOWN], 1e-3, 1.0)),
        "thrust_model_factor": float(np.clip(p[at.SHAPE], 0.0, 1.0)),
        "blade_element": None,
        "wind_tunnel": None,
        "motor": None,  # the first order lag was fitted
    }
    forces = [force for force in vehicle.forces if not isinstance(force, AirMoment)]
    about_x, about_y = (float(x) for x in p[at.AIR_MOMENT : at.AIR_MOMENT + 2])
    if max(abs(about_x), abs(about_y)) > _NEGLIGIBLE:
        forces.append(AirMoment(kind="air_moment", about_x_ns=about_x, about_y_ns=about_y))

    def spheres(given: Sequence[Any]) -> tuple[Any, ...]:
        return tuple(x.model_copy(update={"position_m": moved(x.position_m)}) for x in given)

    changed = vehicle.model_copy(
        update={
            "inertia_kgm2": (ix, iy, iz),
            "rotor_model": "quadratic",  # the model that was fitted
            "rotor_constants": vehicle.rotor_constants.model_copy(update=constants),
            "rotors": spheres(vehicle.rotors),
            "feet": spheres(vehicle.feet),
            "hull": spheres(vehicle.hull),
            "body_drag_linear_n_per_mps": tuple(positive(at.LINEAR_DRAG + i) for i in range(3)),
            "body_drag_quadratic_n_per_m2ps2": tuple(positive(at.QUADRATIC_DRAG + i) for i in range(3)),
            "forces": tuple(forces),
        }
    )
    return Vehicle.model_validate(changed.model_dump())
