"""The moving set-point of a plane: path, height and airspeed to roll, pitch and throttle, and these to commands.

Flight modes and the navigator command it. Each guidance step (50 Hz) they call one of the functions of the second
group; `commands` runs the inner loops at IMU rate. Local NED, m, m/s, rad.

    path -> NPFG -> lateral acceleration a -> roll_sp = atan(a / g), limited by FW_R_LIM, and more near the ground
    height, airspeed -> TECS -> pitch_sp, throttle
    roll_sp, pitch_sp -> attitude -> rates -> torque demands -> surfaces
"""

from __future__ import annotations

from math import sqrt
from typing import TypedDict, Unpack

from firmware_bridge._native import STATE_FIELDS, FlightCore
from firmware_bridge.mock_pixhawk import elementary as el
from firmware_bridge.mock_pixhawk.flight.trajectory import Point
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.plane.air_data import AirData
from firmware_bridge.mock_pixhawk.plane.attitude import PlaneAttitude
from firmware_bridge.mock_pixhawk.plane.npfg import lateral_acceleration_mps2, track_error_bound_m
from firmware_bridge.mock_pixhawk.plane.path import Circle, Line
from firmware_bridge.mock_pixhawk.plane.surfaces import SurfaceMixer
from firmware_bridge.mock_pixhawk.plane.tecs import Demand, Tecs, VerticalState
from firmware_bridge.mock_pixhawk.vehicle import Vehicle
from signals.units import RAD_PER_DEG, STANDARD_GRAVITY_MPS2

PERIOD_S = 0.02
CHANNELS = 16
_EULER, _RATES, _ACCEL = (STATE_FIELDS[name][0] for name in ("euler", "w_NF_F", "a_NF_N"))
_GROUND_ROLL_RAD = 5.0 * RAD_PER_DEG
_GROUND_GAIN, _GROUND_YAW_GAIN = 0.05, 1.5  # rad/m, 1/s
_GROUND_INTEGRAL = 0.4  # most of the wheel's command, as PX4's FW_WR_IMAX
_RUDDER_SHARE = 2.0  # of the wheel's command
_GROUND_TURN_RAD = 20.0 * RAD_PER_DEG
_LOW_M = 15.0  # above home: below, the bank is limited


class Wanted(TypedDict, total=False):
    """Height, airspeed and limits of a guidance step; each may be left out."""

    d_m: float | None  # height, local down
    climb_mps: float | None  # height rate, without a height
    airspeed_mps: float  # calibrated; else that of the flight
    least_airspeed_mps: float  # below which speed is all that counts; else FW_AIRSPD_MIN
    weight: float  # of speed against height; else FW_T_SPDWEIGHT
    throttle_max: float
    pitch_min_rad: float
    pitch_max_rad: float
    pitch_damping: float
    keeps_pitch: bool  # no jump of the pitch at a change of `weight`
    roll_limit_rad: float | None
    runway: Line | None  # wheels may touch: wings level, and rudder and wheel keep the nose along this line


