"""Factors between units, and constants of nature. Times are in `signals.time`."""

from __future__ import annotations

from math import pi

TURN_RAD = 2.0 * pi
QUARTER_TURN_RAD = 0.5 * pi
RAD_PER_DEG = pi / 180.0
DEG_PER_RAD = 180.0 / pi
STANDARD_GRAVITY_MPS2 = 9.80665  # by definition (CGPM 1901)
LIGHT_MPS = 299_792_458.0  # by definition
STEFAN_BOLTZMANN_W_PER_M2_K4 = 5.670374419e-8
