"""Total energy control: throttle commands the energy, pitch its distribution over height and speed.

A. A. Lambregts, "Vertical flight path and speed control autopilot design using total energy principles", AIAA 83-2239;
in the form of PX4's TECS (parameters FW_T_*). Energies per mass; V: true airspeed, h: height.

    total rate         E' = g h' + V V'          throttle = trim + E'_sp / E'_limit (limit - trim) + D e + I
    balance rate       B' = w_h g h' - w_v V V'  pitch = (B'_sp + D e + I) / (V g)

E'_sp is clipped to what the engine can do: g FW_T_CLMB_MAX at full throttle, -g FW_T_SINK_MIN with the engine off, and
the trim throttle holds level flight. e: set-point minus estimate. FW_T_SPDWEIGHT 0 leaves speed to the throttle, 2
height; below the least airspeed pitch keeps the speed alone, whatever that costs in height.
"""

from __future__ import annotations

from dataclasses import dataclass

from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from signals.units import STANDARD_GRAVITY_MPS2

_LONGEST_STEP_S = 0.1


@dataclass
class VerticalState:
    """Motion in the vertical plane: height above the origin [m], its rate, true airspeed and its rate."""

    height_m: float
    climb_mps: float
    airspeed_mps: float
    airspeed_rate_mps2: float


@dataclass
class Demand:
    """Height and airspeed that pitch and throttle are to reach, and the limits that they keep."""

    height_m: float
    airspeed_mps: float  # true
    least_airspeed_mps: float  # true, below which speed is all that counts
    climb_mps: float | None = None  # commanded height rate, instead of a height
    throttle_min: float = 0.0
    throttle_max: float = 1.0
    pitch_min_rad: float = -0.5
    pitch_max_rad: float = 0.5
    load_factor: float = 1.0
    speed_weight: float | None = None  # None: FW_T_SPDWEIGHT
    pitch_damping: float | None = None  # None: FW_T_PTCH_DAMP
    keeps_pitch: bool = False  # the integral takes up what the change to this demand would make the pitch jump by


