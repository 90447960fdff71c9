"""Set-points for the flight core: trajectories, holding, descending, heading.

One `Guidance` per vehicle. Flight modes (`flight_modes`, `navigator`) command it; each guidance step it advances the
set-point and passes it to the flight core. Local NED, m, m/s, rad.

The flight core gets position, velocity and acceleration of the trajectory, so that it needs no position error to fly
a corner.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import nan, sqrt

from firmware_bridge._native import FlightCore
from firmware_bridge.mock_pixhawk import elementary as el
from firmware_bridge.mock_pixhawk.flight.trajectory import Limits, Point, Trajectory
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.vehicle import Vehicle
from signals.units import RAD_PER_DEG

OFF, IDLE, POSITION, VELOCITY, ATTITUDE, RATE = range(6)  # FlightCore.set_setpoint kinds

PERIOD_US = 20_000  # guidance step: 50 Hz, as PX4's flight tasks

_CORNER_DEVIATION_M = 0.12  # rounding of mission corners, part of the cross-track error
_ACCEL_LATERAL_SHARE = 0.3  # of MPC_ACC_HOR in corners
_LAG_FREE_M, _HOLD_SPEED_MPS = 0.6, 0.3
_YAW_GAIN = 2.0  # 1/s


class Guidance:
    """The moving set-point of one vehicle."""

    def __init__(self, core: FlightCore, vehicle: Vehicle, params: ParamTable) -> None:
        self._core = core
        self._vehicle = vehicle
        self._params = params
        self._dt_s = PERIOD_US * 1e-6
        self.trajectory: Trajectory | None = None
        self._hold: Point | None = None
        self._landing_speed = 0.0
        self.yaw = 0.0
        self._yaw_rate = 0.0
        self.yaw_target: float | None = None  # None: keep
        self.course_yaw = True  # heading along the path
        self.refresh_params()

    def refresh_params(self) -> None:
        """Read the parameters again; call after any of them has changed."""
        p = self._params
        self.limits = Limits(
            speed_up_mps=min(p["MPC_Z_V_AUTO_UP"], p["MPC_Z_VEL_MAX_UP"]),
            speed_down_mps=min(p["MPC_Z_V_AUTO_DN"], p["MPC_Z_VEL_MAX_DN"]),
            accel_mps2=p["MPC_ACC_HOR"],
            jerk_mps3=p["MPC_JERK_AUTO"],
            accel_lateral_mps2=_ACCEL_LATERAL_SHARE * p["MPC_ACC_HOR"],
            corner_deviation_m=_CORNER_DEVIATION_M,
        )
        self.cruise_mps = p["MPC_XY_CRUISE"]
        self._speed_max = p["MPC_XY_VEL_MAX"]
        self._lag_max = max(p["MPC_XY_ERR_MAX"], 2.0 * _LAG_FREE_M)
        self._yaw_rate_max = p["MPC_YAWRAUTO_MAX"] * RAD_PER_DEG
        self._yaw_accel = p["MPC_YAWRAUTO_ACC"] * RAD_PER_DEG
        self._hover = p["MPC_THR_HOVER"]

    # -- commands of the flight modes ---------------------------------------------------------------------------

    def here(self) -> Point:
        """Return the estimated position."""
        v = self._vehicle
        return (v.pos_n, v.pos_e, v.pos_d)

    def take_over(self) -> None:
        """Reset for a new mode, with the vehicle's heading as set-point."""
        self.yaw = self._vehicle.yaw
        self._yaw_rate = 0.0
        self.yaw_target = None
        self.course_yaw = True
        self.trajectory = None
        self._hold = None

    def fly(self, points: Sequence[Point], speeds: Sequence[float] | None = None) -> Trajectory:
        """Follow the line through `points`. The first one is the current set-point."""
        v = self._vehicle
        if speeds is None:
            speeds = [min(self.cruise_mps, self._speed_max)] * (len(points) - 1)
        else:
            speeds = [min(s, self._speed_max) for s in speeds]
        trajectory = Trajectory(points, speeds, self.limits)
        t = trajectory.tangent
        trajectory.v = max(v.v_n * t[0] + v.v_e * t[1] + v.v_d * t[2], 0.0)
        self.trajectory = trajectory
        self._hold = None
        return trajectory

    def setpoint_position(self) -> Point:
        """Return the position set-point: on the trajectory or held, else the vehicle's position."""
        if self.trajectory is not None:
            return self.trajectory.position
        return self._hold or self.here()

    def brake(self) -> None:
        """Stop as fast as the limits allow and stay there."""
        v = self._vehicle
        speed = sqrt(v.v_n * v.v_n + v.v_e * v.v_e + v.v_d * v.v_d)
        if speed < _HOLD_SPEED_MPS:
            self.trajectory = None
            self._hold = self.here()
            return
        accel, jerk = self.limits.accel_mps2, self.limits.jerk_mps3
        distance = 0.5 * speed * (speed / accel + accel / jerk)
        n, e, d = self.here()
        k = distance / speed
        self.fly([(n, e, d), (n + k * v.v_n, e + k * v.v_e, d + k * v.v_d)], [speed])

    def hold(self, point: Point) -> None:
        """Stay at `point`."""
        self.trajectory = None
        self._hold = point

    def distance_to(self, point: Point) -> tuple[float, float]:
        """Return the horizontal and vertical distance of the vehicle from `point`."""
        v = self._vehicle
        dn, de = v.pos_n - point[0], v.pos_e - point[1]
        return sqrt(dn * dn + de * de), abs(v.pos_d - point[2])

    # -- the guidance step: exactly one of these per step -------------------------------------------------------

    def idle(self) -> None:
        """Run the motors at idle, on the ground."""
        self.yaw = self._vehicle.yaw
        self._core.set_setpoint(IDLE)

    def off(self) -> None:
        """Turn the motors off."""
        self._core.set_setpoint(OFF)

    def descend_blind(self) -> None:
        """Descend at landing speed without position. Without velocity the flight core keeps the vehicle level."""
        if self._vehicle.landed:
            self.idle()
        else:
            self.velocity(nan, nan, nan, 0.0, 0.0, self._params["MPC_LAND_SPEED"], 0.0)

    def follow(self) -> None:
        """Move along the trajectory, or hold."""
        trajectory = self.trajectory
        if trajectory is None:
            if self._hold is None:
                self._hold = self.here()
            n, e, d = self._hold
            self._turn(self.yaw_target)
            self._core.set_setpoint(POSITION, n, e, d, 0.0, 0.0, 0.0, self.yaw, self._yaw_rate, 0.0, 0.0, 0.0)
            return
        v = self._vehicle
        pn, pe, pd = trajectory.position
        dn, de, dd = v.pos_n - pn, v.pos_e - pe, v.pos_d - pd
        lag = sqrt(dn * dn + de * de + dd * dd)
        stretch = 1.0 if lag <= _LAG_FREE_M else max(0.0, (self._lag_max - lag) / (self._lag_max - _LAG_FREE_M))
        trajectory.advance(self._dt_s, stretch)
        n, e, d = trajectory.position
        vn, ve, vd = trajectory.velocity()
        an, ae, ad = trajectory.acceleration()
        target = self.yaw_target
        if target is None and self.course_yaw:
            target = trajectory.heading()
        self._turn(target)
        self._core.set_setpoint(POSITION, n, e, d, vn, ve, vd, self.yaw, self._yaw_rate, an, ae, ad)

    def descend(self, point: Point, speed_mps: float) -> None:
        """Descend at `speed_mps` over `point`. Its altitude is not used."""
        step = self.limits.accel_mps2 * 0.5 * self._dt_s
        now = self._landing_speed
        self._landing_speed = min(max(speed_mps, now - step), now + step)
        self._turn(self.yaw_target)
        self._core.set_setpoint(
            POSITION, point[0], point[1], nan, 0.0, 0.0, self._landing_speed, self.yaw, self._yaw_rate
        )

    def start_descent(self) -> None:
        """Start the next `descend` with the current vertical speed."""
        self._landing_speed = max(self._vehicle.v_d, 0.0)

    def velocity(self, n: float, e: float, d: float, vn: float, ve: float, vd: float, yaw_rate: float) -> None:
        """Control velocity on axes whose position is NaN, turning at `yaw_rate`."""
        self.yaw = el.wrap_pi(self.yaw + yaw_rate * self._dt_s)
        self._core.set_setpoint(POSITION, n, e, d, vn, ve, vd, self.yaw, yaw_rate)

    def attitude(self, roll: float, pitch: float, thrust: float, yaw_rate: float) -> None:
        """Control attitude and thrust 0..1, turning at `yaw_rate`."""
        self.yaw = el.wrap_pi(self.yaw + yaw_rate * self._dt_s)
        self._core.set_setpoint(ATTITUDE, roll, pitch, thrust, 0.0, 0.0, 0.0, self.yaw, yaw_rate)

    def climb_thrust(self, v_down_mps: float) -> float:
        """Return the collective thrust 0..1 for the vertical speed `v_down_mps`: hover thrust plus a P controller."""
        error = v_down_mps - self._vehicle.v_d
        return min(max(self._hover * (1.0 - 0.3 * error), 0.5 * self._hover), 1.5 * self._hover)

    def _turn(self, target: float | None) -> None:
        """Turn the heading set-point towards `target` at limited rate and acceleration; None: stop turning."""
        wanted = 0.0
        if target is not None:
            error = el.wrap_pi(target - self.yaw)
            brake = sqrt(2.0 * self._yaw_accel * abs(error))
            rate = min(self._yaw_rate_max, brake, _YAW_GAIN * abs(error))
            wanted = rate if error > 0.0 else -rate
        step = self._yaw_accel * self._dt_s
        self._yaw_rate += min(max(wanted - self._yaw_rate, -step), step)
        self.yaw = el.wrap_pi(self.yaw + self._yaw_rate * self._dt_s)
