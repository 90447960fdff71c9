"""Lockstep, as in PX4 SITL: the only clock is HIL_SENSOR.time_usec, and each step has one reply.

Steps of one HIL_SENSOR (id 0):
    1 the clock is set; if it goes backwards the autopilot is silent from then on, as in PX4
    2 sensors go to the estimator; the flight core predicts, controls and mixes with the current set-point
    3 due timers run: guidance (failsafes, mode, set-point for the next step), then telemetry
    4 HIL_ACTUATOR_CONTROLS is written with the same time_usec
Until `boot_sensors` samples have arrived nothing is written; replies to other messages wait.

The last messages of a silent PX4 tell the cause. Flight termination in the air: STATUSTEXT "Flight termination active"
and a HEARTBEAT of system_status 8 (MAV_STATE_FLIGHT_TERMINATION), armed. OFFBOARD selected while disarmed: a HEARTBEAT
of that mode, disarmed, system_status 3. A clock that went backwards: no message.
"""

from __future__ import annotations

import struct

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID, message_class
from firmware_bridge.mock_pixhawk.faults import FaultInjector
from firmware_bridge.mock_pixhawk.firmware import Firmware
from firmware_bridge.mock_pixhawk.ids import Cmd
from firmware_bridge.mock_pixhawk.services.outbox import CHANNELS, Outbox, push_controls

HIL_SENSOR, HIL_GPS = MSGID["HIL_SENSOR"], MSGID["HIL_GPS"]

_unpack_sensor = struct.Struct("<Q13fIB").unpack
_FLAGS_LOCKSTEP = 1
_MODE_DISARMED, _MODE_ARMED = 1, 129
_LATEST_US = 1 << 60  # later times are invalid: 36,000 years
_HIL_SENSOR_INTERVAL_US = 5000.0  # what PX4 asks the simulator for: message 115 every 5 ms
_HIL_STATE_QUATERNION = 115
_CommandLong = message_class("COMMAND_LONG")


class Lockstep:
    """Timing of lockstep: steps `firmware` with each HIL_SENSOR."""

    def __init__(self, firmware: Firmware, outbox: Outbox, fault_injector: FaultInjector, boot_sensors: int) -> None:
        self._firmware, self._outbox, self._fault_injector = firmware, outbox, fault_injector
        self._boot_left = boot_sensors
        self._last_us = -1
        self.silent = False
        self._final_output = False
        self.steps = 0
        self.ignored = 0

    def send_boot_messages(self) -> None:
        """Send PX4's first messages: a request for HIL_STATE_QUATERNION and a HEARTBEAT."""
        request = (0, 0, Cmd.SET_MESSAGE_INTERVAL, 0, float(_HIL_STATE_QUATERNION), _HIL_SENSOR_INTERVAL_US)
        self._outbox.send(_CommandLong(*request, 0.0, 0.0, 0.0, 0.0, 0.0))
        self._firmware.send_heartbeat()

    def fall_silent(self) -> None:
        """Stop time and replies. Messages queued so far and a HEARTBEAT are still written."""
        if not self.silent:
            self.silent = self._final_output = True
            self._firmware.send_heartbeat()

    def next_due_us(self) -> int | None:
        """Return None: nothing happens without input."""
        return None

    def take(self, frames: list[Frame]) -> bytes:
        """Handle the received frames and return the bytes to write."""
        for frame in frames:
            msgid = frame[0]
            if msgid == HIL_SENSOR:
                self._on_sensor(frame[4])
            elif msgid == HIL_GPS:
                if not self.silent and self._last_us >= 0:
                    self._firmware.sensors.take_gps(frame[4], self._last_us)
            elif self.silent:
                self.ignored += 1
            else:
                self._firmware.handle(frame)
        outbox = self._outbox
        if not outbox.waiting or outbox.holding or (self.silent and not self._final_output):
            return b""
        self._final_output = False
        return outbox.take()

    def _on_sensor(self, payload: bytes) -> None:
        values = _unpack_sensor(payload)
        now_us = values[0]
        if values[15] != 0 or self.silent or now_us > _LATEST_US:
            self.ignored += 1
            return
        last_us = self._last_us
        if now_us <= last_us:
            # An equal time is a duplicate; an earlier one is a clock going backwards, which silences PX4.
            self.silent = now_us < last_us
            self.ignored += 1
            return
        firmware = self._firmware
        self._last_us = firmware.vehicle.now_us = now_us
        if last_us < 0:
            firmware.begin(now_us)
        self.steps += 1
        firmware.sensors.take(now_us, values, payload)
        if now_us >= firmware.timers.next_due_us:
            firmware.timers.run(now_us)
        if self._boot_left:
            self._boot_left -= 1
        elif not self.silent:
            self._reply(now_us)

    def _reply(self, now_us: int) -> None:
        firmware = self._firmware
        if firmware.vehicle.armed:
            controls = firmware.outputs(now_us)
            mode = _MODE_ARMED
        else:
            controls = [0.0] * CHANNELS
            mode = _MODE_DISARMED
        firmware.telemetry.controls = controls
        push_controls(self._outbox, self._fault_injector, now_us, _FLAGS_LOCKSTEP, controls, mode)
        self._outbox.holding = False
