"""Transmitter power and receiver of a radar: conversion of an echo's power to counts of the ADC.

A sine of power P into the impedance Z has the peak voltage sqrt(2 P Z). With the conversion gain g [dB] of mixer and
amplifiers, and an ADC of b bits over the full scale V, an echo of power P_r has the peak

    A [counts] = sqrt(P_r) * sqrt(2 Z) 10^(g / 20) / (V / 2^b)
"""

from __future__ import annotations

from math import sqrt
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from signals._kernel import det_pow
from signals.documents.validate import StrictModel

_Cutoff = Annotated[float, Field(gt=0.0, le=1e12)]


class Receiver(StrictModel):
    """Figures of the chain from the transmitter's port to the ADC. Filters are of first order; None: no filter."""

    tx_power_dbm: Annotated[float, Field(ge=-60.0, le=60.0)]
    conversion_gain_db: Annotated[float, Field(ge=-60.0, le=160.0)]
    impedance_ohm: Annotated[float, Field(gt=0.0, le=1e5)]
    adc_full_scale_v: Annotated[float, Field(ge=1e-3, le=100.0)]
    adc_bits: Annotated[int, Field(ge=4, le=16)]
    hp_cutoff_hz: _Cutoff | None = None
    aaf_cutoff_hz: _Cutoff | None = None

    @model_validator(mode="after")
    def _passes_a_band(self) -> Receiver:
        if self.hp_cutoff_hz is not None and self.aaf_cutoff_hz is not None and self.hp_cutoff_hz >= self.aaf_cutoff_hz:
            raise ValueError(
                f"hp_cutoff_hz {self.hp_cutoff_hz:g} is not below aaf_cutoff_hz {self.aaf_cutoff_hz:g}: nothing passes"
            )
        return self

    @property
    def tx_power_w(self) -> float:
        return 1e-3 * det_pow(10.0, 0.1 * self.tx_power_dbm)

    @property
    def count_v(self) -> float:
        """Voltage of one count of the ADC."""
        return self.adc_full_scale_v / float(1 << self.adc_bits)

    @property
    def counts_per_sqrt_watt(self) -> float:
        """Peak of a sine in counts per root of its power at the antenna's port."""
        return sqrt(2.0 * self.impedance_ohm) * det_pow(10.0, self.conversion_gain_db / 20.0) / self.count_v

    def filter_power(self, frequency_hz: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return |H|^2 of the filters at beat frequencies, (n,)."""
        gain = np.ones(len(frequency_hz))
        if self.hp_cutoff_hz is not None:
            gain *= frequency_hz * frequency_hz / (self.hp_cutoff_hz**2 + frequency_hz * frequency_hz)
        if self.aaf_cutoff_hz is not None:
            ratio = frequency_hz / self.aaf_cutoff_hz
            gain /= 1.0 + ratio * ratio
        return gain
