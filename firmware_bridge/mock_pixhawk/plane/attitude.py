"""Attitude and rate loops of a plane, at IMU rate: roll and pitch set-points to torque demands, as in PX4.

    phi' = (phi_sp - phi) / FW_R_TC      theta' = (theta_sp - theta) / FW_P_TC
    psi' = g tan(phi) cos(theta) / V     coordinated turn: no side force in it
    p = phi' - psi' sin(theta)           q = theta' cos(phi) + psi' cos(theta) sin(phi)
    r = psi' cos(theta) cos(phi) - theta' sin(phi)
    u = s^2 (P e + I) + s FF w_sp + trim,      e = w_sp - w,  s = V_trim / V

A surface's torque grows with V^2 and the damping of rates with V: s scales the gains so that the loops answer alike at
every airspeed. FRD, rad. u: torque over that of full deflection at trim airspeed.
"""

from __future__ import annotations

from firmware_bridge.mock_pixhawk import elementary as el
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from signals.units import RAD_PER_DEG, STANDARD_GRAVITY_MPS2

_SCALE = (0.4, 1.8)  # limits of s: PX4 bounds it by the least and the greatest airspeed
_LONGEST_STEP_S = 0.02


class PlaneAttitude:
    """Rate integrators of roll, pitch and yaw."""

    def __init__(self, params: ParamTable) -> None:
        self.refresh_params(params)
        self.reset()

    def refresh_params(self, p: ParamTable) -> None:
        """Read the parameters again."""
        self._tc = (p["FW_R_TC"], p["FW_P_TC"])
        r = RAD_PER_DEG
        self._rate_limits = (
            (-p["FW_R_RMAX"] * r, p["FW_R_RMAX"] * r),
            (-p["FW_P_RMAX_NEG"] * r, p["FW_P_RMAX_POS"] * r),
            (-p["FW_Y_RMAX"] * r, p["FW_Y_RMAX"] * r),
        )
        self._gains = tuple(
            (p[f"FW_{axis}_P"], p[f"FW_{axis}_I"], p[f"FW_{axis}_FF"], p[f"FW_{axis}_IMAX"])
            for axis in ("RR", "PR", "YR")
        )
        self._trim = (p["TRIM_ROLL"], p["TRIM_PITCH"], p["TRIM_YAW"])
        self._trim_airspeed = p["FW_AIRSPD_TRIM"]

    def reset(self) -> None:
        """Clear the integrators."""
        self._integral = [0.0, 0.0, 0.0]

    def step(
        self,
        roll_sp: float,
        pitch_sp: float,
        *,
        euler: tuple[float, float],
        rates: tuple[float, float, float],
        airspeed_mps: float,
        holds: bool,
        dt_s: float,
    ) -> tuple[float, float, float]:
        """Return the torque demands (roll, pitch, yaw), not yet limited. `euler`: roll and pitch; `holds`: integrators
        stand still, on the ground."""
        roll, pitch = euler
        roll_rate = (roll_sp - roll) / self._tc[0]
        pitch_rate = (pitch_sp - pitch) / self._tc[1]
        sin_roll, cos_roll = el.sin(roll), el.cos(roll)
        sin_pitch, cos_pitch = el.sin(pitch), el.cos(pitch)
        bank = min(max(roll, -1.2), 1.2)  # tan grows without bound at a right angle
        turn = STANDARD_GRAVITY_MPS2 * el.sin(bank) / el.cos(bank) * cos_pitch / max(airspeed_mps, 3.0)
        wanted = (
            roll_rate - turn * sin_pitch,
            pitch_rate * cos_roll + turn * cos_pitch * sin_roll,
            turn * cos_pitch * cos_roll - pitch_rate * sin_roll,
        )
        return self.rate_step(wanted, rates=rates, airspeed_mps=airspeed_mps, holds=holds, dt_s=dt_s)

    def rate_step(
        self,
        wanted: tuple[float, float, float],
        *,
        rates: tuple[float, float, float],
        airspeed_mps: float,
        holds: bool,
        dt_s: float,
    ) -> tuple[float, float, float]:
        """Return the torque demands for body rates."""
        scale = min(max(self._trim_airspeed / max(airspeed_mps, 1.0), _SCALE[0]), _SCALE[1])
        dt = min(dt_s, _LONGEST_STEP_S)
        out = [0.0, 0.0, 0.0]
        integral = self._integral
        for axis in range(3):
            low, high = self._rate_limits[axis]
            rate_sp = min(max(wanted[axis], low), high)
            p, i, ff, most = self._gains[axis]
            error = rate_sp - rates[axis]
            if not holds:
                integral[axis] = min(max(integral[axis] + i * error * dt, -most), most)
            out[axis] = scale * scale * (p * error + integral[axis]) + scale * ff * rate_sp + self._trim[axis]
        return (out[0], out[1], out[2])
