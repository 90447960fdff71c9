"""PX4's parameters for a VTOL: of its rotors, its wings and its transitions. The mock takes those of a standard VTOL.

The rotors keep the order of the vehicle's file: CA_ROTORn are lifters and pushers as they come, with their axes, as
PX4's standard VTOL has them (ActuatorEffectivenessStandardVTOL: those that point ahead do not lift).

Transition: the wings can carry the vehicle alone from VT_ARSP_TRANS on, 1.3 times the stall but not over cruise;
the lifters give way from VT_ARSP_BLEND on, the stall. A back-transition ends at MPC_XY_CRUISE over ground.

Tilts: PX4 has one command VT_TILT_* for all, 0 at the servos' minimum and 1 at their maximum. In the transition they
wait for the airspeed at 0.6 of their way, as in PX4's airframes; its allocation follows the axes to halfway
(ActuatorEffectivenessTiltrotorVTOL). Halfway, the wings took over so much of the weight that the rotors slowed down,
and the airspeed was not reached.

Tilts on both sides steer the yaw in hover (CA_SV_TLn_CT 1), and PX4's rotors then do not: the yaw that a rotor with
the thrust T at y, tilted ahead by t, gives, T (|y| sin t -+ k cos t), passes those of the other rotors on the way, and
there roll and yaw have one and the same command. From upright a tilt turns ahead only: half of them act on a demand.

    yaw of a full demand = sum of T |y| (max - min) / 2 / 2, and MC_YAWRATE_P as of a multirotor's rotors
"""

from __future__ import annotations

from math import degrees, sin, sqrt

from firmware_bridge.autopilots.installation import Vtol
from firmware_bridge.autopilots.px4.rotor_parameters import (
    THRUST_CT,
    geometry_parameters,
    hover_and_gains,
    mock_parameters,
    yaw_rate_gains,
)
from firmware_bridge.autopilots.px4.tail_parameters import (
    LEAST_THRUST,
    frame_parameters,
    turning_parameters,
    wind_parameters,
)
from firmware_bridge.autopilots.px4.wing_parameters import (
    calibration,
    full_torques_nm,
    plane_parameters,
    px4_parameters,
    rate_gains,
)
from signals.units import STANDARD_GRAVITY_MPS2

# MAV_TYPE_VTOL_FIXEDROTOR, _TILTROTOR and _TAILSITTER
_KINDS = {
    "standard": {"CA_AIRFRAME": 2, "MAV_TYPE": 22, "VT_TYPE": 2},
    "tiltrotor": {"CA_AIRFRAME": 3, "MAV_TYPE": 21, "VT_TYPE": 1},
    "tailsitter": {"CA_AIRFRAME": 4, "MAV_TYPE": 23, "VT_TYPE": 0},
}
MOST_TILTS = 4  # CA_SV_TL_COUNT
_PITCH_BANDWIDTH = 15.0  # of a tiltrotor's elevators [1/s]
_STIFF_PITCH = {"FW_P_TC": 0.2, "FW_P_RMAX_POS": 120.0}  # PX4's least; twice its 60 deg/s
_ASIDE_M = 0.01  # PX4's margin (ActuatorEffectivenessTilts)
_SAME = 1e-3  # commands of tilts that turn together
_FIRST_SERVO = 201
_TRANSITION, _BLEND = 1.3, 1.0  # over the stall
_RAMP_S = 3.0  # 1 / VT_PSHER_SLEW
_TILTING_S = 5.0  # VT_F_TRANS_DUR, PX4's default: until the tilts wait
_ON_THE_WAY = 0.6  # VT_TILT_TRANS from VT_TILT_MC to VT_TILT_FW
# PX4's own defaults, where its airframe has those of its aircraft: full throttle, and no pusher in hover.
_PX4_TRANSITION = {"VT_F_TRANS_THR": 1.0, "VT_FWD_THRUST_EN": 0.0}


