"""Antennas of a radar: positions of its transmitters and receivers, and their patterns.

For a unit direction d = (x, y, z) in R (x forward, y left, z up), and the half-power beamwidths a of azimuth and e of
elevation:

    G(d) = G_0 (x / sqrt(x^2 + y^2))^p (x / sqrt(x^2 + z^2))^q    for x > 0, else 0
    p = ln(1/2) / ln(cos(a / 2)),   q = ln(1/2) / ln(cos(e / 2))

In either principal plane the gain is a power of the cosine, and half of G_0 at half the beamwidth off the axis. This is
the main lobe of a small patch antenna, without side lobes; measured cuts have them (antenna_cut.py). All receivers have
the same pattern, and all transmitters, but for differences of single ones (element_cuts.py).

A pair of transmitter p and receiver k is a channel of the virtual array, at t_p + r_k (Richards, Fundamentals of Radar
Signal Processing, 2nd ed., sec. 9.8). Several transmitters are told apart

    tdm   in time: chirp m is that of transmitter m mod P
    ddm   in Doppler: all transmit in every chirp, transmitter p with the phase p m / D cycles, so that its echoes are
          displaced by p / D of the unambiguous speeds. D is `doppler_bands`; bands without a transmitter tell which
          band is the first
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from signals._kernel import det_cos, det_log, det_pow
from signals.documents.validate import StrictModel
from signals.samples import Vec3
from signals.units import RAD_PER_DEG
from sim._kernels import azimuth_elevation, cosine_pattern
from sim.radar import antenna_cut
from sim.radar.antenna_cut import Cut
from sim.radar.chirp import Chirp
from sim.radar.element_cuts import ElementCuts
from sim.radar.synthesis import MAX_RECEIVERS, MAX_TRANSMITTERS, ORIGIN
from sim.radar.virtual_array import VirtualArray

Float64 = NDArray[np.float64]

_HALF_RAD_PER_DEG = 0.5 * RAD_PER_DEG
_Beamwidth = Annotated[float, Field(ge=0.5, le=179.0)]
_FieldAngle = Annotated[float, Field(ge=0.0, le=90.0)]


class Pattern(StrictModel):
    """Gain of one antenna as a function of direction."""

    gain_dbi: Annotated[float, Field(ge=-30.0, le=60.0)]  # on the axis
    azimuth_beamwidth_deg: _Beamwidth  # full width at half of the power
    elevation_beamwidth_deg: _Beamwidth
    azimuth_cut: Cut | None = None  # rows of degrees and dB, in place of the beamwidth; sim/radar/antenna_cut.py
    elevation_cut: Cut | None = None

    @field_validator("azimuth_cut", "elevation_cut")
    @classmethod
    def _rising(cls, cut: tuple[tuple[float, float], ...] | None) -> tuple[tuple[float, float], ...] | None:
        problem = "" if cut is None else antenna_cut.problem_with(cut)
        if problem:
            raise ValueError(problem)
        return cut

    @property
    def axis_gain(self) -> float:
        """Gain on the axis as a ratio of powers."""
        return det_pow(10.0, 0.1 * self.gain_dbi)

    def share(self, direction_R: Float64) -> Float64:
        """Return the gain in unit directions (n, 3), relative to the axis, (n,)."""
        if self.azimuth_cut is not None or self.elevation_cut is not None:
            return self._share_by_cuts(direction_R)
        share = np.empty(len(direction_R))
        p, q = _exponent(self.azimuth_beamwidth_deg), _exponent(self.elevation_beamwidth_deg)
        cosine_pattern(np.ascontiguousarray(direction_R, np.float64), p, q, share)
        return share

    def _share_by_cuts(self, direction_R: Float64) -> Float64:
        """Return the product of both planes; a plane without a cut has its main lobe alone."""
        d = np.ascontiguousarray(direction_R, np.float64)
        azimuth, elevation, lobe = np.empty(len(d)), np.empty(len(d)), np.empty(len(d))
        azimuth_elevation(d, azimuth, elevation)
        p = 0.0 if self.azimuth_cut is not None else _exponent(self.azimuth_beamwidth_deg)
        q = 0.0 if self.elevation_cut is not None else _exponent(self.elevation_beamwidth_deg)
        share = np.ones(len(d))
        if p != 0.0 or q != 0.0:
            cosine_pattern(d, p, q, lobe)
            share = lobe
        for cut, angle in ((self.azimuth_cut, azimuth), (self.elevation_cut, elevation)):
            if cut is not None:
                share = share * antenna_cut.share(cut, angle)
        return share

    def gain(self, direction_R: Float64) -> Float64:
        """Return the gain in unit directions (n, 3) as ratios of powers, (n,)."""
        return self.axis_gain * self.share(direction_R)


class Antenna(StrictModel):
    """Transmitters and receivers."""

    rx_positions_m: tuple[Vec3, ...]  # in R, in the order of the channels
    tx: Pattern
    rx: Pattern
    tx_positions_m: tuple[Vec3, ...] = (ORIGIN,)  # in R, in the order in which they transmit
    # Differences of single transmitters and receivers to `tx` and `rx`, in the order of their positions.
    tx_cuts: tuple[ElementCuts, ...] | None = None
    rx_cuts: tuple[ElementCuts, ...] | None = None
    mimo: Literal["tdm", "ddm"] = "tdm"
    doppler_bands: Annotated[int, Field(ge=2, le=32)] | None = None  # with ddm; null: the number of transmitters
    # Greatest angles off the axis at which directions are to be unambiguous: azimuth, elevation. Null: not checked.
    field_deg: tuple[_FieldAngle, _FieldAngle] | None = None

    @field_validator("rx_positions_m")
    @classmethod
    def _check_receivers(cls, value: tuple[Vec3, ...]) -> tuple[Vec3, ...]:
        return _checked(value, "receiver", MAX_RECEIVERS)

    @field_validator("tx_positions_m")
    @classmethod
    def _check_transmitters(cls, value: tuple[Vec3, ...]) -> tuple[Vec3, ...]:
        return _checked(value, "transmitter", MAX_TRANSMITTERS)

    @model_validator(mode="after")
    def _bands_fit(self) -> Antenna:
        if self.doppler_bands is not None and self.mimo != "ddm":
            raise ValueError(f"doppler_bands is for mimo: ddm, not {self.mimo}")
        if self.doppler_bands is not None and self.doppler_bands < len(self.tx_positions_m):
            raise ValueError(
                f"doppler_bands {self.doppler_bands} are fewer than {len(self.tx_positions_m)} transmitters"
            )
        return self

    @model_validator(mode="after")
    def _cuts_fit(self) -> Antenna:
        for name, cuts, places in (
            ("tx_cuts", self.tx_cuts, self.tx_positions_m),
            ("rx_cuts", self.rx_cuts, self.rx_positions_m),
        ):
            if cuts is not None and len(cuts) != len(places):
                raise ValueError(f"{name} has {len(cuts)} elements; {name[:2]}_positions_m has {len(places)}")
            if cuts is not None and self.mimo == "ddm" and len(self.tx_positions_m) > 1:
                raise ValueError(f"{name} is for transmitters that take turns, not for mimo: ddm")
        return self

    @property
    def elements_differ(self) -> bool:
        """True if single transmitters or receivers have cuts of their own."""
        return self.tx_cuts is not None or self.rx_cuts is not None

    @property
    def array(self) -> VirtualArray:
        """The virtual array."""
        bands = 0 if self.mimo == "tdm" else self.doppler_bands or len(self.tx_positions_m)
        return VirtualArray(self.rx_positions_m, self.tx_positions_m, bands)

    def problems_with(self, chirp: Chirp) -> list[str]:
        """Return why the array does not fit the chirp; empty if it does."""
        problems, transmitters = [], len(self.tx_positions_m)
        if self.mimo == "tdm" and (chirp.chirps % transmitters or chirp.chirps < 2 * transmitters):
            problems.append(
                f"chirp.chirps must be a multiple of the {transmitters} transmitters that take turns, "
                f"{2 * transmitters} at least, not {chirp.chirps}"
            )
        if self.mimo == "ddm" and self.array.doppler_bands > chirp.chirps // 2:
            problems.append(f"chirp.chirps {chirp.chirps} are fewer than two for each Doppler band")
        ambiguous = "" if self.field_deg is None else self.array.problem_with_field(self.field_deg, chirp.wavelength_m)
        if ambiguous:
            problems.append(f"antenna {ambiguous}")
        return problems

    def channels(self, chirp: Chirp) -> int:
        """Return the number of channels of the converter: one a receiver, or two with complex samples."""
        return len(self.rx_positions_m) * chirp.parts

    def share(self, direction_R: Float64) -> Float64:
        """Return the two-way gain in unit directions (n, 3), relative to the axis, (n,)."""
        return self.tx.share(direction_R) * self.rx.share(direction_R)

    def gain(self, direction_R: Float64) -> Float64:
        """Return the two-way gain G_t G_r in unit directions (n, 3) as ratios of powers, (n,)."""
        return self.tx.gain(direction_R) * self.rx.gain(direction_R)


def _checked(positions_m: tuple[Vec3, ...], what: str, most: int) -> tuple[Vec3, ...]:
    if not 1 <= len(positions_m) <= most:
        raise ValueError(f"holds {len(positions_m)} {what}s; a radar has 1 to {most}")
    if any(abs(v) > 1.0 for position in positions_m for v in position):
        raise ValueError(f"holds a {what} more than 1 m away: positions are in metres from the radar's origin")
    return positions_m


def _exponent(beamwidth_deg: float) -> float:
    return det_log(0.5) / det_log(det_cos(beamwidth_deg * _HALF_RAD_PER_DEG))
