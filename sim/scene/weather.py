"""Weather: haze and fog by the meteorological visibility, rain and snow by their rates.

Visibility V is the range at which a black object has 2 % of contrast against the sky at the horizon (Koschmieder 1924):

    exp(-beta V) = 0.02,   beta = 3.912 / V

beta is the extinction of visible light and, for droplets far larger than the wavelength, of a LiDAR's light as well. It
is uniform up to the height `HAZE_M`, with clear air above. Rain and snow add their own (sim/scene/precipitation.py).
Radar at 60 GHz loses less than 0.02 dB over 10 m even in thick fog (Recommendation ITU-R P.840); the model leaves it
unchanged.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from signals.documents.validate import StrictModel
from sim.scene.precipitation import Precipitation, rain, snow

CONTRAST_EXPONENT = 3.912  # -ln 0.02
NEAREST_VISIBILITY_M, MOST_RAIN_MM_PER_H, MOST_SNOW_MM_PER_H = 10.0, 200.0, 10.0
HAZE_M = 300.0  # typical thickness of a layer of fog or of the haze over a city


class Weather(StrictModel):
    """Visibility of the air, rain and snow."""

    # Of haze and fog alone; null: clear.
    visibility_m: Annotated[float, Field(ge=NEAREST_VISIBILITY_M, le=1e6)] | None = None
    # Drizzle 1, a shower 10, a cloudburst 100.
    rain_mm_per_h: Annotated[float, Field(ge=0.0, le=MOST_RAIN_MM_PER_H)] = 0.0
    # Dry snow, as water: about 1 cm of snow per mm.
    snow_mm_per_h: Annotated[float, Field(ge=0.0, le=MOST_SNOW_MM_PER_H)] = 0.0

    @model_validator(mode="after")
    def _one_kind(self) -> Weather:
        if self.rain_mm_per_h > 0.0 and self.snow_mm_per_h > 0.0:
            raise ValueError("rain and snow at once are not modelled; give rain_mm_per_h or snow_mm_per_h")
        return self

    @property
    def precipitation(self) -> Precipitation | None:
        """Rain or snow; None if there is none."""
        if self.rain_mm_per_h > 0.0:
            return rain(self.rain_mm_per_h)
        return snow(self.snow_mm_per_h) if self.snow_mm_per_h > 0.0 else None

    @property
    def extinction_per_m(self) -> float:
        """Extinction beta; 0 in clear air."""
        falling = self.precipitation
        return self.haze_per_m if falling is None else self.haze_per_m + falling.extinction_per_m

    @property
    def haze_per_m(self) -> float:
        """Extinction by haze and fog alone."""
        return 0.0 if self.visibility_m is None else CONTRAST_EXPONENT / self.visibility_m
