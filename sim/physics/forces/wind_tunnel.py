"""Parameters of a rotor by wind-tunnel coefficients over the advance ratio.

Equation: sim/native/forces/tunnel_rotors.hpp.

Static thrust and torque are those of `RotorConstants`, k O^2 and m_ratio k O^2, at the density of the air for which the
file holds: of the coefficients only the ratios to the first of them count. A propeller with the diameter D and the
static C_T has k = C_T rho D^4 / (4 pi^2), one with C_P the moment ratio C_P D / (2 pi C_T).
"""

from __future__ import annotations

from typing import Annotated

import pydantic
from pydantic import Field

from signals.documents.validate import StrictModel
from sim import _kernels
from sim.scene.atmosphere import SEA_LEVEL_KGPM3

_Coefficient = Annotated[float, Field(ge=-10.0, le=10.0)]
_Static = Annotated[float, Field(gt=0.0, le=10.0)]
_Falling = Annotated[float, Field(ge=-10.0, le=0.0)]


class WindTunnel(StrictModel):
    """Coefficients of C_T = a_0 + a_1 J + a_2 J sqrt(J^2 + 0.01) and C_P = b_0 + b_1 J + b_2 J^2.

    J = u / (n D) with the flow u along the rotor's axis. a_1 and a_2 must not be above 0, or a rotor would have more
    thrust the faster it flies; nor b_2, or the flow would turn a rotor backwards, which the model does not hold.
    """

    thrust_coefficients: tuple[_Static, _Falling, _Falling]
    power_coefficients: tuple[_Static, _Coefficient, _Falling]
    air_density_kgpm3: Annotated[float, Field(gt=0.01, le=5.0)] = SEA_LEVEL_KGPM3  # for which the file's constants hold

    @pydantic.field_validator("thrust_coefficients")
    @classmethod
    def _falls(cls, values: tuple[float, float, float]) -> tuple[float, float, float]:
        if values[1] == values[2] == 0.0:
            raise ValueError("the thrust must fall with the advance ratio: one of the last two must be below 0")
        return values

    def force(self, rotors: _kernels.Rotors) -> _kernels.TunnelRotors:
        """Return rotors with these coefficients, and everything else of `rotors`."""
        a, b = self.thrust_coefficients, self.power_coefficients
        return _kernels.TunnelRotors(
            rotors,
            thrust_slope=a[1] / a[0],
            thrust_bend=a[2] / a[0],
            torque_slope=b[1] / b[0],
            torque_bend=b[2] / b[0],
            density_ratio=SEA_LEVEL_KGPM3 / self.air_density_kgpm3,
        )
