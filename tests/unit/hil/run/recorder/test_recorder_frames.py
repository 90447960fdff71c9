"""Pictures and point clouds in a recording: standard ROS 2 messages, bit for bit, readable up to a kill."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.run.recorder.digest import Digest
from hil.run.recorder.frame_description import FrameDescription, Projection
from hil.run.recorder.frame_series import cloud_fields
from hil.run.recorder.reading import read_messages
from hil.run.recorder.recorder import Album, Recorder
from hil.run.replay import compare
from hil.run_files import MCAP_NAME
from signals.samples import CHANNEL_UNITS, ImageSample, RadarSample
from sim.radar.processing.points import POINT_DTYPE
from sim.radar.processing.tracker import TRACK_DTYPE
from tests.worlds.synthetic_flight import POSE, TICK_NS, cloud, decoded, image, make_flight

ENCODINGS = {
    "rgb": "rgb8",
    "depth": "32FC1",
    "range": "32FC1",
    "segmentation": "mono8",
    "instance": "mono16",
    "geom": "32SC1",
    "normal": "32FC3",
    "radial_velocity": "32FC1",
    "material": "mono8",
}
K = (16.0, 0.0, 7.5, 0.0, 16.0, 5.5, 0.0, 0.0, 1.0)
P = (16.0, 0.0, 7.5, 0.0, 0.0, 16.0, 5.5, 0.0, 0.0, 0.0, 1.0, 0.0)
PROJECTION = Projection(16, 12, "plumb_bob", (0.1, 0.2, 0, 0, 0), K, P)
SWEEP_NS = 10_000
CAMERA = FrameDescription("front_optical", (0.1, 0.0, 0.05), (0.5, -0.5, 0.5, -0.5), PROJECTION)


def record(folder: Path, samples: list[tuple[str, Any]], *, close: bool = True, ticks: int = 40) -> Recorder:
    recorder = Recorder(folder, mcap=True, tlog=False, tick_ns=TICK_NS)
    recorder.describe("front", CAMERA)
    recorder.describe("lidar", FrameDescription("lidar", sweep_ns=SWEEP_NS))
    for tick in make_flight(ticks):
        recorder.truth(tick.truth)
        for port, sample in samples:
            if sample.t_available_ns == tick.t_ns:
                recorder.sample(port, sample)
    if close:
        recorder.close("PASS")
    return recorder


def test_pictures_are_standard_messages_and_bit_exact(tmp_path: Path) -> None:
    samples = [image(k, late_ns=3 * TICK_NS) for k in (0, 10, 20)]
    record(tmp_path, [("front", sample) for sample in samples])
    found = decoded(tmp_path / MCAP_NAME)
    for name, encoding in ENCODINGS.items():
        messages = found[f"/front/{name}"]
        assert len(messages) == 3
        for sample, (message, ros) in zip(samples, messages, strict=True):
            assert (message.sequence, message.log_time) == (sample.seq, sample.t_available_ns)
            assert message.publish_time == sample.t_available_ns
            assert ros.header.stamp.sec * 10**9 + ros.header.stamp.nanosec == sample.t_capture_ns
            assert ros.header.frame_id == "front_optical"
            assert (ros.height, ros.width, ros.encoding, ros.is_bigendian) == (12, 16, encoding, 0)
            picture = sample.channels[name]
            assert ros.step == picture.strides[0]
            assert ros.step * ros.height == len(ros.data)
            assert bytes(ros.data) == picture.tobytes()
    for _, info in found["/front/camera_info"]:
        assert (info.height, info.width, info.distortion_model) == (12, 16, "plumb_bob")
        assert list(info.d) == [0.1, 0.2, 0.0, 0.0, 0.0]
        assert (tuple(info.k), tuple(info.p)) == (K, P)
        assert tuple(info.r) == (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
        assert not info.roi.do_rectify
    for _, pose in found["/front/pose"]:
        assert pose.header.frame_id == "world"
        assert (pose.pose.position.x, pose.pose.position.z) == (1.5, 3.0)
        assert (pose.pose.orientation.w, pose.pose.orientation.x) == (0.5, -0.5)
    ((_, static),) = found["/tf_static"]
    (place,) = static.transforms
    assert (place.header.frame_id, place.child_frame_id) == ("base_link", "front_optical")
    assert (place.transform.translation.x, place.transform.translation.z) == (0.1, 0.05)


def test_point_clouds_of_any_size_are_standard_messages_and_bit_exact(tmp_path: Path) -> None:
    samples = [cloud(0, 50), cloud(10, 0), cloud(20, 7)]  # the first began before the run
    record(tmp_path, [("lidar", sample) for sample in samples])
    messages = decoded(tmp_path / MCAP_NAME)["/lidar"]
    assert len(messages) == 3
    for sample, (_, ros) in zip(samples, messages, strict=True):
        assert (ros.height, ros.width, ros.header.frame_id) == (1, len(sample.range_m), "lidar")
        assert ros.is_dense
        assert ros.row_step == ros.point_step * ros.width == len(ros.data)
        formats = {7: "<f4", 6: "<u4", 4: "<u2", 2: "u1"}  # sensor_msgs/PointField
        layout = np.dtype(
            {
                "names": [field.name for field in ros.fields],
                "formats": [formats[field.datatype] for field in ros.fields],
                "offsets": [field.offset for field in ros.fields],
                "itemsize": ros.point_step,
            }
        )
        points = np.frombuffer(bytes(ros.data), layout)
        assert np.array_equal(np.stack([points["x"], points["y"], points["z"]], axis=1), sample.points_L)
        assert np.array_equal(points["range"], sample.range_m)
        assert np.array_equal(points["intensity"], sample.intensity)
        begin_ns = ros.header.stamp.sec * 10**9 + ros.header.stamp.nanosec
        assert begin_ns == max(0, sample.t_capture_ns - SWEEP_NS)
        fired_ns = np.maximum(sample.t_capture_ns + sample.time_offset_ns, 0)
        assert np.array_equal(begin_ns + points["t"].astype(np.int64), fired_ns)
        assert points["time"] == pytest.approx(points["t"] * 1e-9, rel=1e-6)
        assert np.array_equal(points["ring"], sample.ring)
        assert np.array_equal(points["label"], sample.segmentation)


def test_points_of_a_radar_have_the_names_of_ros_drivers_too() -> None:
    fields = {field.name: field for field in cloud_fields(POINT_DTYPE)}
    assert list(fields)[:3] == ["x", "y", "z"]
    for common, own in (("doppler", "speed_mps"), ("intensity", "snr_db")):
        assert fields[common].offset == fields[own].offset
        assert fields[common].datatype == 7  # float32
    assert "doppler" not in {field.name for field in cloud_fields(TRACK_DTYPE)}


def test_a_killed_run_leaves_its_pictures_up_to_the_last_flush(tmp_path: Path) -> None:
    samples = [("front", image(k)) for k in range(0, 600, 50)]
    record(tmp_path, samples, close=False, ticks=600)
    topics = [message.topic for message in read_messages(tmp_path / MCAP_NAME)]
    assert topics.count("/front/rgb") == topics.count("/front/depth") == 10  # all of the first two seconds
    whole = (tmp_path / MCAP_NAME).read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) * 3 // 4])
    assert sum(m.topic == "/front/rgb" for m in read_messages(tmp_path / "cut.mcap")) == 5


def test_large_pictures_do_not_pile_up_in_memory(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, mcap=True, tlog=False, tick_ns=TICK_NS)
    large = np.zeros((2048, 2048, 3), np.uint8)  # 12.6 MB
    for tick in make_flight(6):
        recorder.truth(tick.truth)
        sample = ImageSample(tick.tick, tick.t_ns, tick.t_ns, *POSE, {"rgb": large})
        recorder.sample("front", sample)
        assert recorder._mcap is not None
        assert recorder._mcap.pending_bytes <= 2 * large.nbytes
    assert sum(m.topic == "/front/rgb" for m in read_messages(tmp_path / MCAP_NAME)) >= 3


def test_the_first_difference_of_two_runs_names_the_pixel(tmp_path: Path) -> None:
    record(tmp_path / "a", [("front", image(10))])
    record(tmp_path / "b", [("front", image(10))])
    assert compare(tmp_path / "a" / MCAP_NAME, tmp_path / "b" / MCAP_NAME) is None
    other = image(10)
    other.channels["segmentation"][3, 4] += 1
    record(tmp_path / "c", [("front", other)])
    difference = compare(tmp_path / "a" / MCAP_NAME, tmp_path / "c" / MCAP_NAME)
    assert difference is not None
    assert (difference.tick, difference.port, difference.field) == (10, "/front/segmentation", f"data[{3 * 16 + 4}]")
    assert difference.fresh == difference.recorded + 1


def digest(port: str, sample: Any) -> str:
    d = Digest()
    d.frame(port, sample)
    return d.hexdigest()


def test_the_digest_covers_every_byte_and_the_stamps() -> None:
    reference = image(10)
    base = digest("front", reference)
    assert base == digest("front", image(10))
    others = [digest("rear", reference), digest("front", reference._replace(t_available_ns=1))]
    others.append(digest("front", reference._replace(p_WC=(1.5, -2.0, 3.1))))
    for name in CHANNEL_UNITS:
        changed = image(10)
        changed.channels[name].reshape(-1)[-1] += 1
        others.append(digest("front", changed))
    others.append(digest("front", image(10, channels=("rgb",))))
    assert len({base, *others}) == len(others) + 1
    # The order of the channels does not matter; a transposed picture is a different one.
    turned = reference._replace(channels=dict(reversed(reference.channels.items())))
    assert digest("front", turned) == base
    flat = image(10, channels=("depth",))
    assert digest("front", flat) != digest("front", flat._replace(channels={"depth": flat.channels["depth"].T}))
    assert digest("lidar", cloud(1, 5)) != digest("lidar", cloud(1, 6))


def test_the_album_shows_the_middle_of_the_flight() -> None:
    for last in (0, 1, 2, 7, 100, 1000, 1023):
        album = Album()
        for k in range(last + 1):
            album.add("front", image(k, channels=("material",)))
        (sample,) = album.shown().values()
        assert last / 3 - 1 <= sample.seq <= 2 * last / 3 + 1
        assert len(album._candidates["front"]) <= 3


def test_the_album_shows_a_radar_at_its_fullest() -> None:
    def radar(seq: int, points: int, tracks: int) -> RadarSample:
        channels = {"points": np.zeros(points), "tracks": np.zeros(tracks)}
        return RadarSample(seq, seq * TICK_NS, seq * TICK_NS, *POSE, channels)

    for found, expected in (
        ([(0, 0), (3, 0), (5, 0), (5, 1), (5, 1), (0, 3), (0, 0), (0, 0)], 3),
        ([(0, 0)] * 6 + [(1, 0), (0, 0)], 6),
        ([(0, 0)] * 8, 4),  # all empty: the middle
    ):
        album = Album()
        for k, (points, tracks) in enumerate(found):
            album.add("radar/points", radar(k, points, tracks))
            album.add("front", image(k, channels=("material",)))
        shown = album.shown()
        assert list(shown) == ["front", "radar/points"]
        assert shown["radar/points"].seq == expected
        assert shown["front"].seq == 4
    silent = Album()
    for k in range(8):
        silent.add("radar", RadarSample(k, 0, 0, *POSE, {"raw": np.zeros((1, 2, 8), np.uint16)}))
    assert silent.shown()["radar"].seq == 4


def test_frames_compare_by_their_bytes() -> None:
    assert image(3) == image(3)
    assert image(3) != image(4)
    assert image(3) != image(3)._replace(seq=4)
    assert image(3, channels=("rgb",)) != image(3)
    nan = image(3, channels=("depth",))
    nan.channels["depth"][1, 1] = np.nan
    assert nan == nan._replace(channels={"depth": nan.channels["depth"].copy()})
    assert cloud(1, 4) == cloud(1, 4)
    assert cloud(1, 4) != cloud(2, 4)
    assert cloud(1, 4) != image(3)
    with pytest.raises(TypeError):
        hash(image(3))
