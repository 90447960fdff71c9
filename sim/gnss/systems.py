"""Satellite systems: what a receiver needs to know of their open signals near 1.6 GHz."""

from __future__ import annotations

from typing import Literal, NamedTuple

from signals.units import LIGHT_MPS

SystemName = Literal["gps", "galileo", "glonass", "beidou"]


class System(NamedTuple):
    """Open signal of a system."""

    letter: str  # RINEX
    chip_m: float  # length of a chip of the code
    wavelength_m: float
    chips_per_s: float
    mu_m3ps2: float  # gravitational constant of its user algorithm


def _system(letter: str, chips_per_s: float, carrier_hz: float, mu_m3ps2: float) -> System:
    return System(letter, LIGHT_MPS / chips_per_s, LIGHT_MPS / carrier_hz, chips_per_s, mu_m3ps2)


# IS-GPS-200 (L1 C/A); Galileo OS SIS ICD (E1, whose BOC(1,1) counts as a code of 1.023 Mchip/s); GLONASS ICD (L1OF,
# channel 0); BDS-SIS-ICD (B1I).
SYSTEMS: dict[str, System] = {
    "gps": _system("G", 1.023e6, 1575.42e6, 3.986005e14),
    "galileo": _system("E", 1.023e6, 1575.42e6, 3.986004418e14),
    "glonass": _system("R", 0.511e6, 1602.0e6, 3.986004418e14),
    "beidou": _system("C", 2.046e6, 1561.098e6, 3.986004418e14),
}
