"""Vibration of a vehicle by its rotors, as its file declares it or as an *estimate* from its size.

    imbalance       F = b O^2, turning with the rotor in its plane; b the residual imbalance [kg m]
    blade passing   F = s_k T along the rotor's axis at k times blades times its speed, T = k_T O^2 its thrust
    broadband       RMS of specific force and rate between two frequencies, growing with the mean O^2
    mount           damped spring between airframe and flight controller; none: rigid

How a sensor feels it: sim/native/rotor_vibration.hpp. It is a motion of micrometres and not part of the vehicle's true
state: b / m, its amplitude, is below 5 um for every shipped vehicle.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from signals.documents.validate import StrictModel
from signals.units import STANDARD_GRAVITY_MPS2

# Estimate: a propeller as it comes out of the bag has its centre of mass this far from the axis. At 770 rad/s that is
# balance grade G 385 of ISO 21940-11; a balanced one reaches a tenth of it.
OFFSET_M = 0.5e-3
# Estimate: RMS of the broadband part in hover, in shares of g along x, y and z.
BROADBAND_G = (0.05, 0.05, 0.1)
BROADBAND_GYRO_RADPS = 0.02  # estimate

Share = Annotated[float, Field(ge=0.0, le=0.5)]
Force = Annotated[float, Field(ge=0.0, le=200.0)]
Rate = Annotated[float, Field(ge=0.0, le=20.0)]
Frequency = Annotated[float, Field(gt=0.0, le=10_000.0)]


class Mount(StrictModel):
    """Isolator of the flight controller: transmissibility of a damped oscillator that is shaken at its base."""

    frequency_hz: Frequency
    damping_ratio: Annotated[float, Field(gt=0.0, le=2.0)]


class Vibration(StrictModel):
    """Sizes of the vibration, in hover where they depend on the rotors' speed."""

    imbalance_kgm: Annotated[float, Field(ge=0.0, le=0.1)]  # of each rotor
    blades: Annotated[int, Field(ge=2, le=8)] = 2
    blade_pass_thrust: Annotated[tuple[Share, ...], Field(max_length=4)] = (0.03, 0.01)  # s_1, s_2 ...; estimate
    broadband_accel_mps2: tuple[Force, Force, Force] = (0.0, 0.0, 0.0)  # RMS
    broadband_gyro_radps: tuple[Rate, Rate, Rate] = (0.0, 0.0, 0.0)  # RMS
    broadband_hz: tuple[Frequency, Frequency] = (10.0, 1000.0)
    mount: Mount | None = None

    @model_validator(mode="after")
    def _band(self) -> Vibration:
        low, high = self.broadband_hz
        if not high > low:
            raise ValueError(f"broadband_hz {[low, high]} must begin below its end")
        return self


def estimate(rotor_inertia_kgm2: float, radius_m: float) -> Vibration:
    """Return the estimate for a vehicle whose file says nothing: blades as uniform rods, m = 3 J / R^2, b = m OFFSET_M.

    J contains the bell of the motor, which turns with the blades and has an imbalance, too.
    """
    gx, gy, gz = BROADBAND_G
    g, rate = STANDARD_GRAVITY_MPS2, BROADBAND_GYRO_RADPS
    return Vibration(
        imbalance_kgm=3.0 * rotor_inertia_kgm2 / (radius_m * radius_m) * OFFSET_M,
        broadband_accel_mps2=(gx * g, gy * g, gz * g),
        broadband_gyro_radps=(rate, rate, rate),
    )
