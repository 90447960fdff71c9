"""Finds the failsafes of a flight in the vehicle's messages, whatever the firmware.

    STATUSTEXT   one that the firmware uses for failsafes (`Firmware.failsafe_texts`)
    HEARTBEAT    system_status CRITICAL, EMERGENCY or FLIGHT_TERMINATION of an armed vehicle: a failsafe is in charge

A failsafe is complete with the next HEARTBEAT, which has the mode that it has chosen: also that of a HEARTBEAT, because
its text may come later. Another text or another mode while the status lasts is a failsafe of its own: PX4 holds first,
then lands.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from firmware_bridge.autopilots.firmware import Firmware
from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID
from firmware_bridge.ground_station.modes import mode_word
from firmware_bridge.ground_station.vehicle_link import VehicleLink, enum_name
from signals.time import NS_PER_S

_SAFETY_ARMED = 0x80
_IN_CHARGE = frozenset({5, 6, 8})  # MAV_STATE: CRITICAL, EMERGENCY, FLIGHT_TERMINATION
_SAME_NS = 3 * NS_PER_S  # a text and the HEARTBEAT that shows its failsafe are not farther apart
_MOST = 100  # bounds the memory for a vehicle that sends failsafes without end


class Failsafe(NamedTuple):
    """One failsafe in flight: when [ns], the firmware's words, and the word of the mode after it."""

    t_ns: int
    text: str
    mode: str


class FailsafeWatch:
    """Call `step` with the frames of every tick. `found` has all failsafes so far."""

    def __init__(self, firmware: Firmware) -> None:
        self._firmware = firmware
        self._link = VehicleLink(target_sysid=None)
        self._t_ns = 0
        self._armed = False
        self._in_charge = self._continues = False  # now; and at the HEARTBEAT before, too
        self._mode = ""
        self._pending: list[tuple[int, str]] = []  # since the last HEARTBEAT
        self._untold: tuple[int, str] | None = None  # a HEARTBEAT's failsafe, unless a text tells it
        self._last_ns = -_SAME_NS  # of the newest text
        self.found: list[Failsafe] = []
        self._handlers = {MSGID["HEARTBEAT"]: self._on_heartbeat, MSGID["STATUSTEXT"]: self._on_statustext}

    def step(self, t_ns: int, frames: Sequence[Frame]) -> Sequence[Failsafe]:
        """Return the failsafes that the frames of this tick complete."""
        handlers = self._handlers
        for frame in frames:
            if frame[0] in handlers:
                break
        else:  # as in nearly every tick
            return ()
        before = len(self.found)
        self._t_ns = t_ns
        self._link.dispatch(frames, handlers)
        return self.found[before:]

    def conclude(self) -> Sequence[Failsafe]:
        """Return the failsafes that the flight's last texts told, without a HEARTBEAT after them."""
        before = len(self.found)
        if self._armed:
            self._complete()
        return self.found[before:]

    def _on_statustext(self, message: Any) -> None:
        text = message.text.strip()
        if self._firmware.is_failsafe(text):
            self._pending.append((self._t_ns, text))
            self._last_ns = self._t_ns
            self._untold = None

    def _on_heartbeat(self, message: Any) -> None:
        was_armed, self._armed = self._armed, bool(message.base_mode & _SAFETY_ARMED)
        was_in_charge = self._continues = self._in_charge
        self._in_charge = self._armed and message.system_status in _IN_CHARGE
        before, self._mode = self._mode, mode_word(message.autopilot, message.custom_mode, message.type)
        if was_armed or self._armed:
            self._complete()
        self._pending.clear()
        if not self._in_charge or self._t_ns - self._last_ns < _SAME_NS:
            return
        if not was_in_charge:
            self._untold = self._t_ns, f"Failsafe (HEARTBEAT: {enum_name('MAV_STATE', message.system_status)})"
        elif self._mode != before and self.found:
            self._add(self._t_ns, self.found[-1].text)

    def _complete(self) -> None:
        if self._untold is not None:
            self._pending.insert(0, self._untold)
            self._untold = None
        for t_ns, text in self._pending:
            self._add(t_ns, text)
        self._pending.clear()

    def _add(self, t_ns: int, text: str) -> None:
        last = self.found[-1] if self.found else None
        if last is not None and (last.text, last.mode) == (text, self._mode):
            repeated = self._continues or t_ns - last.t_ns < _SAME_NS
        else:
            repeated = False
        if not repeated and len(self.found) < _MOST:
            self.found.append(Failsafe(t_ns, text, self._mode))
