"""Links ArduPilot SITL over its JSON interface: lockstep by frame count. SITL sends first, the bench answers.

    SITL   servo packet n                      and then stands still
    send   [extra, over MAVLink] [state line]  the answer to packet n, the one datagram that lets SITL step
    wait   servo packet n + 1                  computed from that state: the controls of this tick;
                                               MAVLink frames of SITL before it belong to this tick

One packet, one answer; simulated time advances by the difference of the timestamps in the answers. A surplus answer
stays in SITL's socket and makes every later state one step old, so:
    - packets that repeat n before the answer (SITL sends one a second while it waits) get no answer of their own
    - a repeat after the answer means that it was lost, or crossed the repeat. The same bytes are sent again only if no
      newer packet follows within a moment: neither the vehicle nor time advances
    - before an answer all received packets are read, and the newest is answered. That uses up a surplus answer on
      which SITL may have stepped
    - old packets, and those of a SITL that has rebooted since, are counted and not answered

A packet 0 where another number was due is an autopilot that has started again. Missions end there (`LinkClosed`, cause
"restarted"); with `on_restart="reset"` it is `RestartRequested`, and the link is as after `open`: the caller puts the
vehicle back, counts its time from 0 again, and continues with `observe` and `send`.

SITL makes GPS, barometer and magnetometer data itself from the vehicle's true pose, which `observe` gives before each
`send`. Of the bench's sensors it uses the IMU, range finders, the pitot tube (as airspeed) and the sideslip of a vane
(as the direction of a wind vane, whose speed is the truth's).
"""

from __future__ import annotations

import select
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from firmware_bridge.codecs.ardupilot_json import (
    CONTROLS,
    PwmRange,
    ServoPacket,
    VehicleState,
    air_data,
    decode_servos,
    encode_state,
    ideal_imu,
    state_from_truth,
    true_airspeed_mps,
)
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.hil_odometry import ODOMETRY, odometry_payload
from firmware_bridge.codecs.mavlink_frame import Frame, FrameEncoder, FrameParser
from firmware_bridge.links.ardupilot.home_check import Home, HomeCheck
from firmware_bridge.links.ardupilot.mavlink_channel import MavlinkChannel
from firmware_bridge.links.ardupilot.servo_outputs import motor_command
from firmware_bridge.links.autopilot_link import (
    SIMULATOR_COMPID,
    SIMULATOR_SYSID,
    AutopilotLink,
    LinkCaps,
    LinkStats,
    LinkTimeouts,
    TickSamples,
)
from firmware_bridge.links.child_process import ChildProcess
from firmware_bridge.links.silence import VehicleMonitor, process_is_stopped
from firmware_bridge.transports.udp import Address, UdpInbox
from signals.errors import HandshakeError, HilError, LinkClosed, LockstepLost
from signals.samples import (
    ActuatorFrame,
    DifferentialPressureSample,
    ImuSample,
    OdometrySample,
    RangeSample,
    TruthState,
    VaneSample,
    Vec3,
)
from signals.units import STANDARD_GRAVITY_MPS2

_SLICE_S = 0.05
_CHECK_S = 0.25  # how often the process is checked while waiting
# SITL repeats after 1 s of silence. A repeat that has crossed the bench's answer is followed by the next packet.
_GRACE_S = 0.25
_UNSETTLED_PACKETS = 1000  # the rate may change by 1 Hz a packet, from 1200
_RATE_TOLERANCE_HZ = 1.5  # SITL reports the rate of the bench's timestamps, with an error of 1 Hz
_MODULUS = 1 << 32
# Sent for ArduPlane until its outputs are set (SITL_State::_simulator_servos): to a motor, half throttle.
_BOOT_US = (1500, 1500, 1000, 1500, *(1000,) * 12)
_TIMEOUTS = LinkTimeouts(connect_s=60.0)


class RestartRequested(HilError):
    """The autopilot has started again, and `on_restart` is "reset": the vehicle must go back to its start.

    The link's clock towards the autopilot begins anew with the next `send`; the bench's own time continues.
    """


