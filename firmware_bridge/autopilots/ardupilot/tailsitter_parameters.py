"""ArduPlane's parameters for a tailsitter: a "copter tailsitter", which hovers on the rotors of a copter's frame.

Frames: ArduPlane turns its view of the attitude by 90 degrees in hover. The frame is that of the hover (x out of the
belly), the surfaces are those of the plane; in hover it moves them with the rotors.

In flight the motors of Q_TAILSIT_MOTMX pull.

Hover: a wing across the wind gives several times the side force of a quadrotor. 5 m/s against the shipped tailsitter
give 5 m/s2, which the position loops of other VTOLs answer with 2.4 m, by a / (position P * velocity P). Here each loop
is half as fast as the one in it: 7 : 3.2 : 1.6 [1/s] around rates of 15 /s, with the velocity's integral at its P.
Before it lands it turns an edge of its wing into the wind (Q_WVANE_*), in which it leans half as much. Not in the
take-off: ArduPlane goes to its wings in whatever direction its belly looks.
"""

from __future__ import annotations

_ATTITUDE_P, _VELOCITY_P, _POSITION_P = 7.0, 3.2, 1.6  # [1/s]
_VELOCITY_D = 0.125  # over P: ArduCopter's ratio
_DECELERATION_MPS2 = 6.0  # ArduPlane's own for tailsitters: the wing turns across the flow
_SIDE_INTO_WIND, _NO_TURN = 3, 0  # Q_WVANE_*
_WIND_GAIN = 1.0  # 45 degrees of lean turn it at half of its highest rate. With 2 it swings in gusts


def tailsitter_parameters(motors: int) -> dict[str, float]:
    """Return Q_TAILSIT_* and what differs from a standard VTOL; `motors`: the mask of those that pull in flight."""
    return {
        "Q_TAILSIT_ENABLE": 1,
        "Q_TAILSIT_MOTMX": motors,
        "Q_TRANS_DECEL": _DECELERATION_MPS2,
        "Q_A_ANG_RLL_P": _ATTITUDE_P,
        "Q_A_ANG_PIT_P": _ATTITUDE_P,
        "Q_P_VELXY_P": _VELOCITY_P,
        "Q_P_VELXY_I": _VELOCITY_P,
        "Q_P_VELXY_D": _VELOCITY_D * _VELOCITY_P,
        "Q_P_POSXY_P": _POSITION_P,
        "Q_WVANE_ENABLE": _SIDE_INTO_WIND,
        "Q_WVANE_TAKEOFF": _NO_TURN,
        "Q_WVANE_GAIN": _WIND_GAIN,
    }
