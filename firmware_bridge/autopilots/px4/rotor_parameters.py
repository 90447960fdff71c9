"""PX4's parameters for the rotors of a vehicle, for PX4 and for the mock: geometry, hover thrust, gains.

Control allocation, as PX4 does it: with the effectiveness E of the rotors [roll, pitch, yaw, thrust], the commands are
E^+ times the demand, each column scaled so that demands are fractions (firmware_bridge/native/mixer.hpp). A full demand
then gives the torque or thrust `authority`, and a gain P of the rate loop a bandwidth of P authority / I.

Bandwidths, of the loops from the inside out: rate 0.9 / tau of the slower motor constant, at most the x500's 23 1/s;
attitude a third of it; velocity half of that. The mock's hand-tuned airframes (x500, iris) have about these.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from firmware_bridge.autopilots.installation import Multirotor
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable, airframe_kind, airframes
from signals.units import STANDARD_GRAVITY_MPS2

BASE_AIRFRAME = "x500"  # of the mock, where the parameters below replace its rotors and gains
_MAV_TYPE = {3: 15, 4: 2, 6: 13, 8: 14}  # tricopter, quadrotor, hexarotor, octorotor
THRUST_CT = 6.5  # PX4's default thrust coefficient
_INTEGRAL_PER_S, _LEAD_S, _YAW_INTEGRAL_PER_S = 1.54, 0.0154, 0.5  # over P; the x500's
_GEOMETRY = ("PX", "PY", "AX", "AY", "AZ", "CT", "KM")
_SAME = 2e-3  # m, and relative


class Authority(NamedTuple):
    """Torques [N m] and thrust [N] of a full demand."""

    roll_nm: float
    pitch_nm: float
    yaw_nm: float
    thrust_n: float


def authority(vehicle: Multirotor) -> Authority:
    """Return what a full demand gives, scaled as the allocation scales it."""
    mix = np.linalg.pinv(vehicle.full_effect)
    squares = np.sum(mix[:, :2] ** 2, axis=0)
    tilt = float(np.sqrt(max(squares) / (0.5 * len(vehicle.rotors))))
    return Authority(1 / tilt, 1 / tilt, 1 / float(np.max(np.abs(mix[:, 2]))), 1 / float(np.mean(mix[:, 3])))


def geometry_parameters(vehicle: Multirotor) -> dict[str, float]:
    """Return CA_ROTOR*: positions and axes in FRD, thrust coefficients, moments per thrust."""
    values: dict[str, float] = {"CA_ROTOR_COUNT": len(vehicle.rotors)}
    for i, rotor in enumerate(vehicle.rotors):
        (x, y, z), (ax, ay, az), share = rotor.position_m, rotor.axis, rotor.thrust_share
        km = rotor.spin * rotor.moment_ratio_m / share
        place = {"PX": x, "PY": -y, "PZ": -z, "AX": ax, "AY": -ay, "AZ": -az, "CT": THRUST_CT * share, "KM": km}
        values |= {f"CA_ROTOR{i}_{key}": round(value, 6) + 0.0 for key, value in place.items()}
    return values


def hover_and_gains(vehicle: Multirotor) -> dict[str, float]:
    """Return thrust curve, hover thrust, and the gains of the rate and attitude loops."""
    full = authority(vehicle)
    rate, yaw_rate = _bandwidths(vehicle)
    attitude = min(6.5, rate / 2.9)
    values = {
        "THR_MDL_FAC": vehicle.thrust_model_factor,
        "MPC_THR_HOVER": min(max(vehicle.mass_kg * STANDARD_GRAVITY_MPS2 / full.thrust_n, 0.1), 0.8),
        "MC_ROLL_P": attitude,
        "MC_PITCH_P": attitude,
        "MC_YAW_P": min(2.8, 0.56 * yaw_rate),
    }
    for axis, inertia, torque_nm in zip(("ROLL", "PITCH"), vehicle.inertia_kgm2, full, strict=False):
        gain = min(rate * inertia / torque_nm, 0.5)
        values |= {
            f"MC_{axis}RATE_P": gain,
            f"MC_{axis}RATE_I": _INTEGRAL_PER_S * gain,
            f"MC_{axis}RATE_D": min(_LEAD_S * gain, 0.01),
        }
    values["MC_YAWRATE_P"], values["MC_YAWRATE_I"] = yaw_rate_gains(vehicle, full.yaw_nm)
    return {name: float(f"{value:.4g}") for name, value in values.items()}


def yaw_rate_gains(vehicle: Multirotor, full_nm: float) -> tuple[float, float]:
    """Return MC_YAWRATE_P and _I, for the torque of a full demand."""
    gain = min(_bandwidths(vehicle)[1] * vehicle.inertia_kgm2[2] / full_nm, 1.5)
    return gain, min(_YAW_INTEGRAL_PER_S * gain, 1.0)


def _bandwidths(vehicle: Multirotor) -> tuple[float, float]:
    """Return those of the rate loops of roll and pitch, and of yaw [1/s]."""
    rate = min(23.0, 0.9 / vehicle.time_constant_s)
    return rate, min(5.0, 0.25 * rate)


def mock_parameters(vehicle: Multirotor) -> dict[str, float]:
    """Return the parameters that make the mock's base airframe this vehicle."""
    values = hover_and_gains(vehicle)
    velocity = min(3.0, values["MC_ROLL_P"] / 2.1)
    values |= {"MPC_XY_VEL_P_ACC": velocity, "MPC_XY_P": min(1.3, 0.435 * velocity)}
    return {"SYS_AUTOSTART": 0, **_vehicle_type(vehicle), **geometry_parameters(vehicle), **values}


def px4_parameters(vehicle: Multirotor, *, outputs: str = "PWM_MAIN_FUNC") -> dict[str, float]:
    """Return the parameters that make any multirotor airframe of PX4 this vehicle; a board has outputs HIL_ACT_FUNC."""
    functions, geometry = motor_functions(vehicle, outputs), geometry_parameters(vehicle)
    return {"CA_AIRFRAME": 0, **_vehicle_type(vehicle), **functions, **geometry, **hover_and_gains(vehicle)}


def motor_functions(vehicle: Multirotor, outputs: str) -> dict[str, float]:
    """Return the functions of the outputs: motor n at output n."""
    return {f"{outputs}{n}": 100 + n for n in range(1, len(vehicle.rotors) + 1)}


def _vehicle_type(vehicle: Multirotor) -> dict[str, float]:
    return {"MAV_TYPE": _MAV_TYPE.get(len(vehicle.rotors), 2)}


def matching_airframe(vehicle: Multirotor) -> str | None:
    """Return the mock's airframe that has these rotors; None if there is none."""
    wanted = geometry_parameters(vehicle)
    for name in airframes():
        if airframe_kind(name) != "multirotor":
            continue
        table = _airframe_table(name)
        if table["CA_ROTOR_COUNT"] == wanted["CA_ROTOR_COUNT"] and all(
            abs(table[key] - value) <= _SAME for key, value in wanted.items() if key.rpartition("_")[2] in _GEOMETRY
        ):
            return name
    return None


@cache
def _airframe_table(name: str) -> ParamTable:
    table = ParamTable.of_firmware()
    table.load_airframe(name)
    return table
