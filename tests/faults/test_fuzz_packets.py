"""Broken packets through every decoder of received bytes: named errors only, bounded memory.

The parser and the decoders of messages and of ArduPilot's servo packets get 200 000 each, and a million each in
`make test-all`; slower code gets fewer. The packets are true frames of every known message with random payloads
(MAVLink 1 and 2, signed, shorter and longer than they should be), then left alone, cut, bit-flipped, given a wrong
checksum or another length, or replaced by random bytes. No wall-clock time is asserted: the suite's time limit ends
what does not end.
"""

from __future__ import annotations

import struct
import tracemalloc
from collections.abc import Iterator
from contextlib import suppress

import numpy as np
import pytest
from fastcrc.crc16 import mcrf4xx

from firmware_bridge.codecs.ardupilot_json import PwmRange, ServoPacket, decode_servos
from firmware_bridge.codecs.dialect import SHAPES
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.hil import HIL_ACTUATOR_CONTROLS, actuator_frame
from firmware_bridge.codecs.mavlink_frame import MAX_FRAME_LENGTH, FrameEncoder, FrameParser, FrameSplitter
from firmware_bridge.codecs.messages import MSGID, message_class, pack, unpack
from firmware_bridge.ground_station.station import GroundStation
from firmware_bridge.links.autopilot_link import InvalidControls, LinkCaps, TickSamples
from firmware_bridge.links.px4.lockstep import LockstepLink
from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from firmware_bridge.transports.loopback import LoopbackTransport
from hil.config import load_bench
from signals.errors import HandshakeError, LockstepLost
from signals.samples import ImuSample
from tests.worlds.ardupilot_json_sitl import encode_servos
from tests.worlds.patience import PATIENT

BATCH = 20_000
WIDTH = 320  # longest packet; a signed frame with 255 bytes of payload has 280
IDS = np.array(sorted(SHAPES))
COMMON = [
    "HEARTBEAT SYS_STATUS STATUSTEXT COMMAND_LONG COMMAND_INT COMMAND_ACK PARAM_SET PARAM_REQUEST_READ PARAM_VALUE",
    "PARAM_REQUEST_LIST MISSION_COUNT MISSION_ITEM MISSION_ITEM_INT MISSION_REQUEST MISSION_REQUEST_INT MISSION_ACK",
    "MISSION_SET_CURRENT MISSION_CLEAR_ALL MISSION_REQUEST_LIST MISSION_CURRENT MISSION_ITEM_REACHED ATTITUDE PING",
    "LOCAL_POSITION_NED GLOBAL_POSITION_INT MANUAL_CONTROL SET_POSITION_TARGET_LOCAL_NED SET_ATTITUDE_TARGET TIMESYNC",
    "EXTENDED_SYS_STATE HOME_POSITION SET_MODE RC_CHANNELS_OVERRIDE DISTANCE_SENSOR HIL_SENSOR HIL_GPS",
    "HIL_OPTICAL_FLOW HIL_STATE_QUATERNION HIL_ACTUATOR_CONTROLS",
]
# Two packets in three are of messages that the project reads.
FAVOURITES = np.array([MSGID[name] for line in COMMON for name in line.split()])


def any_frame(rng: np.random.Generator, msgid: int, noise: bytes) -> bytes:
    """Return a frame with a valid checksum, whose length may differ from the message's."""
    shape = SHAPES[msgid]
    kind, length = rng.integers(0, 10), shape.length
    if kind < 2:
        length = int(rng.integers(0, 256))
    payload = noise[:length]
    addresses = bytes((noise[-1], 1, 1)) if kind < 6 else noise[-3:]
    if kind in (2, 6) and msgid < 256:
        body = bytes((len(payload),)) + addresses + bytes((msgid,)) + payload
        return b"\xfe" + body + mcrf4xx(body + bytes((shape.crc_extra,))).to_bytes(2, "little")
    signed = kind in (3, 7)
    body = struct.pack("<BBB", len(payload), signed, 0) + addresses + msgid.to_bytes(3, "little") + payload
    crc = mcrf4xx(body + bytes((shape.crc_extra,))).to_bytes(2, "little")
    return b"\xfd" + body + crc + (noise[:13] if signed else b"")


def fuzzed(count: int, *, seed: int) -> Iterator[bytes]:
    """Yield `count` packets as streams of bytes, a batch at a time."""
    rng = np.random.default_rng(seed)
    for at in range(0, count, BATCH):
        yield _batch(rng, min(BATCH, count - at))


