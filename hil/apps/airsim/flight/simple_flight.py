"""Flight controller `simple_flight` of one vehicle: API control, arming, one move at a time, hovering, remote control.

It is a pilot of `hil.run.stepped`: `controls` turns the true state into rotor commands at every tick. A move takes a
step at its first tick and every 20 ms after it. A new move cancels the running one, whose result is False. 60 ms after
the last command the vehicle hovers: at the place of that command if it is within 0.5 m, otherwise where it is.

Differences from AirSim:

- A move without API control is an error; there it waits for its timeout without an effect.
- Disarming, and giving up API control, cancel the running move.
- On the ground the rotors idle (armed) or stand still, and the vehicle counts as landed once it stands there with idle
  rotors; there it goes on pressing for its last command, and is landed only after it was disarmed.
- An armed vehicle whose API control is taken in the air hovers; there it falls until the first move.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import sqrt

from hil.apps.airsim.flight.gains import with_gains
from hil.apps.airsim.flight.move import ACCURACY_M, NOTHING, PERIOD_NS, Command, Move, MoveError
from hil.apps.airsim.flight.ned_edge import NedEdge
from hil.apps.airsim.flight.remote import RcData, Receiver
from hil.apps.airsim.flight.spot import stay
from hil.run.stepped.ideal_controller import IdealController
from hil.run.stepped.setpoint import IDLE, STOPPED, Setpoint
from signals.rotation import norm
from signals.samples import TruthState, Vec3
from signals.time import NS_PER_MS
from sim.physics.vehicle import Vehicle

HOVER_AFTER_NS = 60 * NS_PER_MS
_STANDING_MPS = _STANDING_RADPS = 0.08
_IDLING = 0.1  # thrust over weight
Done = Callable[[bool | MoveError], None]  # receives the result of a move, or the error that ended it


class SimpleFlight:
    """Flight controller of one vehicle. `start_W` is the origin of its NED frame."""

    def __init__(
        self, vehicle: Vehicle, tick_ns: int, gravity_mps2: float, start_W: Vec3, *, density_ratio: float = 1.0
    ) -> None:
        self._edge = NedEdge(vehicle, gravity_mps2, start_W, density_ratio=density_ratio)
        self._controller = IdealController(vehicle, tick_ns, gravity_mps2, density_ratio=density_ratio)
        k_n = density_ratio * vehicle.rotor_constants.thrust_coefficient_n_per_radps2 * len(vehicle.rotors)
        self._idle_radps = sqrt(_IDLING * vehicle.mass_kg * gravity_mps2 / k_n)
        self.receiver = Receiver()
        self._move: Move | None = None
        self._done: Done | None = None
        self.reset()

    def reset(self) -> None:
        """Cancel the move, and forget API control and arming. Gains stay."""
        self.api_control = False
        self.armed = False
        self.landed = False
        self.receiver.data = RcData()
        self.cancel()
        self.moved()

    def close(self) -> None:
        """End what the controller has started outside; nothing here."""

    def moved(self) -> None:
        """Adapt to a vehicle that was put elsewhere: it hovers there, unless a move goes on."""
        self._controller.reset()
        self._setpoint: Setpoint = STOPPED
        self._command: Command = NOTHING
        self._hovering = False
        self._sent_ns: int | None = None  # time of the last command; None: there is none to wait for
        self._next_ns: int | None = None  # time of the next step; None: now

    # -- calls of the client ----------------------------------------------------------------------------------------

    def enable_api_control(self, enable: bool) -> None:
        """Take or give up the control of the vehicle. Without it the remote control commands the vehicle."""
        if enable != self.api_control:
            self.api_control = enable
            self._stop()

    def arm(self, arm: bool) -> bool:
        """Arm or disarm: the rotors of a disarmed vehicle stand still. Return False without API control."""
        if not self.api_control or (not arm and not self.armed):
            return False
        if arm != self.armed:
            self.armed = arm
            self._stop()
        return True

    def start(self, move: Move, done: Done) -> None:
        """Begin a move at the next tick; it cancels the running one. A move arms the vehicle, as in AirSim.

        `done` is called once. Raises MoveError without API control.
        """
        if not self.api_control:
            raise MoveError("the vehicle takes no commands: call enableApiControl(True) first")
        self.cancel()
        self.armed = True
        self._move, self._done, self._next_ns = move, done, None

    def cancel(self) -> None:
        """End the running move, with the result False."""
        self._finish(False)

    @property
    def busy(self) -> bool:
        """True while a move runs."""
        return self._move is not None

    def set_rc(self, data: RcData) -> None:
        """Take data of the remote control. Raises MoveError for a stick that is not finite."""
        self.receiver.data = data.checked()

    def set_gains(self, loop: str, kp: Sequence[float], ki: Sequence[float], kd: Sequence[float]) -> bool:
        """Set the gains of the loop `rate`, `attitude`, `velocity` or `position`; see `flight.gains`.

        Return True if `ki` or `kd` ask for what has no effect here. Raises MoveError.
        """
        gains, ignored = with_gains(self._controller.gains, loop, kp, ki, kd)
        self._controller.set_gains(gains)
        return ignored

    # -- every tick -------------------------------------------------------------------------------------------------

    def observe(self, truth: TruthState) -> None:
        """Step the move if it is due, and give its result if it is over.

        To call after every tick: a move then ends with the tick that ends it, and its successor begins at once.
        """
        self._update_landed(truth)
        t_ns = truth.t_ns
        if not self.api_control:
            self._command = NOTHING
            if self.receiver.data.is_valid:
                self._setpoint = self._edge.setpoint(self.receiver.data.command())
            else:
                self._setpoint = IDLE if self.armed else STOPPED
            return
        if self._move is not None and (self._next_ns is None or t_ns >= self._next_ns):
            self._next_ns = (t_ns if self._next_ns is None else self._next_ns) + PERIOD_NS
            self._step(self._move, truth)
        if self._sent_ns is None or t_ns - self._sent_ns > HOVER_AFTER_NS:
            self._hover(truth)

    def controls(self, truth: TruthState) -> Sequence[float]:
        """Return the command 0..1 of every rotor until the next tick."""
        self.observe(truth)
        return self._controller.controls(truth, self._setpoint)

    def _step(self, move: Move, truth: TruthState) -> None:
        try:
            command = move.step(self._edge.state(truth, self.landed))
            if command is None:
                self._finish(move.succeeded)
            elif command is not NOTHING:
                if command is not self._command:
                    self._setpoint = self._edge.setpoint(command)
                self._command, self._sent_ns, self._hovering = command, truth.t_ns, False
        except MoveError as error:
            self._finish(error)

    def _hover(self, truth: TruthState) -> None:
        """Hold a place in the air; on the ground let the rotors idle, or stand still if the vehicle is disarmed."""
        if self.landed or not self.armed:
            self._setpoint, self._hovering = IDLE if self.armed else STOPPED, False
        elif not self._hovering:
            self._hovering = True
            state = self._edge.state(truth, self.landed)
            (x, y, z), place, height = state.p_m, self._command.p_xy_m, self._command.z_m
            if (
                place is not None
                and height is not None
                and norm((place[0] - x, place[1] - y, height - z)) <= ACCURACY_M
            ):
                state = state._replace(p_m=(*place, height))
            self._setpoint = self._edge.setpoint(stay(state))
        self._command = NOTHING

    def _update_landed(self, truth: TruthState) -> None:
        if not truth.in_contact:
            self.landed = False
        elif self._controller.landed:
            self.landed = True
        elif norm(truth.v_WB_W) < _STANDING_MPS and norm(truth.w_WB_B) < _STANDING_RADPS:
            self.landed = self.landed or max(truth.rotor_speed_radps) < self._idle_radps

    def _finish(self, result: bool | MoveError) -> None:
        done, self._move, self._done = self._done, None, None
        if done is not None:
            done(result)

    def _stop(self) -> None:
        """Cancel the move and forget its last command."""
        self.cancel()
        self._command, self._sent_ns, self._hovering = NOTHING, None, False
