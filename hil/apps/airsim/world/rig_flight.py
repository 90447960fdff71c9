"""Flight controller of a vehicle with an autopilot of its own: PX4Multirotor and ArduCopter, flown by our rigs.

Moves are those of simple_flight; every 20 ms their command goes to the autopilot as a position or velocity.

Differences from simple_flight:

- A move waits until the autopilot would arm (some seconds after its start and after a landing), without using up its
  timeout. The autopilot arms with the first move and disarms after a landing by itself.
- `land` is the autopilot's own landing, which cannot be cancelled.
- Moves by angles, rates, throttle or motor commands are errors, and so are controller gains and remote control.
- `reset` starts the autopilot anew, unless the vehicle has not flown.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import sqrt

from hil.apps.airsim.flight.move import PERIOD_NS, Move, MoveError
from hil.apps.airsim.flight.remote import RcData
from hil.apps.airsim.flight.simple_flight import Done, SimpleFlight
from hil.apps.airsim.flight.spot import Land
from hil.run.stepped.ideal_controller import Setpoint
from hil.run.stepped.rig_pilot import RigPilot
from signals.desired import DesiredState
from signals.samples import TruthState, Vec3
from sim.physics.vehicle import Vehicle

_NEAR_M = 1.0  # from a place, within which the autopilot gets the place itself
_APPROACH_PER_S = 1.0  # speed towards a place, per distance
_MOST_CLIMB_MPS = 3.0


class RigFlight(SimpleFlight):
    """Flight controller of one vehicle. Making one starts the autopilot; `close` ends it."""

    def __init__(
        self, vehicle: Vehicle, tick_ns: int, gravity_mps2: float, start_W: Vec3, make: Callable[[], RigPilot]
    ) -> None:
        self._rig: RigPilot | None = None
        self._flown = False
        super().__init__(vehicle, tick_ns, gravity_mps2, start_W)
        self._make = make
        self._rig = make()

    def reset(self) -> None:
        """Cancel the move, forget API control, and start the autopilot of a vehicle that has flown anew."""
        super().reset()
        if self._rig is not None and self._flown:
            self._flown = False
            self.close()
            self._rig = self._make()

    def close(self) -> None:
        """End the autopilot."""
        if self._rig is not None:
            rig, self._rig = self._rig, None
            rig.close()

    def start(self, move: Move, done: Done) -> None:
        """Begin a move once the autopilot is ready. Raises MoveError without API control."""
        if self._rig is None:
            raise MoveError("the vehicle's autopilot has ended; start the server again")
        super().start(move, done)
        self._rig.prepare()

    def set_gains(self, loop: str, kp: Sequence[float], ki: Sequence[float], kd: Sequence[float]) -> bool:  # noqa: ARG002
        """Raise MoveError: the autopilot has gains of its own."""
        raise MoveError("the vehicle has an autopilot of its own; set its parameters instead of controller gains")

    def set_rc(self, data: RcData) -> None:  # noqa: ARG002
        """Raise MoveError: the autopilot has no remote control here."""
        raise MoveError("the vehicle has an autopilot of its own, to which no remote control is connected here")

    def observe(self, truth: TruthState) -> None:
        """Step the move if it is due and the autopilot is ready."""
        if self._move is not None and self._rig is not None and not self._rig.ready:
            self._update_landed(truth)
            return
        super().observe(truth)

    def controls(self, truth: TruthState) -> Sequence[float]:
        """Return the autopilot's commands until the next tick. Raises LinkError if it is lost."""
        self.observe(truth)
        rig = self._rig
        if rig is None:
            return (0.0,) * len(truth.rotor_speed_radps)
        if truth.t_ns % PERIOD_NS == 0:
            desired = self._desired(truth)
            if desired is not None:
                rig.desire(desired)
        self._flown = self._flown or rig.flying
        return rig.controls(truth)

    def _desired(self, truth: TruthState) -> DesiredState | None:
        """Return what the autopilot shall do now; None: what it does anyway."""
        s = self._setpoint
        if isinstance(self._move, Land) and not self.landed:
            return DesiredState(land=True)
        if s.rotors is not None and (self._move is None or self.landed):
            return None  # idle rotors on the ground
        if s.rotors is not None or s.roll_pitch_rad is not None or s.roll_pitch_rate_radps is not None:
            self._finish(MoveError("this move needs simple_flight: an own autopilot takes positions and velocities"))
            self.moved()
            return None
        return _path_of(s, truth)


def _path_of(s: Setpoint, truth: TruthState) -> DesiredState:
    """Return the desired state of a set-point with positions and velocities."""
    x, y, z = truth.p_WB
    yaw, yaw_rate = s.yaw_rad, s.yaw_rate_radps
    if s.p_xy_m is not None and s.z_m is not None:
        dx, dy, dz = s.p_xy_m[0] - x, s.p_xy_m[1] - y, s.z_m - z
        away_m = sqrt(dx * dx + dy * dy + dz * dz)
        if away_m <= _NEAR_M:
            return DesiredState(p_W=(*s.p_xy_m, s.z_m), yaw_rad=yaw, yaw_rate_radps=yaw_rate, hold=True)
        speed = min(_APPROACH_PER_S * away_m, s.speed_limit_mps or away_m) / away_m
        return DesiredState(v_W=(speed * dx, speed * dy, speed * dz), yaw_rad=yaw, yaw_rate_radps=yaw_rate, hold=True)
    vx, vy = (0.0, 0.0)
    if s.v_xy_mps is not None:
        vx, vy = s.v_xy_mps
    elif s.p_xy_m is not None:
        vx, vy = _APPROACH_PER_S * (s.p_xy_m[0] - x), _APPROACH_PER_S * (s.p_xy_m[1] - y)
    vz = s.vz_mps
    if vz is None:
        climb = _APPROACH_PER_S * ((s.z_m if s.z_m is not None else z) - z)
        vz = min(max(climb, -_MOST_CLIMB_MPS), _MOST_CLIMB_MPS)
    return DesiredState(v_W=(vx, vy, vz), yaw_rad=yaw, yaw_rate_radps=yaw_rate, hold=True)
