"""The tick loop. This header defines what one tick does, and what is undefined after a failure.

    t_k = k * tick_ns                 integer nanoseconds; time is never a sum of floats

    1 physics    advance to t_k with ActuatorFrame[k-1]   -> TruthState[k]
    2 sensors    sample the sensors that are due and have a consumer, except frame sensors (camera, LiDAR, radar)
                                                          -> samples with t_capture, t_available, seq
    3 release    take the samples with t_available <= t_k, in the order of (t_available, port, seq)
    4 commands   collect bytes from the command sources (ground station, router clients) for the autopilot
    5 send       one write: command bytes, range, flow and vision, HIL_GPS, HIL_SENSOR
    6 frames     sample the frame sensors at TruthState[k]; their samples with t_available <= t_k are released too
      record     write what this tick produced so far
      companion  pass the released samples to the clients under test; their setpoints are commanded from tick k+1 on
    7 wait       block until the reply that answers t_k   -> ActuatorFrame[k]
    8 latch      validate and keep ActuatorFrame[k]; it moves the vehicle in tick k+1

Overlap. From the reply to the next send the autopilot waits for the bench, so that only phases 1 to 5 lie there, and
nothing in them can be done earlier: the physics needs the reply, the IMU the physics. Phase 6 and the statistics of the
ticks before run while the autopilot computes its reply, and feed nothing back into tick k. While bench and autopilot
share one processor (`record_first`), phase 6 runs before phase 5 instead, except that the bytes sent are recorded after
it: the processor is the autopilot's during the wait. What arrives in phase 7 is recorded in phase 6 of tick k+1, or by
`flush`. The order of the messages in the recording is the same in all cases.

Free-running autopilots do not wait for the bench. The link's `begin` then starts each tick at its wall-clock time and
returns the newest command as ActuatorFrame[k-1]; phase 7 is empty.

Failure. An exception in any phase ends the run. Phases 1 to 4 have no effect outside the bench, so a tick that fails
there was never sent. After a failure in phase 5 or 7 nothing more is sent and no command is invented: the actuator
frame of that tick is undefined and is not latched. The caller then calls `flush` and closes the recorder, so the
recording is complete up to the failure.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Any, Protocol

import numpy as np

from firmware_bridge.codecs.mavlink_frame import Frame
from firmware_bridge.links.autopilot_link import AutopilotLink, TickSamples
from hil.run.recorder.recorder import Recorder
from signals.latency import LatencyHistogram
from signals.samples import ActuatorFrame, Sample, TruthState, Vec3
from signals.time import RateAccumulator
from sim.physics.vehicle_physics import VehiclePhysics

_SERVE_MARGIN_S = 0.0005  # companions are not served in this time before a tick's deadline
_HIL_SENSOR_KINDS = ("imu", "magnetometer", "barometer", "gps")  # in the order of `TickSamples`
_OTHERS = len(_HIL_SENSOR_KINDS)
_OTHER_KINDS = ("range_finder", "optical_flow", "external_vision", "pitot", "vane")
_new_tuple = tuple.__new__  # without the calls of a NamedTuple's own
_COUNTED_TICKS = 256  # whose durations are counted at once
# Processor time is measured in every 17th tick: its clock is a system call, which takes as long as thirty readings of
# the other. A prime, so that the ticks measured are in step with no sensor, nor with the recorder's flushes.
_OWN_EVERY_TICKS = 17
PHASES = ("physics", "sensors", "commands", "send", "frames", "record", "companion", "wait")


class Sensor(Protocol):
    """A simulated sensor."""

    @property
    def name(self) -> str: ...

    def sample(self, truth: TruthState, seq: int) -> Sample | None:
        """Return sample `seq`, None where it drops out."""
        ...


class CommandSource(Protocol):
    """A sender of messages to the autopilot beside the sensors: the bench's ground station, the router's clients."""

    def step(self, t_ns: int, frames: Sequence[Frame]) -> bytes:
        """Return the bytes to send at `t_ns`. `frames`: received from the autopilot in the tick before."""
        ...


class Exchange(Protocol):
    """A receiver of every tick's released samples that is served while the autopilot computes, such as companions."""

    @property
    def free_running(self) -> bool:
        """Return True if it is also served between paced ticks, as time allows."""
        ...

    def step(self, truth: TruthState, released: Sequence[tuple[str, Sample]]) -> None:
        """Process the samples (port, sample) that this tick released."""
        ...

    def serve(self, limit_s: float) -> None:
        """Exchange messages between ticks for at most `limit_s` of wall-clock time."""
        ...


