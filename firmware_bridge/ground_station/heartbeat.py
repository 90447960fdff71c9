"""The ground station's heartbeat, and the vehicle's."""

from __future__ import annotations

from typing import Any

from firmware_bridge.codecs.messages import message_class
from firmware_bridge.ground_station.wire import Wire
from hil.signals.time import NS_PER_S

_Heartbeat = message_class("HEARTBEAT")
_TYPE_GCS = 6
_AUTOPILOT_INVALID = 8
_STATE_ACTIVE = 4
_MAVLINK_VERSION = 3
_SAFETY_ARMED = 0x80


class Heartbeats:
    """Says once a simulated second that a ground station is there, and keeps the vehicle's latest heartbeat.

    PX4 starts its data-link failsafe when the ground station's heartbeats stop.
    """

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        self.due_ns = 0
        self.connected = False
        self.armed = False
        self.autopilot = 0  # MAV_AUTOPILOT
        self.custom_mode = 0
        self.system_status = 0

    def on_heartbeat(self, message: Any) -> None:
        self.connected = True
        self.armed = bool(message.base_mode & _SAFETY_ARMED)
        self.autopilot = message.autopilot
        self.custom_mode = message.custom_mode
        self.system_status = message.system_status

    def step(self, t_ns: int) -> None:
        if t_ns >= self.due_ns:
            # From the previous due time, not from now: no drift if a tick does not fall on the second.
            self.due_ns += NS_PER_S * ((t_ns - self.due_ns) // NS_PER_S + 1)
            self._wire.say(_Heartbeat(_TYPE_GCS, _AUTOPILOT_INVALID, 0, 0, _STATE_ACTIVE, _MAVLINK_VERSION))
