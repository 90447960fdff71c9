"""HITL, as on a real Pixhawk with SYS_HITL=1: the board runs by its own clock and waits for nothing.

HIL_ACTUATOR_CONTROLS is sent at 200 Hz in any case. HIL_SENSOR and HIL_GPS are time-stamped on arrival;
`time_usec` and `id` are not read, so a second IMU corrupts the first. HIL messages are used only if SYS_HITL was on
at boot and the link is fast enough; otherwise PX4 ignores them without a message and sends no actuator controls.

HIL_STATE_QUATERNION overwrites the estimator's inputs. PX4 cannot fly with that; in the mock the estimate is invalid
from then on.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.codecs.messages import MSGID, unpack
from firmware_bridge.mock_pixhawk.estimate.sensors import IMU_BITS
from firmware_bridge.mock_pixhawk.faults import FaultInjector
from firmware_bridge.mock_pixhawk.firmware import Firmware
from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from firmware_bridge.mock_pixhawk.services.outbox import CHANNELS, HIL_ACTUATOR_CONTROLS, Outbox, push_controls
from firmware_bridge.mock_pixhawk.vehicle import Vehicle

HIL_SENSOR, HIL_GPS = MSGID["HIL_SENSOR"], MSGID["HIL_GPS"]
HIL_STATE_QUATERNION = MSGID["HIL_STATE_QUATERNION"]
HIL_IN = frozenset({HIL_SENSOR, HIL_GPS, HIL_STATE_QUATERNION})

OUTPUT_PERIOD_US = 5_000
_MODE_DISARMED, _MODE_ARMED = 53, 181  # measured on PX4; 32 is the HIL bit
_LEAST_RATE_BPS = 5000  # bytes/s
_BAUD_PER_RATE = 20  # PX4 takes a twentieth of the baud rate as the link's data rate, where none is configured
_MS2_PER_MG = 9.80665e-3
_FIRST_MOTOR = 101  # HIL_ACT_FUNCn: 101 is motor 1
_FIRST_SERVO = 201  # HIL_ACT_FUNCn: 201 is control surface 1
_CONSTANT_MAX = 2
_PPB = 1_000_000_000

DEFAULT_BAUD = 921600
_unpack_sensor = struct.Struct("<Q13fIB").unpack


def fast_enough(baud: int) -> bool:
    """Return True if PX4 takes HIL on a link of that baud rate."""
    return baud / _BAUD_PER_RATE > _LEAST_RATE_BPS


class BoardClock:
    """The board's own clock: microseconds since power-on.

    It runs from any source of nanoseconds: the monotonic wall clock in the process, simulated time in tests.
    `offset_us` is its reading at power-on, `drift_ppm` how much too fast it runs: the errors that time
    synchronisation has to find.
    """

    def __init__(
        self, source_ns: Callable[[], int] = time.monotonic_ns, *, offset_us: int = 0, drift_ppm: float = 0.0
    ) -> None:
        self._source_ns = source_ns
        self.offset_us = offset_us
        self._drift_ppb = round(drift_ppm * 1000.0)
        self._zero_ns = source_ns()

    def restart(self) -> None:
        """Set the clock to its reading at power-on."""
        self._zero_ns = self._source_ns()

    def now_us(self) -> int:
        """Return its reading. Integer arithmetic: the same source gives the same microseconds on every machine."""
        elapsed_ns = self._source_ns() - self._zero_ns
        return self.offset_us + (elapsed_ns + elapsed_ns * self._drift_ppb // _PPB) // 1000

    def source_ns(self, t_us: int) -> int:
        """Return the first nanosecond of the source at which the clock reads `t_us`."""
        own_ns = (t_us - self.offset_us) * 1000
        # Rounded up, so that a caller that sleeps until then does not wake a microsecond early.
        elapsed_ns = -(-own_ns * _PPB // (_PPB + self._drift_ppb)) + (1 if self._drift_ppb else 0)
        return self._zero_ns + elapsed_ns

    def until_s(self, t_us: int) -> float:
        """Return the source's seconds until the clock reads `t_us`; 0 if that is past."""
        return max(0.0, (self.source_ns(t_us) - self._source_ns()) * 1e-9)


@dataclass(frozen=True)
class Board:
    """The hardware of a mock in HITL: its clock, and the data rate of its line. On a slow line PX4 ignores HIL."""

    clock: BoardClock = field(default_factory=BoardClock)
    baud: int = DEFAULT_BAUD


