"""Switches of the vehicle model's optional parts.

Each leaves the vehicle file's numbers alone and sets the part to nothing; a part that is off costs nothing. Motor
lag, gyroscopic torque and drag have no switch: their coefficients in the vehicle file can be zero.
"""

from __future__ import annotations

from hil.signals.documents.validate import StrictModel


class Effects(StrictModel):
    """Which optional parts of the model are at work."""

    ground_effect: bool = True  # more thrust near the ground
    descent_loss: bool = True  # less thrust in the vortex ring state
    battery: bool = False  # speed limit sags with the battery's voltage; needs a vehicle with a battery
