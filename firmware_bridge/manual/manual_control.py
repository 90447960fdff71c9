"""Sends the sticks to the autopilot: MANUAL_CONTROL at a fixed rate of simulated time, with a dead-man switch.

    SILENT    no message is sent. The dead-man switch pressed -> FLYING
    FLYING    the sticks are sent. Switch released, or device lost -> RELEASED
    RELEASED  centred sticks are sent for `neutral_s`. Then -> SILENT; the switch pressed again -> FLYING

The silence is intended: the autopilot's failsafe for a lost remote control then takes over, as with a dead radio. After
the loss of a device the switch must be released before it counts again, so that a pad plugged in with the button
pressed has no effect.

The output is a pure function of (simulated time, frames received, state of the device). Input by hand makes a run
unrepeatable; without a device, or with a scripted one, it stays repeatable.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from enum import Enum
from typing import NamedTuple

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID, message_class
from firmware_bridge.ground_station.commands import ACCEPTED, Commands
from firmware_bridge.ground_station.vehicle_link import VehicleLink, enum_name
from firmware_bridge.manual.axes import StickMapping, manual_control_axes
from firmware_bridge.manual.sticks import NEUTRAL, ManualControlError, StickDevice, StickLost, StickState
from signals.errors import HandshakeError
from signals.time import NS_PER_S

# ArduPilot accepts sticks from its ground station's system id only. A component other than the bench's ground station,
# because each sender numbers its own messages.
_COMPID = 25  # MAV_COMP_ID_USER1

_ManualControl = message_class("MANUAL_CONTROL")
_COMMAND_ACK = MSGID["COMMAND_ACK"]
_DO_SET_MODE = 176
_COMPONENT_ARM_DISARM = 400
_TRIES = 3
_CUSTOM_MODE = 1.0  # MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
# Autopilots take up these modes only once sticks have come; a button for one that is pressed before waits so long.
_BY_STICKS = frozenset({"manual", "acro", "stabilized", "altitude", "position"})
_LEAD_NS = NS_PER_S // 4


class ManualEvent(NamedTuple):
    """An event for the recording."""

    t_ns: int
    kind: str
    text: str


class Control(Enum):
    """The state of manual control; see the module's header."""

    SILENT = "silent"
    FLYING = "flying"
    RELEASED = "released"


class Buttons(NamedTuple):
    """The functions of buttons. They count only while the sticks do; disarming too."""

    arm: int | None = None
    disarm: int | None = None
    modes: Mapping[int, str] = {}


def buttons_of(mapping: StickMapping) -> Buttons:
    """Return the buttons of a mapping."""
    return Buttons(mapping.arm, mapping.disarm, mapping.modes)


