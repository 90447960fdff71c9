"""Companion output for the page: maps as streams `companion/NAME/map`, and detection boxes over the run's pictures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from firmware_bridge.codecs.companion_view import View
from hil.run.feed.streams import map_client
from signals.detections import Detections, detection_text


def view_streams(views: Mapping[str, View], wanted: Iterable[str], sent: dict[str, int]) -> dict[str, Any]:
    """Return the newest map of each wanted stream unless it was sent. `sent` (stream -> frame number) is updated."""
    payloads: dict[str, Any] = {}
    for stream in wanted:
        client = map_client(stream)
        view = None if client is None else views.get(client)
        if view is not None and sent.get(stream) != view.frame:
            sent[stream] = view.frame
            payloads[stream] = view_payload(view)
    return payloads


def view_payload(view: View) -> dict[str, Any]:
    """Return a companion's view as a stream payload. `p`, `q`: the pose that the companion estimates."""
    half = 0.5 * view.yaw_rad
    view_fields: dict[str, Any] = {
        "goal": view.goal_W,
        "yaw": view.yaw_rad,
        "plan": np.frombuffer(view.plan_W, "<f4").reshape(-1, 2).tolist(),
        "particles": np.frombuffer(view.particles_W, "<f4").reshape(-1, 2).tolist(),
    }
    cells = b""
    if view.map is not None:
        m = view.map
        view_fields["map"] = {"rows": m.rows, "columns": m.columns, "cell_m": m.cell_m, "origin": m.origin_W}
        cells = m.unpacked()
    q = (float(np.cos(half)), 0.0, 0.0, float(np.sin(half)))
    return {"t_ns": view.t_ns, "p": view.p_W, "q": q, "view": view_fields, "data": cells}


def boxes_of(detected: Mapping[str, Detections], streams: Iterable[str]) -> dict[str, Any]:
    """Return stream -> {t_ns, boxes: [[x0, y0, x1, y1, text], ...]}; corners as fractions of the picture's size."""
    boxes = {}
    for stream in streams:
        newest = detected.get(stream)
        if newest is not None:
            width, height = newest.size_px
            rows = [
                [
                    d.box_px[0] / width,
                    d.box_px[1] / height,
                    d.box_px[2] / width,
                    d.box_px[3] / height,
                    detection_text(d),
                ]
                for d in newest.boxes
            ]
            boxes[stream] = {"t_ns": newest.t_capture_ns, "boxes": rows}
    return boxes
