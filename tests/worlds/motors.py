"""Shipped vehicles with motors in place of the first order lag, and with wind-tunnel coefficients."""

from __future__ import annotations

import math
from typing import Any

from sim.physics.vehicle import Vehicle, load_vehicle

# APC Slow Flyer 10 x 4.7 in, UIUC propeller database, 5000 to 6500 rev/min: see docs/physics.md.
SLOW_FLYER = {"thrust_coefficients": (0.1300, -0.1063, -0.1365), "power_coefficients": (0.0530, -0.0026, -0.0714)}


def with_motors(name: str | Vehicle, *, model: str | None = None, **changes: Any) -> Vehicle:
    """Return a vehicle whose motors reach its greatest speed at full duty, a fifth of the voltage on resistance."""
    vehicle = load_vehicle(name) if isinstance(name, str) else name
    c = vehicle.rotor_constants
    volts = 14.8 if vehicle.battery is None else vehicle.battery.nominal_voltage_v
    K = 0.8 * volts / c.max_speed_radps
    current = c.moment_ratio_m * c.thrust_coefficient_n_per_radps2 * c.max_speed_radps**2 / K
    motor = {
        "kv_rpm_per_v": 60.0 / (2.0 * math.pi * K),
        "resistance_ohm": 0.2 * volts / (1.05 * current),
        "no_load_current_a": 0.05 * current,
        "nominal_voltage_v": volts,
    }
    data = vehicle.model_dump()
    data["rotor_constants"] |= {"motor": motor | changes, "wind_tunnel": SLOW_FLYER}
    data["rotor_constants"]["inertia_kgm2"] = max(c.inertia_kgm2, 2e-5)
    data["rotor_model"] = model or vehicle.rotor_model
    return Vehicle.model_validate(data)


def with_tunnel(name: str) -> Vehicle:
    """Return a shipped vehicle with wind-tunnel coefficients and the lag of its file."""
    data = load_vehicle(name).model_dump()
    data["rotor_constants"] |= {"wind_tunnel": SLOW_FLYER}
    return Vehicle.model_validate(data | {"rotor_model": "wind_tunnel"})
