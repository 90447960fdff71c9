"""PX4's parameters for a tailsitter, beyond those of every VTOL: its frames, its change of attitude, hover in wind.

Frames: PX4's body frame of a tailsitter is that of hover (FRD: x out of the belly, y to the right, z towards the tail),
in which it levels, and turns by 90 degrees about y for the wings (FixedwingAttitudeControl, FixedwingRateControl). The
bench's sensors are mounted along the body, x to the nose: SENS_BOARD_ROT 24, by 90 degrees about y, makes them PX4's.

    x = z_sensor, z = -x_sensor    and so    CA_SV_CSn_TRQ_R = yaw, CA_SV_CSn_TRQ_Y = -roll    of a surface on the wings

Change of attitude: PX4 lowers and raises the nose at a steady rate, by 90 degrees within VT_F_TRANS_DUR and
VT_B_TRANS_DUR = T, and is on the wings below 30 degrees with VT_ARSP_TRANS. With the thrust of hover and no drag

    v = integral of g sin(pi t / (2 T)) dt = g T / pi at 30 degrees over the horizon;    T = pi VT_ARSP_TRANS / g

Hover in wind: against the belly it is that of a plate, and the vehicle leans. So the integral of the velocity loop
takes 1.25 s, PX4 lifts off within 1 s and leans from there on, and is quick to stop the rotors on the ground, where
they drag it along. PX4's weather vane would turn the belly into the wind.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi

from signals.units import STANDARD_GRAVITY_MPS2

_PITCH_90 = 24  # SENS_BOARD_ROT
_INTEGRAL_PER_S = 0.8  # MPC_XY_VEL_I_ACC over MPC_XY_VEL_P_ACC; PX4's defaults have 0.2
_LIFT_OFF_S, _LIFT_OFF_LEAN_DEG = 1.0, 30.0  # PX4: 3 and 12
LEAST_THRUST = 0.24  # MPC_THR_MIN over that of hover: PX4's 0.12 with its MPC_THR_HOVER 0.5
_LANDED_S = 0.5  # PX4: 1
# Those of PX4, where its airframe of standard VTOLs has its own: no attitude by more thrust, with which it hops on the
# ground; no weather vane. Its estimator knows no sideslip of a tailsitter (EKF2.cpp).
_PX4 = {"MC_AIRMODE": 0.0, "WV_EN": 0.0, "EKF2_FUSE_BETA": 0.0}


def frame_parameters(values: Mapping[str, float]) -> dict[str, float]:
    """Return the frame of the sensors, and the torques of the surfaces of `values`, CA_SV_CS*, in that of hover."""
    turned: dict[str, float] = {"SENS_BOARD_ROT": _PITCH_90}
    for n in range(round(values["CA_SV_CS_COUNT"])):
        roll, yaw = values[f"CA_SV_CS{n}_TRQ_R"], values[f"CA_SV_CS{n}_TRQ_Y"]
        turned |= {f"CA_SV_CS{n}_TRQ_R": yaw, f"CA_SV_CS{n}_TRQ_Y": 0.0 - roll}
    return turned


def turning_parameters(trans_mps: float, cruise_mps: float) -> dict[str, float]:
    """Return the times of a change of attitude that leads to a true airspeed, and how it brakes on the way back.

    The belly brakes from the airspeed of cruise to none while the nose rises. PX4 begins v^2 / (2 VT_B_DEC_MSS) before
    the place; with its 2 m/s2 it came down from the wings too early, and hovered the rest of the way.
    """
    turning_s = pi * trans_mps / STANDARD_GRAVITY_MPS2
    return {
        "VT_F_TRANS_DUR": min(turning_s, 20.0),
        "VT_B_TRANS_DUR": min(turning_s, 20.0),
        "VT_B_DEC_MSS": min(max(cruise_mps / turning_s, 0.5), 10.0),
        "VT_F_TR_OL_TM": min(2.0 * turning_s, 30.0),
        "VT_TRANS_TIMEOUT": min(3.0 * turning_s, 30.0),
    }


def wind_parameters(values: Mapping[str, float]) -> dict[str, float]:
    """Return what holds a tailsitter in wind, for the gains and the hover thrust of `values`."""
    return _PX4 | {
        "MPC_XY_VEL_I_ACC": _INTEGRAL_PER_S * values["MPC_XY_VEL_P_ACC"],
        "MPC_TKO_RAMP_T": _LIFT_OFF_S,
        "MPC_TILTMAX_LND": _LIFT_OFF_LEAN_DEG,
        "MPC_THR_MIN": LEAST_THRUST * values["MPC_THR_HOVER"],
        "LNDMC_TRIG_TIME": _LANDED_S,
    }
