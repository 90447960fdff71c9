"""Steps asked of the vehicle one after the other, each again while the vehicle declines it for now."""

from __future__ import annotations

from collections.abc import Sequence

from firmware_bridge.ground_station.commands import ACCEPTED, Commands
from firmware_bridge.ground_station.heartbeat import Heartbeats
from firmware_bridge.ground_station.procedure import Step, declined_for_now
from firmware_bridge.ground_station.status_texts import StatusTexts
from firmware_bridge.ground_station.wire import enum_name, refused
from hil.signals.time import NS_PER_S

_RETRY_NS = NS_PER_S
_ARMINGS_LIMIT = 5


class Asking:
    """`begin` with steps, then `step` until it says True. HandshakeError where the vehicle refuses one for good."""

    def __init__(self, commands: Commands, heartbeats: Heartbeats, texts: StatusTexts) -> None:
        self._commands, self._heartbeats, self._texts = commands, heartbeats, texts
        self._steps: tuple[Step, ...] = ()
        self._asked: Step | None = None
        self._since_ns = self._limit_ns = 0
        self._armings = 0
        self.retry_ns: int | None = None  # when to ask again

    def begin(self, t_ns: int, steps: Sequence[Step], limit_ns: int) -> None:
        """`limit_ns`: how long a step may be declined for now, from `t_ns` on, which may be past."""
        self._steps = tuple(steps)
        self._asked = self.retry_ns = None
        self._since_ns, self._limit_ns = t_ns, limit_ns
        self._commands.result = None  # an answer to an earlier question answers none of these

    def step(self, t_ns: int) -> bool:
        """Ask what is to be asked at `t_ns`; whether all has been done."""
        while True:
            while self._steps and self._steps[0].arms and self._heartbeats.armed:
                self._next()
            if not self._steps:
                return True
            if self._commands.busy or (self.retry_ns is not None and t_ns < self.retry_ns):
                return False
            result, self._commands.result = self._commands.result, None
            asked, self._asked = self._asked, None
            if asked is not None and result == ACCEPTED and not asked.arms:
                self._next()
                continue
            if asked is not None and result is not None:
                self._wait(t_ns, asked, result)
                return False
            self.retry_ns = None
            self._asked = self._steps[0]
            self._commands.ask(t_ns, self._asked.command, self._asked.params)
            return False

    def _next(self) -> None:
        self._steps = self._steps[1:]
        self._asked = self.retry_ns = None

    def _wait(self, t_ns: int, asked: Step, result: int) -> None:
        """The step is not done, but may be a second later."""
        self.retry_ns = t_ns + _RETRY_NS
        if result == ACCEPTED:  # arming: the heartbeat will say so
            self._armings += 1
            if self._armings > _ARMINGS_LIMIT:
                raise refused(
                    f"the vehicle has accepted arming {_ARMINGS_LIMIT} times, but its heartbeats never say that "
                    f"it is armed{self._texts.last()}"
                )
            return
        waited_ns = t_ns - self._since_ns
        if result not in declined_for_now(self._heartbeats.autopilot) or waited_ns >= self._limit_ns:
            raise refused(
                f"the vehicle was asked to {asked.what} and answered {enum_name('MAV_RESULT', result)} "
                f"{waited_ns / NS_PER_S:.1f} s after the first request{self._texts.last()}"
            )
