"""Motor commands from ArduPilot's SERVO_OUTPUT_RAW: requests the message, checks it and converts it to controls.

A copter sends it on request only, and forgets the request at each boot. It refuses more than 0.8 of its main loop's
rate; then lower rates are requested, step by step. Its time since boot shows a reboot.
"""

from __future__ import annotations

import struct

from firmware_bridge.codecs.ardupilot_json import CONTROLS, PwmRange
from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder
from firmware_bridge.codecs.messages import MSGID, message_class, pack, unpack
from signals.samples import ActuatorFrame
from signals.time import NS_PER_S

_HEARTBEAT = MSGID["HEARTBEAT"]
_COMMAND_ACK = MSGID["COMMAND_ACK"]
_CommandLong = message_class("COMMAND_LONG")
_SET_MESSAGE_INTERVAL = 511
_ACCEPTED = 0
_ARMED_BIT = 0x80

# Minimum of a main loop of 400 Hz: 3000 us; of 200 Hz: 6000 us; of 125 Hz: 10,000 us.
INTERVALS_US = (3000, 4000, 6000, 8000, 10_000, 14_000, 20_000)
_SHARE_OF_LOOP = 0.8
_REPEAT_NS = NS_PER_S


SERVO_OUTPUT_RAW = MSGID["SERVO_OUTPUT_RAW"]

_unpack = struct.Struct("<I8HB8H").unpack_from
_LENGTH = 37
_TIME_WRAP_US = 1 << 32
_ORDER_US = 1_000_000  # a step back by less means messages out of order
_PAUSE_US = 60_000_000  # longest silence in which the time may have wrapped


def servo_output(frame: Frame) -> tuple[int, tuple[int, ...]] | None:
    """Return (time since boot [us], pulse widths [us] of outputs 1 to 16; 0: no pulse), or None for outputs 17 to 32.

    A sender that knows only eight outputs (MAVLink 1) leaves the others 0.
    """
    payload = frame[4]
    values = _unpack(payload if len(payload) >= _LENGTH else payload + bytes(_LENGTH - len(payload)))
    return None if values[9] != 0 else (values[0], values[1:9] + values[10:18])


def has_rebooted(before_us: int, after_us: int) -> bool:
    """Return True if the time since boot fell back, which shows a reboot, unless it wrapped after 71.6 minutes."""
    back_us = before_us - after_us
    return _ORDER_US < back_us < _TIME_WRAP_US - _PAUSE_US


class ServoOutputs:
    """The newest outputs of an autopilot whose main loop has `loop_hz` or less. `encoder` sends the requests."""

    def __init__(self, encoder: FrameEncoder, pwm: PwmRange, *, loop_hz: float = 400.0) -> None:
        self._encoder = encoder
        self._pwm = pwm
        self._mode = 0
        self._sysid = 0  # the autopilot's, known from its first message
        self._time_us: int | None = None
        self._came_ns: int | None = None
        self._requested_ns: int | None = None
        min_us = 1000 * (1000 // (_SHARE_OF_LOOP * loop_hz))  # ArduPilot counts whole milliseconds
        self._step = sum(interval_us < min_us for interval_us in INTERVALS_US[:-1])
        self._alive = False
        self._new: tuple[int, tuple[float, ...]] | None = None
        self.granted_us: int | None = None
        self.result: int | None = None  # MAV_RESULT of the last answer
        self.count = 0

    def take_frame(self, frame: Frame, now_ns: int) -> bool:
        """Take a frame. Return True if it shows that the autopilot has rebooted."""
        if not self._sysid and frame[2] == 1 and frame[0] in (_HEARTBEAT, SERVO_OUTPUT_RAW):
            self._sysid = frame[1]
        if frame[1] != self._sysid:
            return False
        if frame[0] == SERVO_OUTPUT_RAW:
            return self._take_outputs(frame, now_ns)
        if frame[0] == _HEARTBEAT and frame[2] == 1:
            self._alive = True
            self._mode = unpack(frame).base_mode
        elif frame[0] == _COMMAND_ACK:
            self._take_ack(frame)
        return False

    def _take_outputs(self, frame: Frame, now_ns: int) -> bool:
        outputs = servo_output(frame)
        if outputs is None:
            return False
        time_us, widths_us = outputs
        rebooted = self._time_us is not None and has_rebooted(self._time_us, time_us)
        self._time_us = time_us
        self._came_ns = now_ns
        self.count += 1
        self._new = (time_us * 1000, self._pwm.controls(widths_us))
        return rebooted

    def _take_ack(self, frame: Frame) -> None:
        ack = unpack(frame)
        ours = (self._encoder.sysid, self._encoder.compid)
        if ack.command != _SET_MESSAGE_INTERVAL or (ack.target_system, ack.target_component) != ours:
            return
        self.result = ack.result
        if ack.result == _ACCEPTED:
            self.granted_us = INTERVALS_US[self._step]
        elif self._step + 1 < len(INTERVALS_US):
            self._step += 1
            self._requested_ns = None

    def request(self, now_ns: int) -> bytes:
        """Return the request if one is due: the autopilot is alive, but its outputs do not come."""
        if not self._alive or (self._came_ns is not None and now_ns - self._came_ns < _REPEAT_NS):
            return b""
        if self._requested_ns is not None and now_ns - self._requested_ns < _REPEAT_NS:
            return b""
        self._requested_ns = now_ns
        interval_us = float(INTERVALS_US[self._step])
        message = _CommandLong(
            self._sysid, 1, _SET_MESSAGE_INTERVAL, 0, float(SERVO_OUTPUT_RAW), interval_us, 0.0, 0.0, 0.0, 0.0, 0.0
        )
        return self._encoder.frame(message.MSGID, pack(message))

    def reset(self) -> None:
        """Start over after a reboot: the motors have stopped, and the autopilot has forgotten the request."""
        self._mode &= ~_ARMED_BIT
        self._new = (0, (0.0,) * CONTROLS)
        self._time_us = self._came_ns = self._requested_ns = None
        self._alive = False

    def command(self, tick: int) -> ActuatorFrame | None:
        """Return the newest outputs, once; None if none came since."""
        new, self._new = self._new, None
        if new is None:
            return None
        t_ns, controls = new
        return motor_command(tick, t_ns, controls, self._mode, self._pwm.signed)


def motor_command(
    tick: int, t_ns: int, controls: tuple[float, ...], base_mode: int, signed: frozenset[int] = frozenset()
) -> ActuatorFrame:
    """Return `controls` as the command of an ArduPilot whose last heartbeat had `base_mode`.

    A heartbeat comes once a second; turning motors show at once that it is armed. `signed` controls are no motors.
    """
    assert len(controls) == CONTROLS
    turning = any(control for i, control in enumerate(controls[:8]) if i not in signed) if signed else any(controls[:8])
    armed = base_mode & _ARMED_BIT != 0 or turning
    return ActuatorFrame(tick, t_ns, controls, armed, base_mode | _ARMED_BIT if armed else base_mode)
