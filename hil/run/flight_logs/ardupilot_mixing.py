"""Commands of ArduPilot's motors at the rate of its controller, which its logs of outputs do not have.

ArduCopter writes RCOU ten times a second whatever LOG_BITMASK says, and RATE, the outputs of its rate controllers and
the throttle, at every loop (bit 0, fast attitude). Its mixer adds them for each motor (AP_MotorsMatrix), and a curve
makes an actuator's command of the thrust (AP_Motors_Thrust_Linearization):

    T_i = a_i R + b_i P + c_i Y + d_i A        x_i with T_i = (1 - e) x_i + e x_i^2        e: MOT_THST_EXPO
    u_i = s_min + (s_max - s_min) x_i          s_min, s_max: MOT_SPIN_MIN, MOT_SPIN_MAX

The factors follow from RCOU by least squares, so that any frame, order and scale of them is right. Where the mixer
limits something, the sum does not hold; if the commands differ from RCOU by more than `_AGREES` (rms), they are not
used. In two flights of ArduCopter 4.7 they differ by 0.0003, the resolution of RCOU.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hil.run.flight_logs.flight_log import Series

_AGREES = 0.01
_FLYING = 0.02  # of the thrust: motors that only spin follow no controller
_LEAST_ROWS = 50


def faster_commands(outputs: Series, rate: Series, parameters: Mapping[str, float]) -> Series | None:
    """Return commands 0 to 1 at the times of `rate`; None if the outputs do not follow from it.

    `outputs`: commands of the motors as RCOU has them. `rate`: ROut, POut, YOut and AOut of RATE.
    """
    expo = min(max(parameters.get("MOT_THST_EXPO", 0.65), 0.0), 1.0)
    low, high = parameters.get("MOT_SPIN_MIN", 0.15), parameters.get("MOT_SPIN_MAX", 0.95)
    if not high > low:
        return None
    x = (outputs.values - low) / (high - low)
    thrust = (1.0 - expo) * x + expo * x * x
    # The controller's values of the same loop, or of the one before: those at or before the output's time.
    at = np.searchsorted(rate.t_s, outputs.t_s, "right") - 1
    flying = (at >= 0) & ((x > _FLYING) & (x < 1.0 - _FLYING)).all(axis=1)
    if np.count_nonzero(flying) < _LEAST_ROWS:
        return None
    factors, *_ = np.linalg.lstsq(rate.values[at[flying]], thrust[flying], rcond=None)
    commands = _commands(rate.values @ factors, expo, low, high)
    error = commands[at[flying]] - outputs.values[flying]
    if float(np.sqrt(np.mean(error * error))) > _AGREES:
        return None
    # On the ground the outputs are those of the spool-up, which RATE does not contain.
    held = outputs.values[np.clip(np.searchsorted(outputs.t_s, rate.t_s, "right") - 1, 0, None)]
    on_ground = (held <= low + _FLYING * (high - low)).all(axis=1)
    commands[on_ground] = held[on_ground]
    return Series(rate.t_s, commands)


def _commands(thrust: NDArray[np.float64], expo: float, low: float, high: float) -> NDArray[np.float64]:
    thrust = np.clip(thrust, 0.0, 1.0)
    if expo == 0.0:
        return np.asarray(low + (high - low) * thrust, np.float64)
    x = (expo - 1.0 + np.sqrt((1.0 - expo) ** 2 + 4.0 * expo * thrust)) / (2.0 * expo)
    return np.asarray(low + (high - low) * np.clip(x, 0.0, 1.0), np.float64)
