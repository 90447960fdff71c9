"""A synthetic flight for tests of the recorder: every field differs in every tick."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from pymavlink.dialects.v20 import common

from hil.run.recorder.recorder import Recorder
from signals.channels import CHANNELS
from signals.samples import (
    CHANNEL_UNITS,
    ActuatorFrame,
    BaroSample,
    GpsSample,
    ImageSample,
    ImuSample,
    MagSample,
    PointCloudSample,
    Sample,
    TruthState,
)

TICK_NS = 4_000_000
POSE = ((1.5, -2.0, 3.0), (0.5, -0.5, 0.5, -0.5))


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


def image(seq: int, *, late_ns: int = 0, channels: tuple[str, ...] = tuple(CHANNEL_UNITS)) -> ImageSample:
    """Return a picture of 16 x 12 random pixels."""
    rng = np.random.default_rng(seq)
    pictures = {}
    for name in channels:
        channel = CHANNELS[name]
        pictures[name] = rng.integers(0, 200, channel.shape(12, 16)).astype(channel.dtype)
    if "depth" in pictures:
        pictures["depth"][0, 0] = np.inf
    return ImageSample(seq, seq * TICK_NS, seq * TICK_NS + late_ns, *POSE, pictures)


def cloud(seq: int, n: int) -> PointCloudSample:
    """Return a random cloud of n points."""
    rng = np.random.default_rng(seq)
    return PointCloudSample(
        seq,
        seq * TICK_NS,
        seq * TICK_NS,
        *POSE,
        rng.normal(size=(n, 3)).astype(np.float32),
        rng.uniform(0, 9, n).astype(np.float32),
        rng.uniform(0, 1, n).astype(np.float32),
        rng.integers(0, 16, n).astype(np.uint8),
        rng.integers(-10_000, 0, n).astype(np.int32),
        rng.integers(0, 9, n).astype(np.uint8),
    )


def decoded(path: Path) -> dict[str, list[tuple[Any, Any]]]:
    """Return (MCAP message, ROS message) by topic, read by the libraries that Foxglove and ROS tools use."""
    found: dict[str, list[tuple[Any, Any]]] = {}
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, ros in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message, ros))
    return found
