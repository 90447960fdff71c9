"""Section of a wing for panels: slopes, stall, and the effect of a flap. Equations: sim/native/forces/panels.hpp."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Annotated, NamedTuple

import numpy as np
import pydantic
from numpy.typing import NDArray
from pydantic import Field

from signals._kernel import det_atan2
from signals.documents.validate import StrictModel

_SINES = np.arange(0.0, 0.5, 0.0005)  # of the angles among which the greatest lift is looked for: to 30 degrees
_NARROWEST, _WIDEST = 0.03, 0.6


class Airfoil(StrictModel):
    """Coefficients of a wing's section, without the effects of its finite span, which the panels add."""

    lift_slope_per_rad: Annotated[float, Field(ge=2.0, le=8.0)] = 6.0  # estimate for small wings; thin airfoil 2 pi
    zero_lift_deg: Annotated[float, Field(ge=-15.0, le=15.0)] = 0.0
    cl_max: Annotated[float, Field(ge=0.3, le=3.0)]
    cl_min: Annotated[float, Field(ge=-3.0, le=-0.3)]
    cd0: Annotated[float, Field(gt=0.0, le=0.5)]
    cd_cl2: Annotated[float, Field(ge=0.0, le=0.5)] = 0.0  # of the profile drag, with the lift's square
    cm0: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0  # about the quarter chord

    @pydantic.model_validator(mode="after")
    def _stalls(self) -> Airfoil:
        stall_of(self.lift_slope_per_rad, self.cl_max, self.cl_min, 1.2)
        return self


class Stall(NamedTuple):
    """Middle and half of the width of attached flow, in the sine of the angle to the zero-lift line."""

    middle: float
    half_width: float


def plate_drag(aspect_ratio: float) -> float:
    """Return the drag coefficient of a wing across the flow (Viterna and Corrigan, NASA CP-2230, 1982)."""
    return min(2.01, 1.11 + 0.018 * aspect_ratio)


def lift_of(sines: NDArray[np.float64], slope: float, stall: Stall, plate: float) -> NDArray[np.float64]:
    """Return C_l at the sine of the angle to the zero-lift line, in flow from ahead."""
    cosines = np.sqrt(1.0 - sines * sines)
    off = (sines - stall.middle) / stall.half_width
    off2 = off * off
    off4 = off2 * off2
    share = 0.25 * (1.0 + cosines) * (1.0 + cosines) * (2.0 - cosines) / (1.0 + off4 * off4)
    normal = plate * sines / (0.56 + 0.44 * np.sqrt(sines * sines + 0.0025))
    return np.asarray(share * slope * sines + (1.0 - share) * normal * cosines)


@lru_cache(maxsize=256)
def stall_of(slope: float, cl_max: float, cl_min: float, plate: float) -> Stall:
    """Return the stall at which a section has its greatest and least lift. Raises ValueError if it can have none."""
    upper = lower = 0.3
    for _ in range(8):  # each side moves the other a little
        upper = _edge(slope, cl_max, lower, plate, "cl_max", cl_max)
        lower = _edge(slope, -cl_min, upper, plate, "cl_min", cl_min)
    return Stall(0.5 * (upper - lower), 0.5 * (upper + lower))


def _edge(slope: float, peak: float, other: float, plate: float, key: str, given: float) -> float:
    """Return the sine at which half of the flow is attached on one side, `other` being that of the other side."""
    low, high = _NARROWEST, _WIDEST
    for _ in range(48):
        edge = 0.5 * (low + high)
        stall = Stall(0.5 * (edge - other), 0.5 * (edge + other))
        if float(lift_of(_SINES, slope, stall, plate).max()) < peak:
            low = edge
        else:
            high = edge
    if low == _NARROWEST or high == _WIDEST:
        raise ValueError(f"{key} {given:g}: a section with a slope of {slope:g} per rad cannot stall there")
    return 0.5 * (low + high)


class Flap(NamedTuple):
    """Effect of a flap by thin airfoil theory, per radian of deflection."""

    angle: float  # tau: change of the angle of zero lift
    moment: float  # change of C_m about the quarter chord


def flap_of(chord_ratio: float) -> Flap:
    """Return the effect of a flap that takes this share of the chord.

    k the angle of the hinge, cos k = 2 E - 1:  tau = 1 - (k - sin k) / pi,  C_m = -sin k (1 - cos k) / 2
    """
    cosine = 2.0 * chord_ratio - 1.0
    sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
    hinge = det_atan2(sine, cosine)
    return Flap(1.0 - (hinge - sine) / math.pi, -0.5 * sine * (1.0 - cosine))
