"""Maps that companions show of themselves, as streams of the page: `companion/NAME/map`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from firmware_bridge.codecs.companion_view import View

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