class SensorSlot:
    """A sensor with its rate on the tick and its sample count."""

    __slots__ = ("after_send", "durations_ns", "idle", "port", "rate", "sample", "samples", "timing")

    def __init__(self, sensor: Sensor, rate: RateAccumulator, *, after_send: bool = False) -> None:
        """`after_send`: sampled while the autopilot computes, because the autopilot does not receive its samples."""
        self.after_send = after_send
        self.port = sensor.name
        self.sample = sensor.sample
        self.rate = rate
        self.idle = 0  # coming ticks on which it is not due
        self.samples = 0
        self.durations_ns: list[int] = []  # not yet in `timing`
        self.timing = LatencyHistogram()


class ReleaseQueue:
    """Holds captured samples until they are available. The order (t_available_ns, port, seq) is total."""

    def __init__(self) -> None:
        self.heap: list[tuple[int, str, int, Sample]] = []

    def push(self, port: str, sample: Sample) -> None:
        heappush(self.heap, (sample.t_available_ns, port, sample.seq, sample))

    def release(self, t_ns: int) -> list[tuple[str, Sample]]:
        """Remove and return every sample with t_available_ns <= t_ns, in release order."""
        heap = self.heap
        released = []
        while heap and heap[0][0] <= t_ns:
            _, port, _, sample = heappop(heap)
            released.append((port, sample))
        return released

    def __len__(self) -> int:
        return len(self.heap)


@dataclass(frozen=True)
class Wiring:
    """The objects that a tick connects."""

    physics: VehiclePhysics
    sensors: Sequence[SensorSlot]
    link: AutopilotLink
    ports: Mapping[str, str]  # kind -> port of the sensors whose samples go to the autopilot, an imu among them
    recorder: Recorder
    commands: Sequence[CommandSource] = ()
    observers: Sequence[Callable[[TruthState], None]] = ()
    exchanges: Sequence[Exchange] = ()


