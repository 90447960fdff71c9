"""ArduPilot SITL over its JSON interface: lockstep by frame count. SITL asks first, the bench answers.

    SITL   servo packet n                      and then stands still
    send   [extra, over MAVLink] [state line]  the answer to packet n: the one datagram that lets SITL step
    wait   servo packet n + 1                  computed from that state: the controls of this tick
           what SITL said over MAVLink before it belongs to this tick

One packet, one answer; simulated time goes on by the difference of the timestamps in the answers. An answer too many
stays in SITL's socket and makes every later state one step old, so:
    - packets that repeat n (SITL sends one a second while it waits) and came before the answer need none of their own
    - a repeat that comes after the answer means that it was lost, or arrived as the repeat left. Only if no newer
      packet follows within a moment is the answer sent again, the same bytes: no step of the vehicle, no time passes
    - before answering, everything that has come is read and the newest packet is the one answered. Should SITL have
      stepped on an answer too many, that uses it up
    - packets of the past, and those of a SITL that has rebooted since, are counted and get nothing

A packet 0 where another number was due is an autopilot that has started again. Missions end there (`LinkClosed`, cause
"restarted"); with `on_restart="reset"` it is `RestartRequested`, and the link is as after `open`: the caller puts the
vehicle back, counts its time from 0 again, and goes on with `observe` and `send`.

SITL makes GPS, barometer and magnetometer itself, out of the vehicle's true pose: it wants truth, by `observe`, before
each `send`. Of the bench's sensors it uses IMU and range finder.
"""

from __future__ import annotations

import select
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from firmware_bridge.codecs.ardupilot_json import (
    PwmRange,
    ServoPacket,
    VehicleState,
    air_data,
    decode_servos,
    encode_state,
    ideal_imu,
    state_from_truth,
)
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.mavlink_frame import FrameParser
from firmware_bridge.links.ardupilot_mavlink import MavlinkSide
from firmware_bridge.links.autopilot_link import AutopilotLink, LinkCaps, LinkStats
from firmware_bridge.links.child_process import ChildProcess
from firmware_bridge.links.servo_outputs import motor_command
from firmware_bridge.links.silence import VehicleWatch, process_is_stopped
from firmware_bridge.transports.udp import Address, UdpInbox
from hil.signals.errors import HandshakeError, HilError, LinkClosed, LockstepLost
from hil.signals.samples import (
    ActuatorFrame,
    BaroSample,
    GpsSample,
    ImuSample,
    MagSample,
    RangeSample,
    Sample,
    TruthState,
    Vec3,
)
from hil.signals.units import STANDARD_GRAVITY_MPS2

_SLICE_S = 0.05
_CHECK_S = 0.25  # how often the process is looked at while waiting
# SITL repeats after 1 s of silence. A repeat that has crossed our answer is followed by the next packet at once.
_GRACE_S = 0.25
_UNSETTLED_PACKETS = 1000  # the rate may walk by 1 Hz a packet, from 1200
_RATE_TOLERANCE_HZ = 1.5  # SITL reports the rate of our timestamps, one more or less
_MODULUS = 1 << 32


class RestartRequested(HilError):
    """The autopilot has started again and the link was told to go along: put the vehicle back to where it began.

    The link's clock towards the autopilot begins anew with the next `send`; the bench's own time goes on.
    """


@dataclass
class ArduPilotStats(LinkStats):
    """Besides, what the frame count tells."""

    frame_rate_hz: int = 0  # in the newest servo packet
    channels: int = 0
    repeats: int = 0  # servo packets that said again what an earlier one had said
    answered_again: int = 0
    unasked_steps: int = 0  # steps that SITL made on an answer too many
    stale: int = 0  # packets of the past, or of a SITL that is no more
    junk: int = 0  # datagrams that are no servo packet
    restarts: int = 0