def vtol_parameters(vehicle: Vtol) -> dict[str, float]:
    """Return the parameters that make a VTOL of PX4's kind, or the mock's standard VTOL, this vehicle."""
    values = plane_parameters(vehicle.wing) | _hover_parameters(vehicle)
    values |= {
        "SYS_AUTOSTART": 0,
        **_KINDS[vehicle.kind],
        "RWTO_TKOFF": 0.0,
        **{name: float(f"{value:.4g}") for name, value in transition_parameters(vehicle).items()},
    }
    return values


def px4_vtol_parameters(vehicle: Vtol) -> dict[str, float]:
    """Return the parameters that make PX4's VTOL this vehicle.

    PX4 takes the thrust curve THR_MDL_FAC for the engines, too: throttles are shares of the thrust, f u^2 + (1 - f) u
    of a command u. Airspeeds are calibrated.
    """
    values = vtol_parameters(vehicle) | px4_parameters(vehicle.wing) | _PX4_TRANSITION | tilt_parameters(vehicle)
    del values["SYS_AUTOSTART"]
    if vehicle.kind == "tailsitter":
        values |= frame_parameters(values) | wind_parameters(values)
    curve = values["THR_MDL_FAC"]
    values["FW_THR_TRIM"] *= curve * values["FW_THR_TRIM"] + 1.0 - curve
    for name in ("VT_ARSP_TRANS", "VT_ARSP_BLEND"):
        values[name] *= calibration(vehicle.wing)
    return {name: float(f"{value:.6g}") for name, value in values.items()}


def transition_parameters(vehicle: Vtol) -> dict[str, float]:
    """Return VT_ARSP_* and the times within which pushers, tilts or a lowered nose must reach them."""
    wing = vehicle.wing
    trans_mps = min(_TRANSITION * wing.stall_mps, wing.cruise_mps)
    blend_mps = min(_BLEND * wing.stall_mps, 0.9 * trans_mps)
    airspeeds = {"VT_ARSP_TRANS": trans_mps, "VT_ARSP_BLEND": blend_mps}
    if vehicle.kind == "tailsitter":
        return airspeeds | turning_parameters(trans_mps, wing.cruise_mps)
    if vehicle.tilts:
        return airspeeds | {
            "VT_F_TRANS_DUR": _TILTING_S,
            "VT_F_TR_OL_TM": min(2.0 * _tilting_s(vehicle, blend_mps), 30.0),
            "VT_TRANS_TIMEOUT": min(3.0 * _tilting_s(vehicle, trans_mps), 30.0),
        }
    # The thrust beyond the drag of cruise is the least that there is on the way.
    least_mps2 = max(STANDARD_GRAVITY_MPS2 * wing.climb_mps / wing.cruise_mps, 0.1)
    return airspeeds | {
        "VT_F_TR_OL_TM": min(max(_RAMP_S + blend_mps / (1.5 * least_mps2), 6.0), 30.0),
        "VT_TRANS_TIMEOUT": min(max(_RAMP_S + trans_mps / least_mps2, 15.0), 30.0),
    }


def _tilting_s(vehicle: Vtol, airspeed_mps: float) -> float:
    """Return the time to an airspeed without drag: tilts go as far as VT_TILT_TRANS at a steady rate, then wait.

    The rotors on tilts keep their thrust of hover; there they give the acceleration a = g share sin(angle).
    """
    share = sum(len(sides) for sides in _sides_m(vehicle)) / len(vehicle.lifters)
    waiting_mps2 = STANDARD_GRAVITY_MPS2 * share * abs(sin(_ON_THE_WAY * vehicle.tilts[0].ahead_rad))
    ramped_mps = 0.5 * _TILTING_S * waiting_mps2
    return _TILTING_S + max(airspeed_mps - ramped_mps, 0.0) / max(waiting_mps2, 0.1)


