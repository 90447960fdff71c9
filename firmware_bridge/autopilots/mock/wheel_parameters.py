"""Parameters that tell the mock of a plane's steered and braked wheels, by the surfaces' CA_SV_CSn_*.

CA_SV_CSn_TYPE 16 is PX4's steering wheel, without torque in the air; the sign of CA_SV_CSn_TRQ_Y is that of the turn at
a positive command, to the right above 0. PX4 knows no wheel brakes: type 20 is the mock's own.
"""

from __future__ import annotations

from firmware_bridge.autopilots.installation import FixedWing
from firmware_bridge.mock_pixhawk.plane.surfaces import STEERING_WHEEL, WHEEL_BRAKE


def wheel_parameters(vehicle: FixedWing) -> dict[str, float]:
    """Return CA_SV_CSn_* of the wheels, and the count of all with the surfaces."""
    first, count = len(vehicle.rotors), len(vehicle.surfaces)
    values: dict[str, float] = {}
    for command, kind, turn in ((vehicle.steering, STEERING_WHEEL, -1.0), (vehicle.brake, WHEEL_BRAKE, 0.0)):
        if command is None:
            continue
        slot = command - first
        count = max(count, slot + 1)
        values |= {f"CA_SV_CS{slot}_TYPE": float(kind), f"CA_SV_CS{slot}_TRQ_Y": turn}
    return values | {"CA_SV_CS_COUNT": float(count)} if values else {}
