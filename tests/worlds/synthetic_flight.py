"""A synthetic flight for tests of the recorder: every field differs in every tick."""

from __future__ import annotations

import random
from typing import NamedTuple

from pymavlink.dialects.v20 import common

from hil.run.recorder.recorder import Recorder
from signals.samples import (
    ActuatorFrame,
    BaroSample,
    GpsSample,
    ImuSample,
    MagSample,
    Sample,
    TruthState,
)

TICK_NS = 4_000_000


class RawFrame(NamedTuple):
    msgid: int
    raw: bytes


class Tick(NamedTuple):
    tick: int
    t_ns: int
    truth: TruthState
    samples: list[tuple[str, Sample]]
    sent: bytes
    received: list[RawFrame]
    actuators: ActuatorFrame


def make_flight(ticks: int, *, seed: int = 1) -> list[Tick]:
    """Return `ticks` ticks of random values and real MAVLink frames; IMU samples arrive one tick after capture."""
    rng = random.Random(seed)
    bench = common.MAVLink(None, srcSystem=255, srcComponent=190)
    autopilot = common.MAVLink(None, srcSystem=1, srcComponent=1)

    def v(n: int) -> tuple[float, ...]:
        return tuple(rng.gauss(0.0, 3.0) for _ in range(n))

    flight = []
    for k in range(ticks):
        t_ns = k * TICK_NS
        truth = TruthState(k, t_ns, v(3), v(4), v(3), v(3), v(3), v(3), v(4), rng.random() < 0.5)
        samples: list[tuple[str, Sample]] = []
        if k > 0:
            samples.append(("imu", ImuSample(k - 1, t_ns - TICK_NS, t_ns, v(3), v(3), v(1)[0])))
        if k % 3 == 0:
            samples.append(("mag", MagSample(k // 3, t_ns, t_ns, v(3))))
        if k % 5 == 0:
            samples.append(("baro", BaroSample(k // 5, t_ns, t_ns, *v(3))))
        if k % 25 == 0:
            fix, satellites = rng.randrange(6), rng.randrange(20)
            samples.append(("gps", GpsSample(k // 25, t_ns, t_ns, *v(3), v(3), *v(2), fix, satellites)))
        sensor = bench.hil_sensor_encode(t_ns // 1000, *v(13), 0x1FFF, 0)
        sent = sensor.pack(bench)
        bench.seq = (bench.seq + 1) % 256
        if k % 25 == 0:
            sent = bench.heartbeat_encode(6, 8, 0, 0, 4).pack(bench) + sent
        controls = tuple(round(rng.random(), 3) for _ in range(4)) + (0.0,) * 12
        answer = autopilot.hil_actuator_controls_encode(t_ns // 1000, controls, 129, 1)
        received = [RawFrame(answer.get_msgId(), answer.pack(autopilot))]
        if k % 10 == 0:
            attitude = autopilot.attitude_encode(t_ns // 1_000_000, *v(6))
            received.insert(0, RawFrame(attitude.get_msgId(), attitude.pack(autopilot)))
        autopilot.seq = (autopilot.seq + 1) % 256
        flight.append(Tick(k, t_ns, truth, samples, sent, received, ActuatorFrame(k, t_ns, controls, True, 129)))
    return flight


def fly(recorder: Recorder, flight: list[Tick]) -> None:
    """Feed the flight to the recorder as the scheduler does."""
    for tick in flight:
        recorder.truth(tick.truth)
        for port, sample in tick.samples:
            recorder.sample(port, sample)
        recorder.sent(tick.tick, tick.t_ns, tick.sent)
        recorder.received(tick.tick, tick.t_ns, tick.received)
        recorder.actuators(tick.actuators)