class Tecs:
    """The controller's state. Angles in rad, pitch without FW_PSP_OFF."""

    def __init__(self, params: ParamTable) -> None:
        self.refresh_params(params)
        self.reset(0.0, 0.0)

    def refresh_params(self, p: ParamTable) -> None:
        """Read the parameters again."""
        g = STANDARD_GRAVITY_MPS2
        self._most, self._least = g * p["FW_T_CLMB_MAX"], -g * p["FW_T_SINK_MIN"]
        self._sink_max, self._climb_max = p["FW_T_SINK_MAX"], p["FW_T_CLMB_MAX"]
        self._climb_ref, self._sink_ref = p["FW_T_CLMB_R_SP"], p["FW_T_SINK_R_SP"]
        self._height_tc, self._speed_tc = p["FW_T_ALT_TC"], p["FW_T_TAS_TC"]
        self._throttle_damping, self._pitch_damping = p["FW_T_THR_DAMPING"], p["FW_T_PTCH_DAMP"]
        self._throttle_i, self._pitch_i = p["FW_T_THR_INTEG"], p["FW_T_I_GAIN_PIT"]
        self._weight = p["FW_T_SPDWEIGHT"]
        self._roll_to_throttle = p["FW_T_RLL2THR"]
        self._vertical_accel = p["FW_T_VERT_ACC"]
        self._rate_tc = p["FW_T_STE_R_TC"]
        self._forward = p["FW_T_SEB_R_FF"]
        self._trim_throttle = p["FW_THR_TRIM"]

    def reset(self, height_m: float, pitch_rad: float) -> None:
        """Start anew from the vehicle's height and pitch."""
        self.reference_m = height_m
        self._throttle_integral = 0.0
        self._pitch_integral = 0.0
        self._total_filtered: float | None = None
        self.pitch_rad = pitch_rad
        self.throttle = self._trim_throttle
        self.underspeed = 0.0

    def step(self, state: VerticalState, demand: Demand, dt_s: float) -> tuple[float, float]:
        """Return pitch [rad] and throttle 0..1."""
        dt = min(dt_s, _LONGEST_STEP_S)
        g, v = STANDARD_GRAVITY_MPS2, max(state.airspeed_mps, 3.0)
        climb_sp = self._climb_setpoint(state, demand, dt)
        speed_error = demand.airspeed_mps - state.airspeed_mps
        speed_rate_sp = min(max(speed_error / self._speed_tc, 0.5 * self._least / v), 0.5 * self._most / v)
        height_sp, speed_sp = g * climb_sp, v * speed_rate_sp
        height_rate, speed_rate = g * state.climb_mps, v * state.airspeed_rate_mps2

        below = demand.least_airspeed_mps - state.airspeed_mps
        self.underspeed = min(max(below / (0.1 * demand.least_airspeed_mps), 0.0), 1.0)
        throttle = self._throttle_step(height_sp + speed_sp, height_rate + speed_rate, demand, dt)
        weight = self._weight if demand.speed_weight is None else demand.speed_weight
        w_v = weight * (1.0 - self.underspeed) + 2.0 * self.underspeed
        w_h = (2.0 - weight) * (1.0 - self.underspeed)
        balance_sp = w_h * height_sp - w_v * speed_sp
        balance = w_h * height_rate - w_v * speed_rate
        pitch = self._pitch_step(balance_sp, balance_sp - balance, v, demand, dt)
        return pitch, throttle

    def _climb_setpoint(self, state: VerticalState, demand: Demand, dt: float) -> float:
        """Move the height reference towards the demand at limited rate; return the height rate that follows it."""
        if demand.climb_mps is not None:
            self.reference_m = state.height_m
            wanted = demand.climb_mps
        else:
            offset = demand.height_m - self.reference_m
            rate = min(max(offset / self._height_tc, -self._sink_ref), self._climb_ref)
            self.reference_m += rate * dt
            # A reference that ran away from a vehicle that cannot follow would wind up.
            self.reference_m = min(max(self.reference_m, state.height_m - 30.0), state.height_m + 30.0)
            wanted = rate + (self.reference_m - state.height_m) / self._height_tc
        return min(max(wanted, -self._sink_max), self._climb_max)

    def _throttle_step(self, total_sp: float, total: float, demand: Demand, dt: float) -> float:
        previous = total if self._total_filtered is None else self._total_filtered
        filtered = self._total_filtered = previous + (total - previous) * dt / (dt + self._rate_tc)
        wanted = total_sp + self._roll_to_throttle * (demand.load_factor - 1.0)
        wanted = min(max(wanted, self._least), self._most)
        error = min(max(total_sp, self._least), self._most) - filtered
        trim, low, high = self._trim_throttle, demand.throttle_min, demand.throttle_max
        if wanted >= 0.0:
            predicted = trim + wanted / self._most * max(high - trim, 0.0)
        else:
            predicted = trim - wanted / self._least * max(trim - low, 0.0)
        gain = 1.0 / (self._most - self._least)
        raw = predicted + self._throttle_damping * gain * error + self._throttle_integral
        step = self._throttle_i * gain * error * dt
        if not ((raw >= high and step > 0.0) or (raw <= low and step < 0.0)):
            self._throttle_integral = min(max(self._throttle_integral + step, -0.5), 0.5)
        full = self.underspeed * high + (1.0 - self.underspeed) * raw
        self.throttle = min(max(full, low), high)
        return self.throttle

    def _pitch_step(self, balance_sp: float, error: float, v: float, demand: Demand, dt: float) -> float:
        scale = 1.0 / (v * STANDARD_GRAVITY_MPS2)
        low, high = demand.pitch_min_rad, demand.pitch_max_rad
        damping = self._pitch_damping if demand.pitch_damping is None else demand.pitch_damping
        raw = (self._forward * balance_sp + damping * error + self._pitch_integral) * scale
        step = self._pitch_i * error * dt
        if not ((raw >= high and step > 0.0) or (raw <= low and step < 0.0)):
            self._pitch_integral = min(max(self._pitch_integral + step, -0.6 / scale), 0.6 / scale)
        if demand.keeps_pitch:
            self._pitch_integral = self.pitch_rad / scale - self._forward * balance_sp - damping * error
            raw = self.pitch_rad
        most = self._vertical_accel / v * dt
        wanted = min(max(raw, low), high)
        self.pitch_rad += min(max(wanted - self.pitch_rad, -most), most)
        return self.pitch_rad
