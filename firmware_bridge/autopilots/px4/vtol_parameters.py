"""PX4's parameters for a standard VTOL, for PX4 and for the mock: of its rotors, of its wings, of the transitions.

The rotors keep the order of the vehicle's file: CA_ROTORn are lifters and pushers as they come, with their axes, as
PX4's standard VTOL has them (ActuatorEffectivenessStandardVTOL: those that point ahead do not lift).

Transition: the wings can carry the vehicle alone from VT_ARSP_TRANS on, 1.3 times the stall but not over cruise;
the lifters give way from VT_ARSP_BLEND on, the stall. A back-transition ends at MPC_XY_CRUISE over ground.
"""

from __future__ import annotations

from firmware_bridge.autopilots.installation import Vtol
from firmware_bridge.autopilots.px4.rotor_parameters import geometry_parameters, mock_parameters
from firmware_bridge.autopilots.px4.wing_parameters import calibration, plane_parameters, px4_parameters
from signals.units import STANDARD_GRAVITY_MPS2

STANDARD_VTOL = 2  # CA_AIRFRAME
_MAV_TYPE = 22  # MAV_TYPE_VTOL_FIXEDROTOR
_VT_STANDARD = 2  # VT_TYPE
_FIRST_SERVO = 201
_TRANSITION, _BLEND = 1.3, 1.0  # over the stall
_RAMP_S = 3.0  # 1 / VT_PSHER_SLEW
# PX4's own defaults, where its airframe has those of its aircraft: full throttle, and no pusher in hover.
_PX4_TRANSITION = {"VT_F_TRANS_THR": 1.0, "VT_FWD_THRUST_EN": 0.0}


def vtol_parameters(vehicle: Vtol) -> dict[str, float]:
    """Return the parameters that make the mock's standard VTOL this vehicle."""
    values = plane_parameters(vehicle.wing) | _hover_parameters(vehicle)
    values |= {
        "SYS_AUTOSTART": 0,
        "CA_AIRFRAME": STANDARD_VTOL,
        "MAV_TYPE": _MAV_TYPE,
        "VT_TYPE": _VT_STANDARD,
        "RWTO_TKOFF": 0.0,
        **{name: float(f"{value:.4g}") for name, value in transition_parameters(vehicle).items()},
    }
    return values


def px4_vtol_parameters(vehicle: Vtol) -> dict[str, float]:
    """Return the parameters that make PX4's standard VTOL this vehicle.

    PX4 takes the thrust curve THR_MDL_FAC for the pusher, too: throttles are shares of the thrust, f u^2 + (1 - f) u of
    a command u. Airspeeds are calibrated.
    """
    values = vtol_parameters(vehicle) | px4_parameters(vehicle.wing) | _PX4_TRANSITION
    del values["SYS_AUTOSTART"]
    curve = values["THR_MDL_FAC"]
    values["FW_THR_TRIM"] *= curve * values["FW_THR_TRIM"] + 1.0 - curve
    for name in ("VT_ARSP_TRANS", "VT_ARSP_BLEND"):
        values[name] *= calibration(vehicle.wing)
    return {name: float(f"{value:.6g}") for name, value in values.items()}


def transition_parameters(vehicle: Vtol) -> dict[str, float]:
    """Return VT_ARSP_* and the times within which the pusher must reach them."""
    wing = vehicle.wing
    trans_mps = min(_TRANSITION * wing.stall_mps, wing.cruise_mps)
    blend_mps = min(_BLEND * wing.stall_mps, 0.9 * trans_mps)
    # The thrust beyond the drag of cruise is the least that there is on the way.
    least_mps2 = max(STANDARD_GRAVITY_MPS2 * wing.climb_mps / wing.cruise_mps, 0.1)
    return {
        "VT_ARSP_TRANS": trans_mps,
        "VT_ARSP_BLEND": blend_mps,
        "VT_F_TR_OL_TM": min(max(_RAMP_S + blend_mps / (1.5 * least_mps2), 6.0), 30.0),
        "VT_TRANS_TIMEOUT": min(max(_RAMP_S + trans_mps / least_mps2, 15.0), 30.0),
    }


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
    for rotor, pusher in zip(vehicle.pushers, vehicle.wing.rotors, strict=True):
        (x, y, z), (ax, ay, az) = pusher.position_m, pusher.axis
        # A pusher's own torque is left out, as PX4 does for pushers.
        place = {"PX": x, "PY": -y, "PZ": -z, "AX": ax, "AY": -ay, "AZ": -az, "CT": 6.5, "KM": 0.0}
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
    """Return the functions of the outputs in the order of the vehicle's commands: motors, then surfaces."""
    rotors = len(vehicle.lifters) + len(vehicle.pushers)
    motors: dict[str, float] = {f"{outputs}{n}": 100 + n for n in range(1, rotors + 1)}
    return motors | {f"{outputs}{rotors + 1 + i}": _FIRST_SERVO + i for i in range(len(vehicle.wing.surfaces))}