class HitlOutputs:
    """Control slots by HIL_ACT_FUNC1..16. As in PX4, a change takes effect while disarmed."""

    def __init__(self, params: ParamTable, vehicle: Vehicle, outputs: Callable[[int], list[float]]) -> None:
        """`outputs(now_us)` returns the commands: motors, then surfaces."""
        self._params, self._vehicle, self._outputs = params, vehicle, outputs
        self._rotors = int(params["CA_ROTOR_COUNT"])
        self._functions = [0] * CHANNELS

    def controls(self, now_us: int) -> list[float]:
        """Return the 16 values of this instant, 0..1. Disarmed or terminated: all zero."""
        vehicle = self._vehicle
        if not vehicle.armed:
            self._functions = [int(self._params[f"HIL_ACT_FUNC{slot}"]) for slot in range(1, CHANNELS + 1)]
            return [0.0] * CHANNELS
        if vehicle.terminated:
            return [0.0] * CHANNELS
        commands = self._outputs(now_us)
        return [self._value(function, commands) for function in self._functions]

    def _value(self, function: int, commands: list[float]) -> float:
        motor, servo = function - _FIRST_MOTOR, function - _FIRST_SERVO
        if 0 <= motor < self._rotors:
            return commands[motor]
        if 0 <= servo < CHANNELS - self._rotors:
            return commands[self._rotors + servo]
        return 1.0 if function == _CONSTANT_MAX else 0.0


class Hitl:
    """Timing of HITL: runs `firmware` by the clock of `board`."""

    def __init__(self, firmware: Firmware, outbox: Outbox, fault_injector: FaultInjector, board: Board) -> None:
        self._firmware, self._outbox, self._fault_injector, self._clock = firmware, outbox, fault_injector, board.clock
        self.hil_on = firmware.hitl and fast_enough(board.baud)
        self.silent = False  # only while it reboots
        self.steps = 0
        self.ignored = 0
        self.state_quaternions = 0
        self._last_stamp_us = -1
        outbox.holding = False
        now_us = board.clock.now_us()
        firmware.begin(now_us)
        if self.hil_on:
            self._outputs = HitlOutputs(firmware.params, firmware.vehicle, firmware.outputs)
            firmware.add_stream(HIL_ACTUATOR_CONTROLS, self._output, OUTPUT_PERIOD_US, now_us)

    def send_boot_messages(self) -> None:
        """Send a first HEARTBEAT."""
        self._firmware.send_heartbeat()

    def fall_silent(self) -> None:
        """Do nothing: without lockstep the board goes on sending."""

    def next_due_us(self) -> int | None:
        """Return the time of the next due timer, by the board's clock."""
        return self._firmware.timers.next_due_us

    def take(self, frames: list[Frame]) -> bytes:
        """Handle the received frames, run what is due, and return the bytes to write."""
        for frame in frames:
            if self.silent:
                break
            self._run()
            if frame[0] in HIL_IN:
                self._on_hil(frame)
            else:
                self._firmware.handle(frame)
        if not self.silent:
            self._run()
        out = self._outbox.take()
        return b"" if self._fault_injector.stalled(self._firmware.vehicle.now_us) else out

    def _run(self) -> None:
        firmware = self._firmware
        now_us = firmware.vehicle.now_us = self._clock.now_us()
        if now_us >= firmware.timers.next_due_us:
            firmware.timers.run(now_us)

    def _on_hil(self, frame: Frame) -> None:
        if not self.hil_on:
            self.ignored += 1
            return
        # Two samples of one read arrive at almost the same time; the estimator needs increasing times.
        firmware = self._firmware
        t_us = self._last_stamp_us = max(firmware.vehicle.now_us, self._last_stamp_us + 1)
        if frame[0] == HIL_SENSOR:
            values = _unpack_sensor(frame[4])
            if values[14] & IMU_BITS == IMU_BITS:
                firmware.sensors.arrivals.note(t_us)
            firmware.sensors.take(t_us, values, frame[4])
            self.steps += 1
        elif frame[0] == HIL_GPS:
            firmware.sensors.take_gps(frame[4], t_us)
        else:
            self._overwrite(frame, t_us)

    def _overwrite(self, frame: Frame, t_us: int) -> None:
        self.state_quaternions += 1
        self._firmware.estimate.overwritten = True
        m = unpack(frame)
        rates = (m.rollspeed, m.pitchspeed, m.yawspeed)
        forces = (m.xacc * _MS2_PER_MG, m.yacc * _MS2_PER_MG, m.zacc * _MS2_PER_MG)
        self._firmware.core.step(t_us, *rates, *forces)

    def _output(self, now_us: int) -> None:
        controls = self._firmware.telemetry.controls = self._outputs.controls(now_us)
        mode = _MODE_ARMED if self._firmware.vehicle.armed else _MODE_DISARMED
        push_controls(self._outbox, self._fault_injector, now_us, 0, controls, mode)
