"""What a page is told of a run: plain values, small, made only when somebody has asked for them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_bridge.links.autopilot_link import AutopilotLink
from hil.signals.samples import FRAME_SAMPLES, FrameSample, ImageSample, PointCloudSample, RadarSample, Sample

_WIDEST = 320  # pixels across; what is wider is thinned before it leaves the run
MOST_POINTS = 6000  # of a sweep
CLOUD_PART = "points"  # the one stream of a LiDAR


def frame_streams(latest: Mapping[str, Sample], wanted: Iterable[str], sent: dict[str, int]) -> dict[str, Any]:
    """The newest frame of each wanted stream, but for those that were `sent` already (by sequence number)."""
    made: dict[str, Any] = {}
    for stream in wanted:
        port, _, part = stream.rpartition("/")
        sample = latest.get(port)
        if not isinstance(sample, FRAME_SAMPLES) or sent.get(stream) == sample.seq:
            continue
        body = _body(sample, part)
        if body is not None:
            sent[stream] = sample.seq
            made[stream] = {"t_ns": sample.t_capture_ns, "p": sample[3], "q": sample[4], **body}
    return made


def _body(sample: FrameSample, part: str) -> dict[str, Any] | None:
    if isinstance(sample, PointCloudSample):
        if part != CLOUD_PART:
            return None
        step = -(-len(sample.points_L) // MOST_POINTS) or 1
        return {"points": sample.points_L[::step].tobytes()}
    picture = sample.channels.get(part)
    if picture is None:
        return None
    if picture.dtype.names is not None:
        return {"records": records(picture)}
    if isinstance(sample, RadarSample):
        return array_body(picture)
    return array_body(thinned(picture))


def thinned(picture: NDArray[Any]) -> NDArray[Any]:
    """At most 320 pixels across, by leaving rows and columns out."""
    step = -(-picture.shape[1] // _WIDEST)
    return picture[::step, ::step] if step > 1 else picture


def array_body(picture: NDArray[Any]) -> dict[str, Any]:
    """An array on the wire."""
    return {"shape": list(picture.shape), "dtype": picture.dtype.str, "data": picture.tobytes()}


def array_of(body: Mapping[str, Any]) -> NDArray[Any]:
    """The array again."""
    return np.frombuffer(body["data"], np.dtype(body["dtype"])).reshape(body["shape"])


def records(table: NDArray[Any]) -> list[dict[str, Any]]:
    """Detections or tracks, at most 200 of them."""
    names = table.dtype.names or ()
    return [{name: row[name].tolist() for name in names} for row in table[:200]]


def scalar_samples(latest: Mapping[str, Sample]) -> dict[str, dict[str, Any]]:
    """The newest values of sensors that give numbers."""
    return {port: sample._asdict() for port, sample in latest.items() if not isinstance(sample, FRAME_SAMPLES)}


def autopilot_health(link: AutopilotLink) -> dict[str, Any]:
    """How the wire to the autopilot does."""
    stats, caps = link.stats, link.caps
    return {
        "name": caps.kind,
        "lockstep": caps.lockstep,
        "steps": stats.steps,
        "late": stats.late,
        "lost": stats.lost_frames,
        "bad": stats.bad_crc,
        "rtt_p50_us": stats.rtt.quantile_ns(0.5) / 1000,
        "rtt_p99_us": stats.rtt.quantile_ns(0.99) / 1000,
        "tx_bytes": stats.tx_bytes,
        "rx_bytes": stats.rx_bytes,
    }


def channels_of(sample_type: type, parts: Iterable[str]) -> list[str]:
    """Parts that a page can show, of a sensor of this sample type."""
    if sample_type is PointCloudSample:
        return [CLOUD_PART]
    if sample_type in (ImageSample, RadarSample):
        return [part for part in parts if part != "raw"]
    return []
