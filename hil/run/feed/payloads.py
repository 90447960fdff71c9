"""Stream payloads: samples of a run as small messages for a page, made only on request."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.run.feed.streams import CLOUD_CHANNEL
from signals.samples import FRAME_SAMPLES, FrameSample, ImageSample, PointCloudSample, RadarSample, Sample

_MAX_WIDTH_PX = 320  # wider pictures are thinned before they leave the run
MAX_POINTS = 6000  # of a sweep


def frame_streams(latest: Mapping[str, Sample], wanted: Iterable[str], sent: dict[str, int]) -> dict[str, Any]:
    """Return the newest payload of each wanted stream unless it was sent. `sent` (stream -> seq) is updated."""
    payloads: dict[str, Any] = {}
    for stream in wanted:
        port, _, channel = stream.rpartition("/")
        sample = latest.get(port)
        if not isinstance(sample, FRAME_SAMPLES) or sent.get(stream) == sample.seq:
            continue
        payload = _payload(sample, channel)
        if payload is not None:
            sent[stream] = sample.seq
            payloads[stream] = {"t_ns": sample.t_capture_ns, "p": sample[3], "q": sample[4], **payload}
    return payloads


def _payload(sample: FrameSample, channel: str) -> dict[str, Any] | None:
    if isinstance(sample, PointCloudSample):
        if channel != CLOUD_CHANNEL:
            return None
        step = -(-len(sample.points_L) // MAX_POINTS) or 1
        return {"points": sample.points_L[::step].tobytes()}
    picture = sample.channels.get(channel)
    if picture is None:
        return None
    if picture.dtype.names is not None:
        return {"records": records(picture)}
    if isinstance(sample, RadarSample):
        return array_payload(picture)
    return array_payload(thinned(picture))


def thinned(picture: NDArray[Any]) -> NDArray[Any]:
    """Return the picture at most 320 pixels wide, with every n-th row and column."""
    step = -(-picture.shape[1] // _MAX_WIDTH_PX)
    return picture[::step, ::step] if step > 1 else picture


def array_payload(picture: NDArray[Any]) -> dict[str, Any]:
    """Return an array as shape, dtype and bytes."""
    return {"shape": list(picture.shape), "dtype": picture.dtype.str, "data": picture.tobytes()}


def payload_array(payload: Mapping[str, Any]) -> NDArray[Any]:
    """Return the array of an `array_payload`."""
    return np.frombuffer(payload["data"], np.dtype(payload["dtype"])).reshape(payload["shape"])


def records(table: NDArray[Any]) -> list[dict[str, Any]]:
    """Return the rows of a table of detections or tracks, at most 200 of them."""
    names = table.dtype.names or ()
    return [{name: row[name].tolist() for name in names} for row in table[:200]]


def scalar_samples(latest: Mapping[str, Sample]) -> dict[str, dict[str, Any]]:
    """Return the newest values of the sensors that measure numbers, by port."""
    return {port: sample._asdict() for port, sample in latest.items() if not isinstance(sample, FRAME_SAMPLES)}


def shown_channels(sample_type: type, channels: Iterable[str]) -> list[str]:
    """Return the channels of a sensor with this sample type that a page can show."""
    if sample_type is PointCloudSample:
        return [CLOUD_CHANNEL]
    if sample_type in (ImageSample, RadarSample):
        return [channel for channel in channels if channel != "raw"]
    return []
