"""Encodes stream payloads for a browser: pictures as JPEG or PNG, points as floats, records as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hil.run.feed.messages import StreamFrame
from hil.run.feed.payloads import payload_array
from hil.run.report.channel_images import channel_image
from signals.classes import Classes


def encoded_frame(stream: str, payload: Mapping[str, Any], classes: Classes = Classes()) -> StreamFrame:  # noqa: B008 (immutable)
    """Encode a payload of `hil.run.feed.payloads` for the page."""
    head = {"stream": stream, "t_ns": payload["t_ns"], "p": payload["p"], "q": payload["q"]}
    if "points" in payload:
        return StreamFrame(head | {"as": "points"}, bytes(payload["points"]))
    if "view" in payload:
        return StreamFrame(head | {"as": "map", **payload["view"]}, bytes(payload["data"]))
    if "segments" in payload:
        return StreamFrame(head | {"as": "drawings", "texts": payload["texts"]}, bytes(payload["segments"]))
    if "records" in payload:
        return StreamFrame(head | {"as": "records", "records": payload["records"]}, b"")
    array = payload_array(payload)
    kind, data = channel_image(stream.rpartition("/")[2], array, classes)
    return StreamFrame(head | {"as": kind, "shape": list(array.shape)}, data)
