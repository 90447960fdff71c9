"""ArduPlane's parameters for a VTOL, its QuadPlane: lifters as a copter's frame, transitions, and the plane's.

Rate loops of the hover (AC_AttitudeControl): an output of 1 about an axis takes half of each lifter's range, so that
its torque is M = sum |effect of a lifter| / 2 at full thrust, times the share of thrust within the spin range. With
inertia I a gain P = w I / M makes I p' = M P e a loop of bandwidth w. The other gains keep ArduPilot's ratios to P.

Loops of the position (AC_PosControl): attitude, velocity and position lie around the rates, and each is slower than the
one in it by ArduCopter's ratios, 4.5 : 2 : 1 [1/s] around rates of 15 /s. A lasting disturbance a [m/s2] moves the
vehicle by at most a / (position P * velocity P) before the integral answers. ArduPlane's own 0.5 and 0.7, for heavy
VTOLs whose attitude is slow, make this 2.9 m per m/s2 in place of 0.5.

Transition (ArduPlane/transition): the lifters give way for Q_TRANSITION_MS from AIRSPEED_MIN on, 1.2 times the stall
here, and help again below Q_ASSIST_SPEED. Back: ArduPlane brakes on its wings down to Q_ASSIST_SPEED, or AIRSPEED_MIN
less 2 m/s. From there, V1, it raises the nose to brake by Q_TRANS_DECEL, a, at most as fast as Q_BACKTRANS_MS, T, says.
The wing's lift stays below the weight, and the lifters carry the rest, while the angle of attack is at most its first
value times (V1 / (V1 - a t))^2. T = V1 / a, the time to stop, does that; in ArduPlane's 3 s the nose rose faster, and
the wing alone carried the vehicle down to 0.8 times the stall, with idle lifters.
"""

from __future__ import annotations

import numpy as np

from firmware_bridge.autopilots.ardupilot.copter import frame_for
from firmware_bridge.autopilots.ardupilot.tailsitter_parameters import tailsitter_parameters
from firmware_bridge.autopilots.ardupilot.tilt_parameters import tilt_parameters, yaw_torque_nm
from firmware_bridge.autopilots.ardupilot.wing_parameters import (
    flight_parameters,
    output_parameters,
    rate_parameters,
    rounded,
)
from firmware_bridge.autopilots.installation import Vtol
from firmware_bridge.codecs.ardupilot_json import hover_throttle
from firmware_bridge.links.ardupilot.frames import FIRST_MOTOR_FUNCTION
from firmware_bridge.links.ardupilot.sitl import SPIN_MAX, SPIN_MIN, thrust_parameters
from signals.errors import LinkError

_AXES = (("RLL", 0, 15.0, 1.0), ("PIT", 1, 15.0, 1.0), ("YAW", 2, 4.0, 0.1))  # axis, bandwidth [1/s], I / P
_POSITION_P, _VELOCITY_P = 1.0, 2.0  # [1/s]
_VELOCITY_I, _VELOCITY_D = 0.5, 0.125  # over P: ArduCopter's ratios
_JERK_MPS3 = 5.0  # ArduCopter's: the attitude follows at its bandwidth
_DAMPING = 0.0036 / 0.135  # ArduPilot's default D / P of roll and pitch
_ASSIST = 1.15  # over the stall: between AIRSPEED_MIN's 1.2 and the 1.1 below which no plane should fly on its wings
_DECELERATION_MPS2 = 2.0  # ArduPlane's
_BRAKE_S = 1.0  # ArduPlane brakes so long with lifters that idle, whatever the airspeed


