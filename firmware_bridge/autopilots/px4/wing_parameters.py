"""PX4's parameters for a plane, for PX4 and for the mock: surfaces, airspeeds, energy, gains of the rate loops.

Surfaces: CA_SV_CSn_TRQ_* are shares of a full demand, chosen so that a full demand of roll, pitch or yaw moves the
surfaces that serve it to full command; the share of each is its torque over the sum of all about that axis. PX4's
allocation takes the pseudo-inverse of them, and so does the mock's (`plane/surfaces.py`).

Rate loops, with M the torque of a full demand at the trim airspeed, I the inertia, L < 0 the damping of the rate:

    feed-forward  FF = -L / M                  holds a steady rate against the damping; for pitch the share in a turn
    gain          P  = (w I + L) / M           makes I p' = M u + L p a loop of bandwidth w
    integral      FW_*_I = P w / 4 + FF w / 8

w is three times 1 / FW_R_TC, the attitude loop outside. No gain is below a tenth of the feed-forward.
"""

from __future__ import annotations

from math import degrees, pi, radians, sin, sqrt, tan

from firmware_bridge.autopilots.installation import FixedWing, Surface
from firmware_bridge.mock_pixhawk.plane.npfg import track_error_bound_m
from signals.units import STANDARD_GRAVITY_MPS2

_RATE_BANDWIDTH = 7.5  # 1/s
_SERVED = 0.05  # share of the strongest surface below which one does not serve an axis
_AXES = (("R", 0, 1.0), ("P", 1, -1.0), ("Y", 2, -1.0))  # FLU to FRD: pitch and yaw change sign
_LEFT_ELEVON, _RIGHT_ELEVON, _LEFT_AILERON, _RIGHT_AILERON = 5, 6, 1, 2
_ELEVATOR, _RUDDER, _LEFT_V, _RIGHT_V, _ANY = 3, 4, 7, 8, 12
_FIRST_SERVO = 201
_CLIMB_SHARE = 0.8  # of what the engine could: TECS keeps some for speed
LAUNCH_MPS2 = 12.0  # forward acceleration of a launch; PX4's 30 is more than a hand has
ROTATION = 1.15  # airspeed at which the nose rises on the runway, over the stall
_WHEEL_GAINS = 1.0, 0.5  # of the yaw rate: PX4's 0.5 and 0.1 let a tail wheel turn into the wind by 12 degrees
_TOUCHDOWN_S = 2.0  # after the beginning of the flare
_STEERING_WHEEL = 440  # output function "Landing_Gear_Wheel"
_STEADY_CLIMB = 0.6  # of what the engine could, in PX4's climb off a catapult
_TAKEOFF, _APPROACH = 1.5, 1.3  # airspeeds of the climb and of the approach over the stall
_WIND = 0.5  # of the cruise airspeed, the strongest that is expected
_GUST_MPS = 0.5  # up or down near the ground: a tenth of a wind of 5 m/s (MIL-F-8785C)
_FLARE_S = 0.5  # FW_LND_FL_TIME, half of PX4's: while it runs PX4 lowers the nose
_SEA_LEVEL_KGPM3 = 1.225
# PX4's defaults: NPFG_PERIOD and NPFG_DAMPING; FW_R_LIM, FW_R_TC and FW_R_RMAX; FW_P_TC and FW_LND_ANG.
_NPFG_PERIOD_S, _NPFG_DAMPING = 10.0, 0.7
_BANK_DEG, _ROLL_S, _ROLL_DEGPS = 50.0, 0.4, 70.0
_PITCH_S, _SLOPE_DEG = 0.4, 5.0


def torques_frd_nm(surface: Surface) -> tuple[float, float, float]:
    """Return roll, pitch and yaw torque of a surface in FRD."""
    return (surface.torque_nm[0], -surface.torque_nm[1], -surface.torque_nm[2])


def full_torques_nm(vehicle: FixedWing) -> tuple[float, float, float]:
    """Return the torque of a full demand about each axis in FRD, 0 where no surface serves it."""
    return _full(vehicle, 0), _full(vehicle, 1), _full(vehicle, 2)