def tilt_parameters(vehicle: Vtol) -> dict[str, float]:
    """Return CA_SV_TL* and CA_ROTORn_TILT, and VT_TILT_* of all tilts; nothing without tilts."""
    if not vehicle.tilts:
        return {}
    first = vehicle.tilts[0]
    hover, ahead = 0.5 * (first.hover_command + 1.0), 0.5 * (first.ahead_command + 1.0)
    values: dict[str, float] = {
        "CA_SV_TL_COUNT": len(vehicle.tilts),
        "VT_TILT_MC": hover,
        "VT_TILT_TRANS": hover + _ON_THE_WAY * (ahead - hover),
        "VT_TILT_FW": ahead,
    }
    values |= _pitch_loop(vehicle) | _linear_throttle(vehicle)
    steers = _steers(vehicle)
    if steers:
        values |= _yaw_gains(vehicle)
    for n, tilt in enumerate(vehicle.tilts):
        to_front = 1.0 if tilt.ahead_rad >= 0.0 else -1.0
        values |= {
            f"CA_SV_TL{n}_CT": float(steers),
            f"CA_SV_TL{n}_TD": 0.0,  # towards the front
            f"CA_SV_TL{n}_MINA": to_front * degrees(tilt.min_rad) + 0.0,
            f"CA_SV_TL{n}_MAXA": to_front * degrees(tilt.max_rad) + 0.0,
        }
        values |= {f"CA_ROTOR{rotor}_TILT": n + 1 for rotor in tilt.rotors}
    return values


def _sides_m(vehicle: Vtol) -> list[list[float]]:
    """Return for each tilt how far to the left its rotors are that lift."""
    y_m = {rotor: facts.position_m[1] for rotor, facts in zip(vehicle.lifters, vehicle.hover.rotors, strict=True)}
    return [[y_m[rotor] for rotor in tilt.rotors if rotor in y_m] for tilt in vehicle.tilts]


def _steers(vehicle: Vtol) -> bool:
    """Return True if every tilt is on one side, some left and some right."""
    left = [all(y > _ASIDE_M for y in tilt) for tilt in _sides_m(vehicle)]
    right = [all(y < -_ASIDE_M for y in tilt) for tilt in _sides_m(vehicle)]
    return any(left) and any(right) and all(a or b for a, b in zip(left, right, strict=True))


def _pitch_loop(vehicle: Vtol) -> dict[str, float]:
    """Return FW_PR_P as `wing_parameters` has it, with a loop twice as fast, and the stiffest attitude about it.

    In the first half second of a back-transition PX4 gives all rotors the throttle of the flight while the tilts are
    still ahead: those behind lift, and push the nose down with T x. The elevators answer (FW_PR_FF + FW_PR_P) / FW_P_TC
    per angle. With PX4's FW_P_TC of 0.4 s the nose of the tiltrotor fell to 37 degrees below the horizon.
    """
    wing = vehicle.wing
    torque_nm = full_torques_nm(wing)[1]
    if torque_nm <= 0.0:
        return {}
    gain = (_PITCH_BANDWIDTH * wing.inertia_kgm2[1] + min(wing.damping_nms[1], 0.0)) / torque_nm
    return {"FW_PR_P": max(min(gain, 2.0), rate_gains(wing)["FW_PR_P"]), **_STIFF_PITCH}


def _linear_throttle(vehicle: Vtol) -> dict[str, float]:
    """Return THR_MDL_FAC 0, with which PX4's thrusts are commands u, and what follows: hover, least thrust, gains.

    In that half second PX4's thrust falls steadily to 0. As a command it takes the thrust u^2 with it sooner: a third
    less impulse. The gains of the rate loops are over the slope of the thrust f u^2 + (1 - f) u in hover.
    """
    hover = vehicle.hover
    f, u = hover.thrust_model_factor, hover.hover_control
    least = LEAST_THRUST * (f * u * u + (1.0 - f) * u)
    least_u = 2.0 * least / (1.0 - f + sqrt((1.0 - f) ** 2 + 4.0 * f * least))
    gains = hover_and_gains(hover)
    return {
        "THR_MDL_FAC": 0.0,
        "MPC_THR_HOVER": min(max(u, 0.1), 0.8),
        "MPC_THR_MIN": least_u,
        **{
            name: gains[name] / (2.0 * f * u + 1.0 - f)
            for name in gains
            if name.startswith(("MC_ROLLRATE_", "MC_PITCHRATE_"))
        },
    }


