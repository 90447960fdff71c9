"""The tick loop.

    t_k = k * tick_ns                 integer nanoseconds; nothing adds floats to make time

    1 physics    advance with ActuatorFrame[k-1]          -> TruthState[k]
    2 sensors    sample those due and consumed, but for cameras and LiDARs
                                                          -> samples with t_capture, t_available, seq
    3 release    samples with t_available <= t_k, ordered by (t_available, port, seq)
    4 commands   ground station and outside clients       -> bytes for the autopilot
    5 send       one write: commands, range and flow, HIL_GPS, HIL_SENSOR
    6 frames     cameras and LiDARs look at TruthState[k]; what is available by t_k is released
      record     everything known so far. Both while the autopilot thinks; neither feeds back
      companion  what was released to the clients under test; what they desire is commanded from tick k+1 on
    7 wait       for the reply that answers t_k           -> ActuatorFrame[k]
    8 latch      check and keep ActuatorFrame[k]; it moves the vehicle in tick k+1

Where the autopilot keeps more than one processor busy (PX4's threads), phase 6 comes before phase 5 but for the
bytes sent: there is no processor left to write on while it thinks.

The record of what arrived in phase 7 is written in phase 6 of the next tick (or by `flush`), so that writing
overlaps the autopilot's own work. The order in the recording is the same either way.

An autopilot that waits for nobody (`begin`) turns this round: each tick begins at its wall-clock time, with
ActuatorFrame[k-1] being whatever was commanded last, and phase 7 is empty.

When a phase fails: an exception of any phase ends the run. Phases 1 to 4 have no side effect outside, so the
tick in which they fail was never sent. After a failure in 5 or 7 nothing further is sent and no command is
invented; the actuator frame of the failed tick is undefined and is not latched. The caller calls `flush` and
closes the recorder, so everything up to the failure is readable.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.links.autopilot_link import AutopilotLink
from hil.recorder.recorder import Recorder
from hil.signals.latency import LatencyHistogram
from hil.signals.samples import ActuatorFrame, Sample, TruthState, Vec3
from hil.signals.time import RateAccumulator
from sim.physics.quadrotor import QuadrotorPhysics

if TYPE_CHECKING:
    from hil.companion.stage import CompanionStage

_BACK_S = 0.0005  # before a tick's deadline the companion is no longer served
_HIL_SENSOR_KINDS = ("imu", "magnetometer", "barometer", "gps")
_RANGING_KINDS = ("range_finder", "optical_flow")
PHASES = ("physics", "sensors", "commands", "send", "frames", "record", "companion", "wait")


class Sensor(Protocol):
    """Whatever measures it."""

    @property
    def name(self) -> str: ...

    def sample(self, truth: TruthState, seq: int) -> Sample | None:
        """Sample `seq`; None where the sensor has none to give (a dropout)."""
        ...


class CommandSource(Protocol):
    """Whatever talks to the autopilot beside the sensors: the bench's ground station, the router's clients."""

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes: ...


class SensorSlot:
    """A sensor with its rate on the tick and its sample count."""

    __slots__ = ("after_send", "due", "port", "sample", "samples", "timing")

    def __init__(self, sensor: Sensor, rate: RateAccumulator, *, after_send: bool = False) -> None:
        """`after_send`: the autopilot does not get its samples, so need not wait for them."""
        self.after_send = after_send
        self.port = sensor.name
        self.sample = sensor.sample
        self.due = rate.due
        self.samples = 0
        self.timing = LatencyHistogram()


class ReleaseQueue:
    """Holds captured samples until they arrive. Release order is (t_available_ns, port, seq): total and repeatable."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, str, int, Sample]] = []

    def push(self, port: str, sample: Sample) -> None:
        heapq.heappush(self._heap, (sample.t_available_ns, port, sample.seq, sample))

    def release(self, t_ns: int) -> list[tuple[str, Sample]]:
        """Every sample with t_available_ns <= t_ns, in release order."""
        heap = self._heap
        released = []
        while heap and heap[0][0] <= t_ns:
            _, port, _, sample = heapq.heappop(heap)
            released.append((port, sample))
        return released

    def __len__(self) -> int:
        return len(self._heap)


