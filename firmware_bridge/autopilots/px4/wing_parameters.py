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

from math import degrees

from firmware_bridge.autopilots.installation import FixedWing, Surface
from firmware_bridge.mock_pixhawk.plane.npfg import track_error_bound_m

_RATE_BANDWIDTH = 7.5  # 1/s
_SERVED = 0.05  # share of the strongest surface below which one does not serve an axis
_AXES = (("R", 0, 1.0), ("P", 1, -1.0), ("Y", 2, -1.0))  # FLU to FRD: pitch and yaw change sign
_LEFT_ELEVON, _RIGHT_ELEVON, _LEFT_AILERON, _RIGHT_AILERON = 5, 6, 1, 2
_ELEVATOR, _RUDDER, _LEFT_V, _RIGHT_V, _ANY = 3, 4, 7, 8, 12
_FIRST_SERVO = 201
_CLIMB_SHARE = 0.8  # of what the engine could: TECS keeps some for speed
_TAKEOFF = 1.5  # airspeed of the climb over the stall
LAUNCH_MPS2 = 12.0  # forward acceleration of a launch; PX4's 30 is more than a hand has
ROTATION = 1.15  # airspeed at which the nose rises on the runway, over the stall
_WHEEL_GAINS = 1.0, 0.5  # of the yaw rate: PX4's 0.5 and 0.1 let a tail wheel turn into the wind by 12 degrees
_TOUCHDOWN_S = 2.0  # after the beginning of the flare
_STEERING_WHEEL = 440  # output function "Landing_Gear_Wheel"
_NPFG_PERIOD_S, _NPFG_DAMPING, _SWITCH = 10.0, 0.7, 0.32  # PX4's NPFG_PERIOD, NPFG_DAMPING and NPFG_SW_DST_MLT


def torques_frd_nm(surface: Surface) -> tuple[float, float, float]:
    """Return roll, pitch and yaw torque of a surface in FRD."""
    return (surface.torque_nm[0], -surface.torque_nm[1], -surface.torque_nm[2])


def full_torques_nm(vehicle: FixedWing) -> tuple[float, float, float]:
    """Return the torque of a full demand about each axis in FRD, 0 where no surface serves it."""
    return _full(vehicle, 0), _full(vehicle, 1), _full(vehicle, 2)


def _served(vehicle: FixedWing, axis: int) -> list[float]:
    """Return the torque of every surface about an axis; 0 for those that hardly act on it."""
    torques = [torques_frd_nm(surface)[axis] for surface in vehicle.surfaces]
    most = max((abs(t) for t in torques), default=0.0)
    # Yaw by ailerons is adverse yaw, not a control: it must also be what the surface mostly does, or nearly.
    own = [max(abs(t) for t in torques_frd_nm(surface)) for surface in vehicle.surfaces]
    return [t if abs(t) >= _SERVED * most and abs(t) >= _OWN * o else 0.0 for t, o in zip(torques, own, strict=True)]


_OWN = 0.2  # of the surface's strongest torque


def _full(vehicle: FixedWing, axis: int) -> float:
    return sum(abs(t) for t in _served(vehicle, axis))


def surface_parameters(vehicle: FixedWing) -> dict[str, float]:
    """Return CA_SV_CS*: type and torques of every surface."""
    values: dict[str, float] = {"CA_SV_CS_COUNT": len(vehicle.surfaces)}
    shares = {}
    for letter, axis, _ in _AXES:
        full = _full(vehicle, axis)
        shares[letter] = [t / full if full > 0.0 else 0.0 for t in _served(vehicle, axis)]
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
        torque = sum(t * s.trim for t, s in zip(_served(vehicle, axis), vehicle.surfaces, strict=True))
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


def px4_parameters(vehicle: FixedWing) -> dict[str, float]:
    """Return what PX4 needs beside `plane_parameters`, and the mock does not."""
    # PX4 climbs off the catapult as steeply as it can at FW_TKO_AIRSPD, and its default is the slowest airspeed: the
    # change to the first leg takes a tenth of it. 1.17 begins a leg at NAV_ACC_RAD, NPFG's distance no longer reaches
    # its navigator. Without a range finder it would break off every landing.
    takeoff_mps = min(max(vehicle.glide_mps, _TAKEOFF * vehicle.stall_mps), vehicle.cruise_mps)
    switch_m = _SWITCH * track_error_bound_m(vehicle.cruise_mps, _NPFG_PERIOD_S, _NPFG_DAMPING)
    values = {"FW_TKO_AIRSPD": takeoff_mps, "NAV_ACC_RAD": switch_m, "FW_LND_ABORT": 0.0}
    if vehicle.wheels:  # after the flare it takes the pitch RWTO_PSP: a tail wheel off the ground does not steer
        values["FW_LND_TD_TIME"] = _TOUCHDOWN_S
    return {name: float(f"{value:.4g}") for name, value in values.items()}


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