def served_torques_nm(vehicle: FixedWing, axis: int) -> list[float]:
    """Return the torque of every surface about an axis; 0 for those that hardly act on it."""
    torques = [torques_frd_nm(surface)[axis] for surface in vehicle.surfaces]
    most = max((abs(t) for t in torques), default=0.0)
    # Yaw by ailerons is adverse yaw, not a control: it must also be what the surface mostly does, or nearly.
    own = [max(abs(t) for t in torques_frd_nm(surface)) for surface in vehicle.surfaces]
    return [t if abs(t) >= _SERVED * most and abs(t) >= _OWN * o else 0.0 for t, o in zip(torques, own, strict=True)]


_OWN = 0.2  # of the surface's strongest torque


def _full(vehicle: FixedWing, axis: int) -> float:
    return sum(abs(t) for t in served_torques_nm(vehicle, axis))


def surface_parameters(vehicle: FixedWing) -> dict[str, float]:
    """Return CA_SV_CS*: type and torques of every surface."""
    values: dict[str, float] = {"CA_SV_CS_COUNT": len(vehicle.surfaces)}
    shares = {}
    for letter, axis, _ in _AXES:
        full = _full(vehicle, axis)
        shares[letter] = [t / full if full > 0.0 else 0.0 for t in served_torques_nm(vehicle, axis)]
    for i in range(len(vehicle.surfaces)):
        roll, pitch, yaw = (shares[letter][i] for letter in "RPY")
        values[f"CA_SV_CS{i}_TYPE"] = _type(roll, pitch, yaw, vehicle.surfaces[i].name)
        for letter in "RPY":
            values[f"CA_SV_CS{i}_TRQ_{letter}"] = round(shares[letter][i], 4) + 0.0
    return values


def _type(roll: float, pitch: float, yaw: float, name: str) -> int:
    """Return CA_SV_CSn_TYPE, by which PX4 names the surface and fills in what is 0."""
    left = "left" in name
    if roll and pitch:
        return _LEFT_ELEVON if left else _RIGHT_ELEVON
    if roll:
        return _LEFT_AILERON if left else _RIGHT_AILERON
    if pitch and yaw:
        return _LEFT_V if left else _RIGHT_V
    if pitch:
        return _ELEVATOR
    return _RUDDER if yaw else _ANY


def trims(vehicle: FixedWing) -> tuple[float, float, float]:
    """Return the torque demands of steady cruise, TRIM_ROLL, _PITCH and _YAW: the surfaces' trim in shares of them."""
    out = []
    for _, axis, _ in _AXES:
        full = _full(vehicle, axis)
        served = served_torques_nm(vehicle, axis)
        torque = sum(t * s.trim for t, s in zip(served, vehicle.surfaces, strict=True))
        out.append(min(max(torque / full, -0.5), 0.5) if full > 0.0 else 0.0)
    return out[0], out[1], out[2]


def rate_gains(vehicle: FixedWing) -> dict[str, float]:
    """Return FW_RR_*, FW_PR_* and FW_YR_*."""
    values: dict[str, float] = {}
    full = full_torques_nm(vehicle)
    for axis, (name, inertia, damping) in enumerate(
        zip(("RR", "PR", "YR"), vehicle.inertia_kgm2, vehicle.damping_nms, strict=True)
    ):
        if full[axis] <= 0.0:
            values |= {f"FW_{name}_{part}": 0.0 for part in ("P", "I", "FF")}
            continue
        forward = vehicle.pull_up if name == "PR" else max(-damping / full[axis], 0.0)
        forward = min(max(forward, 0.0), 2.0)
        gain = max((_RATE_BANDWIDTH * inertia + min(damping, 0.0)) / full[axis], 0.1 * forward, 0.01)
        gain = min(gain, 2.0)
        integral = 0.25 * gain * _RATE_BANDWIDTH + 0.125 * forward * _RATE_BANDWIDTH
        if name == "YR":  # the air turns the nose; rudder only damps
            forward, integral = 0.0, 0.0
        values |= {f"FW_{name}_P": gain, f"FW_{name}_I": integral, f"FW_{name}_FF": forward}
    return values


