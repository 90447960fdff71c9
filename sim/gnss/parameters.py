"""Parameters of a GNSS receiver that sees the sky: what the part is like, and what a bench declares."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from signals.documents.validate import StrictModel
from sim.gnss.gps_time import DEFAULT_UTC, gps_seconds
from sim.gnss.orbit import Orbit
from sim.gnss.systems import SystemName
from sim.scene.light import Light, Utc, time_of

Seconds = Annotated[float, Field(ge=0.0, le=1e5)]
Level = Annotated[float, Field(ge=0.0, le=60.0)]  # dB-Hz


def _each_once(systems: Sequence[SystemName]) -> Sequence[SystemName]:
    """Raise ValueError for a system that is there twice: its satellites would count twice."""
    twice = [name for i, name in enumerate(systems) if name in systems[:i]]
    if twice:
        raise ValueError(f"holds {twice[0]!r} twice")
    return systems


Systems = Annotated[tuple[SystemName, ...], Field(min_length=1), AfterValidator(_each_once)]


class ReceiverParameters(StrictModel):
    """Figures of a receiver that count with `sky` only; the defaults are typical of a small one."""

    systems: Systems = ("gps", "galileo", "glonass")
    zenith_cn0_dbhz: Level = 48.0  # of a satellite at the antenna's zenith, in the open
    tracking_dbhz: Level = 22.0  # a signal below is lost
    acquisition_dbhz: Level = 28.0  # a signal is found from here on
    correlator_spacing_chips: Annotated[float, Field(gt=0.0, le=1.0)] = 0.1  # early to late
    cold_start_s: Seconds = 26.0  # nothing known
    warm_start_s: Seconds = 25.0  # almanac, time and place known, no ephemeris
    hot_start_s: Seconds = 1.0  # ephemeris known; also after a long loss
    reacquisition_s: Seconds = 1.0  # of one satellite after a short loss
    standalone_error_m: Annotated[float, Field(ge=0.0, le=100.0)] = 1.3  # of each horizontal axis without corrections
    rtk_float_error_m: Annotated[float, Field(ge=0.0, le=100.0)] = 0.3
    rtk_start_s: Seconds = 10.0  # from conditions for a fixed solution to the solution

    @model_validator(mode="after")
    def _keeps_what_it_finds(self) -> Self:
        if self.acquisition_dbhz < self.tracking_dbhz:
            raise ValueError(
                f"acquisition_dbhz {self.acquisition_dbhz:g} is below tracking_dbhz {self.tracking_dbhz:g}: a signal "
                "between them would be found and lost in turns"
            )
        return self


class SkyParameters(StrictModel):
    """Option `sky` of a `gps`: satellites on their orbits, seen past the scene."""

    utc: Utc | None = None  # time at the start of the run; null: that of the scene's light, else 2026-01-01T12:00:00Z
    almanac: str | None = None  # YUMA or SEM file of GPS, relative to the file that names it
    orbits: tuple[Orbit, ...] = ()  # of GPS; what was read from the almanac
    systems: Systems | None = None  # null: those of the receiver
    gps_satellites: Literal[24, 32] = 32  # of the nominal constellation
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0  # turns the nominal constellations; 0: as published
    elevation_mask_deg: Annotated[float, Field(ge=0.0, le=60.0)] = 5.0
    start: Literal["tracking", "hot", "warm", "cold"] = "tracking"  # tracking: it was on long before the run
    reflections: bool = True
    smallest_face_m2: Annotated[float, Field(ge=0.1, le=1e4)] = 4.0  # of the map's faces that reflect
    foliage_db_per_m: Annotated[float, Field(ge=0.0, le=10.0)] = 0.3
    smoothing_s: Annotated[float, Field(ge=0.0, le=1000.0)] = 2.0  # time constant of the receiver's filter of position
    residual_limit_m: Annotated[float, Field(gt=0.0, le=1e4)] = 15.0  # a satellite beyond is left out of the fix
    skip_clear_sky: bool = True  # cast no ray while nothing of the scene is above the mask


def start_gps_s(sky: SkyParameters, light: Light) -> float:
    """Return the GPS time [s] at which a run begins: that of the sky, else that of the scene's light."""
    utc = sky.utc or light.utc
    return gps_seconds(DEFAULT_UTC if utc is None else time_of(utc))