class ManualControlSource:
    """A source of commands for the scheduler: the sticks of `device`.

    `device` None: none is plugged in yet. `reopen` is called every `retry_s` while there is none; it returns None or
    raises StickLost while there still is none. `modes`: the autopilot's, for buttons (`Firmware.manual_modes`). All
    times are simulated.
    """

    def __init__(
        self,
        device: StickDevice | None,
        *,
        reopen: Callable[[], StickDevice | None] | None = None,
        buttons: Buttons = Buttons(),  # noqa: B008 (immutable)
        modes: Mapping[str, tuple[float, float]] = {},
        rate_hz: float = 25.0,
        neutral_s: float = 0.5,
        retry_s: float = 1.0,
        target_sysid: int | None = 1,
    ) -> None:
        if not 1.0 <= rate_hz <= 250.0:
            raise ManualControlError(f"rate_hz {rate_hz} must be from 1 to 250: autopilots expect 5 to 50 a second")
        if neutral_s < 0.0 or retry_s <= 0.0:
            raise ManualControlError(f"neutral_s {neutral_s} must not be negative, retry_s {retry_s} must be positive")
        unknown = sorted(set(buttons.modes.values()) - set(modes))
        if unknown:
            raise ManualControlError(f"unknown mode {', '.join(unknown)}; choose from: {', '.join(modes)}")
        self.control = Control.SILENT
        self.sent = 0  # MANUAL_CONTROL messages
        self._device, self._reopen = device, reopen
        self._buttons, self._modes = buttons, modes
        self._rate_millihz = round(rate_hz * 1000)
        self._neutral_ns, self._retry_ns = round(neutral_s * NS_PER_S), round(retry_s * NS_PER_S)
        self._link = VehicleLink(target_sysid=target_sysid, compid=_COMPID)
        self._commands = Commands(self._link, tries=_TRIES)
        self._command_name = ""  # of the command under way
        self._waiting = ""  # mode that is requested once the sticks have come
        self._flying_since_ns = 0
        self._next = 0  # number of the next poll
        self._released_at_ns = 0
        self._retry_at_ns = 0
        self._must_release = False
        self._unusable = ""
        self._pressed: frozenset[int] = frozenset()
        self._events: list[ManualEvent] = []

    def take_events(self) -> list[ManualEvent]:
        """Return the events since the last call."""
        events, self._events = self._events, []
        return events

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        """Run one tick. Return the bytes for the autopilot."""
        self._link.dispatch(frames, {_COMMAND_ACK: lambda ack: self._commands.on_ack(t_ns, ack)})
        self._follow_up(t_ns)
        self._poll_when_due(t_ns)
        return self._link.take()

    def _poll_when_due(self, t_ns: int) -> None:
        # Poll n is due at n / rate, in whole nanoseconds from the start: no drift whatever the tick.
        if t_ns * self._rate_millihz < self._next * 1000 * NS_PER_S:
            return
        self._next = t_ns * self._rate_millihz // (1000 * NS_PER_S) + 1
        state = self._poll(t_ns)
        held = state is not None and state.held
        if not held:
            if state is not None:
                self._must_release = False
            if self.control is Control.FLYING:
                self._release(t_ns, "released", "dead-man switch released: sticks centred")
        elif self.control is not Control.FLYING and not self._must_release:
            self.control, self._flying_since_ns = Control.FLYING, t_ns
            self._event(t_ns, "flying", f"{self._name}: the sticks count")
        if self.control is Control.FLYING and state is not None:
            self._on_buttons(t_ns, state.pressed - self._pressed)
        self._pressed = frozenset() if state is None else state.pressed
        self._send_sticks(t_ns, state)
        if self._waiting and t_ns - self._flying_since_ns >= _LEAD_NS:
            self._send_mode(t_ns, self._waiting)

    def close(self) -> None:
        """Close the device. May be called any number of times."""
        device, self._device = self._device, None
        if device is not None:
            with suppress(OSError):
                device.close()

    @property
    def _name(self) -> str:
        return self._device.name if self._device is not None else "no device"

    def _event(self, t_ns: int, kind: str, text: str) -> None:
        self._events.append(ManualEvent(t_ns, f"manual_{kind}", text))

    # -- sticks -------------------------------------------------------------------------------------------------

    def _send_sticks(self, t_ns: int, state: StickState | None) -> None:
        if self.control is Control.RELEASED and t_ns - self._released_at_ns >= self._neutral_ns:
            self.control = Control.SILENT
            self._event(t_ns, "silent", "no more sticks are sent: the autopilot's failsafe decides")
        if self.control is Control.SILENT:
            return
        sticks = state.sticks if self.control is Control.FLYING and state is not None else NEUTRAL
        self.sent += 1
        x, y, z, r = manual_control_axes(sticks)
        self._link.send(_ManualControl(target=self._link.target_sysid, x=x, y=y, z=z, r=r, buttons=0))

    def _poll(self, t_ns: int) -> StickState | None:
        if self._device is None:
            self._try_reopen(t_ns)
        if self._device is None:
            return None
        try:
            return self._device.poll()
        except StickLost as error:
            self.close()
            self._retry_at_ns = t_ns + self._retry_ns
            self._must_release = True
            if self.control is Control.FLYING:
                self._release(t_ns, "lost", f"{error}: sticks centred")
            else:
                self._event(t_ns, "lost", str(error))
            return None

    def _try_reopen(self, t_ns: int) -> None:
        if self._reopen is None or t_ns < self._retry_at_ns:
            return
        self._retry_at_ns = t_ns + self._retry_ns
        try:
            self._device = self._reopen()
        except StickLost:
            return
        except ManualControlError as error:
            # Perhaps another device than before. Reported once; the right one may still be plugged in.
            if str(error) != self._unusable:
                self._unusable = str(error)
                self._event(t_ns, "unusable", self._unusable)
            return
        if self._device is not None:
            advice = "; release the dead-man switch, then press it" if self._must_release else ""
            self._event(t_ns, "found", f"{self._name}: plugged in{advice}")

    def _release(self, t_ns: int, kind: str, text: str) -> None:
        self.control = Control.RELEASED
        self._released_at_ns = t_ns
        self._commands.drop()  # a pilot who has released the switch must not arm
        self._waiting = ""
        self._event(t_ns, kind, text)

    # -- buttons ------------------------------------------------------------------------------------------------

    def _on_buttons(self, t_ns: int, new: frozenset[int]) -> None:
        """Send one command for the newly pressed buttons: disarm before mode before arm."""
        buttons = self._buttons
        if buttons.disarm in new:
            self._request(t_ns, "disarm", _COMPONENT_ARM_DISARM, (0.0,))
            return
        for button, name in sorted(buttons.modes.items()):
            if button in new:
                self._event(t_ns, "button", f"mode {name} requested")
                if name in _BY_STICKS and t_ns - self._flying_since_ns < _LEAD_NS:
                    self._waiting = name
                else:
                    self._send_mode(t_ns, name)
                return
        if buttons.arm in new:
            self._request(t_ns, "arm", _COMPONENT_ARM_DISARM, (1.0,))

    def _request(self, t_ns: int, what: str, command: int, params: tuple[float, ...]) -> None:
        self._event(t_ns, "button", f"{what} requested")
        self._send(t_ns, what, command, params)

    def _send_mode(self, t_ns: int, name: str) -> None:
        self._waiting = ""
        self._send(t_ns, f"mode {name}", _DO_SET_MODE, (_CUSTOM_MODE, *self._modes[name]))

    def _send(self, t_ns: int, what: str, command: int, params: tuple[float, ...]) -> None:
        self._command_name = what
        self._commands.send(t_ns, command, params)

    def _follow_up(self, t_ns: int) -> None:
        """Report the answer to the command under way, or repeat it."""
        commands = self._commands
        if commands.result is not None:
            kind = "done" if commands.result == ACCEPTED else "refused"
            self._event(t_ns, kind, f"{self._command_name}: {enum_name('MAV_RESULT', commands.result)}")
            commands.drop()
        try:
            commands.step(t_ns)
        except HandshakeError:
            commands.drop()
            self._event(t_ns, "refused", f"{self._command_name}: sent {_TRIES} times without an answer")
