"""Haze and fog, given by the meteorological visibility.

Visibility V is the range at which a black object has 2 % of contrast against the sky at the horizon (Koschmieder 1924):

    exp(-beta V) = 0.02,   beta = 3.912 / V

beta is the extinction of visible light and, for droplets far larger than the wavelength, of a LiDAR's light as well. It
is uniform up to the height `HAZE_M`, with clear air above. Radar at 60 GHz loses less than 0.02 dB over 10 m even in
thick fog (Recommendation ITU-R P.840); the model leaves it unchanged.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from signals.documents.validate import StrictModel

CONTRAST_EXPONENT = 3.912  # -ln 0.02
HAZE_M = 300.0  # typical thickness of a layer of fog or of the haze over a city


class Weather(StrictModel):
    """Visibility of the air; rain and snow are not modelled."""

    visibility_m: Annotated[float, Field(ge=10.0, le=1e6)] | None = None  # null: perfectly clear

    @property
    def extinction_per_m(self) -> float:
        """Extinction beta; 0 in clear air."""
        return 0.0 if self.visibility_m is None else CONTRAST_EXPONENT / self.visibility_m
