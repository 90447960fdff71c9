"""Jammers and spoofers: transmitters on the receiver's frequency, with a place and a power.

    J = EIRP - 20 log(4 pi d / lambda) - L + G          at the antenna, free space (Friis); L: lost behind an obstacle
    1 / (c/n0)' = 1 / (c/n0) + (j/s) / (Q f_c)          (Kaplan and Hegarty, Understanding GPS, 2nd ed., section 6.2)

G is the antenna's gain towards the transmitter, s the power of a satellite, -158.5 dBW (IS-GPS-200, L1 C/A) at the
antenna's zenith, f_c the rate of the code's chips and Q 1 for a narrow band, 1.5 for the spectrum of the code, 2.22 for
white noise. A receiver loses a signal where (c/n0)' falls below its limit c_t, that is from

    J/S = 10 log(Q f_c (1 / c_t - 1 / (c/n0)))

A spoofer is received as a jammer with the code's spectrum until its power exceeds that of the satellites by
`capture_db`. Then it holds the receiver, which follows the false place.
"""

from __future__ import annotations

from typing import NamedTuple

from signals.samples import Vec3
from sim.gnss.decibel import decibel, power
from sim.gnss.systems import SYSTEMS

SIGNAL_DBW = -158.5
BANDS = {"narrow": 1.0, "code": 1.5, "wide": 2.22}  # Q
_WAVELENGTH_M = SYSTEMS["gps"].wavelength_m
_PI = 3.141592653589793
_NEAREST_M = 0.1


class Emitter(NamedTuple):
    """A transmitter that is on."""

    place_W_m: Vec3
    power_dbw: float  # EIRP
    band: str  # key of BANDS
    shadow_db: float  # lost behind an obstacle


class Spoofer(NamedTuple):
    """A transmitter of false signals that is on; `since_s`: for so long."""

    emitter: Emitter
    capture_db: float
    offset_m: Vec3  # of the false place from the true one, W
    velocity_mps: Vec3  # at which it moves away since the spoofer holds the receiver


def received_dbw(emitter: Emitter, distance_m: float, *, gain_db: float, hidden: bool) -> float:
    """Return the power of a transmitter at the antenna's output."""
    spread = 4.0 * _PI * max(distance_m, _NEAREST_M) / _WAVELENGTH_M
    return emitter.power_dbw - 2.0 * decibel(spread) + gain_db - (emitter.shadow_db if hidden else 0.0)


def jammed_dbhz(cn0_dbhz: float, jammers: tuple[tuple[float, float], ...], chips_per_s: float) -> float:
    """Return C/N0 beside jammers, each (J/S [dB], Q)."""
    worse = 1.0 / power(cn0_dbhz)
    for js_db, q in jammers:
        worse += power(js_db) / (q * chips_per_s)
    return decibel(1.0 / worse)


def tolerated_js_db(cn0_dbhz: float, limit_dbhz: float, q: float, chips_per_s: float) -> float:
    """Return J/S at which C/N0 falls to `limit_dbhz`."""
    return decibel(q * chips_per_s * (1.0 / power(limit_dbhz) - 1.0 / power(cn0_dbhz)))