class ArduPilotJsonLink(AutopilotLink):
    """Lockstep with ArduPilot SITL (`--model JSON`), whose servo packets come to `inbox`.

    Home is where the vehicle is at the first `observe`. SITL adds noise of its own to the IMU's samples (SIM_ACC*,
    SIM_GYR*). With `tells_wind` a wind vane is among what SITL is told. Limits are wall-clock; infinite for a server
    that waits for whoever comes. `on_event` hears of restarts, and of a step that does not fit the tick.
    """

    _stats: ArduPilotStats

    def __init__(
        self,
        inbox: UdpInbox,
        mavlink: MavlinkSide | None = None,
        *,
        start_process: Callable[[], ChildProcess] | None = None,
        gravity_mps2: float = STANDARD_GRAVITY_MPS2,
        tells_wind: bool = False,
        on_restart: Literal["error", "reset"] = "error",
        on_event: Callable[[str, str], None] | None = None,
        reply_limit_s: float = 10.0,
        boot_limit_s: float = 60.0,
    ) -> None:
        self._inbox = inbox
        self._mavlink = mavlink
        self._pwm = PwmRange()
        self._gravity_mps2 = gravity_mps2
        self._tells_wind = tells_wind
        self._on_restart = on_restart
        self._reply_limit_s = reply_limit_s
        self._boot_limit_s = boot_limit_s
        caps = LinkCaps(
            "ardupilot_json",
            lockstep=True,
            deterministic=False,  # SITL's boot takes a few steps more or less, as its threads get the processor
            boot_sensors=0,
            busy_processors=2,  # its threads for input and output run on wall-clock time
            takes_truth=True,
        )
        # SITL that waits for a state does not hear SIGTERM.
        super().__init__(caps, inbox, aside=mavlink, start_process=start_process, deaf=True, on_event=on_event)

    def _reset(self) -> None:
        self._stats = ArduPilotStats()
        self._forget()

    def _forget(self) -> None:
        """As before the first packet of an autopilot."""
        self._asked: ServoPacket | None = None  # the packet to answer, or answered last
        self._asker: Address = ("", 0)
        self._former: Address | None = None  # of the autopilot before its last start
        self._reply = b""  # the last one
        self._home_W: Vec3 | None = None
        self._truth: TruthState | None = None
        self._wind_W: Vec3 = (0.0, 0.0, 0.0)
        self._imu: ImuSample | None = None
        self._ranges_m: tuple[float, ...] = ()
        self._frames = []
        self._watch = VehicleWatch()
        self._heard_in_wait = 0
        self._sent_at_ns = 0
        self._last_t_ns: int | None = None
        self._epoch_ns: int | None = None  # the bench's time of this autopilot's first state
        self._tick_ns = 0
        self._rate_packets = 0

    def _parsers(self) -> Sequence[FrameParser]:
        return () if self._mavlink is None else (self._mavlink.parser,)

    def observe(self, truth: TruthState, wind_W: Vec3 = (0.0, 0.0, 0.0)) -> None:
        """The vehicle's true state, and the wind at it [m/s, W], which the next `send` tells."""
        self._truth, self._wind_W = truth, wind_W
        if self._home_W is None:
            self._home_W = truth.p_WB

    def send(
        self,
        tick: int,
        t_ns: int,
        imu: ImuSample | None,
        mag: MagSample | None,  # noqa: ARG002 (SITL makes its own)
        baro: BaroSample | None,  # noqa: ARG002
        gps: GpsSample | None,  # noqa: ARG002
        extra: bytes,
        ranging: Sequence[Sample] = (),
    ) -> bytes:
        """Write `extra` to the MAVLink side, then the state line; these bytes. CodecError if it holds no number."""
        if imu is not None:
            self._imu = imu
        ranges_m = tuple(sample.distance_m for sample in ranging if isinstance(sample, RangeSample))
        if ranges_m:
            self._ranges_m = ranges_m
        if self._epoch_ns is None:
            self._epoch_ns = t_ns
        data = encode_state(self._state(tick, t_ns, self._epoch_ns))
        self._sweep()
        if self._mavlink is not None:
            self._mavlink.write(extra)
        self._reply = data
        self._inbox.send(data, self._asker)
        self._sent_at_ns = time.perf_counter_ns()
        stats = self._stats
        stats.steps += 1
        stats.tx_bytes += len(extra) + len(data)
        if self._last_t_ns is not None:
            self._tick_ns = t_ns - self._last_t_ns
        self._last_t_ns = t_ns
        return extra + data

    def wait(self, tick: int, t_ns: int) -> ActuatorFrame | None:
        """The controls that SITL computed from this tick's state.

        LockstepLost: no further packet within the limit. LinkClosed: its process ended, or it has started again.
        """
        packet = self._await_next(t_ns)
        self._stats.rtt.add(time.perf_counter_ns() - self._sent_at_ns)
        self._drain()
        self._watch_rate(packet)
        return motor_command(tick, t_ns, self._pwm.controls(packet.pwm_us), self._watch.base_mode)

    # ---- what is sent

    def _state(self, tick: int, t_ns: int, epoch_ns: int) -> VehicleState:
        truth, home_W = self._truth, self._home_W
        if truth is None or home_W is None or truth.t_ns != t_ns:
            raise LockstepLost(self.name, f"tick {tick}: `observe` was not called with the truth of {t_ns} ns")
        sample = self._imu
        if sample is None:
            # Before the sensor's first sample: all zeros would leave the estimator uninitialised for ever.
            accel, gyro = ideal_imu(truth, self._gravity_mps2)
        else:
            accel, gyro = sample.accel_mps2, sample.gyro_radps
        state = state_from_truth(
            t_ns - epoch_ns, truth, home_W=home_W, accel_B_mps2=accel, gyro_B_radps=gyro, ranges_m=self._ranges_m
        )
        return state._replace(windvane=air_data(truth, self._wind_W)[1]) if self._tells_wind else state

    # ---- what is received

    def _receive(self) -> tuple[ServoPacket, Address] | None:
        """The oldest servo packet that has come; None if none has."""
        while (found := self._inbox.receive()) is not None:
            data, sender = found
            self._stats.rx_bytes += len(data)
            try:
                return decode_servos(data), sender
            except CodecError:
                self._stats.junk += 1
        return None

    def _sweep(self) -> None:
        """Before an answer: read all that has come. The newest packet is the one to be answered."""
        while (found := self._receive()) is not None:
            packet, sender = found
            if self._is_next(packet, sender):
                self._stats.unasked_steps += 1
                self._take(packet, sender)

    def _await_next(self, t_ns: int) -> ServoPacket:
        deadline_ns = self._sent_at_ns + self._reply_limit_s * 1e9
        again_ns: int | None = None
        check_ns = self._sent_at_ns + int(_CHECK_S * 1e9)
        self._heard_in_wait = 0
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
                self._inbox.send(self._reply, self._asker)
                self._stats.answered_again += 1
            if now_ns >= check_ns:
                check_ns = now_ns + int(_CHECK_S * 1e9)
                self._check_process(f"ended while the state of {t_ns} ns was to be answered")
            if now_ns >= deadline_ns:
                raise LockstepLost(
                    self.name, self._silence(t_ns, self._stats.repeats - repeats_before), cause=self._cause()
                )
            self._pause(_SLICE_S)

    def _pause(self, limit_s: float) -> None:
        """Wait for a datagram. Telemetry is read meanwhile: SITL stands still if nobody reads its TCP port."""
        inbox, side = self._inbox.fileno(), self._mavlink.fileno() if self._mavlink is not None else None
        if inbox not in select.select([fd for fd in (inbox, side) if fd is not None], [], [], limit_s)[0]:
            self._drain()

    def _drain(self) -> None:
        if self._mavlink is None:
            return
        frames = self._mavlink.read()
        self._heard_in_wait += len(frames)
        self._frames += frames
        self._watch.heard(frames)

    def _is_next(self, packet: ServoPacket, sender: Address) -> bool:
        """Whether `packet` is the one after the one asked last. Counts all others, or ends the run."""
        asked = self._asked
        assert asked is not None
        count, stats, same = packet.frame_count, self._stats, sender == self._asker
        ahead = (count - asked.frame_count) % _MODULUS
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
                f"SITL's frame count went from {asked.frame_count} to {count}: it took answers of another simulator, "
                "or packets were lost",
                cause="gap",
            )
        if same or sender == self._former:
            stats.stale += 1
            return False
        raise LockstepLost(
            self.name,
            f"a second autopilot sends here: frame {count} from {sender[0]}:{sender[1]}, besides frame "
            f"{asked.frame_count} from {self._asker[0]}:{self._asker[1]}; stop one or give it another instance",
            cause="second_autopilot",
        )

    def _take(self, packet: ServoPacket, sender: Address) -> None:
        self._asked, self._asker = packet, sender
        self._stats.frame_rate_hz = packet.frame_rate_hz
        self._stats.channels = len(packet.pwm_us)

    def _restarted(self, packet: ServoPacket, sender: Address) -> None:
        """A packet 0 out of turn: another start of the autopilot. Raises, unless nothing had been flown yet."""
        asked = self._asked
        assert asked is not None
        former = self._asker if sender != self._asker else None
        if self._last_t_ns is None:
            # It rebooted before its first answer: nothing to put back.
            self._take(packet, sender)
            self._former = former
            return
        self._stats.restarts += 1
        t_ns = self._last_t_ns
        text = (
            f"the autopilot has started again at {t_ns * 1e-9:.3f} s: its frame count fell from {asked.frame_count} "
            f"to 0, and it sends from port {sender[1]} now, {self._asker[1]} before"
        )
        self._on_event("restart", text)
        if self._on_restart == "error":
            said = f"; {self._watch.last_words}" if self._watch.texts else ""
            raise LinkClosed(
                self.name, f"{text} (rebooted, or crashed and started by somebody){said}", cause="restarted"
            )
        self._forget()
        if self._mavlink is not None:
            self._mavlink.start_again()
        self._take(packet, sender)
        self._former = former
        raise RestartRequested(text)

    def _watch_rate(self, packet: ServoPacket) -> None:
        """Say once if SITL keeps asking for another step than it gets."""
        if not self._tick_ns or self._rate_packets > _UNSETTLED_PACKETS:
            return
        tick_hz = 1e9 / self._tick_ns
        fits = abs(packet.frame_rate_hz - tick_hz) <= _RATE_TOLERANCE_HZ
        self._rate_packets = 0 if fits else self._rate_packets + 1
        if self._rate_packets > _UNSETTLED_PACKETS:
            self._on_event(
                "warning",
                f"ArduPilot asks for {packet.frame_rate_hz} steps a second and gets {tick_hz:g}: its time follows the "
                "timestamps all the same, but set SIM_RATE_HZ to the tick rate",
            )

    # ---- waiting for it to come up, and saying why it does not answer

    def _await_far_side(self) -> None:
        deadline_s = time.monotonic() + self._boot_limit_s
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
            if time.monotonic() >= deadline_s:
                raise HandshakeError(self.name, self._no_packet())
            self._pause(_SLICE_S)

    def _no_packet(self) -> str:
        heard = []
        if self._stats.junk:
            heard.append(f"{self._stats.junk} datagrams came that are no servo packets: is it `--model JSON`?")
        frames = self.stats.rx_frames
        if frames:
            heard.append(f"{frames} MAVLink frames came: is it started with `--model JSON`, and our port?")
        if not heard:
            heard.append(
                f"nothing came at all; is it started with `--model JSON:127.0.0.1 --sim-port-out {self._inbox.port}`? "
                "By default it first waits for a client on TCP 5760; `--serial0 udpclient:127.0.0.1:PORT` avoids that"
            )
        if self._process is not None:
            tail = self._process.stderr_tail()
            heard.append("its process runs" + (f"; it last said:\n{tail}" if tail else ""))
        return f"no servo packet within {self._boot_limit_s:g} s of wall clock; {'; '.join(heard)}"

    def _cause(self) -> str:
        if self._process is not None and process_is_stopped(self._process.pid):
            return "stopped"
        return "silent"

    def _silence(self, t_ns: int, repeats: int) -> str:
        assert self._asked is not None
        facts = []
        if repeats:
            facts.append(
                f"it repeats frame {self._asked.frame_count} ({repeats} times): it does not take the answer "
                f"({self._stats.answered_again} sent again); SITL's own output says why"
            )
        if self._heard_in_wait:
            facts.append(f"MAVLink is still heard ({self._heard_in_wait} frames since)")
        elif self._mavlink is not None:
            facts.append("it says nothing over MAVLink either")
        if self._process is not None:
            stopped = self._cause() == "stopped"
            facts.append("its process is halted (SIGSTOP, or a debugger)" if stopped else "its process still runs")
        if self._watch.texts:
            facts.append(self._watch.last_words)
        return (
            f"no servo packet after the state of {t_ns} ns within {self._reply_limit_s:g} s of wall clock: "
            f"{'; '.join(facts) or 'it said nothing'}"
        )
