"""The pilot of a standard VTOL: it owns a multirotor's guidance and a plane's pilot, and flies the transitions itself.

In a transition roll follows the path (the plane's NPFG), and the plane's energy control holds the height by pitch, in a
range about s times the pitch of cruise that opens with s = (V - V_blend) / (V_trans - V_blend), cut to 0..1; in a
back-transition with s = 1. Both the lifters' attitude loops and the surfaces get these angles. The lifters carry what
the wings do not:

    T = T_hover (1 - s (V / V_trim)^2 + a / g) / cos(tilt),    a = K (climb_sp - climb) + I,    climb_sp = k (h_sp - h)

(V / V_trim)^2 is the lift over the weight at the pitch of cruise. T and the torques are then weighted (`transition`).
"""

from __future__ import annotations

from math import sqrt

from firmware_bridge._native import STATE_FIELDS, FlightCore
from firmware_bridge.mock_pixhawk import elementary as el
from firmware_bridge.mock_pixhawk.flight.guidance import IDLE, Guidance
from firmware_bridge.mock_pixhawk.flight.trajectory import Point
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.plane.path import Line
from firmware_bridge.mock_pixhawk.plane.pilot import PERIOD_S, PlanePilot
from firmware_bridge.mock_pixhawk.vehicle import Vehicle
from firmware_bridge.mock_pixhawk.vtol.transition import Motion, Regime, Transition
from signals.units import RAD_PER_DEG, STANDARD_GRAVITY_MPS2

_EULER = STATE_FIELDS["euler"][0]
_CLIMB_GAIN, _CLIMB_INTEGRAL, _HEIGHT_GAIN = 2.0, 1.0, 0.5  # 1/s, 1/s2, 1/s
_MOST_CLIMB_MPS, _MOST_INTEGRAL_MPS2 = 1.0, 5.0
_NOSE_DOWN_RAD, _NOSE_UP_RAD = 5.0 * RAD_PER_DEG, 8.0 * RAD_PER_DEG  # about the pitch of cruise
_BACK_NOSE_UP_RAD = 12.0 * RAD_PER_DEG
_ROLL_LIMIT_RAD = 20.0 * RAD_PER_DEG