class Scheduler:
    """Runs ticks. Owns nothing it is given: opening and closing is the composition root's business (`hil.bench`)."""

    def __init__(
        self,
        *,
        tick_ns: int,
        physics: QuadrotorPhysics,
        sensors: Sequence[SensorSlot],
        link: AutopilotLink,
        ports: Mapping[str, str],
        commands: Sequence[CommandSource],
        recorder: Recorder,
        observers: Sequence[Callable[[TruthState], None]] = (),
        companion: CompanionStage | None = None,
        pace: float | None = None,
        wind_at: Callable[[], Vec3] = lambda: (0.0, 0.0, 0.0),
    ) -> None:
        """`ports`: kind -> port of the sensors whose samples go to the autopilot; an imu is always among them."""
        self.tick_ns = tick_ns
        self.tick = 0  # the next tick to run
        self.late = 0  # ticks that began after their wall-clock deadline (paced runs only)
        self.phase_ns = {name: LatencyHistogram() for name in PHASES}
        self.own_ns = LatencyHistogram()  # everything but waiting, per tick
        self.step_ns = LatencyHistogram()  # the whole tick, pacing excluded
        self.begun_ns = 0  # when the present tick began, by `time.perf_counter_ns`
        self.truth: TruthState | None = None
        self._physics = physics
        self._sensors = tuple(slot for slot in sensors if not slot.after_send)
        self._frame_sensors = tuple(slot for slot in sensors if slot.after_send)
        self._link = link
        self._begin: Callable[[int], ActuatorFrame | None] | None = None if link.caps.lockstep else link.begin  # type: ignore[attr-defined]
        self._observe: Callable[[TruthState, Vec3], None] | None = link.observe if link.caps.takes_truth else None  # type: ignore[attr-defined]
        self._wind_at = wind_at
        self._record_first = link.caps.busy_processors > 1
        # Where the autopilot may take the processor from under the bench, only processor time is the bench's own.
        self._own_clock = time.thread_time_ns if link.caps.busy_processors > 1 else time.perf_counter_ns
        self._kinds = {port: kind for kind, port in ports.items()}
        self._commands = tuple(commands)
        self._recorder = recorder
        self._observers = tuple(observers)
        self._companion = companion
        self._queue = ReleaseQueue()
        self._latched = ActuatorFrame(-1, -tick_ns, (0.0,) * 16, False, 0)
        self._frames: list[Frame] = []  # received in the tick before
        self._unrecorded: tuple[int, list[Frame], ActuatorFrame | None] | None = None
        self._tick_wall_ns = None if pace is None else tick_ns / pace
        self._wall_start_ns = 0

    @property
    def t_ns(self) -> int:
        """Simulated time of the next tick."""
        return self.tick * self.tick_ns

    @property
    def actuators(self) -> ActuatorFrame:
        """The frame that moves the vehicle in the next tick; all zero and disarmed until the first reply."""
        return self._latched

    def step(self) -> None:
        """Run one tick. Raises HilError subclasses; see the header for what is undefined then."""
        tick = self.tick
        begun: ActuatorFrame | None = None
        if self._begin is not None:
            begun = self._begin(tick)
            if begun is not None:
                self._latched = begun
        elif self._tick_wall_ns is not None:
            self._wait_for_deadline(self._tick_wall_ns)
        clock = time.perf_counter_ns
        t_ns = tick * self.tick_ns

        own_clock = self._own_clock
        own0 = own_clock()
        t0 = self.begun_ns = clock()
        truth = self._physics.advance(tick, self._latched.controls)
        self.truth = truth

        t1 = clock()
        self._sample(self._sensors, truth, t1)
        released = self._queue.release(t_ns)
        newest, ranging = self._for_autopilot(released)

        t2 = clock()
        extra = b""
        for source in self._commands:
            extra += source.step(t_ns, self._frames)

        t3 = clock()
        recorded_first = self._record_first
        looked_ns = answered_ns = 0
        if recorded_first:
            looked_ns = self._look(truth, released)
            self._record(truth, begun, released)
            answered_ns = self._exchange(truth, released)
        r3 = clock()
        if self._observe is not None:
            self._observe(truth, self._wind_at())
        imu, mag, baro, gps = (newest.get(kind) for kind in _HIL_SENSOR_KINDS)
        sent = self._link.send(tick, t_ns, imu, mag, baro, gps, extra, ranging)

        t4 = clock()
        if not recorded_first:
            looked_ns = self._look(truth, released)
            self._record(truth, begun, released)
        self._recorder.sent(tick, t_ns, sent)
        if not recorded_first:
            answered_ns = self._exchange(truth, released)
        t5 = clock()
        own5 = own_clock()
        try:
            actuators = self._link.wait(tick, t_ns)
        finally:
            # Whatever did arrive belongs to the recording, also when the reply itself never came.
            self._frames = self._link.take_frames()
            self._unrecorded = (tick, self._frames, None)
        t6 = clock()

        if actuators is not None:
            self._latched = actuators
            self._unrecorded = (tick, self._frames, actuators)
        self.tick = tick + 1

        phase = self.phase_ns
        phase["physics"].add(t1 - t0)
        phase["sensors"].add(t2 - t1)
        phase["commands"].add(t3 - t2)
        phase["send"].add(t4 - r3)
        phase["frames"].add(looked_ns)
        phase["record"].add(t5 - t4 + r3 - t3 - looked_ns - answered_ns)
        phase["companion"].add(answered_ns)
        phase["wait"].add(t6 - t5)
        # A companion is waited for as an autopilot is; processor time does not count while it is.
        self.own_ns.add(own5 - own0 - (answered_ns if own_clock is clock else 0))
        self.step_ns.add(t6 - t0)

    def _sample(self, slots: Sequence[SensorSlot], truth: TruthState, before: int) -> int:
        """Take a sample of each sensor that is due. Wall clock at the start in, at the end out [ns]."""
        clock, queue = time.perf_counter_ns, self._queue
        for slot in slots:
            if slot.due():
                sample = slot.sample(truth, slot.samples)
                slot.samples += 1  # also for a sample that dropped out: noise is keyed by this number
                if sample is not None:
                    queue.push(slot.port, sample)
                after = clock()
                slot.timing.add(after - before)
                before = after
        return before

    def _look(self, truth: TruthState, released: list[tuple[str, Sample]]) -> int:
        """Cameras and LiDARs; what they have by now joins what was released. Returns the time it took [ns]."""
        if not self._frame_sensors:
            return 0
        begun = time.perf_counter_ns()
        took = self._sample(self._frame_sensors, truth, begun) - begun
        released += self._queue.release(truth.t_ns)
        return took

    def _exchange(self, truth: TruthState, released: list[tuple[str, Sample]]) -> int:
        """Returns the time it took [ns]."""
        if self._companion is None:
            return 0
        begun = time.perf_counter_ns()
        self._companion.step(truth, released)
        return time.perf_counter_ns() - begun

    def _record(self, truth: TruthState, begun: ActuatorFrame | None, released: list[tuple[str, Sample]]) -> None:
        """What is known before the tick is sent; its bytes follow, and the order in the recording is always this."""
        self._record_received()
        recorder = self._recorder
        if begun is not None:
            recorder.actuators(begun)
        recorder.truth(truth)
        for event in self._physics.take_events():
            recorder.event(event.t_ns, event.kind, event.text)
        for port, sample in released:
            recorder.sample(port, sample)
        for observe in self._observers:
            observe(truth)

    def skip_tick(self) -> None:
        """Go on after the tick that failed, with all controls at zero: the autopilot has started again."""
        self._latched = ActuatorFrame(self.tick, self.t_ns, (0.0,) * 16, False, 0)
        self.tick += 1

    def flush(self) -> None:
        """Record what the last tick received. Call once, when no further tick will run."""
        self._record_received()

    def _record_received(self) -> None:
        if self._unrecorded is None:
            return
        tick, frames, actuators = self._unrecorded
        self._unrecorded = None
        if frames:
            self._recorder.received(tick, tick * self.tick_ns, frames)
        if actuators is not None:
            self._recorder.actuators(actuators)

    def _for_autopilot(self, released: list[tuple[str, Sample]]) -> tuple[dict[str, Any], list[Sample]]:
        """By kind the newest released sample of each sensor that the autopilot listens to; of range and flow, all."""
        newest: dict[str, Any] = {}
        ranging: list[Sample] = []
        for port, sample in released:
            kind = self._kinds.get(port)
            if kind in _RANGING_KINDS:
                ranging.append(sample)
            elif kind is not None:
                newest[kind] = sample
        return newest, ranging

    def _wait_for_deadline(self, tick_wall_ns: float) -> None:
        """Sleep until this tick's wall-clock time. A late tick is counted and the schedule kept, not stretched."""
        now = time.perf_counter_ns()
        if self.tick == 0:
            self._wall_start_ns = now
            return
        deadline = self._wall_start_ns + int(self.tick * tick_wall_ns)
        if now > deadline:
            self.late += 1
            return
        if self._companion is not None and self._companion.waits_for_nobody:
            self._companion.serve(max((deadline - now) * 1e-9 - _BACK_S, 0.0))
            now = time.perf_counter_ns()
        time.sleep(max(deadline - now, 0) * 1e-9)