def _batch(rng: np.random.Generator, count: int) -> bytes:
    templates = []
    for msgid in np.where(rng.random(2000) < 0.66, rng.choice(FAVOURITES, 2000), rng.choice(IDS, 2000)).tolist():
        noise = rng.bytes(260) if rng.random() < 0.7 else bytes(rng.choice([0, 0, 1, 127, 128, 255], 260).tolist())
        templates.append(any_frame(rng, msgid, noise))
    table = np.frombuffer(b"".join(t.ljust(WIDTH, b"\0") for t in templates), np.uint8).reshape(-1, WIDTH)
    sizes = np.array([len(t) for t in templates])
    chosen = rng.integers(0, len(templates), count)
    packets, lengths = table[chosen].copy(), sizes[chosen]
    rows = np.arange(count)
    kind = rng.integers(0, 8, count)  # 0 to 2: unchanged
    flip = kind == 3
    for _ in range(3):
        where = (rng.random(count) * lengths).astype(int)
        packets[rows[flip], where[flip]] ^= (1 << rng.integers(0, 8, count)).astype(np.uint8)[flip]
    cut = kind == 4
    lengths = np.where(cut, (rng.random(count) * lengths).astype(int), lengths)
    longer = kind == 5  # a wrong length, often the greatest
    packets[rows[longer], 1] = np.where(rng.random(count) < 0.5, 255, rng.integers(0, 256, count))[longer]
    wrong = (kind == 6) & (lengths > 2)
    packets[rows[wrong], lengths[wrong] - 1] ^= 0x55
    noise = kind == 7
    packets[noise] = rng.integers(0, 256, (int(noise.sum()), WIDTH), np.uint8)
    lengths = np.where(noise, rng.integers(1, WIDTH, count), lengths)
    return packets[np.arange(WIDTH)[None, :] < lengths[:, None]].tobytes()


def pieces(data: bytes, seed: int) -> Iterator[bytes]:
    """Yield `data` cut at random places, as from a serial line."""
    rng = np.random.default_rng(seed)
    at = 0
    while at < len(data):
        size = int(rng.choice([1, 7, 64, 300, 4096, 65536]))
        yield data[at : at + size]
        at += size


def decode_all(count: int, seed: int) -> tuple[int, int, int]:
    """Return frames, refusals and messages seen. Errors other than CodecError are raised."""
    parser, refused, kinds = FrameParser(), 0, set()
    for number, data in enumerate(fuzzed(count, seed=seed)):
        for piece in pieces(data, number):
            for frame in parser.feed(piece):
                kinds.add(frame.msgid)
                try:
                    unpack(frame)
                    if frame.msgid == HIL_ACTUATOR_CONTROLS:
                        actuator_frame(0, frame)
                except CodecError:
                    refused += 1
            assert parser.pending < MAX_FRAME_LENGTH
        parser.rescan()
    return parser.frames, refused, len(kinds)


COUNTS = pytest.mark.parametrize("count", [200_000, pytest.param(1_000_000, marks=pytest.mark.slow)])


@COUNTS
def test_parser_and_decoders(count: int) -> None:
    frames, refused, kinds = decode_all(count, seed=1)
    assert frames > 0.3 * count
    assert refused > 0
    assert kinds > len(IDS) * 0.99


