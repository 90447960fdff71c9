"""The vehicle file's content with the fitted numbers in place."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.apps.identify.fit import parameters as at
from sim.physics.forces.air_moment import AirMoment
from sim.physics.forces.blade_element import BladeElement, lumps_of
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
        "voltage_slope": float(np.clip(p[at.VOLTAGE], 0.0, 2.0)) if vehicle.battery else 1.0,
        "thrust_model_factor": float(np.clip(p[at.SHAPE], 0.0, 1.0)),
        "motor": None,  # the first order lag was fitted
    }
    if vehicle.rotor_constants.ground_radius_m is not None or abs(s[at.GROUND_RADIUS]) > _NEGLIGIBLE:
        constants["ground_radius_m"] = float(np.clip(p[at.GROUND_RADIUS], 1.1e-3, 20.0))
    blades = vehicle.rotor_constants.blade_element
    if vehicle.rotor_model == "blade_element" and blades is not None:
        constants["blade_element"] = _fitted_blades(blades, p)
        least_m = blades.induced_power_factor * _induced_per_speed_m(vehicle, float(p[at.THRUST]))
        constants["moment_ratio_m"] = max(float(p[at.MOMENT_RATIO]), (1.0 + 1e-9) * least_m)
    else:
        constants |= {"blade_element": None, "wind_tunnel": None}  # their constants would contradict the fitted ones
        constants["ground_thrust_ratio"] = float(np.clip(p[at.GROUND], 1.0, 4.0))
    forces = [force for force in vehicle.forces if not isinstance(force, AirMoment)]
    about_x, about_y = (float(x) for x in p[at.AIR_MOMENT : at.AIR_MOMENT + 2])
    if max(abs(about_x), abs(about_y)) > _NEGLIGIBLE:
        forces.append(AirMoment(kind="air_moment", about_x_ns=about_x, about_y_ns=about_y))

    def spheres(given: Sequence[Any]) -> tuple[Any, ...]:
        return tuple(x.model_copy(update={"position_m": moved(x.position_m)}) for x in given)

    changed = vehicle.model_copy(
        update={
            "inertia_kgm2": (ix, iy, iz),
            "rotor_model": "blade_element" if vehicle.rotor_model == "blade_element" else "quadratic",
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


def _fitted_blades(blades: BladeElement, p: NDArray[np.float64]) -> BladeElement:
    """Return the blades with the lumps that were fitted; the loss of thrust with inflow is given as itself."""
    ground = blades.ground_inflow_loss
    return blades.model_copy(
        update={
            "inflow_thrust_kg_per_rad": float(p[at.INFLOW]),
            "zero_thrust_advance_ratio": None,
            "blades": None,
            "hub_moment_share": float(np.clip(p[at.HUB_SHARE], 0.0, 1.0)),
            "ground_inflow_loss": float(np.clip(p[at.GROUND], 0.0, 0.95)) if ground > 0.0 else ground,
        }
    )


def _induced_per_speed_m(vehicle: Vehicle, k: float) -> float:
    """Return sqrt(kappa): induced velocity over rotor speed in hover."""
    c, blades = vehicle.rotor_constants, vehicle.rotor_constants.blade_element
    assert blades is not None
    return math.sqrt(k / lumps_of(c, blades).disc_kg_per_m)