def _yaw_gains(vehicle: Vtol) -> dict[str, float]:
    """Return MC_YAWRATE_P and _I for tilts that steer."""
    hover = vehicle.hover
    thrust_n = hover.mass_kg * STANDARD_GRAVITY_MPS2 / len(hover.rotors)
    torque_nm = sum(
        0.25 * thrust_n * sum(abs(y) for y in sides) * abs(tilt.max_rad - tilt.min_rad)
        for sides, tilt in zip(_sides_m(vehicle), vehicle.tilts, strict=True)
    )
    gain, integral = yaw_rate_gains(hover, torque_nm)
    return {"MC_YAWRATE_P": float(f"{gain:.4g}"), "MC_YAWRATE_I": float(f"{integral:.4g}")}


def tilt_problem(vehicle: Vtol) -> tuple[str, str] | None:
    """Return why PX4 cannot turn these tilts, and the remedy; None if it can."""
    tilts = vehicle.tilts
    if len(tilts) > MOST_TILTS:
        return (
            f"{vehicle.name!r} has {len(tilts)} tilts, and PX4 takes {MOST_TILTS}",
            "let one tilt turn several rotors",
        )
    for tilt in tilts:
        if tilt.ahead_command <= tilt.hover_command:
            hint = "turn the sign of its axis, and swap and negate min_deg and max_deg"
            return f"PX4 turns tilts ahead with a rising command, and {tilt.name!r} turns with a falling one", hint
        first = tilts[0]
        apart = abs(tilt.hover_command - first.hover_command), abs(tilt.ahead_command - first.ahead_command)
        if max(apart) > _SAME:
            hint = "give both the same min_deg and max_deg"
            return f"PX4 has one command for all tilts, and {first.name!r} and {tilt.name!r} have other ranges", hint
    return None


def rotor_geometry(vehicle: Vtol) -> dict[str, float]:
    """Return CA_ROTOR* of all rotors, in the order of the vehicle's file."""
    count = len(vehicle.lifters) + len(vehicle.pushers)
    values: dict[str, float] = {"CA_ROTOR_COUNT": count}
    hover = geometry_parameters(vehicle.hover)
    for n, rotor in enumerate(vehicle.lifters):
        values |= {
            name.replace(f"CA_ROTOR{n}_", f"CA_ROTOR{rotor}_"): value
            for name, value in hover.items()
            if name.startswith(f"CA_ROTOR{n}_")
        }
    engines = dict(zip(vehicle.engines, vehicle.wing.rotors, strict=True))
    for rotor in vehicle.pushers:
        pusher = engines[rotor]
        (x, y, z), (ax, ay, az) = pusher.position_m, pusher.axis
        # A pusher's own torque is left out, as PX4 does for pushers.
        place = {"PX": x, "PY": -y, "PZ": -z, "AX": ax, "AY": -ay, "AZ": -az, "CT": THRUST_CT, "KM": 0.0}
        values |= {f"CA_ROTOR{rotor}_{key}": round(value, 6) + 0.0 for key, value in place.items()}
    return values


def _hover_parameters(vehicle: Vtol) -> dict[str, float]:
    """Return thrust curve, hover thrust and gains of the lifters, and the geometry of all rotors."""
    own = {
        name: value
        for name, value in mock_parameters(vehicle.hover).items()
        if not name.startswith("CA_ROTOR") and name != "MAV_TYPE"
    }
    return own | rotor_geometry(vehicle)


def vtol_functions(vehicle: Vtol, outputs: str) -> dict[str, float]:
    """Return the functions of the outputs in the order of the vehicle's commands: motors, tilts, surfaces.

    PX4 numbers the servos of the surfaces first.
    """
    rotors, tilts, surfaces = (
        len(vehicle.lifters) + len(vehicle.pushers),
        len(vehicle.tilts),
        len(vehicle.wing.surfaces),
    )
    motors: dict[str, float] = {f"{outputs}{n}": 100 + n for n in range(1, rotors + 1)}
    servos = [*range(surfaces, surfaces + tilts), *range(surfaces)]
    return motors | {f"{outputs}{rotors + 1 + i}": _FIRST_SERVO + servo for i, servo in enumerate(servos)}