def flight_parameters(vehicle: FixedWing) -> dict[str, float]:
    """Return airspeeds, energy and pitch: what the controllers of the position loop need."""
    cruise = vehicle.cruise_mps
    values = {
        "FW_AIRSPD_STALL": vehicle.stall_mps,
        "FW_AIRSPD_MIN": vehicle.least_mps,
        "FW_AIRSPD_TRIM": cruise,
        "FW_AIRSPD_MAX": max(min(vehicle.fastest_mps, 1.6 * cruise), 1.1 * cruise),
        "FW_PSP_OFF": degrees(vehicle.pitch_rad),
        "FW_THR_TRIM": min(max(vehicle.throttle, 0.05), 0.95),
        "FW_T_CLMB_MAX": max(min(_CLIMB_SHARE * vehicle.climb_mps, 8.0), 1.0),
        "FW_T_CLMB_R_SP": max(min(0.5 * vehicle.climb_mps, 3.0), 0.5),
        "FW_T_SINK_MIN": max(vehicle.idle_sink_mps, 1.0),
        "FW_T_SINK_R_SP": max(min(0.8 * vehicle.idle_sink_mps, 2.0), 0.5),
        "FW_T_SINK_MAX": max(3.0, 2.0 * vehicle.idle_sink_mps),
        "LNDFW_AIRSPD_MAX": max(6.0, 0.7 * vehicle.stall_mps),
        "RWTO_TKOFF": float(vehicle.wheels),
        "FW_LAUN_AC_THLD": LAUNCH_MPS2,
        "FW_W_EN": float(vehicle.wheels),
    }
    if vehicle.wheels:  # it rolls as it stands: a tail wheel steers only on the ground
        values["RWTO_PSP"] = min(max(degrees(vehicle.ground_pitch_rad), -10.0), 20.0)
        values["FW_WR_P"], values["FW_WR_I"] = _WHEEL_GAINS
        values["RWTO_ROT_AIRSPD"] = ROTATION * vehicle.stall_mps
    for name, trim in zip(("TRIM_ROLL", "TRIM_PITCH", "TRIM_YAW"), trims(vehicle), strict=True):
        values[name] = trim
    return values


def plane_parameters(vehicle: FixedWing) -> dict[str, float]:
    """Return the parameters that make a plane of PX4, or the mock's, this vehicle."""
    values: dict[str, float] = {
        "CA_AIRFRAME": 1,
        "MAV_TYPE": 1,
        "CA_ROTOR_COUNT": len(vehicle.rotors),
        **surface_parameters(vehicle),
        **{name: float(f"{value:.4g}") for name, value in (flight_parameters(vehicle) | rate_gains(vehicle)).items()},
    }
    return values


def calibration(vehicle: FixedWing) -> float:
    """Return calibrated over true airspeed, sqrt(rho / rho0): PX4's airspeeds are calibrated."""
    return sqrt(vehicle.density_kgpm3 / _SEA_LEVEL_KGPM3)


def px4_parameters(vehicle: FixedWing) -> dict[str, float]:
    """Return what PX4 needs over `plane_parameters`, and the mock does not."""
    own = flight_parameters(vehicle)
    # PX4 multiplies throttle and sink of level flight by sqrt(rho0 / rho), the throttle by 1 at least.
    calibrated = calibration(vehicle)
    values = {name: own[name] * calibrated for name in own if name.startswith("FW_AIRSPD_")}
    values["FW_THR_TRIM"] = own["FW_THR_TRIM"] * min(calibrated, 1.0)
    values["FW_T_SINK_MIN"] = own["FW_T_SINK_MIN"] * calibrated
    # Off the catapult PX4 holds FW_T_CLMB_MAX at FW_TKO_AIRSPD, and gives airspeed for it: its share of what the engine
    # can is what gusts leave. Its default of FW_TKO_AIRSPD is the slowest airspeed.
    values["FW_T_CLMB_MAX"] = max(min(_STEADY_CLIMB * vehicle.climb_mps, 8.0), 1.0)
    takeoff_mps = min(max(vehicle.glide_mps, _TAKEOFF * vehicle.stall_mps), vehicle.cruise_mps)
    values["FW_TKO_AIRSPD"] = takeoff_mps * calibrated
    switch = _switch(vehicle.cruise_mps)
    # 1.17 begins a leg at NAV_ACC_RAD or, if it is nearer, at NPFG's switch distance, which grows with the speed over
    # ground: NAV_ACC_RAD is that of the strongest wind from behind.
    fastest_mps = (1.0 + _WIND) * vehicle.cruise_mps
    values["NPFG_SW_DST_MLT"] = switch
    values["NAV_ACC_RAD"] = switch * track_error_bound_m(fastest_mps, _NPFG_PERIOD_S, _NPFG_DAMPING)
    values |= _landing(vehicle, calibrated)
    if vehicle.wheels:  # after the flare it takes the pitch RWTO_PSP: a tail wheel off the ground does not steer
        values["FW_LND_TD_TIME"] = _TOUCHDOWN_S
    return {name: float(f"{value:.4g}") for name, value in values.items()}


