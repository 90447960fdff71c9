"""ArduPlane's parameters for a plane: outputs, airspeeds, energy, rate loops, turns, take-off and landing.

Outputs (SRV_Channel): SERVOn_FUNCTION tells what an output serves, SERVOn_REVERSED turns it over. ArduPlane's signs are
roll to the right, nose up, nose to the right; elevons and V-tails are mixed as

    elevon left  = gain (elevator - aileron)     V-tail left  = gain (elevator + rudder)
    elevon right = gain (elevator + aileron)     V-tail right = gain (elevator - rudder)

with MIXING_GAIN 1, so that a surface's function follows from the signs of its torques (FRD), whatever its name.

Rate loops (APM_Control/AP_RollController.cpp): the output is 45 degrees for a full demand, and

    out [deg] = (180 / pi) (FF r s + (P (r - p) + I int (r - p) dt) s^2),    s = SCALING_SPEED / airspeed

with rates r (wanted) and p [rad/s]. With SCALING_SPEED the cruise airspeed, gains k of a full demand per rad/s
(`px4/wing_parameters.py`, where they come from torque, inertia and damping) are pi / 4 k here.

Turns (AP_L1_Control): the L1 distance is 0.3183 NAVL1_DAMPING NAVL1_PERIOD V. ArduPlane begins a turn at that distance
from a waypoint, if WP_RADIUS is not less; a right angle flown with radius R begins at R, or earlier.

Landing: a plane without brakes comes down a slope with wind from behind faster than it should. By ArduPlane's defaults
it pulls up to slow down, and floats: the X8 touched down 105 m past the point. Here it keeps to the slope instead
(TECS_LAND_SPDWGT 0), and LAND_FLARE_AIM 100 aims all of the flare ahead. It sinks at 0.35 m/s in the flare: at 0.7 it
came down so fast over the ground that it bounced, and stalled.
LAND_PITCH_DEG, the least pitch of the flare, is 1.5 degrees over that of cruise: with a lower nose it touched its front
skid, bounced, and once rolled over.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees, pi, tan

from firmware_bridge.autopilots.installation import FixedWing
from firmware_bridge.autopilots.px4.wing_parameters import rate_gains, served_torques_nm
from signals.units import RAD_PER_DEG, STANDARD_GRAVITY_MPS2

AILERON, ELEVATOR, RUDDER, THROTTLE = 4, 19, 21, 70
ELEVON_LEFT, ELEVON_RIGHT, VTAIL_LEFT, VTAIL_RIGHT, UNUSED = 77, 78, 79, 80, 0
_OUTPUTS = 16
_GAIN = pi / 4.0
_ATTITUDE_S = 0.4  # FW_R_TC, to which the rate loops belong
_BANK_DEG = 35.0  # of the turns that a plan may expect
_BANK_LIMIT_DEG = 54.0
_AHEAD = 1.35  # of that radius: where a turn begins, for rolling in, and for wind from behind
_L1_DAMPING = 0.75
_L1_SHARE = 0.3183  # 1 / pi
_CLIMB_SHARE = 0.8  # of what the engine could
_FLARE_DEG = 1.5  # least pitch of the flare over that of cruise
_APPROACH = 1.3  # airspeed over the stall


def surface_function(roll: float, pitch: float, yaw: float) -> tuple[int, bool]:
    """Return SERVOn_FUNCTION of a surface with these torques in FRD, 0 about axes not served, and if reversed."""
    if pitch:
        reverse = pitch < 0.0
        if roll:
            return (ELEVON_RIGHT if (roll > 0.0) == (pitch > 0.0) else ELEVON_LEFT), reverse
        if yaw:
            return (VTAIL_LEFT if (yaw > 0.0) == (pitch > 0.0) else VTAIL_RIGHT), reverse
        return ELEVATOR, reverse
    if roll:
        return AILERON, roll < 0.0
    return (RUDDER, yaw < 0.0) if yaw else (UNUSED, False)


def output_parameters(
    vehicle: FixedWing, engines: Sequence[int] | None = None, rotors: int | None = None
) -> dict[str, float]:
    """Return SERVOn_*: rotors, then surfaces, in the order of the vehicle's commands; all others off.

    `engines`: which of its `rotors` are those of this plane; None: all.
    """
    engines = range(len(vehicle.rotors)) if engines is None else engines
    first = (len(vehicle.rotors) if rotors is None else rotors) + 1
    values: dict[str, float] = {f"SERVO{n}_FUNCTION": UNUSED for n in range(1, _OUTPUTS + 1)}

    def output(n: int, function: int, *, reverse: bool, trim_us: int) -> None:
        values.update(
            {
                f"SERVO{n}_FUNCTION": function,
                f"SERVO{n}_REVERSED": int(reverse),
                f"SERVO{n}_MIN": 1000,
                f"SERVO{n}_MAX": 2000,
                f"SERVO{n}_TRIM": trim_us,
            }
        )

    for rotor in engines:
        output(rotor + 1, THROTTLE, reverse=False, trim_us=1000)
    torques = [served_torques_nm(vehicle, axis) for axis in range(3)]
    for i, surface in enumerate(vehicle.surfaces):
        function, reverse = surface_function(torques[0][i], torques[1][i], torques[2][i])
        trim_us = 1500 + round(500.0 * min(max(surface.trim, -0.5), 0.5))
        output(first + i, function, reverse=reverse, trim_us=trim_us)
    return values


def rate_parameters(vehicle: FixedWing) -> dict[str, float]:
    """Return the gains of the rate loops at the cruise airspeed."""
    gains = rate_gains(vehicle)
    values = {"SCALING_SPEED": vehicle.cruise_mps, "RLL2SRV_TCONST": _ATTITUDE_S, "PTCH2SRV_TCONST": _ATTITUDE_S}
    for ours, name in (("RLL", "RR"), ("PTCH", "PR")):
        values |= {f"{ours}_RATE_{part}": _GAIN * gains[f"FW_{name}_{part}"] for part in ("P", "I", "FF")}
        values[f"{ours}_RATE_D"] = 0.0
    # ArduPlane's yaw damper: out [deg] = -YAW2SRV_DAMP (rate - that of the turn) [deg/s] s^2.
    values["YAW2SRV_DAMP"] = 45.0 / degrees(1.0) * gains["FW_YR_P"]
    return values


def flight_parameters(vehicle: FixedWing) -> dict[str, float]:
    """Return airspeeds, energy, turns, take-off and landing."""
    cruise, stall = vehicle.cruise_mps, vehicle.stall_mps
    fastest = max(min(vehicle.fastest_mps, 1.6 * cruise), 1.1 * cruise)
    radius = cruise * cruise / (STANDARD_GRAVITY_MPS2 * tan(_BANK_DEG * RAD_PER_DEG))
    pitch_deg = degrees(vehicle.pitch_rad)
    climb = max(min(_CLIMB_SHARE * vehicle.climb_mps, 8.0), 1.0)
    values = {
        "AIRSPEED_CRUISE": cruise,
        "AIRSPEED_MIN": vehicle.least_mps,
        "AIRSPEED_MAX": fastest,
        "AIRSPEED_STALL": stall,
        "PTCH_TRIM_DEG": pitch_deg,
        "PTCH_LIM_MAX_DEG": 25.0,
        "PTCH_LIM_MIN_DEG": -25.0,
        "ROLL_LIMIT_DEG": _BANK_LIMIT_DEG,
        "TRIM_THROTTLE": 100.0 * min(max(vehicle.throttle, 0.05), 0.95),
        "THR_MAX": 100.0,
        "TECS_CLMB_MAX": climb,
        "TECS_SINK_MIN": max(vehicle.idle_sink_mps, 0.5),
        "TECS_SINK_MAX": max(3.0, 2.0 * vehicle.idle_sink_mps),
        "TECS_LAND_ARSPD": _APPROACH * stall,
        "NAVL1_PERIOD": _AHEAD * radius / (_L1_SHARE * _L1_DAMPING * cruise),
        "NAVL1_DAMPING": _L1_DAMPING,
        "WP_RADIUS": max(2.0 * radius, 50.0),
        "WP_LOITER_RAD": max(1.3 * radius, 50.0),
        "TECS_LAND_SINK": 0.35,
        "TECS_LAND_SPDWGT": 0.0,
        "LAND_FLARE_ALT": 2.5,
        "LAND_FLARE_SEC": 2.0,
        "LAND_FLARE_AIM": 100.0,
        "LAND_PITCH_DEG": pitch_deg + _FLARE_DEG,
        "LAND_DISARMDELAY": 5.0,
    }
    # Their names before 4.5 and 4.7, with units in the name where they changed.
    values |= {
        "TRIM_ARSPD_CM": 100.0 * cruise,
        "ARSPD_FBW_MIN": vehicle.least_mps,
        "ARSPD_FBW_MAX": fastest,
        "LIM_PITCH_MAX": 2500.0,
        "LIM_PITCH_MIN": -2500.0,
        "LIM_ROLL_CD": 100.0 * _BANK_LIMIT_DEG,
        "TRIM_PITCH_CD": 100.0 * pitch_deg,
        "LAND_PITCH_CD": 100.0 * (pitch_deg + _FLARE_DEG),
    }
    return values


def plane_parameters(vehicle: FixedWing) -> dict[str, float]:
    """Return the parameters that make ArduPlane's aircraft this vehicle."""
    return output_parameters(vehicle) | rounded(flight_parameters(vehicle) | rate_parameters(vehicle))


def rounded(values: Mapping[str, float]) -> dict[str, float]:
    """Return the values with the five digits that a parameter file needs."""
    return {name: float(f"{value:.5g}") for name, value in values.items()}
