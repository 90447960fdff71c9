"""Kind of a fix, as MAVLink's GPS_FIX_TYPE numbers it, from what a receiver tracks.

    1 no fix   fewer than three satellites, or no solution
    2 2-D      three satellites, with the last height
    3 3-D      four or more, PDOP up to 20
    4 DGPS     as 3-D, for a receiver with corrections
    5 float    RTK: five satellites in common with the base, seen directly and above 30 dB-Hz
    6 fixed    RTK: as float with six, the carriers' errors by multipath below 10 mm RMS, and this for `rtk_start_s`

Hysteresis: a fixed solution is kept with five satellites and up to 20 mm. Corrections always arrive: their link is not
modelled, and the base sees the whole sky. No receiver exceeds the kind of its preset.
"""

from __future__ import annotations

from signals.time import NS_PER_S

NO_FIX, FIX_2D, FIX_3D, DGPS, FLOAT, FIXED = range(1, 7)
_MOST_PDOP = 20.0
_FLOAT_LEAST, _FIXED_LEAST, _KEPT_LEAST = 5, 6, 5
_FIXED_RMS_M, _KEPT_RMS_M = 0.010, 0.020


class SolutionState:
    """State of the solution of one receiver."""

    def __init__(self, best: int, rtk_start_s: float, *, started: bool) -> None:
        """`best`: of the preset. `started`: the first solution may be fixed at once."""
        self._best = best
        self._start_ns = round(rtk_start_s * NS_PER_S)
        self._fit_since_ns: int | None = None
        self._fixed = False
        self._at_once = started

    def update(self, t_ns: int, *, used: int, solved: bool, pdop: float, common: int, phase_rms_m: float) -> int:
        """Return the kind of fix at `t_ns`."""
        if not solved or used < 3:
            self._fixed, self._fit_since_ns = False, None
            return NO_FIX
        if used == 3:
            self._fixed, self._fit_since_ns = False, None
            return min(FIX_2D, self._best)
        if pdop > _MOST_PDOP:
            self._fixed, self._fit_since_ns = False, None
            return NO_FIX
        if self._best < FLOAT:
            return min(self._best, DGPS) if self._best >= FIX_2D else self._best
        if common < _FLOAT_LEAST:
            self._fixed, self._fit_since_ns = False, None
            return DGPS
        if self._fixed:
            self._fixed = common >= _KEPT_LEAST and phase_rms_m <= _KEPT_RMS_M
        elif self._best >= FIXED and common >= _FIXED_LEAST and phase_rms_m <= _FIXED_RMS_M:
            if self._fit_since_ns is None:
                self._fit_since_ns = t_ns
            self._fixed = self._at_once or t_ns - self._fit_since_ns >= self._start_ns
        if not self._fixed and not (common >= _FIXED_LEAST and phase_rms_m <= _FIXED_RMS_M):
            self._fit_since_ns = None
        self._at_once = False
        return max(self._best, FIXED) if self._fixed else FLOAT
