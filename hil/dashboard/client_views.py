"""What companions show: maps of themselves, as streams `companion/NAME/map`, and boxes over the run's pictures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from firmware_bridge.codecs.companion_view import View
from hil.signals.detections import Detections, words_of

_PREFIX, _SUFFIX = "companion/", "/map"


def stream_of(client: str) -> str:
    """The stream of a client's map."""
    return f"{_PREFIX}{client}{_SUFFIX}"


def client_of(stream: str) -> str | None:
    """The client whose map a stream is; None where it is none."""
    if not (stream.startswith(_PREFIX) and stream.endswith(_SUFFIX)):
        return None
    return stream[len(_PREFIX) : -len(_SUFFIX)]


def view_streams(views: Mapping[str, View], wanted: Iterable[str], sent: dict[str, int]) -> dict[str, Any]:
    """The newest map of each wanted stream, but for those that were `sent` already (by frame)."""
    made: dict[str, Any] = {}
    for stream in wanted:
        client = client_of(stream)
        view = None if client is None else views.get(client)
        if view is not None and sent.get(stream) != view.frame:
            sent[stream] = view.frame
            made[stream] = view_body(view)
    return made


def view_body(view: View) -> dict[str, Any]:
    """A view as it goes to the page's server. `p`, `q`: of where the client believes that it is."""
    half = 0.5 * view.yaw_rad
    shown: dict[str, Any] = {
        "goal": view.goal_W,
        "yaw": view.yaw_rad,
        "plan": np.frombuffer(view.plan_W, "<f4").reshape(-1, 2).tolist(),
        "particles": np.frombuffer(view.particles_W, "<f4").reshape(-1, 2).tolist(),
    }
    cells = b""
    if view.map is not None:
        m = view.map
        shown["map"] = {"rows": m.rows, "columns": m.columns, "cell_m": m.cell_m, "origin": m.origin_W}
        cells = m.unpacked()
    q = (float(np.cos(half)), 0.0, 0.0, float(np.sin(half)))
    return {"t_ns": view.t_ns, "p": view.p_W, "q": q, "view": shown, "data": cells}


def boxes_of(detected: Mapping[str, Detections], streams: Iterable[str]) -> dict[str, Any]:
    """Stream -> {t_ns, boxes: [[x0, y0, x1, y1, words], ...]}; places as shares of the picture's width and height."""
    shown = {}
    for stream in streams:
        seen = detected.get(stream)
        if seen is not None:
            width, height = seen.size_px
            rows = [
                [d.box_px[0] / width, d.box_px[1] / height, d.box_px[2] / width, d.box_px[3] / height, words_of(d)]
                for d in seen.boxes
            ]
            shown[stream] = {"t_ns": seen.t_capture_ns, "boxes": rows}
    return shown