@pytest.mark.parametrize("batches", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_memory_stays_bounded(batches: int) -> None:
    decode_all(BATCH, seed=2)  # caches that are filled on first use
    received = list(fuzzed(batches * BATCH, seed=3))
    parser, splitter, mock = FrameParser(), FrameSplitter(), MockPixhawk()
    tracemalloc.start()
    try:
        for data in received:
            for piece in pieces(data[: len(data) // 2], 1):
                for frame in parser.feed(piece):
                    with suppress(CodecError):  # of a message known to the framing only
                        unpack(frame)
                splitter.feed(piece)
                mock.feed(piece)
            mock.feed(sensor_frame(mock.steps))  # queued texts are sent
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 8_000_000


def sensor_frame(step: int) -> bytes:
    payload = struct.pack("<Q13fIB", (step + 1) * 4000, 0, 0, -9.81, *(0.0,) * 10, 0x3F, 0)
    return FrameEncoder(254, 200).frame(MSGID["HIL_SENSOR"], payload)


@pytest.mark.parametrize("boot_sensors", [0, 20])
def test_no_packet_makes_the_mock_raise(boot_sensors: int) -> None:
    """It may fall silent: a HIL_SENSOR of the past silences PX4 as well. A new mock then replaces it."""
    mock = MockPixhawk(boot_sensors=boot_sensors)
    parser, heard, silenced = FrameParser(), 0, 0
    for data in fuzzed(100_000, seed=5):
        for at in range(0, len(data), 500):
            for frame in parser.feed(mock.feed(data[at : at + 500])):
                unpack(frame)
                heard += 1
            if mock.silent:
                silenced += 1
                mock = MockPixhawk(boot_sensors=boot_sensors)
                mock.feed(sensor_frame(0))
    assert heard > 0 or boot_sensors
    assert silenced > 0


def test_the_mock_answers_every_tick_between_random_packets() -> None:
    """Without HIL_SENSOR in the random packets, time goes on and it answers every tick."""
    mock, parser = MockPixhawk(boot_sensors=0, offboard_silence=False), FrameParser()
    words = FrameParser()
    for data in fuzzed(20_000, seed=6):
        frames = [f for f in words.feed(data) if f.msgid != MSGID["HIL_SENSOR"]]
        for at in range(0, len(frames), 20):
            out = mock.feed(b"".join(f.raw for f in frames[at : at + 20]) + sensor_frame(mock.steps))
            answers = [f for f in parser.feed(out) if f.msgid == HIL_ACTUATOR_CONTROLS]
            assert len(answers) == 1
            actuator_frame(0, answers[0])
    assert mock.steps > 200


def test_the_ground_station_takes_any_frame() -> None:
    items = load_bench().mission.items
    station, parser, refusals = GroundStation(items), FrameParser(), 0
    for data in fuzzed(20_000, seed=7):
        frames = parser.feed(data)
        for tick, at in enumerate(range(0, len(frames), 5)):
            try:
                station.step(tick * 4_000_000, frames[at : at + 5])
            except HandshakeError:
                refusals += 1
                station = GroundStation(items)
    assert refusals > 0


class NoisyAutopilot:
    """An autopilot that sends a few broken packets before each valid answer."""

    def __init__(self, noise: Iterator[bytes]) -> None:
        self._noise = noise
        self._encoder = FrameEncoder(1, 1)
        self._parser = FrameParser()

    def boot(self) -> bytes:
        beat = message_class("HEARTBEAT")
        return self._encoder.frame(beat.MSGID, pack(beat(2, 12, 0, 0, 0, 3)))

    def feed(self, data: bytes) -> bytes:
        out = b""
        for frame in self._parser.feed(data):
            if frame.msgid == MSGID["HIL_SENSOR"]:
                answer = frame.payload[:8] + bytes(73)
                out += next(self._noise, b"") + self._encoder.frame(HIL_ACTUATOR_CONTROLS, answer)
        return out


def test_the_lockstep_link_raises_named_errors_only() -> None:
    caps = LinkCaps("fuzz", lockstep=True, deterministic=True, boot_sensors=0)
    noise = (data[at : at + 256] for data in fuzzed(20_000, seed=8) for at in range(0, len(data), 256))
    imu = ImuSample(0, 0, 0, (0.0, 0.0, 9.81), (0.0, 0.0, 0.0), 25.0)
    ends: dict[str, int] = {}
    for _ in range(400):
        link = LockstepLink(LoopbackTransport(NoisyAutopilot(noise)), caps, timeouts=PATIENT)
        link.open()
        try:
            for tick in range(40):
                link.send(tick, tick * 4_000_000, TickSamples(imu), b"")
                assert link.wait(tick, tick * 4_000_000) is not None
                link.take_frames()
        except (LockstepLost, InvalidControls) as error:
            ends[type(error).__name__] = ends.get(type(error).__name__, 0) + 1
        finally:
            link.close()
    assert ends["LockstepLost"] > 10


@COUNTS
def test_servo_packets_of_ardupilot_are_decoded_or_refused(count: int) -> None:
    rng = np.random.default_rng(9)
    pwm = PwmRange()
    good = refused = 0
    noise = rng.integers(0, 256, count * 8 + 200, np.uint8).tobytes()
    sizes = np.where(rng.random(count) < 0.3, rng.integers(0, 120, count), rng.choice([40, 72], count)).tolist()
    true_magic = (rng.random(count) < 0.7).tolist()
    magics = (struct.pack("<H", 18458), struct.pack("<H", 29569))
    for i, (size, true) in enumerate(zip(sizes, true_magic, strict=True)):
        packet = noise[i * 8 : i * 8 + size]
        if true:
            packet = magics[size == 72 if i % 5 else i % 2] + packet[2:]
        try:
            servos = decode_servos(packet)
        except CodecError:
            refused += 1
            continue
        good += 1
        controls = pwm.controls(servos.pwm_us)
        assert len(controls) == 16
        assert all(0.0 <= control <= 1.0 for control in controls)
        if i % 100 == 0:
            assert isinstance(servos, ServoPacket)
            assert encode_servos(servos) == packet
    assert good > count * 0.3
    assert refused > count * 0.2