@dataclass
class ArduPilotStats(LinkStats):
    """Counters of a link, with those of the frame count."""

    frame_rate_hz: int = 0  # in the newest servo packet
    channels: int = 0
    repeats: int = 0  # servo packets with the number of an earlier one
    answered_again: int = 0
    unasked_steps: int = 0  # steps that SITL made on a surplus answer
    stale: int = 0  # old packets, and those of a SITL that has ended
    junk: int = 0  # datagrams that are not servo packets
    restarts: int = 0


class StateLine(NamedTuple):
    """Settings of the line that tells SITL the vehicle's state."""

    gravity_mps2: float = STANDARD_GRAVITY_MPS2  # of a step without an IMU sample
    wind_vane: bool = False  # in a bench with wind
    home_altitude_m: float = 0.0  # above the sea, of the vehicle's place at its start


_STATE_LINE = StateLine()


class ArduPilotJsonLink(AutopilotLink):
    """Lockstep with ArduPilot SITL (`--model JSON`), whose servo packets come to `inbox`.

    SITL gets positions relative to the vehicle's place at the first `observe`. SITL adds noise of its own to the IMU's
    samples (SIM_ACC*, SIM_GYR*). `on_event` gets restarts, and a step that does not fit the tick. Channels in `signed`
    are control surfaces.
    """

    _stats: ArduPilotStats
    _ignores_sigterm = True  # SITL while it waits for a state

    def __init__(
        self,
        inbox: UdpInbox,
        mavlink: MavlinkChannel | None = None,
        *,
        start_process: Callable[[], ChildProcess] | None = None,
        state_line: StateLine = _STATE_LINE,
        signed: frozenset[int] = frozenset(),
        on_restart: Literal["error", "reset"] = "error",
        on_event: Callable[[str, str], None] | None = None,
        timeouts: LinkTimeouts = _TIMEOUTS,
    ) -> None:
        self._inbox = inbox
        self._mavlink = mavlink
        self._encoder = FrameEncoder(SIMULATOR_SYSID, SIMULATOR_COMPID)
        self._pwm = PwmRange(signed=signed)
        self._home: Home | None = None
        self._state_line = state_line
        self._on_restart = on_restart
        self._timeouts = timeouts
        caps = LinkCaps(
            "ardupilot_json",
            lockstep=True,
            deterministic=False,  # the number of steps in SITL's boot depends on its threads
            boot_sensors=0,
            busy_processors=2,  # its threads for input and output run on wall-clock time
            takes_truth=True,
        )
        super().__init__(caps, inbox, unnamed=mavlink, start_process=start_process, on_event=on_event)

    def _reset(self) -> None:
        self._stats = ArduPilotStats()
        self._start_over()

    def _start_over(self) -> None:
        """Set the state before the first packet of an autopilot."""
        self._packet: ServoPacket | None = None  # the packet to answer, or answered last
        self._sender: Address = ("", 0)
        self._former: Address | None = None  # address of the autopilot before its last start
        self._reply = b""  # the last one
        self._has_outputs = False
        self._home_W: Vec3 | None = None
        self._home_check = None if self._home is None else HomeCheck(self._home)
        self._truth: TruthState | None = None
        self._wind_W: Vec3 = (0.0, 0.0, 0.0)
        self._imu: ImuSample | None = None
        self._ranges_m: tuple[float, ...] = ()
        self._pitot_pa: float | None = None
        self._sideslip_rad: float | None = None
        self._frames = []
        self._vehicle = VehicleMonitor()
        self._frames_in_wait = 0
        self._sent_at_ns = 0
        self._last_t_ns: int | None = None
        self._epoch_ns: int | None = None  # the bench's time of this autopilot's first state
        self._tick_ns = 0
        self._rate_packets = 0

    def _parsers(self) -> Sequence[FrameParser]:
        return () if self._mavlink is None else (self._mavlink.parser,)

    def expect_home(self, home: Home) -> None:
        """Compare SITL's home with the vehicle's place at the first `observe`. Call it before `open`."""
        self._home = home

    def observe(self, truth: TruthState, wind_W: Vec3 = (0.0, 0.0, 0.0)) -> None:
        """Take the vehicle's true state, and the wind at it [m/s, W], for the next `send`."""
        self._truth, self._wind_W = truth, wind_W
        if self._home_W is None:
            self._home_W = truth.p_WB

    def send(self, tick: int, t_ns: int, samples: TickSamples, extra: bytes) -> bytes:
        """Write `extra` and external vision to MAVLink, then the state line. Return all of it.

        CodecError if a value is not a number.
        """
        if samples.imu is not None:
            self._imu = samples.imu
        ranges_m = tuple(sample.distance_m for sample in samples.others if isinstance(sample, RangeSample))
        if ranges_m:
            self._ranges_m = ranges_m
        for sample in samples.others:
            if isinstance(sample, OdometrySample):
                extra += self._encoder.frame(ODOMETRY, odometry_payload(t_ns, sample))
            elif isinstance(sample, DifferentialPressureSample):
                self._pitot_pa = sample.differential_pressure_pa
            elif isinstance(sample, VaneSample):
                self._sideslip_rad = sample.sideslip_rad
        if self._epoch_ns is None:
            self._epoch_ns = t_ns
        data = encode_state(self._state(tick, t_ns, self._epoch_ns))
        self._sweep()
        if self._mavlink is not None:
            self._mavlink.write(extra)
        self._reply = data
        self._inbox.send(data, self._sender)
        self._sent_at_ns = time.perf_counter_ns()
        stats = self._stats
        stats.steps += 1
        stats.tx_bytes += len(extra) + len(data)
        if self._last_t_ns is not None:
            self._tick_ns = t_ns - self._last_t_ns
        self._last_t_ns = t_ns
        return extra + data

    def wait(self, tick: int, t_ns: int) -> ActuatorFrame | None:
        """Return the controls that SITL computed from this tick's state.

        LockstepLost: no further packet within the limit. LinkClosed: its process ended, or it has started again.
        """
        packet = self._await_next(t_ns)
        self._stats.rtt.add(time.perf_counter_ns() - self._sent_at_ns)
        self._drain()
        self._watch_rate(packet)
        self._has_outputs = self._has_outputs or packet.pwm_us[:CONTROLS] != _BOOT_US
        controls = self._pwm.controls(packet.pwm_us) if self._has_outputs else (0.0,) * CONTROLS
        return motor_command(tick, t_ns, controls, self._vehicle.base_mode, self._pwm.signed)

    # ---- sending

    def _state(self, tick: int, t_ns: int, epoch_ns: int) -> VehicleState:
        truth, home_W = self._truth, self._home_W
        if truth is None or home_W is None or truth.t_ns != t_ns:
            raise LockstepLost(self.name, f"tick {tick}: `observe` was not called with the truth of {t_ns} ns")
        sample = self._imu
        if sample is None:
            # Before the sensor's first sample: with zeros the estimator would never initialise.
            accel, gyro = ideal_imu(truth, self._state_line.gravity_mps2)
        else:
            accel, gyro = sample.accel_mps2, sample.gyro_radps
        state = state_from_truth(
            t_ns - epoch_ns, truth, home_W=home_W, accel_B_mps2=accel, gyro_B_radps=gyro, ranges_m=self._ranges_m
        )
        if self._pitot_pa is not None:
            altitude_m = self._state_line.home_altitude_m + truth.p_WB[2] - home_W[2]
            state = state._replace(airspeed_mps=true_airspeed_mps(self._pitot_pa, altitude_m))
        if self._sideslip_rad is not None:
            return state._replace(windvane=(self._sideslip_rad, air_data(truth, self._wind_W)[1][1]))
        return state._replace(windvane=air_data(truth, self._wind_W)[1]) if self._state_line.wind_vane else state

    # ---- receiving

    def _receive(self) -> tuple[ServoPacket, Address] | None:
        """Return the oldest received servo packet and its sender, or None."""
        while (found := self._inbox.receive()) is not None:
            data, sender = found
            self._stats.rx_bytes += len(data)
            try:
                return decode_servos(data), sender
            except CodecError:
                self._stats.junk += 1
        return None

    def _sweep(self) -> None:
        """Read all received packets before an answer. The newest is the one to answer."""
        while (found := self._receive()) is not None:
            packet, sender = found
            if self._is_next(packet, sender):
                self._stats.unasked_steps += 1
                self._take(packet, sender)

    def _await_next(self, t_ns: int) -> ServoPacket:
        deadline_ns = self._sent_at_ns + self._timeouts.reply_s * 1e9
        again_ns: int | None = None
        check_ns = self._sent_at_ns + int(_CHECK_S * 1e9)
        self._frames_in_wait = 0
        repeats_before = self._stats.repeats
        while True:
            found = self._receive()
            if found is not None:
                packet, sender = found
                repeats = self._stats.repeats
                if self._is_next(packet, sender):
                    self._take(packet, sender)
                    return packet
                if self._stats.repeats != repeats and again_ns is None:
                    again_ns = time.perf_counter_ns() + int(_GRACE_S * 1e9)
                continue
            now_ns = time.perf_counter_ns()
            if again_ns is not None and now_ns >= again_ns:
                again_ns = None
                self._inbox.send(self._reply, self._sender)
                self._stats.answered_again += 1
            if now_ns >= check_ns:
                check_ns = now_ns + int(_CHECK_S * 1e9)
                self.while_waiting()
                self._check_process(f"ended before it answered the state of {t_ns} ns")
            if now_ns >= deadline_ns:
                raise LockstepLost(
                    self.name, self._silence(t_ns, self._stats.repeats - repeats_before), cause=self._cause()
                )
            self._pause(_SLICE_S)

    def _pause(self, limit_s: float) -> None:
        """Wait for a datagram. Telemetry is read meanwhile: SITL stands still while its TCP port is not read."""
        inbox, side = self._inbox.fileno(), self._mavlink.fileno() if self._mavlink is not None else None
        if inbox not in select.select([fd for fd in (inbox, side) if fd is not None], [], [], limit_s)[0]:
            self._drain()

    def _drain(self) -> None:
        if self._mavlink is None:
            return
        frames = self._mavlink.read()
        self._frames_in_wait += len(frames)
        self._frames += frames
        self._vehicle.received(frames)
        if self._home_check is not None and frames:
            self._check_home(self._home_check, frames)

    def _check_home(self, check: HomeCheck, frames: list[Frame]) -> None:
        problem = check.problem(frames)
        if check.done:
            self._home_check = None
        if problem is not None:
            raise HandshakeError(self.name, problem, cause="home")

    def _is_next(self, packet: ServoPacket, sender: Address) -> bool:
        """Return True if `packet` follows the one answered last. Counts all others, or ends the run."""
        last = self._packet
        assert last is not None
        count, stats, same = packet.frame_count, self._stats, sender == self._sender
        ahead = (count - last.frame_count) % _MODULUS
        if same and ahead == 1:
            return True
        if same and ahead == 0:
            stats.repeats += 1
            return False
        if count == 0:
            self._restarted(packet, sender)
            return False
        if same and ahead < _MODULUS // 2:
            raise LockstepLost(
                self.name,
                f"SITL's frame count went from {last.frame_count} to {count}: it took answers of another simulator, "
                "or packets were lost; stop the other simulator",
                cause="gap",
            )
        if same or sender == self._former:
            stats.stale += 1
            return False
        raise LockstepLost(
            self.name,
            f"a second autopilot sends here: frame {count} from {sender[0]}:{sender[1]}, besides frame "
            f"{last.frame_count} from {self._sender[0]}:{self._sender[1]}; stop one or give it another instance",
            cause="second_autopilot",
        )

    def _take(self, packet: ServoPacket, sender: Address) -> None:
        self._packet, self._sender = packet, sender
        self._stats.frame_rate_hz = packet.frame_rate_hz
        self._stats.channels = len(packet.pwm_us)

    def _restarted(self, packet: ServoPacket, sender: Address) -> None:
        """Handle a packet 0 out of turn, a restart of the autopilot. Raises, unless it came before the first answer."""
        last = self._packet
        assert last is not None
        former = self._sender if sender != self._sender else None
        if self._last_t_ns is None:
            # It rebooted before its first answer: the vehicle is still at its start.
            self._take(packet, sender)
            self._former = former
            return
        self._stats.restarts += 1
        t_ns = self._last_t_ns
        text = (
            f"the autopilot has started again at {t_ns * 1e-9:.3f} s: its frame count fell from {last.frame_count} "
            f"to 0, and it sends from port {sender[1]} now, {self._sender[1]} before"
        )
        self._on_event("restart", text)
        if self._on_restart == "error":
            texts = f"; {self._vehicle.last_texts}" if self._vehicle.texts else ""
            raise LinkClosed(
                self.name, f"{text} (rebooted, or crashed and restarted; see its log){texts}", cause="restarted"
            )
        self._start_over()
        if self._mavlink is not None:
            self._mavlink.restart()
        self._take(packet, sender)
        self._former = former
        raise RestartRequested(text)

    def _watch_rate(self, packet: ServoPacket) -> None:
        """Send one warning if SITL keeps requesting another step than it gets."""
        if not self._tick_ns or self._rate_packets > _UNSETTLED_PACKETS:
            return
        tick_hz = 1e9 / self._tick_ns
        fits = abs(packet.frame_rate_hz - tick_hz) <= _RATE_TOLERANCE_HZ
        self._rate_packets = 0 if fits else self._rate_packets + 1
        if self._rate_packets > _UNSETTLED_PACKETS:
            self._on_event(
                "warning",
                f"ArduPilot requests {packet.frame_rate_hz} steps a second and gets {tick_hz:g}: its time still "
                "follows the timestamps, but set SIM_RATE_HZ to the tick rate",
            )

    # ---- waiting for its start, and describing a missing answer

    def _await_far_side(self) -> None:
        deadline_s = time.monotonic() + self._timeouts.connect_s
        while True:
            found = self._receive()
            if found is not None:
                packet, sender = found
                if packet.frame_count != 0:
                    raise HandshakeError(
                        self.name,
                        f"ArduPilot is in the middle of a flight with another simulator (its first packet is number "
                        f"{packet.frame_count}): start it again, then the bench",
                        cause="midflight",
                    )
                self._take(packet, sender)
                self._drain()
                return
            self._check_process("ended before its first servo packet")
            self.while_waiting()
            if time.monotonic() >= deadline_s:
                raise HandshakeError(self.name, self._no_packet())
            self._pause(_SLICE_S)

    def _no_packet(self) -> str:
        seen = []
        if self._stats.junk:
            seen.append(f"{self._stats.junk} datagrams came that are not servo packets: is it `--model JSON`?")
        frames = self.stats.rx_frames
        if frames:
            seen.append(f"{frames} MAVLink frames came: is it started with `--model JSON` and the bench's port?")
        if not seen:
            seen.append(
                f"no datagram came; is it started with `--model JSON:127.0.0.1 --sim-port-out {self._inbox.port}`? "
                "By default it first waits for a client on TCP 5760; `--serial0 udpclient:127.0.0.1:PORT` avoids that"
            )
        if self._process is not None:
            tail = self._process.stderr_tail()
            seen.append("its process runs" + (f"; it last said:\n{tail}" if tail else ""))
        return f"no servo packet within {self._timeouts.connect_s:g} s of wall clock; {'; '.join(seen)}"

    def _cause(self) -> str:
        if self._process is not None and process_is_stopped(self._process.pid):
            return "stopped"
        return "silent"

    def _silence(self, t_ns: int, repeats: int) -> str:
        assert self._packet is not None
        facts = []
        if repeats:
            facts.append(
                f"it repeats frame {self._packet.frame_count} ({repeats} times): it does not accept the answer "
                f"({self._stats.answered_again} sent again); see SITL's own output"
            )
        if self._frames_in_wait:
            facts.append(f"MAVLink frames still come ({self._frames_in_wait} since)")
        elif self._mavlink is not None:
            facts.append("no MAVLink frames come either")
        if self._process is not None:
            stopped = self._cause() == "stopped"
            facts.append(
                "its process is halted (SIGSTOP, or a debugger); resume it" if stopped else "its process still runs"
            )
        if self._vehicle.texts:
            facts.append(self._vehicle.last_texts)
        return (
            f"no servo packet after the state of {t_ns} ns within {self._timeouts.reply_s:g} s of wall clock: "
            f"{'; '.join(facts) or 'no bytes came; is it hung?'}"
        )