def _switch(cruise_mps: float) -> float:
    """Return NPFG_SW_DST_MLT, with which PX4 turns a right-angled corner in the strongest wind from behind.

        d = V^2 / a + W (pi/2) V / a + (V + W) t,  a = g tan(FW_R_LIM),  t = FW_R_TC + FW_R_LIM / FW_R_RMAX

    V: cruise, W: wind. The radius of the turn in the air, what the wind adds meanwhile, and the time to roll into it.
    """
    wind_mps = _WIND * cruise_mps
    turn_mps2 = STANDARD_GRAVITY_MPS2 * tan(radians(_BANK_DEG))
    roll_s = _ROLL_S + _BANK_DEG / _ROLL_DEGPS
    turn_m = (cruise_mps + 0.5 * pi * wind_mps) * cruise_mps / turn_mps2
    ahead_m = turn_m + (cruise_mps + wind_mps) * roll_s
    return ahead_m / track_error_bound_m(cruise_mps + wind_mps, _NPFG_PERIOD_S, _NPFG_DAMPING)


def _landing(vehicle: FixedWing, calibrated: float) -> dict[str, float]:
    """Return airspeed, height and times of the approach and the flare, without a range finder.

    For FW_LND_FL_TIME T PX4 keeps the sink rate w and closes the throttle, in a second T w falls as 1 - sqrt(t / T);
    the pitch follows with FW_P_TC, and lift beyond the weight, at most 0.3 g, stops what is left:

        FW_LND_FLALT = w (4/3 T + FW_P_TC) + w^2 / (2 * 0.3 g),   w = V sin(FW_LND_ANG) + gust

    PX4's own FW_LND_FLALT of 0.5 m lets the plane reach the ground while T runs. On the slope PX4 flies
    (1 - FW_T_HRATE_FF) w TC too high, with TC = FW_T_ALT_TC FW_LND_THRTC_SC: half of it is left.
    """
    approach_mps = _APPROACH * vehicle.stall_mps
    sink_mps = approach_mps * sin(radians(_SLOPE_DEG)) + _GUST_MPS
    flare_m = sink_mps * (4.0 / 3.0 * _FLARE_S + _PITCH_S) + sink_mps**2 / (2.0 * 0.3 * STANDARD_GRAVITY_MPS2)
    return {
        "FW_LND_AIRSPD": approach_mps * calibrated,
        "FW_LND_FLALT": flare_m,
        "FW_LND_FL_TIME": _FLARE_S,
        "FW_LND_FL_SINK": 0.7,
        "FW_LND_THRTC_SC": 0.5,
        "FW_LND_ABORT": 0.0,  # else it breaks off every landing
    }


def output_functions(vehicle: FixedWing, outputs: str) -> dict[str, float]:
    """Return the functions of the outputs in the order of the vehicle's commands: motors, then surfaces."""
    motors: dict[str, float] = {f"{outputs}{n}": 100 + n for n in range(1, len(vehicle.rotors) + 1)}
    first = len(vehicle.rotors) + 1
    servos: dict[str, float] = {f"{outputs}{first + i}": _FIRST_SERVO + i for i in range(len(vehicle.surfaces))}
    return motors | servos | _steering(vehicle, outputs)


def _steering(vehicle: FixedWing, outputs: str) -> dict[str, float]:
    """Return the output of the wheel's servo, reversed: PX4's is positive to the right. It has none for brakes."""
    if vehicle.steering is None:
        return {}
    reversed_bits = float(1 << vehicle.steering)
    return {f"{outputs}{vehicle.steering + 1}": _STEERING_WHEEL, outputs.replace("FUNC", "REV"): reversed_bits}