class VtolPilot:
    """Set-points and commands of one VTOL."""

    def __init__(
        self, core: FlightCore, vehicle: Vehicle, params: ParamTable, guidance: Guidance, plane: PlanePilot
    ) -> None:
        self._core, self._state = core, core.state
        self._vehicle, self._params = vehicle, params
        self.guidance, self.plane = guidance, plane
        self.transition = Transition(params)
        self.new_failure: str | None = None  # of a quad-chute, until the failsafe has taken it
        self._d = 0.0  # height of the transition
        self._integral = 0.0
        count = int(params["CA_ROTOR_COUNT"])
        ahead = [params[f"CA_ROTOR{i}_AX"] > -params[f"CA_ROTOR{i}_AZ"] for i in range(count)]
        self._rotors = count
        self.lifters = [i for i in range(count) if not ahead[i]]
        self.pushers = [i for i in range(count) if ahead[i]]

    # -- facts --------------------------------------------------------------------------------------------------

    @property
    def regime(self) -> Regime:
        """Carrier of the vehicle now."""
        return self.transition.regime

    @property
    def flies(self) -> bool:
        """True while the wings carry the vehicle."""
        return self.regime is Regime.WING

    @property
    def transiting(self) -> bool:
        """True between hover and flight."""
        return self.transition.transiting

    def here(self) -> Point:
        """Return the estimated position."""
        return self.guidance.here()

    def braking_distance_m(self) -> float:
        """Return how far a back-transition leads, at VT_B_DEC_MSS from the present speed."""
        v = self.plane.ground_speed_mps
        return 0.5 * v * v / self._params["VT_B_DEC_MSS"]

    def motion(self, asked_d_m: float | None = None) -> Motion:
        """Return what the transitions look at."""
        v, s, plane = self._vehicle, self._state, self.plane
        ahead = v.v_n * el.cos(v.yaw) + v.v_e * el.sin(v.yaw)
        height = plane.height_m()
        asked = None if asked_d_m is None else height + v.pos_d - asked_d_m
        return Motion(plane.air.airspeed_mps, ahead, height, asked, float(s[_EULER]), float(s[_EULER + 1]))

    # -- the set-point, as the commander uses it ----------------------------------------------------------------

    def take_over(self) -> None:
        """Start a new mode from the vehicle's motion; a transition goes on."""
        if self.regime is Regime.HOVER:
            self.guidance.take_over()
        elif self.flies:
            self.plane.take_over()

    def idle(self) -> None:
        """On the ground."""
        self.guidance.idle()
        self.plane.off()

    def off(self) -> None:
        """Turn everything off, and begin the next flight in hover."""
        self.guidance.off()
        self.plane.off()
        self.transition.reset()

    def descend_blind(self) -> None:
        """Without position: a descent on the lifters, after a back-transition."""
        if self.flies:
            self.start_back(self._vehicle.now_us)
        if self.transiting:
            self.step_transition(self._vehicle.now_us)
        else:
            self.guidance.descend_blind()

    def refresh_params(self) -> None:
        """Read the parameters again."""
        self.guidance.refresh_params()
        self.plane.refresh_params()

    # -- transitions --------------------------------------------------------------------------------------------

    def start_front(self, now_us: int) -> bool:
        """Begin the front transition along the heading. Return False if the wings are not to be used."""
        if not self.transition.start_front(now_us, self.motion()):
            return False
        self._begin(self.guidance.setpoint_position()[2])
        n, e, _ = self.here()
        yaw = self.guidance.yaw
        self.plane.path = Line(n, e, el.cos(yaw), el.sin(yaw))
        return True

    def start_back(self, now_us: int) -> bool:
        """Begin the back-transition along the course."""
        if not self.transition.start_back(now_us):
            return False
        self._begin_back()
        return True

    def quad_chute(self, now_us: int, reason: str) -> None:
        """Give up the wings."""
        self.transition.quad_chute(now_us, reason, self.motion())
        self._given_up(reason)

    def _given_up(self, reason: str) -> None:
        self.new_failure = reason
        if self.transiting:
            self._begin_back()
        else:
            self._hover()

    def _begin_back(self) -> None:
        course = self.plane.course_rad
        n, e, d = self.here()
        self._begin(d)
        self.plane.path = Line(n, e, el.cos(course), el.sin(course))

    def _begin(self, d_m: float) -> None:
        self._d, self._integral = d_m, 0.0
        path = self.plane.path
        self.plane.idle()
        self.plane.take_over()
        self.plane.path = path
        self.guidance.yaw = self._vehicle.yaw

    def watch(self, now_us: int) -> None:
        """Look for a reason to give up the wings in flight; every guidance step."""
        if self.flies:
            reason = self.transition.step(now_us, self.motion(self.plane.reference_d_m))
            if reason is not None:
                self._given_up(reason)

    def step_transition(self, now_us: int) -> None:
        """Run one guidance step of a transition."""
        reason = self.transition.step(now_us, self.motion())
        if reason is not None:
            self._given_up(reason)
        if self.flies:
            self.plane.take_over()
            self._core.set_setpoint(IDLE)
        elif self.regime is Regime.HOVER:
            if reason is None:
                self._hover()
        else:
            self._fly_transition()

    def _hover(self) -> None:
        self.plane.off()
        self.guidance.take_over()
        self.guidance.brake()
        self.guidance.follow()

    def _fly_transition(self) -> None:
        p, plane, front = self._params, self.plane, self.regime is Regime.FRONT
        airspeed = plane.air.airspeed_mps
        blend, end = p["VT_ARSP_BLEND"], p["VT_ARSP_TRANS"]
        share = min(max((airspeed - blend) / max(end - blend, 0.1), 0.0), 1.0)
        up = _NOSE_UP_RAD if front else _BACK_NOSE_UP_RAD
        opening = share if front else 1.0
        middle = opening * p["FW_PSP_OFF"] * RAD_PER_DEG
        plane.fly(
            d_m=self._d,
            weight=0.0,
            least_airspeed_mps=0.0,
            throttle_max=p["VT_F_TRANS_THR"] if front else 0.0,
            pitch_min_rad=middle - opening * _NOSE_DOWN_RAD,
            pitch_max_rad=middle + opening * up,
            roll_limit_rad=_ROLL_LIMIT_RAD,
        )
        plane.throttle = self.transition.throttle
        if share > 0.0:
            self.guidance.yaw = self._vehicle.yaw  # the wings turn it
        self.guidance.attitude(plane.roll_sp, plane.pitch_sp, self._thrust(airspeed, opening), 0.0)

    def _thrust(self, airspeed_mps: float, share: float) -> float:
        p, v, g = self._params, self._vehicle, STANDARD_GRAVITY_MPS2
        climb_sp = min(max(_HEIGHT_GAIN * (v.pos_d - self._d), -_MOST_CLIMB_MPS), _MOST_CLIMB_MPS)
        error = climb_sp + v.v_d
        self._integral += _CLIMB_INTEGRAL * error * PERIOD_S
        self._integral = min(max(self._integral, -_MOST_INTEGRAL_MPS2), _MOST_INTEGRAL_MPS2)
        accel = _CLIMB_GAIN * error + self._integral
        speed = airspeed_mps / p["FW_AIRSPD_TRIM"]
        lift = min(share * speed * speed, 1.0)
        thrust = p["MPC_THR_HOVER"] * (1.0 - lift + accel / g) / max(v.tilt_cos, 0.7)
        return min(max(thrust, 0.0), 1.0)

    # -- inner loops --------------------------------------------------------------------------------------------

    def commands(self, now_us: int) -> list[float]:
        """Return the 16 commands of an instant: rotors in the order of the file, then surfaces."""
        out = self._core.motor_commands(self._rotors)
        if self.regime is Regime.HOVER:
            return out
        weight = self.transition.weight
        flown = self.plane.commands(now_us)
        for i in self.lifters:
            out[i] = round(1000.0 * self._weighted(out[i], weight)) / 1000.0
        for i in self.pushers:
            out[i] = flown[i]
        out[self._rotors :] = flown[self._rotors :]
        return out

    def _weighted(self, command: float, weight: float) -> float:
        """Return the command of `weight` times the thrust T = f u^2 + (1 - f) u."""
        if weight >= 1.0 or command <= 0.0:
            return command
        if weight <= 0.0:
            return 0.0
        f = self._params["THR_MDL_FAC"]
        thrust = weight * (f * command + 1.0 - f) * command
        if f < 1e-6:
            return thrust
        return (sqrt((1.0 - f) * (1.0 - f) + 4.0 * f * thrust) - (1.0 - f)) / (2.0 * f)
