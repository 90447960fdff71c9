"""Finds an engine that no longer pulls: the plane loses energy as it does without engine, at high throttle.

PX4 finds it by the current of the motor (FD_ACT_*), which HIL does not carry. Here: the rate of the specific energy
h + V^2 / 2g, averaged over a second, stays below half the sink rate without engine (-FW_T_SINK_MIN / 2) for 2 s while
the throttle asks for more than level flight needs. Then a failsafe lands: a glide at the best speed.

On a runway: the speed over ground grows until the nose rises. Where it falls by 0.5 m/s, or has not reached 2 m/s 3 s
after full throttle, the take-off is broken off: engine idle, straight on, brakes. PX4 has no such watch; ArduPlane's
TKOFF_TIMEOUT is one of the second kind.
"""

from __future__ import annotations

from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from signals.time import US_PER_S
from signals.units import STANDARD_GRAVITY_MPS2

_AVERAGE_S = 1.0
_AFTER_US = 2 * US_PER_S
_SLOWER_MPS, _ROLLS_MPS, _MOVES_WITHIN_S = 0.5, 2.0, 3.0


class EngineWatch:
    """Watch of one flight. `failed` stays until the next arming."""

    def __init__(self, params: ParamTable) -> None:
        self._params = params
        self.failed = False
        self.reset()

    def reset(self) -> None:
        """Begin a new flight."""
        self.failed = False
        self._rate_mps = 0.0
        self._since_us: int | None = None
        self._last_us: int | None = None
        self._roll_since_us: int | None = None
        self._fastest_mps = 0.0

    def roll_step(self, now_us: int, *, ground_mps: float) -> bool:
        """Take a step of a take-off roll. Return True at the moment in which the engine is found to have failed."""
        if self._roll_since_us is None:
            self._roll_since_us = now_us
        self._fastest_mps = max(self._fastest_mps, ground_mps)
        full_s = 1e-6 * (now_us - self._roll_since_us) - self._params["RWTO_RAMP_TIME"]
        slows = self._fastest_mps > _ROLLS_MPS and ground_mps < self._fastest_mps - _SLOWER_MPS
        stands = full_s > _MOVES_WITHIN_S and self._fastest_mps < _ROLLS_MPS
        if self.failed or not (slows or stands):
            return False
        self.failed = True
        return True

    def step(
        self, now_us: int, *, climb_mps: float, true_airspeed_mps: float, airspeed_rate_mps2: float, throttle: float
    ) -> bool:
        """Take a step of a flight. Return True at the moment in which the engine is found to have failed."""
        dt = 0.02 if self._last_us is None else min(1e-6 * (now_us - self._last_us), 0.1)
        self._last_us = now_us
        rate = climb_mps + true_airspeed_mps * airspeed_rate_mps2 / STANDARD_GRAVITY_MPS2
        self._rate_mps += (rate - self._rate_mps) * dt / (dt + _AVERAGE_S)
        p = self._params
        high = 0.5 * (p["FW_THR_TRIM"] + p["FW_THR_MAX"])
        powerless = throttle >= high and self._rate_mps < -0.5 * p["FW_T_SINK_MIN"]
        if not powerless:
            self._since_us = None
        elif self._since_us is None:
            self._since_us = now_us
        elif not self.failed and now_us - self._since_us >= _AFTER_US:
            self.failed = True
            return True
        return False
