"""Recorded values equal those that the official readers return, bit for bit."""

from __future__ import annotations

import math
import random
from pathlib import Path

import pytest
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Chunk, MessageIndex
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from mcap_ros2.decoder import DecoderFactory

from firmware_bridge.codecs.mavlink_frame import split_frames
from hil.run.recorder.frame_description import FrameDescription
from hil.run.recorder.mcap.cdr import MESSAGE_PREFIX
from hil.run.recorder.reading import Recording, read_messages
from hil.run.recorder.recorder import Recorder
from signals.errors import RecordingError
from signals.samples import FlowSample, RangeSample
from tests.worlds.synthetic_flight import TICK_NS, Tick, fly, make_flight

TICKS = 620  # three chunks at 250 Hz, the last one short


@pytest.fixture(scope="module")
def flight() -> list[Tick]:
    return make_flight(TICKS)


@pytest.fixture(scope="module")
def path(flight: list[Tick], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("recorded")
    recorder = Recorder(
        out,
        mcap=True,
        tlog=False,
        tick_ns=TICK_NS,
        metadata={"seed": "1"},
        attachments={"config.yaml": b"seed: 1\n"},
    )
    recorder.event(0, "phase", "boot \N{GREEK SMALL LETTER MU}")
    fly(recorder, flight)
    recorder.event(TICKS * TICK_NS, "error", "the end")
    recorder.close("PASS")
    return out / "run.mcap"


def decoded(path: Path, topic: str) -> list[tuple]:
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return [(m, ros) for _, _, m, ros in reader.iter_decoded_messages(topics=[topic])]


def xyz(v) -> tuple[float, float, float]:
    return (v.x, v.y, v.z)


def stamp_ns(header) -> int:
    return header.stamp.sec * 1_000_000_000 + header.stamp.nanosec


def test_truth_is_bit_exact(path: Path, flight: list[Tick]) -> None:
    rows = {
        name: decoded(path, f"/truth/{name}")
        for name in (
            "pose",
            "velocity",
            "angular_velocity",
            "acceleration",
            "angular_acceleration",
            "rotors",
            "contact",
        )
    }
    for k, tick in enumerate(flight):
        truth = tick.truth
        message, pose = rows["pose"][k]
        assert (message.log_time, message.publish_time, message.sequence) == (truth.t_ns, truth.t_ns, k)
        assert stamp_ns(pose.header) == truth.t_ns
        assert pose.header.frame_id == "world"
        assert xyz(pose.pose.position) == truth.p_WB
        q = pose.pose.orientation
        assert (q.w, q.x, q.y, q.z) == truth.q_WB
        assert xyz(rows["velocity"][k][1].vector) == truth.v_WB_W
        assert xyz(rows["angular_velocity"][k][1].vector) == truth.w_WB_B
        assert rows["angular_velocity"][k][1].header.frame_id == "base_link"
        assert xyz(rows["acceleration"][k][1].vector) == truth.a_WB_W
        assert xyz(rows["angular_acceleration"][k][1].vector) == truth.alpha_WB_B
        assert tuple(rows["rotors"][k][1].speed_radps) == truth.rotor_speed_radps
        assert rows["contact"][k][1].in_contact == truth.in_contact
    assert all(len(row) == TICKS for row in rows.values())


def test_samples_are_bit_exact_with_their_own_times_and_numbers(path: Path, flight: list[Tick]) -> None:
    released = {
        port: [(t.t_ns, s) for t in flight for p, s in t.samples if p == port] for port in ("imu", "mag", "baro", "gps")
    }
    for port, expected in released.items():
        rows = decoded(path, f"/{port}")
        assert len(rows) == len(expected)
        for (message, ros), (t_ns, sample) in zip(rows, expected, strict=True):
            assert message.log_time == t_ns
            assert message.publish_time == sample.t_available_ns
            assert message.sequence == sample.seq
            assert stamp_ns(ros.header) == sample.t_capture_ns
    for (_, ros), (_, temperature), (_, sample) in zip(
        decoded(path, "/imu"), decoded(path, "/imu/temperature"), released["imu"], strict=True
    ):
        assert xyz(ros.linear_acceleration) == sample.accel_mps2
        assert xyz(ros.angular_velocity) == sample.gyro_radps
        assert ros.orientation_covariance[0] == -1.0
        assert temperature.temperature == sample.temperature_degc
    for (_, ros), (_, sample) in zip(decoded(path, "/mag"), released["mag"], strict=True):
        assert xyz(ros.magnetic_field) == sample.field_tesla
    for (_, ros), (_, altitude), (_, sample) in zip(
        decoded(path, "/baro"), decoded(path, "/baro/altitude"), released["baro"], strict=True
    ):
        assert ros.fluid_pressure == sample.pressure_pa
        assert altitude.altitude_m == sample.pressure_altitude_m
    for (_, ros), (_, velocity), (_, quality), (_, sample) in zip(
        decoded(path, "/gps"),
        decoded(path, "/gps/velocity"),
        decoded(path, "/gps/quality"),
        released["gps"],
        strict=True,
    ):
        assert (ros.latitude, ros.longitude, ros.altitude) == sample[3:6]
        assert ros.position_covariance[8] == sample.vertical_accuracy_m * sample.vertical_accuracy_m
        assert ros.status.status == (0 if sample.fix_type >= 3 else -1)
        assert xyz(velocity.vector) == sample.v_W
        assert quality.horizontal_accuracy_m == sample.horizontal_accuracy_m
        assert (quality.fix_type, quality.satellites) == (sample.fix_type, sample.satellites)


def test_mavlink_frames_and_commands_are_complete(path: Path, flight: list[Tick]) -> None:
    sent = [bytes(ros.data) for _, ros in decoded(path, "/mavlink/to_autopilot")]
    assert b"".join(sent) == b"".join(t.sent for t in flight)
    assert sent == [raw for t in flight for _, raw in split_frames(t.sent)]
    received = decoded(path, "/mavlink/from_autopilot")
    assert [(ros.msgid, bytes(ros.data)) for _, ros in received] == [f for t in flight for f in t.received]
    assert [m.sequence for m, _ in received] == list(range(len(received)))
    for (message, ros), tick in zip(decoded(path, "/actuators"), flight, strict=True):
        assert message.sequence == tick.actuators.tick
        assert tuple(ros.controls) == tick.actuators.controls
        assert (ros.armed, ros.mode) == (tick.actuators.armed, tick.actuators.mode)


def test_foxglove_has_a_moving_frame_and_the_run_is_described(path: Path, flight: list[Tick]) -> None:
    tf = decoded(path, "/tf")
    assert len(tf) == TICKS // 10
    message, ros = tf[3]
    transform = ros.transforms[0]
    assert (transform.header.frame_id, transform.child_frame_id) == ("world", "base_link")
    assert xyz(transform.transform.translation) == flight[message.sequence].truth.p_WB
    log = decoded(path, "/events")
    assert [(r.level, r.name, r.msg) for _, r in log] == [
        (20, "phase", "boot \N{GREEK SMALL LETTER MU}"),
        (40, "error", "the end"),
    ]
    with open(path, "rb") as file:
        reader = make_reader(file)
        assert [a.data for a in reader.iter_attachments()] == [b"seed: 1\n"]
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
    assert metadata["hil_run"] == {"tick_ns": str(TICK_NS), "seed": "1"}
    assert metadata["hil_result"]["status"] == "PASS"


def test_indexed_and_streaming_readers_agree_and_the_summary_counts(path: Path) -> None:
    def rows(messages):
        return sorted((c.topic, m.log_time, m.sequence, m.data) for _, c, m in messages)

    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        indexed = list(reader.iter_messages())
        file.seek(0)
        streamed = list(NonSeekingReader(file, validate_crcs=True).iter_messages())
    assert rows(indexed) == rows(streamed)
    times = [m.log_time for _, _, m in indexed]
    assert times == sorted(times)
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(indexed)
    assert summary.statistics.chunk_count == len(summary.chunk_indexes) == 3
    assert all(c.uncompressed_size < 2**20 for c in summary.chunk_indexes)
    with open(path, "rb") as file:
        assert len(list(StreamReader(file, validate_crcs=True).records)) > len(indexed)
    own = [(m.topic, m.log_time_ns, m.sequence, m.data) for m in read_messages(path)]
    assert sorted(own) == rows(indexed)


def test_own_decoder_agrees_with_the_ros_one(path: Path) -> None:
    with open(path, "rb") as file:
        oracle = {
            (c.topic, m.log_time, m.sequence): ros
            for _, c, m, ros in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        }
    checked = set()
    for message in read_messages(path):
        ros = oracle.get((message.topic, message.log_time_ns, message.sequence))
        if ros is None:
            continue
        for name, value in message.decode().items():
            expected = ros
            for part in name.split("."):
                part, _, index = part.partition("[")
                expected = getattr(expected, part)
                if index:
                    expected = expected[int(index[:-1])]
            assert value == (bytes(expected) if isinstance(value, bytes) else expected), (message.topic, name)
        checked.add(message.topic)
    assert len(checked) == 21


def test_any_truncation_leaves_a_readable_prefix(path: Path, tmp_path: Path) -> None:
    whole = path.read_bytes()
    everything = list(read_messages(path))
    cut = tmp_path / "cut.mcap"
    counts = []
    cuts = random.Random(3).sample(range(8, len(whole)), 40)
    for size in [*sorted(cuts), len(whole) - 1000, len(whole) - 9, len(whole) - 1, len(whole)]:
        cut.write_bytes(whole[:size])
        recording = Recording(cut)
        messages = list(recording.messages())
        assert messages == everything[: len(messages)]
        assert recording.complete == (size == len(whole))
        counts.append(len(messages))
    assert counts == sorted(counts)
    assert len(set(counts)) >= 4  # the readable part grows chunk by chunk


def test_damage_and_foreign_files_are_named(path: Path, tmp_path: Path) -> None:
    whole = bytearray(path.read_bytes())
    whole[5000] ^= 0x40  # inside the first chunk
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(whole)
    with pytest.raises(RecordingError, match=r"damaged\.mcap"):
        list(read_messages(damaged))
    foreign = tmp_path / "foreign.mcap"
    foreign.write_bytes(b"hello, world")
    with pytest.raises(RecordingError, match="not an MCAP recording"):
        read_messages(foreign)
    with pytest.raises(RecordingError, match="cannot be read"):
        read_messages(tmp_path / "missing.mcap")


def test_unknown_sample_type_is_named(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, mcap=True, tlog=False, tick_ns=TICK_NS)
    with pytest.raises(RecordingError, match="port sonar: a tuple has no recorded form"):
        recorder.sample("sonar", (1, 2))  # type: ignore[arg-type]


def test_message_index_points_at_the_messages(path: Path) -> None:
    """Foxglove seeks with the index; the Python readers do not, so the test follows it itself."""
    with open(path, "rb") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        followed = 0
        for chunk_index in summary.chunk_indexes:
            file.seek(chunk_index.chunk_start_offset + 9)
            chunk = Chunk.read(ReadDataStream(file))
            assert file.tell() == chunk_index.chunk_start_offset + chunk_index.chunk_length
            data, _ = get_chunk_data_stream(chunk, validate_crc=True)
            plain = data.read(chunk.uncompressed_size)
            for channel, offset in chunk_index.message_index_offsets.items():
                file.seek(offset)
                assert file.read(1)[0] == Opcode.MESSAGE_INDEX
                file.seek(8, 1)
                index = MessageIndex.read(ReadDataStream(file))
                assert index.channel_id == channel
                for log_ns, at in index.records:
                    opcode, _, record_channel, _, record_log_ns, _ = MESSAGE_PREFIX.unpack_from(plain, at)
                    assert (opcode, record_channel, record_log_ns) == (Opcode.MESSAGE, channel, log_ns)
                    assert chunk.message_start_time <= log_ns <= chunk.message_end_time
                    followed += 1
        assert summary.statistics is not None
        assert followed == summary.statistics.message_count


def test_range_and_flow_samples_are_bit_exact(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, mcap=True, tlog=False, tick_ns=TICK_NS)
    half = math.sqrt(0.5)
    recorder.describe("down", FrameDescription("down", (0.1, 0.0, -0.05), (half, 0.0, half, 0.0)))
    ranges, flows = [], []
    for tick in make_flight(20):
        k, t_ns = tick.tick, tick.t_ns
        ranges.append(RangeSample(k, t_ns, t_ns, 0.1 * k + 1e-9, 0.3, 12.0, 0.02, k % 101, (0.6, 0.0, -0.8)))
        flows.append(FlowSample(k, t_ns, t_ns, TICK_NS, (0.01 * k, -0.3), (0.1, 0.2 * k, 1e-12), k, -1.0, 30.0 + k))
        recorder.truth(tick.truth)
        recorder.sample("down", ranges[-1])
        recorder.sample("flow", flows[-1])
    recorder.close("PASS")
    down, flow, warm = (
        [ros for _, ros in decoded(tmp_path / "run.mcap", f"/{t}")] for t in ("down", "flow", "flow/temperature")
    )
    assert [(m.distance_m, m.min_distance_m, m.max_distance_m, m.sigma_m, m.quality) for m in down] == [
        tuple(s[3:8]) for s in ranges
    ]
    assert {(m.axis.x, m.axis.y, m.axis.z) for m in down} == {(0.6, 0.0, -0.8)}
    # The x axis of the frame of a sensor_msgs/Range is its beam: the frame is the sensor's own, placed by /tf_static.
    assert {m.header.frame_id for _, m in decoded(tmp_path / "run.mcap", "/down/range")} == {"down"}
    [(_, tf)] = decoded(tmp_path / "run.mcap", "/tf_static")
    [mount] = tf.transforms
    assert (mount.header.frame_id, mount.child_frame_id) == ("base_link", "down")
    assert (mount.transform.translation.x, mount.transform.translation.z) == (0.1, -0.05)
    assert (mount.transform.rotation.w, mount.transform.rotation.y) == (half, half)
    assert [(m.integration_ns, tuple(m.flow_rad), tuple(m.gyro_rad), m.quality, m.distance_m) for m in flow] == [
        tuple(s[3:8]) for s in flows
    ]
    assert [m.temperature for m in warm] == [s.temperature_degc for s in flows]
    assert down[0].header.frame_id == "base_link"