class PlanePilot:
    """Set-points and inner loops of one plane."""

    def __init__(self, core: FlightCore, vehicle: Vehicle, params: ParamTable, air: AirData) -> None:
        self._state = core.state
        self._vehicle, self._params, self.air = vehicle, params, air
        self._tecs = Tecs(params)
        self._attitude = PlaneAttitude(params)
        self._mixer = SurfaceMixer(params)
        self.rotors = int(params["CA_ROTOR_COUNT"])
        self.path: Line | Circle | None = None
        self.airspeed_mps: float | None = None  # commanded, calibrated; None: FW_AIRSPD_TRIM
        self.throttle = 0.0
        self.roll_sp = self.pitch_sp = 0.0
        self._direct: tuple[float, float, float] | None = None  # torque demands of the manual mode
        self._yaw_rate_sp = 0.0  # on the ground
        self._runs = False
        self._steers = False  # wheels or belly on the ground, or nearly: heading is held by rudder and wheel
        self._rolling = False  # the same, and no integrator runs
        self._holds_tail = False
        self._brake = self._wheel_integral = 0.0
        self._last_us: int | None = None
        self.refresh_params()

    def refresh_params(self) -> None:
        """Read the parameters again; call after any of them has changed."""
        p = self._params
        self._tecs.refresh_params(p)
        self._attitude.refresh_params(p)
        self._mixer = SurfaceMixer(p)
        self.air.use_pitot = bool(p["FW_USE_AIRSPD"]) and bool(p["SYS_HAS_NUM_ASPD"])
        self._offset = p["FW_PSP_OFF"] * RAD_PER_DEG
        self._pitch_limits = (p["FW_P_LIM_MIN"] * RAD_PER_DEG, p["FW_P_LIM_MAX"] * RAD_PER_DEG)
        self._roll_limit = p["FW_R_LIM"] * RAD_PER_DEG
        self._roll_step = p["FW_PN_R_SLEW_MAX"] * RAD_PER_DEG * PERIOD_S

    # -- facts for the modes ------------------------------------------------------------------------------------

    def here(self) -> Point:
        """Return the estimated position."""
        v = self._vehicle
        return (v.pos_n, v.pos_e, v.pos_d)

    @property
    def course_rad(self) -> float:
        """Direction over ground; the heading while slow."""
        v = self._vehicle
        if v.v_n * v.v_n + v.v_e * v.v_e < 9.0:
            return v.yaw
        return el.atan2(v.v_e, v.v_n)

    @property
    def ground_speed_mps(self) -> float:
        """Speed over ground."""
        v = self._vehicle
        return sqrt(v.v_n * v.v_n + v.v_e * v.v_e)

    @property
    def trim_airspeed_mps(self) -> float:
        """Airspeed of the flight: commanded, or FW_AIRSPD_TRIM."""
        p = self._params
        asked = self.airspeed_mps if self.airspeed_mps is not None else p["FW_AIRSPD_TRIM"]
        return min(max(asked, p["FW_AIRSPD_MIN"]), p["FW_AIRSPD_MAX"])

    @property
    def forward_force_mps2(self) -> float:
        """Specific force along the body's x axis, as an accelerometer feels it: what launch detection looks at."""
        s, v = self._state, self._vehicle
        pitch = float(s[_EULER + 1])
        cos_pitch = el.cos(pitch)
        forward = cos_pitch * el.cos(v.yaw), cos_pitch * el.sin(v.yaw), -el.sin(pitch)
        along = sum(float(s[_ACCEL + i]) * forward[i] for i in range(3))
        return along + STANDARD_GRAVITY_MPS2 * el.sin(pitch)

    @property
    def reference_d_m(self) -> float:
        """Height that the energy control follows on its way to the one asked for, local down."""
        return -self._tecs.reference_m

    def turn_distance_m(self) -> float:
        """Return how far before a waypoint the next leg is begun: NPFG's switch distance, as PX4's."""
        p = self._params
        bound = track_error_bound_m(self.ground_speed_mps, p["NPFG_PERIOD"], p["NPFG_DAMPING"])
        return bound * p["NPFG_SW_DST_MLT"]

    def height_m(self) -> float:
        """Return the height above home."""
        home = self._vehicle.home
        return (home.d_m if home is not None else 0.0) - self._vehicle.pos_d

    # -- commands of modes that last ----------------------------------------------------------------------------

    def take_over(self) -> None:
        """Start a new mode from the vehicle's motion."""
        v = self._vehicle
        self._tecs.reset(-v.pos_d, float(self._state[_EULER + 1]) - self._offset)
        self.path = None
        self._direct = None
        self._steers = self._rolling = self._holds_tail = False
        self.airspeed_mps = None

    def circle_here(self) -> None:
        """Circle at the present place, on the side of NAV_LOITER_RAD's sign."""
        radius = self._params["NAV_LOITER_RAD"]
        course = self.course_rad
        side = abs(radius) if radius >= 0.0 else -abs(radius)
        n, e, _ = self.here()
        self.path = Circle(n - el.sin(course) * side, e + el.cos(course) * side, abs(radius), radius >= 0.0)

    # -- the guidance step: exactly one of these per step -------------------------------------------------------

    def _mode(self, direct: tuple[float, float, float] | None = None) -> None:
        """Begin a step: in the air, without brakes."""
        self._runs, self._direct, self._brake = True, direct, 0.0
        self._steers = self._rolling = self._holds_tail = False

    def off(self) -> None:
        """Engine off, surfaces neutral, brakes free."""
        self._mode()
        self._runs = False
        self.throttle = 0.0

    def idle(self) -> None:
        """On the ground: engine idle, surfaces level the plane, brakes on."""
        self._mode()
        self._brake = 1.0
        self.throttle = self._params["FW_THR_IDLE"]
        self.roll_sp, self.pitch_sp = 0.0, self._offset
        self._attitude.reset()

    def fly(self, **wanted: Unpack[Wanted]) -> None:
        """Follow the path (none: wings level) at a height (`d_m` local down) or height rate, and an airspeed."""
        p, v, air = self._params, self._vehicle, self.air
        d_m, pitch_min_rad, pitch_max_rad = wanted.get("d_m"), wanted.get("pitch_min_rad"), wanted.get("pitch_max_rad")
        airspeed_mps, throttle_max = wanted.get("airspeed_mps"), wanted.get("throttle_max")
        least_airspeed_mps = wanted.get("least_airspeed_mps")
        self._mode()
        runway = wanted.get("runway")
        if runway is None:
            self._bank(wanted.get("roll_limit_rad"))
        else:
            self.roll_sp = 0.0
            self._hold_heading(runway)
        cos_roll = el.cos(self.roll_sp)
        load = 1.0 / max(cos_roll, 0.3)
        # A banked wing stalls later by the root of its load.
        least = p["FW_AIRSPD_MIN"] if least_airspeed_mps is None else least_airspeed_mps
        asked = self.trim_airspeed_mps if airspeed_mps is None else airspeed_mps
        asked = max(asked, min(p["FW_AIRSPD_STALL"] * 1.15 * sqrt(load), p["FW_AIRSPD_MAX"]))
        demand = Demand(
            height_m=-d_m if d_m is not None else -v.pos_d,
            climb_mps=wanted.get("climb_mps") if d_m is None else None,
            airspeed_mps=asked * air.ratio,
            least_airspeed_mps=max(least * air.ratio, 0.1),
            throttle_min=min(p["FW_THR_MIN"], p["FW_THR_MAX"] if throttle_max is None else throttle_max),
            throttle_max=p["FW_THR_MAX"] if throttle_max is None else throttle_max,
            pitch_min_rad=(self._pitch_limits[0] if pitch_min_rad is None else pitch_min_rad) - self._offset,
            pitch_max_rad=(self._pitch_limits[1] if pitch_max_rad is None else pitch_max_rad) - self._offset,
            load_factor=load,
            speed_weight=wanted.get("weight"),
            pitch_damping=wanted.get("pitch_damping"),
            keeps_pitch=wanted.get("keeps_pitch", False),
        )
        state = VerticalState(-v.pos_d, -v.v_d, air.true_mps, air.rate_mps2)
        pitch, self.throttle = self._tecs.step(state, demand, PERIOD_S)
        self.pitch_sp = pitch + self._offset

    def attitude(self, roll: float, pitch: float, throttle: float) -> None:
        """Hold an attitude."""
        self._mode()
        self.roll_sp, self.pitch_sp, self.throttle = roll, pitch, throttle

    def direct(self, roll: float, pitch: float, yaw: float, throttle: float) -> None:
        """Pass torque demands to the surfaces."""
        self._mode((roll, pitch, yaw))
        self.throttle = throttle

    def roll_on_ground(
        self, line: Line, *, pitch_rad: float, throttle: float, brake: float = 0.0, holds_tail: bool = False
    ) -> None:
        """Roll along a line on the ground, wings level; rudder and wheel steer.

        `holds_tail`: full up elevator presses a tail wheel on the ground, whose side force grows with its load.
        """
        self._mode()
        self._rolling, self._brake, self._holds_tail = True, brake, holds_tail
        self.roll_sp, self.pitch_sp, self.throttle = 0.0, pitch_rad, throttle
        self.path = line
        self._hold_heading(line)

    def _hold_heading(self, line: Line) -> None:
        v = self._vehicle
        self._steers = True
        right = line.nearest(v.pos_n, v.pos_e).right_m
        # Head for the line, at most 20 degrees off its course.
        want = el.atan2(line.t_e, line.t_n) - min(max(_GROUND_GAIN * right, -_GROUND_TURN_RAD), _GROUND_TURN_RAD)
        self._yaw_rate_sp = min(max(_GROUND_YAW_GAIN * el.wrap_pi(want - v.yaw), -0.5), 0.5)

    def descend_blind(self) -> None:
        """Without position: wings level at the glide's airspeed, engine idle."""
        self.path = None
        if self._vehicle.landed:
            self.idle()
        else:
            self.fly(climb_mps=-1.0, throttle_max=0.0, weight=2.0)

    # -- inner loops --------------------------------------------------------------------------------------------

    def _bank(self, roll_limit_rad: float | None) -> None:
        p, v = self._params, self._vehicle
        wanted = 0.0
        if self.path is not None:
            accel = lateral_acceleration_mps2(
                self.path.nearest(v.pos_n, v.pos_e),
                ground_mps=(v.v_n, v.v_e),
                wind_mps=self.air.wind_mps,
                period_s=p["NPFG_PERIOD"],
                damping=p["NPFG_DAMPING"],
            )
            wanted = el.atan2(accel, STANDARD_GRAVITY_MPS2)
        limit = self._roll_limit if roll_limit_rad is None else min(roll_limit_rad, self._roll_limit)
        # PX4 limits the bank near the ground by span and height of the wings; here on a line from 5 deg to FW_R_LIM.
        height = max(self.height_m(), 0.0)
        if height < _LOW_M:
            limit = min(limit, _GROUND_ROLL_RAD + (self._roll_limit - _GROUND_ROLL_RAD) * height / _LOW_M)
        wanted = min(max(wanted, -limit), limit)
        step = self._roll_step if self._roll_step > 0.0 else 10.0
        self.roll_sp += min(max(wanted - self.roll_sp, -step), step)
        self.roll_sp = min(max(self.roll_sp, -limit), limit)

    def commands(self, now_us: int) -> list[float]:
        """Run the inner loops for the sample at `now_us`; return the 16 commands: rotors, then surfaces."""
        out = [0.0] * CHANNELS
        dt = 0.0 if self._last_us is None else 1e-6 * (now_us - self._last_us)
        self._last_us = now_us
        if not self._runs:
            return out
        s = self._state
        rates = (float(s[_RATES]), float(s[_RATES + 1]), float(s[_RATES + 2]))
        airspeed = max(self.air.airspeed_mps, self._params["FW_AIRSPD_STALL"])
        wheel = 0.0
        if self._direct is not None:
            demands = self._direct
            wheel = demands[2]
        else:
            euler = (float(s[_EULER]), float(s[_EULER + 1]))
            demands = self._attitude.step(
                self.roll_sp,
                self.pitch_sp,
                euler=euler,
                rates=rates,
                airspeed_mps=airspeed,
                holds=self._vehicle.landed or self._rolling,
                dt_s=dt,
            )
            if self._steers:
                p = self._params
                error = self._yaw_rate_sp - rates[2]
                if self.ground_speed_mps > 1.0:
                    step = p["FW_WR_I"] * error * min(dt, 0.1)
                    self._wheel_integral = min(max(self._wheel_integral + step, -_GROUND_INTEGRAL), _GROUND_INTEGRAL)
                wheel = p["FW_WR_P"] * error + p["FW_WR_FF"] * self._yaw_rate_sp + self._wheel_integral
                pitch = 1.0 if self._holds_tail else demands[1]
                demands = (demands[0], pitch, min(max(_RUDDER_SHARE * wheel, -1.0), 1.0))
            else:
                self._wheel_integral = 0.0
        for i in range(min(self.rotors, CHANNELS)):
            out[i] = _thousandths(min(max(self.throttle, 0.0), 1.0))
        surfaces = self._mixer.commands(*demands)
        self._mixer.set_wheels(surfaces, steering=wheel, brake=self._brake)
        for i, value in enumerate(surfaces[: CHANNELS - self.rotors]):
            out[self.rotors + i] = _thousandths(value)
        return out


def _thousandths(value: float) -> float:
    """Round to PX4's steps of 1/1000; never -0."""
    return round(value * 1000.0) / 1000.0 + 0.0
