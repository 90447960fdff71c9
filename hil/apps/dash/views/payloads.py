"""Stream payloads: samples of a run as small plain values, made only when a page requests them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.apps.dash.streams import CLOUD_PART
from signals.samples import FRAME_SAMPLES, FrameSample, ImageSample, PointCloudSample, RadarSample, Sample

_MAX_WIDTH_PX = 320  # wider pictures are thinned before they leave the run
MAX_POINTS = 6000  # of a sweep


def frame_streams(latest: Mapping[str, Sample], wanted: Iterable[str], sent: dict[str, int]) -> dict[str, Any]:
    """Return the newest payload of each wanted stream that is not in `sent` (stream -> sequence number) yet."""
    made: dict[str, Any] = {}
    for stream in wanted:
        port, _, part = stream.rpartition("/")
        sample = latest.get(port)
        if not isinstance(sample, FRAME_SAMPLES) or sent.get(stream) == sample.seq:
            continue
        payload = _payload(sample, part)
        if payload is not None:
            sent[stream] = sample.seq
            made[stream] = {"t_ns": sample.t_capture_ns, "p": sample[3], "q": sample[4], **payload}
    return made


def _payload(sample: FrameSample, part: str) -> dict[str, Any] | None:
    if isinstance(sample, PointCloudSample):
        if part != CLOUD_PART:
            return None
        step = -(-len(sample.points_L) // MAX_POINTS) or 1
        return {"points": sample.points_L[::step].tobytes()}
    picture = sample.channels.get(part)
    if picture is None:
        return None
    if picture.dtype.names is not None:
        return {"records": records(picture)}
    if isinstance(sample, RadarSample):
        return array_payload(picture)
    return array_payload(thinned(picture))


def thinned(picture: NDArray[Any]) -> NDArray[Any]:
    """Return the picture at most 320 pixels wide, with rows and columns left out evenly."""
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


def shown_parts(sample_type: type, parts: Iterable[str]) -> list[str]:
    """Return the parts of a sensor with this sample type that a page can show."""
    if sample_type is PointCloudSample:
        return [CLOUD_PART]
    if sample_type in (ImageSample, RadarSample):
        return [part for part in parts if part != "raw"]
    return []
