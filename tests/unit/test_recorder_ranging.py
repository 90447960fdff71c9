"""Range and flow samples come out of the recording bit for bit."""

from __future__ import annotations

from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from hil.recorder.recorder import Recorder
from hil.signals.samples import FlowSample, RangeSample
from tests.unit.recorded_flight import TICK_NS, make_flight


def test_range_and_flow_samples_are_bit_exact(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, mcap=True, tlog=False, tick_ns=TICK_NS)
    ranges, flows = [], []
    for tick in make_flight(20):
        k, t_ns = tick.tick, tick.t_ns
        ranges.append(RangeSample(k, t_ns, t_ns, 0.1 * k + 1e-9, 0.3, 12.0, 0.02, k % 101))
        flows.append(FlowSample(k, t_ns, t_ns, TICK_NS, (0.01 * k, -0.3), (0.1, 0.2 * k, 1e-12), k, -1.0, 30.0 + k))
        recorder.truth(tick.truth)
        recorder.sample("down", ranges[-1])
        recorder.sample("flow", flows[-1])
    recorder.close("PASS")
    found: dict[str, list] = {}
    with open(tmp_path / "run.mcap", "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, _, ros in reader.iter_decoded_messages(topics=["/down", "/flow", "/flow/temperature"]):
            found.setdefault(channel.topic, []).append(ros)
    assert [(m.distance_m, m.min_distance_m, m.max_distance_m, m.sigma_m, m.quality) for m in found["/down"]] == [
        tuple(s[3:]) for s in ranges
    ]
    assert [
        (m.integration_ns, tuple(m.flow_rad), tuple(m.gyro_rad), m.quality, m.distance_m) for m in found["/flow"]
    ] == [tuple(s[3:8]) for s in flows]
    assert [m.temperature for m in found["/flow/temperature"]] == [s.temperature_degc for s in flows]
    assert found["/down"][0].header.frame_id == "base_link"
