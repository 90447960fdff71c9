"""The vehicle of a bench as its autopilot is told of it: plain values."""

from __future__ import annotations

from firmware_bridge.autopilots.installation import Multirotor, Rotor
from sim.physics import multirotor
from sim.physics.vehicle import Vehicle


def multirotor_facts(vehicle: Vehicle, density_ratio: float = 1.0) -> Multirotor:
    """Return the facts about a vehicle that `multirotor.unfit` finds fit.

    `density_ratio`: density of the air where it flies over that of its file.
    """
    group = vehicle.leading_group
    c = vehicle.rotor_constants if group is None else group.constants
    return Multirotor(
        name=vehicle.name,
        mass_kg=vehicle.mass_kg,
        inertia_kgm2=vehicle.inertia_kgm2,
        rotors=[
            Rotor(rotor.position_m, rotor.axis, rotor.spin.sign, share, of.moment_ratio_m)
            for share, rotor, of in zip(vehicle.thrust_shares, vehicle.rotors, vehicle.constants_of_rotors, strict=True)
        ],
        moment_ratio_m=c.moment_ratio_m,
        time_constant_s=max(max(of.time_constant_up_s, of.time_constant_down_s) for of in vehicle.constants_of_rotors),
        thrust_model_factor=multirotor.thrust_model_factor(vehicle, density_ratio),
        hover_control=multirotor.hover_control(vehicle, density_ratio),
        full_effect=multirotor.effectiveness(vehicle)[[3, 4, 5, 2]] * multirotor.full_thrusts_n(vehicle, density_ratio),
    )