class Scheduler:
    """Runs ticks. The composition root (`hil.run.runs.vehicle_run`) opens and closes everything in the wiring."""

    def __init__(
        self,
        wiring: Wiring,
        *,
        tick_ns: int,
        pace: float | None = None,
        wind_at: Callable[[], Vec3] = lambda: (0.0, 0.0, 0.0),
    ) -> None:
        """Prepare tick 0.

        `pace`: multiple of real time, None: as fast as possible. `wind_at` returns the wind at the vehicle [m/s, W].
        """
        link, recorder, sensors = wiring.link, wiring.recorder, wiring.sensors
        self.tick_ns = tick_ns
        self.tick = 0  # the next tick to run
        self.late = 0  # ticks that began after their wall-clock deadline (paced runs only)
        self.phase_ns = {name: LatencyHistogram() for name in PHASES}
        self.own_ns = LatencyHistogram()  # processor time of a tick in this thread, of every `_OWN_EVERY_TICKS`th
        self.step_ns = LatencyHistogram()  # per tick, without pacing
        self.turnaround_ns = LatencyHistogram()  # from a reply to the next send (lockstep, not paced)
        self._histograms = (self.step_ns, *(self.phase_ns[name] for name in PHASES))
        self.begun_ns = 0  # start of the present tick, by `time.perf_counter_ns`
        self.truth: TruthState | None = None
        self._physics = wiring.physics
        self._sensors = tuple(slot for slot in sensors if not slot.after_send)
        self._frame_sensors = tuple(slot for slot in sensors if slot.after_send)
        self._link = link
        self._begin: Callable[[int], ActuatorFrame | None] | None = None if link.caps.lockstep else link.begin
        self._observe: Callable[[TruthState, Vec3], None] | None = link.observe if link.caps.takes_truth else None
        self._wind_at = wind_at
        self.record_first = False  # set while bench and autopilot share one processor
        order = {kind: i for i, kind in enumerate(_HIL_SENSOR_KINDS)} | dict.fromkeys(_OTHER_KINDS, _OTHERS)
        self._places = {port: order[kind] for kind, port in wiring.ports.items() if kind in order}
        self._commands = tuple(wiring.commands)
        self._recorder = recorder
        self._observers = tuple(wiring.observers)
        self._exchanges = tuple(wiring.exchanges)
        self._serves = tuple(exchange.serve for exchange in self._exchanges if exchange.free_running)
        self._queue = ReleaseQueue()
        # The frame that moves the vehicle in the next tick; all zero and disarmed until the first reply.
        self.actuators = ActuatorFrame(-1, -tick_ns, (0.0,) * 16, False, 0)
        self._frames: list[Frame] = []  # received in the tick before
        self._replied_at_ns = 0  # 0: no reply yet, or the autopilot does not wait
        self._clocks_ns: list[tuple[int, ...]] = []  # of ticks that are not yet in the statistics
        self._turnarounds_ns: list[int] = []  # likewise
        self._unrecorded: tuple[int, list[Frame], ActuatorFrame | None] | None = None
        # State of the present tick, kept from one of its phases to the next.
        self._command: ActuatorFrame | None = None  # from `begin` of a free-running link
        self._released: list[tuple[str, Sample]] = []
        self._sent = b""
        self._recorded = False
        self._own_start_ns = self._frames_ns = self._companion_ns = 0
        self._marks_ns = (0, 0, 0, 0, 0, 0)
        self._tick_wall_ns = None if pace is None else tick_ns / pace
        self._wall_start_ns = 0

    @property
    def t_ns(self) -> int:
        """The simulated time of the next tick."""
        return self.tick * self.tick_ns

    def step(self) -> None:
        """Run one tick. Raises HilError; the header of this file defines the state after it."""
        controls = self.begin()
        began_ns = time.perf_counter_ns()
        self.send(self._physics.advance(self.tick, controls), began_ns)
        self.work()
        self.wait()

    def begin(self) -> Sequence[float]:
        """Wait until the tick may begin, and return the controls that move the vehicle in it."""
        if self._begin is not None:
            self._command = self._begin(self.tick)
            if self._command is not None:
                self.actuators = self._command
        elif self._tick_wall_ns is not None:
            self._wait_for_deadline(self._tick_wall_ns)
        # Other programs may preempt the bench, so only processor time measures its own work.
        if self.tick % _OWN_EVERY_TICKS == 0:
            self._own_start_ns = time.thread_time_ns()
        return self.actuators.controls

    def send(self, truth: TruthState, began_ns: int) -> None:
        """Sample the sensors of the autopilot at the vehicle's new state, and send them: phases 2 to 5.

        `began_ns`: time at which the physics began, by `time.perf_counter_ns`.
        """
        clock = time.perf_counter_ns
        tick = self.tick
        t_ns = tick * self.tick_ns
        self.begun_ns = began_ns
        self.truth = truth

        t1 = clock()
        self._sample(self._sensors, truth, t1)
        released = self._released = self._queue.release(t_ns)
        newest: list[Any] = [None] * _OTHERS  # of the kinds in HIL_SENSOR and HIL_GPS
        others: list[Sample] = []  # of the other kinds all, in order
        for port, sample in released:
            place = self._places.get(port)
            if place == _OTHERS:
                others.append(sample)
            elif place is not None:
                newest[place] = sample

        t2 = clock()
        commands = b""
        for source in self._commands:
            commands += source.step(t_ns, self._frames)

        t3 = send_start = clock()
        self._frames_ns = self._companion_ns = 0
        self._recorded = self.record_first
        if self._recorded:
            if self._frame_sensors:
                self._sample_frames(truth, released)
            self._record(truth, self._command, released)
            if self._exchanges:
                self._exchange_all(truth, released)
            send_start = clock()
        if self._observe is not None:
            self._observe(truth, self._wind_at())
        self._sent = self._link.send(tick, t_ns, _new_tuple(TickSamples, (*newest, others)), commands)
        self._marks_ns = (began_ns, t1, t2, t3, send_start, clock())

    def work(self) -> None:
        """Render, record and serve the companions while the autopilot computes its reply: phase 6."""
        truth, released = self.truth, self._released
        assert truth is not None
        if not self._recorded:
            if self._frame_sensors:
                self._sample_frames(truth, released)
            self._record(truth, self._command, released)
        self._recorder.sent(self.tick, truth.t_ns, self._sent)
        if self._exchanges and not self._recorded:
            self._exchange_all(truth, released)
        if len(self._clocks_ns) >= _COUNTED_TICKS:
            self.count_durations()
        if self._replied_at_ns:
            self._turnarounds_ns.append(self._marks_ns[-1] - self._replied_at_ns)

    def wait(self) -> None:
        """Wait for the reply of the autopilot, which moves the vehicle in the next tick: phases 7 and 8."""
        clock = time.perf_counter_ns
        tick = self.tick
        t5 = clock()
        if tick % _OWN_EVERY_TICKS == 0:
            self.own_ns.add(time.thread_time_ns() - self._own_start_ns)
        actuators = None
        try:
            actuators = self._link.wait(tick, tick * self.tick_ns)
        finally:
            # Frames that arrived are recorded even if the reply itself is missing.
            self._frames = self._link.take_frames()
            self._unrecorded = (tick, self._frames, actuators)
        t6 = clock()

        if actuators is not None:
            self.actuators = actuators
        self.tick = tick + 1

        self._clocks_ns.append((*self._marks_ns, t5, t6, self._frames_ns, self._companion_ns))
        if actuators is not None and self._tick_wall_ns is None:
            self._replied_at_ns = t6

    def count_durations(self) -> None:
        """Add the durations of the ticks so far to the statistics; call it before they are read."""
        rows, self._clocks_ns = self._clocks_ns, []
        t0, t1, t2, t3, send_start, t4, t5, t6, frames_ns, companion_ns = np.array(rows, np.int64).reshape(-1, 10).T
        record_ns = t5 - t4 + send_start - t3 - frames_ns - companion_ns
        phases_ns = (t1 - t0, t2 - t1, t3 - t2, t4 - send_start, frames_ns, record_ns, companion_ns, t6 - t5)
        for histogram, durations_ns in zip(self._histograms, (t6 - t0, *phases_ns), strict=True):
            histogram.add_all(durations_ns)
        self.turnaround_ns.add_all(self._turnarounds_ns)
        self._turnarounds_ns.clear()
        for slot in (*self._sensors, *self._frame_sensors):
            slot.timing.add_all(slot.durations_ns)
            slot.durations_ns.clear()

    def _sample(self, slots: Sequence[SensorSlot], truth: TruthState, before_ns: int) -> int:
        """Sample each sensor that is due. `before_ns`: wall clock at the start. Return the wall clock at the end."""
        clock, heap = time.perf_counter_ns, self._queue.heap
        for slot in slots:
            if slot.idle:
                slot.idle -= 1
            else:
                slot.idle = slot.rate.idle_ticks()
                sample = slot.sample(truth, slot.samples)
                slot.samples += 1  # also for a sample that dropped out: noise is keyed by this number
                if sample is not None:
                    heappush(heap, (sample.t_available_ns, slot.port, sample.seq, sample))
                after_ns = clock()
                slot.durations_ns.append(after_ns - before_ns)
                before_ns = after_ns
        return before_ns

    def _sample_frames(self, truth: TruthState, released: list[tuple[str, Sample]]) -> None:
        """Sample the frame sensors and append their released samples to `released`."""
        start_ns = time.perf_counter_ns()
        self._frames_ns = self._sample(self._frame_sensors, truth, start_ns) - start_ns
        released += self._queue.release(truth.t_ns)

    def _exchange_all(self, truth: TruthState, released: list[tuple[str, Sample]]) -> None:
        """Pass the released samples to the companions."""
        start_ns = time.perf_counter_ns()
        for exchange in self._exchanges:
            exchange.step(truth, released)
        self._companion_ns = time.perf_counter_ns() - start_ns

    def _record(self, truth: TruthState, command: ActuatorFrame | None, released: list[tuple[str, Sample]]) -> None:
        """Record what is known before the tick is sent. The sent bytes are recorded afterwards in all cases."""
        self._record_received()
        recorder = self._recorder
        if command is not None:
            recorder.actuators(command)
        recorder.truth(truth)
        for event in self._physics.take_events():
            recorder.event(event.t_ns, event.kind, event.text)
        for port, sample in released:
            recorder.sample(port, sample)
        for observe in self._observers:
            observe(truth)

    def take_pace(self) -> float | None:
        """Stop pacing the ticks and return the pace so far; None: there was none. Whoever calls it holds the ticks."""
        pace = None if self._tick_wall_ns is None else self.tick_ns / self._tick_wall_ns
        self._tick_wall_ns = None
        return pace

    def fall(self, truth: TruthState) -> None:
        """Record one tick of a vehicle whose autopilot is lost. Its sensors are not sampled any more."""
        self.truth = truth
        self._record(truth, None, [])

    def skip_tick(self) -> None:
        """Continue after a failed tick with all controls at zero, because the autopilot has rebooted."""
        self.actuators = ActuatorFrame(self.tick, self.t_ns, (0.0,) * 16, False, 0)
        self.tick += 1

    def flush(self) -> None:
        """Record what the last tick received, and count its durations. Call once, when no further tick will run."""
        self.count_durations()
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

    def _wait_for_deadline(self, tick_wall_ns: float) -> None:
        """Sleep until this tick's wall-clock time. A late tick is counted and does not shift the ticks after it."""
        now = time.perf_counter_ns()
        if self.tick == 0:
            self._wall_start_ns = now
            return
        deadline = self._wall_start_ns + int(self.tick * tick_wall_ns)
        if now > deadline:
            self.late += 1
            return
        if self._serves:
            for serve in self._serves:
                serve(max((deadline - now) * 1e-9 - _SERVE_MARGIN_S, 0.0))
            now = time.perf_counter_ns()
        time.sleep(max(deadline - now, 0) * 1e-9)
