"""Points and tracks of a radar as radar_msgs, read by a decoder that is not this project's."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from hil.run.recorder.frame_description import FrameDescription
from hil.run.recorder.recorder import Recorder
from hil.run_files import MCAP_NAME
from signals.samples import RadarSample
from sim.radar.processing.points import POINT_DTYPE
from sim.radar.processing.tracker import TRACK_DTYPE
from tests.worlds.synthetic_flight import POSE, TICK_NS, decoded, make_flight


@pytest.mark.parametrize("frame_id", ["radar", "radar_R", "front_radar"])  # the elements begin at other offsets
def test_points_and_tracks_are_radar_msgs(tmp_path: Path, frame_id: str) -> None:
    points, tracks = np.zeros(3, POINT_DTYPE), np.zeros(4, TRACK_DTYPE)
    for i, name in enumerate(("range_m", "azimuth_rad", "elevation_rad", "speed_mps", "snr_db")):
        points[name] = [i + 0.25, -i, 10.0 * i]
    tracks["id"] = [1, 258, 3, 65535]
    tracks["p_R_m"], tracks["v_R_mps"] = np.arange(12).reshape(4, 3), -np.arange(12).reshape(4, 3)
    tracks["range_m"], tracks["azimuth_rad"] = 2.0, math.pi / 2  # along y
    tracks["range_std_m"], tracks["azimuth_std_rad"], tracks["elevation_std_rad"] = 0.1, 0.25, 0.5
    tracks["speed_std_mps"] = 0.3
    recorder = Recorder(tmp_path, mcap=True, tlog=False, tick_ns=TICK_NS)
    recorder.describe("radar", FrameDescription(frame_id))
    outputs = [{"points": points, "tracks": tracks}, {"points": points[:0], "tracks": tracks[:0]}]
    for tick in make_flight(len(outputs)):
        recorder.truth(tick.truth)
        recorder.sample("radar", RadarSample(tick.tick, tick.t_ns, tick.t_ns, *POSE, outputs[tick.tick]))
    recorder.close("PASS")

    found = decoded(tmp_path / MCAP_NAME)
    (_, scan), (_, no_scan) = found["/radar/radar_scan"]
    assert (scan.header.frame_id, no_scan.returns) == (frame_id, [])
    rows = [[x.range, x.azimuth, x.elevation, x.doppler_velocity, x.amplitude] for x in scan.returns]
    assert rows == [[0.25, 1.25, 2.25, 3.25, 4.25], [0.0, -1.0, -2.0, -3.0, -4.0], [0.0, 10.0, 20.0, 30.0, 40.0]]
    (_, of_objects), (_, none) = found["/radar/radar_tracks"]
    assert none.tracks == []
    for track, record in zip(of_objects.tracks, tracks, strict=True):
        assert int.from_bytes(bytes(track.uuid.uuid), "big") == record["id"]
        assert [track.position.x, track.position.y, track.position.z] == list(record["p_R_m"])
        assert [track.velocity.x, track.velocity.y, track.velocity.z] == list(record["v_R_mps"])
        assert (track.classification, track.size.x, track.acceleration.z) == (0, 0.0, 0.0)
        assert list(track.position_covariance) == pytest.approx([0.25, 0.0, 0.0, 0.01, 0.0, 1.0], abs=1e-6)
        assert list(track.velocity_covariance) == pytest.approx([0.0, 0.0, 0.0, 0.09, 0.0, 0.0], abs=1e-6)
        assert not any([*track.acceleration_covariance, *track.size_covariance])
