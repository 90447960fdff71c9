"""Landing of a plane: a straight approach on a slope, the flare, the roll-out. With or without engine.

The approach line leads to the touch-down point with the slope min(tan FW_LND_ANG, height / distance at the entry):
level until it meets the slope, then down on it at FW_LND_AIRSPD (default: 1.3 times the stall). The flare begins at the
height max(FW_LND_FLALT, FW_LND_FL_TIME times the sink rate): within FW_LND_FL_TIME the height rate goes from that of
the approach to -FW_LND_FL_SINK, the throttle to FW_THR_IDLE. Then wings level, straight on, until the land detector
acts.

A plane with a steered wheel (FW_W_EN 1) holds the runway's heading, wings level, from the flare to rest; once it is
slow it rolls at the pitch RWTO_PSP and brakes, and a tail wheel is pressed on the ground. PX4 keeps its wheel
controller on as long, and rolls out at RWTO_PSP.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt

from firmware_bridge.mock_pixhawk import elementary as el
from firmware_bridge.mock_pixhawk.flight.trajectory import Point
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.plane.path import Line, line_between
from firmware_bridge.mock_pixhawk.plane.pilot import PlanePilot
from firmware_bridge.mock_pixhawk.vehicle import Vehicle
from signals.units import RAD_PER_DEG

_FLARE_ROLL_RAD = 5.0 * RAD_PER_DEG
_ROLL_OUT_M = 0.3
# Airspeed over the stall below which a plane that has touched down takes the attitude in which it stands, and below
# which it cannot leave the ground again.
_SETTLES, _STAYS = 1.12, 1.05
_FLARE_DAMPING = 0.3  # three times FW_T_PTCH_DAMP: there is no time for the integral


class PlaneLanding:
    """One landing at a point."""

    def __init__(self, pilot: PlanePilot, vehicle: Vehicle, params: ParamTable, say: Callable[[str], None]) -> None:
        self._pilot, self._vehicle, self._params, self._say = pilot, vehicle, params, say
        self._line = Line(0.0, 0.0, 1.0, 0.0)
        self._ground_d = self._entry_d = 0.0
        self._slope = 0.0
        self._flare_us: int | None = None
        self._flare_climb = self._flare_throttle = 0.0
        self._glides = False
        self.flaring = False

    def start(self, entry: Point, touch_down: Point, *, engine: bool = True) -> None:
        """Approach `touch_down`, from `entry`. Without `engine` the plane glides straight on at its best speed."""
        p = self._params
        line = line_between(*entry[:2], *touch_down[:2], otherwise_rad=self._pilot.course_rad)
        dn, de = touch_down[0] - entry[0], touch_down[1] - entry[1]
        self._line = Line(touch_down[0], touch_down[1], line.t_n, line.t_e)
        distance = max(sqrt(dn * dn + de * de), 1.0)
        steepest = p["FW_LND_ANG"] * RAD_PER_DEG
        self._ground_d, self._entry_d = touch_down[2], min(entry[2], touch_down[2])
        self._slope = min(el.sin(steepest) / el.cos(steepest), (self._ground_d - self._entry_d) / distance)
        self._flare_us = None
        self.flaring = False
        self._glides = not engine
        self._pilot.path = self._line
        self._pilot.airspeed_mps = None

    def approach_airspeed_mps(self) -> float:
        """Return FW_LND_AIRSPD, or PX4's default for it."""
        p = self._params
        return p["FW_LND_AIRSPD"] if p["FW_LND_AIRSPD"] > 0.0 else 1.3 * p["FW_AIRSPD_STALL"]

    def engine_lost(self) -> None:
        """Go on without engine."""
        self._glides = True

    def step(self, now_us: int) -> bool:
        """Run one guidance step. Return True once the vehicle is on the ground."""
        pilot, p, v = self._pilot, self._params, self._vehicle
        if v.landed and self._flare_us is not None:
            pilot.idle()
            return True
        height = self._ground_d - v.pos_d
        if self._flare_us is None and height <= max(p["FW_LND_FLALT"], p["FW_LND_FL_TIME"] * max(v.v_d, 0.0)):
            self._flare_us = now_us
            self.flaring = True
            self._flare_climb = min(-v.v_d, -p["FW_LND_FL_SINK"])
            self._flare_throttle = pilot.throttle
            self._say("Flaring")
        if self._flare_us is not None:
            self._flare(now_us, height)
        elif self._glides:
            pilot.fly(climb_mps=-1.0, airspeed_mps=glide_airspeed_mps(p), throttle_max=p["FW_THR_IDLE"], weight=2.0)
        else:
            to_go = -self._line.along_m(v.pos_n, v.pos_e)
            target = max(self._ground_d - self._slope * to_go, self._entry_d)
            pilot.fly(d_m=target, airspeed_mps=self.approach_airspeed_mps(), weight=1.0)
        return False

    def _flare(self, now_us: int, height: float) -> None:
        pilot, p = self._pilot, self._params
        assert self._flare_us is not None
        share = min(1e-6 * (now_us - self._flare_us) / p["FW_LND_FL_TIME"], 1.0)
        wheels = bool(p["FW_W_EN"])
        speed = pilot.air.airspeed_mps / p["FW_AIRSPD_STALL"]
        if wheels and share >= 1.0 and speed < _SETTLES:
            pilot.roll_on_ground(
                self._line,
                pitch_rad=p["RWTO_PSP"] * RAD_PER_DEG,
                throttle=p["FW_THR_IDLE"],
                brake=1.0,
                holds_tail=speed < _STAYS and p["RWTO_PSP"] > p["FW_PSP_OFF"],
            )
            return
        slow = pilot.ground_speed_mps < 0.7 * p["FW_AIRSPD_STALL"]
        if slow and height < _ROLL_OUT_M * 3.0:
            pilot.roll_on_ground(self._line, pitch_rad=p["FW_LND_FL_PMIN"] * RAD_PER_DEG, throttle=p["FW_THR_IDLE"])
            return
        climb = self._flare_climb + share * (-p["FW_LND_FL_SINK"] - self._flare_climb)
        throttle = max(self._flare_throttle * (1.0 - share), p["FW_THR_IDLE"])
        pilot.fly(
            climb_mps=climb,
            throttle_max=throttle,
            weight=0.0,
            least_airspeed_mps=0.0,
            pitch_min_rad=p["FW_LND_FL_PMIN"] * RAD_PER_DEG * share + p["FW_P_LIM_MIN"] * RAD_PER_DEG * (1.0 - share),
            pitch_max_rad=p["FW_LND_FL_PMAX"] * RAD_PER_DEG,
            roll_limit_rad=_FLARE_ROLL_RAD,
            pitch_damping=_FLARE_DAMPING,
            keeps_pitch=wheels and share == 0.0,
            runway=self._line if wheels else None,
        )


def glide_airspeed_mps(p: ParamTable) -> float:
    """Return the airspeed of a glide: that of the best glide ratio lies between the least and the trim airspeed."""
    return 0.5 * (p["FW_AIRSPD_MIN"] + p["FW_AIRSPD_TRIM"])
