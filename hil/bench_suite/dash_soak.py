"""As many updates as hours bring, through the real server and to real sockets, as fast as they go.

This process is the run's end of the wire: it answers each request for an update with a state that is long in what
grows (trail, events, maps, pictures), so that whatever is kept would show in the server's memory.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hil.bench_suite.dash_server import ServedPages
from hil.dashboard.client_views import stream_of
from hil.dashboard.snapshot import array_body
from hil.dashboard.wire import Unpacker, packed
from hil.signals.errors import HilError

_PANES = ("front/depth", stream_of("explore"), "lidar/points")
_WARM = 0.25  # of the updates: then every bound has been met
_PICTURE_EVERY = 5
_READ = 1 << 16
_WAIT_S = 30.0


@dataclass(frozen=True)
class Soaked:
    """`memory_bytes`: of the server, at points spread over the updates behind the warm-up."""

    updates: int
    seconds: float
    memory_bytes: tuple[int, ...]
    pages: tuple[dict[str, Any], ...]

    @property
    def growth_bytes(self) -> float:
        """Of the last third over the first: single readings jump."""
        third = max(1, len(self.memory_bytes) // 3)
        return float(np.median(self.memory_bytes[-third:]) - np.median(self.memory_bytes[:third]))


def soak(folder: Path, updates: int, say: Callable[[str], None]) -> Soaked:
    """So many updates to two pages, one with three panes. HilError where the server goes away."""
    with ServedPages(folder, [_PANES, ()]) as served:
        wire, unpacker = served.wire, Unpacker()
        wire.settimeout(_WAIT_S)
        wire.sendall(packed({"kind": "begin", "sensors": {}, "home": [0.0, 0.0, 0.0], "path": []}))
        memory: list[int] = []
        made, began_s = 0, time.monotonic()
        marks = {round(updates * (_WARM + (1.0 - _WARM) * k / 30)) for k in range(31)}
        while made < updates:
            try:
                data = wire.recv(_READ)
            except TimeoutError:
                data = b""
            if not data:
                raise HilError(f"the dashboard's server went silent after {made} updates")
            for message in unpacker.feed(data):
                if message.get("kind") != "next":
                    continue
                made += 1
                wire.sendall(packed(_state(made, message.get("streams", ()))))
                if made in marks:
                    memory.append(served.memory_bytes)
                    say(f"soak: {made} of {updates} updates, {memory[-1] / 2**20:.0f} MiB")
        seconds = time.monotonic() - began_s
        return Soaked(made, seconds, tuple(memory), tuple(served.end()))


def _state(k: int, streams: Any) -> dict[str, Any]:
    t_s, angle = 0.05 * k, 1e-3 * k
    place = (20.0 * math.cos(angle), 20.0 * math.sin(angle), 5.0)
    state: dict[str, Any] = {
        "kind": "state",
        "tick": 12 * k,
        "t_ns": round(t_s * 1e9),
        "phase": "flying",
        "reached": k % 7,
        "waypoints": 7,
        "speed": 1.0,
        "p": place,
        "q": (1.0, 0.0, 0.0, 0.0),
        "v": (0.1, 0.2, 0.0),
        "controls": (0.5, 0.5, 0.5, 0.5),
        "trail": [t_s, *place],
        "events": [(round(t_s * 1e9), "status", f"event {k}")],
        "slow": {"links": [{"name": "mock", "steps": k, "lost": 0, "bad": 0, "rtt_p50_us": 1.0, "rtt_p99_us": 2.0}]},
    }
    if k % _PICTURE_EVERY == 0:
        state["frames"] = {stream: _frame(stream, k) for stream in streams}
    return state


def _frame(stream: str, k: int) -> dict[str, Any]:
    head = {"t_ns": k, "p": (0.0, 0.0, 0.0), "q": (1.0, 0.0, 0.0, 0.0)}
    if stream == "front/depth":
        return head | array_body(np.full((48, 64), 1.0 + k % 90, np.float32))
    if stream == "lidar/points":
        return head | {"points": np.full((500, 3), k % 7, np.float32).tobytes()}
    shown: dict[str, Any] = {"goal": None, "yaw": 0.0, "plan": [], "particles": []}
    sizes = {"rows": 64, "columns": 64, "cell_m": 0.5, "origin": (0.0, 0.0)}
    return head | {"view": shown | {"map": sizes}, "data": bytes([k % 4]) * 4096}