def vtol_parameters(vehicle: Vtol) -> dict[str, float]:
    """Return the parameters that make ArduPlane's QuadPlane this vehicle. LinkError if it has no frame for it."""
    frame = frame_for(vehicle.hover)
    if frame is None:
        raise LinkError("ardupilot", f"has no frame with the lifters of the vehicle {vehicle.name!r}")
    rotors = len(vehicle.lifters) + len(vehicle.pushers)
    outputs = output_parameters(vehicle.wing, vehicle.pushers, rotors + len(vehicle.tilts))
    motors = [vehicle.lifters[lifter] for lifter in frame.rotors]
    for motor, rotor in enumerate(motors):
        n = rotor + 1
        outputs |= {f"SERVO{n}_FUNCTION": FIRST_MOTOR_FUNCTION + motor, f"SERVO{n}_MIN": 1000, f"SERVO{n}_MAX": 2000}
    outputs |= tilt_parameters(vehicle, motors, rotors + 1)
    fixed = {"Q_ENABLE": 1, "Q_FRAME_CLASS": frame.frame_class, "Q_FRAME_TYPE": frame.frame_type}
    computed = flight_parameters(vehicle.wing) | rate_parameters(vehicle.wing) | hover_parameters(vehicle)
    if not vehicle.pushers:
        computed["TRIM_THROTTLE"] = thrust_throttle(vehicle)
    if vehicle.kind == "tailsitter":
        computed |= tailsitter_parameters((1 << len(motors)) - 1)
    return fixed | outputs | rounded(computed)


def thrust_throttle(vehicle: Vtol) -> float:
    """Return TRIM_THROTTLE [%] of lifters that pull in flight: by the copter's curve, a share of their thrust."""
    curve = vehicle.hover.thrust_model_factor
    share = hover_throttle(vehicle.wing.throttle, curve, spin_min=SPIN_MIN, spin_max=SPIN_MAX)
    return 100.0 * min(max(share, 0.05), 0.95)


def hover_parameters(vehicle: Vtol) -> dict[str, float]:
    """Return Q_*: thrust curve and rate loops of the lifters, and the transition."""
    hover = vehicle.hover
    assist_mps = _ASSIST * vehicle.wing.stall_mps
    thrust = thrust_parameters(hover.hover_control, hover.thrust_model_factor)
    values = {f"Q_M_{name.removeprefix('MOT_')}": value for name, value in thrust.items()}
    values |= {
        "Q_M_PWM_MIN": 1000,
        "Q_M_PWM_MAX": 2000,
        "Q_M_SPIN_ARM": 0.1,
        "Q_M_SPIN_MIN": SPIN_MIN,
        "Q_M_SPIN_MAX": SPIN_MAX,
        "Q_M_BAT_VOLT_MIN": 0,
        "Q_M_BAT_VOLT_MAX": 0,
        "Q_TRANSITION_MS": 3000,
        "Q_ASSIST_SPEED": assist_mps,
        "Q_TRANS_DECEL": _DECELERATION_MPS2,
        "TECS_LAND_ARSPD": vehicle.wing.least_mps + _DECELERATION_MPS2 * _BRAKE_S,
        "Q_BACKTRANS_MS": round(1000.0 * assist_mps / _DECELERATION_MPS2),
    }
    values |= {
        "Q_P_POSXY_P": _POSITION_P,
        "Q_P_VELXY_P": _VELOCITY_P,
        "Q_P_VELXY_I": _VELOCITY_I * _VELOCITY_P,
        "Q_P_VELXY_D": _VELOCITY_D * _VELOCITY_P,
        "Q_P_JERK_XY": _JERK_MPS3,
    }
    share = SPIN_MAX**2 - SPIN_MIN**2
    for name, axis, bandwidth, integral in _AXES:
        torque = 0.5 * share * float(np.sum(np.abs(hover.full_effect[axis])))
        if name == "YAW":
            torque = yaw_torque_nm(vehicle) or torque
        gain = min(max(bandwidth * hover.inertia_kgm2[axis] / torque, 0.01), 2.0)
        values |= {f"Q_A_RAT_{name}_P": gain, f"Q_A_RAT_{name}_I": integral * gain}
        values[f"Q_A_RAT_{name}_D"] = _DAMPING * gain if name != "YAW" else 0.0
    return values
