"""The transitions of a standard VTOL, as PX4's vtol_att_control (standard.cpp, vtol_type.cpp) has them.

    front   the pusher's throttle rises by VT_PSHER_SLEW to VT_F_TRANS_THR. From VT_ARSP_BLEND on, and after
            VT_TRANS_MIN_TM, the lifters give way: w = 1 - (V - V_blend) / (V_trans - V_blend). At V_trans the wings
            carry the vehicle
    back    the pusher stands; w rises with time within VT_B_TRANS_RAMP. It ends below MPC_XY_CRUISE over ground, or
            after VT_B_TRANS_DUR
    quad-chute
            the lifters take over at once, and the wings are not used again before the next flight: an airspeed below
            V_blend after VT_F_TR_OL_TM, no end of the front transition within VT_TRANS_TIMEOUT, a height loss of
            VT_QC_T_ALT_LOSS in it or within 5 s after it; in flight a height below VT_FW_MIN_ALT over home,
            VT_QC_ALT_LOSS below the height that is asked for, bank beyond VT_FW_QC_R, pitch beyond VT_FW_QC_P

w is the weight of the lifters' thrust and torque. A quad-chute at speed is a back-transition with w = 1, which PX4
does not have: its position controller brakes at once.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from signals.time import US_PER_S
from signals.units import DEG_PER_RAD

_LONGEST_STEP_S = 0.05
_AFTER_FRONT_US = 5 * US_PER_S
_FAST_MPS = 8.0  # over ground, above which a quad-chute first brakes as a back-transition does


class Regime(Enum):
    """Carrier of the vehicle: rotors, wings, or one after the other. The values are those of MAV_VTOL_STATE."""

    FRONT = 1
    BACK = 2
    HOVER = 3
    WING = 4


class Motion(NamedTuple):
    """Quantities that the transitions look at."""

    airspeed_mps: float  # calibrated
    ahead_mps: float  # over ground, along the nose
    height_m: float  # over home
    asked_height_m: float | None  # over home, of the flight on the wings
    roll_rad: float
    pitch_rad: float


class Transition:
    """Regime, weight of the lifters and throttle of the pusher in a transition."""

    def __init__(self, params: ParamTable) -> None:
        self._params = params
        self.reset()

    def reset(self) -> None:
        """Begin a new flight, in hover."""
        self.regime = Regime.HOVER
        self.weight = 1.0
        self.throttle = 0.0
        self.failure: str | None = None  # why the wings are not used any more
        self._chute = False
        self._start_us = self._last_us = 0
        self._front_end_us: int | None = None
        self._start_height_m: float | None = None

    @property
    def transiting(self) -> bool:
        """True between hover and flight."""
        return self.regime in (Regime.FRONT, Regime.BACK)

    def start_front(self, now_us: int, motion: Motion) -> bool:
        """Begin the front transition from hover. Return False if the wings are not to be used."""
        if self.failure is not None or self.regime is not Regime.HOVER:
            return False
        self._start(Regime.FRONT, now_us)
        self._start_height_m = motion.height_m
        self.weight = 1.0
        return True

    def start_back(self, now_us: int) -> bool:
        """Begin the back-transition."""
        if self.regime in (Regime.HOVER, Regime.BACK):
            return False
        self.weight = 0.0 if self.regime is Regime.WING else self.weight
        self._start(Regime.BACK, now_us)
        return True

    def quad_chute(self, now_us: int, reason: str, motion: Motion) -> None:
        """Give up the wings."""
        self.failure = reason
        self._start(Regime.BACK if motion.ahead_mps > _FAST_MPS else Regime.HOVER, now_us)
        self.weight, self._chute = 1.0, True

    def _start(self, regime: Regime, now_us: int) -> None:
        self.regime = regime
        self._start_us = self._last_us = now_us
        self.throttle = 0.0
        self._chute = False

    def step(self, now_us: int, motion: Motion) -> str | None:
        """Run a guidance step. Return the reason at the moment of a quad-chute."""
        if self.regime is Regime.HOVER:
            return None
        reason = None if self._chute else self._reason(now_us, motion)
        if reason is not None:
            self.quad_chute(now_us, reason, motion)
            return reason
        dt = min(1e-6 * (now_us - self._last_us), _LONGEST_STEP_S)
        self._last_us = now_us
        if self.regime is Regime.FRONT:
            self._front(now_us, motion, dt)
        elif self.regime is Regime.BACK:
            self._back(now_us, motion)
        return None

    def _front(self, now_us: int, motion: Motion, dt: float) -> None:
        p = self._params
        most, slew = p["VT_F_TRANS_THR"], p["VT_PSHER_SLEW"]
        self.throttle = most if slew <= 0.0 else min(self.throttle + slew * dt, most)
        blend, end = p["VT_ARSP_BLEND"], p["VT_ARSP_TRANS"]
        if self._elapsed_s(now_us) <= p["VT_TRANS_MIN_TM"]:
            return
        if motion.airspeed_mps >= end:
            self.regime, self.weight = Regime.WING, 0.0
            self._front_end_us = now_us
        elif blend < end:
            self.weight = 1.0 - min(max((motion.airspeed_mps - blend) / (end - blend), 0.0), 1.0)

    def _back(self, now_us: int, motion: Motion) -> None:
        p = self._params
        elapsed = self._elapsed_s(now_us)
        if motion.ahead_mps < p["MPC_XY_CRUISE"] or elapsed > p["VT_B_TRANS_DUR"]:
            self.regime, self.weight = Regime.HOVER, 1.0
            return
        ramp = min(p["VT_B_TRANS_RAMP"], p["VT_B_TRANS_DUR"])
        rising = elapsed / ramp if ramp > 0.0 else 1.0
        self.weight = min(max(rising, self.weight), 1.0)

    def _elapsed_s(self, now_us: int) -> float:
        return 1e-6 * (now_us - self._start_us)

    def _reason(self, now_us: int, m: Motion) -> str | None:
        """Return why the wings must be given up, or None: words that fit into a STATUSTEXT of 50 characters."""
        p = self._params
        if self.regime is Regime.BACK:
            return None
        front = self.regime is Regime.FRONT
        if not front and p["VT_FW_MIN_ALT"] > 0.0 and m.height_m < p["VT_FW_MIN_ALT"]:
            return "minimum altitude"
        loss = p["VT_QC_ALT_LOSS"]
        if not front and loss > 0.0 and m.asked_height_m is not None and m.asked_height_m - m.height_m > loss:
            return "altitude loss"
        lately = self._front_end_us is not None and now_us - self._front_end_us < _AFTER_FRONT_US
        lost = 0.0 if self._start_height_m is None else self._start_height_m - m.height_m
        if (front or lately) and 0.0 < p["VT_QC_T_ALT_LOSS"] < lost:
            return "altitude loss"
        if 0.0 < p["VT_FW_QC_P"] < abs(m.pitch_rad) * DEG_PER_RAD:
            return "maximum pitch"
        if 0.0 < p["VT_FW_QC_R"] < abs(m.roll_rad) * DEG_PER_RAD:
            return "maximum roll"
        elapsed = self._elapsed_s(now_us)
        if front and elapsed > p["VT_F_TR_OL_TM"] and m.airspeed_mps < p["VT_ARSP_BLEND"]:
            return "airspeed too low"
        if front and elapsed > p["VT_TRANS_TIMEOUT"]:
            return "transition timeout"
        return None
