"""Drawings of simPlot*: how long they stay, how many are kept, and a dashboard that shows them."""

from __future__ import annotations

import asyncio
import json
import math
import re
import socket
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.sync.client import connect

from hil.apps.airsim.rpc.arguments import Pose, Quaternion, Vector
from hil.apps.airsim.served_page import ServedPage
from hil.apps.airsim.world.drawings import MOST_SEGMENTS, MOST_TEXTS, SEGMENT, SHORTEST_NS, Drawings, Pen
from hil.apps.airsim.world.ned import NedFrame
from hil.run.feed.live_run import LiveRun
from hil.run.feed.messages import packed
from signals.time import NS_PER_S
from tests.worlds.airsim_process import AirSimProcess
from tests.worlds.airsim_server import Client, pose, served, vector
from tests.worlds.patience import PATIENCE_S

RED = (1.0, 0.0, 0.0, 1.0)


class Clock:
    """Drawings whose time the test moves."""

    def __init__(self) -> None:
        self.now_ns = 0
        self.log: list[str] = []
        self.drawings = Drawings(NedFrame((10.0, 20.0, 30.0)), lambda: self.now_ns, self.log.append)
        self.drawings.kept = True

    def count(self) -> tuple[int, int]:
        segments, texts = self.drawings.present()
        return len(np.frombuffer(segments, SEGMENT)), len(texts)


def pen(duration_s: float = -1.0, *, persistent: bool = False, width: float = 5.0) -> Pen:
    return Pen(RED, width, duration_s, persistent)


def points(n: int) -> list[Vector]:
    return [Vector(float(k), 0.0, -1.0) for k in range(n)]


@pytest.mark.parametrize(
    ("duration_s", "persistent", "stays_ns"),
    [
        (2.0, False, 2 * NS_PER_S),
        (0.01, False, SHORTEST_NS),
        (-1.0, False, SHORTEST_NS),
        (math.nan, False, SHORTEST_NS),
        (math.inf, False, None),
        (1.0, True, None),
    ],
)
def test_a_drawing_stays_for_its_duration_of_simulated_time(
    duration_s: float, persistent: bool, stays_ns: int | None
) -> None:
    clock = Clock()
    clock.now_ns = 5 * NS_PER_S
    clock.drawings.points(points(3), pen(duration_s, persistent=persistent))
    version = clock.drawings.version
    assert clock.count() == (3, 0)
    clock.now_ns += 10**17 if stays_ns is None else stays_ns - 1
    assert clock.count() == (3, 0)
    assert clock.drawings.version == version
    if stays_ns is not None:
        clock.now_ns += 1
        assert clock.count() == (0, 0)
        assert clock.drawings.version > version
    clock.drawings.clear()
    assert clock.count() == (0, 0)


def test_texts_stay_until_they_are_flushed_unless_they_have_a_duration() -> None:
    clock = Clock()
    clock.drawings.strings(["a", "b" * 10_000], points(2), pen())
    clock.drawings.strings(["c"], points(1), pen(1.0))
    clock.now_ns = 3600 * NS_PER_S
    _, texts = clock.drawings.present()
    assert [len(each.text) for each in texts] == [1, 200]
    assert texts[0].p_W == (10.0, 20.0, 31.0)
    clock.drawings.clear()
    assert clock.count() == (0, 0)


def test_the_newest_drawings_are_kept_and_the_log_says_so_once() -> None:
    clock = Clock()
    for _ in range(3):
        clock.drawings.lines(points(MOST_SEGMENTS // 2 + 1), pen(persistent=True), strip=True)
    assert clock.count() == (MOST_SEGMENTS, 0)
    clock.drawings.points(points(100_000), pen(persistent=True))
    segments = np.frombuffer(clock.drawings.present()[0], SEGMENT)
    assert segments["from"][-1, 1] == 20.0 + 99_999.0
    for _ in range(3):
        clock.drawings.strings(["x"] * MOST_TEXTS, points(MOST_TEXTS), pen())
    assert clock.count()[1] == MOST_TEXTS
    assert [line for line in clock.log if "only the newest" in line] == clock.log
    assert len(clock.log) == 1


def test_nothing_is_kept_without_a_page() -> None:
    clock = Clock()
    clock.drawings.kept = False
    clock.drawings.points(points(3), pen(persistent=True))
    clock.drawings.points(points(3), pen(persistent=True))
    assert clock.count() == (0, 0)
    assert clock.drawings.counts == {"points": 2}
    assert len(clock.log) == 1


def test_shapes_stand_where_and_as_wide_as_airsim_draws_them() -> None:
    clock = Clock()
    drawings = clock.drawings
    drawings.points([Vector(1.0, 2.0, 3.0)], pen(width=12.0))
    drawings.lines(points(5), pen(), strip=False)
    drawings.arrows([Vector()], [Vector(2.0, 0.0, 0.0)], 2.0, pen())
    half = math.sqrt(0.5)
    drawings.transforms([Pose(Vector(), Quaternion(half, 0.0, 0.0, half))], 50.0, pen())  # turned to the east
    found = np.frombuffer(drawings.present()[0], SEGMENT)
    assert len(found) == 1 + 2 + 3 + 3
    assert found["from"][0].tolist() == found["to"][0].tolist() == [12.0, 21.0, 27.0]
    assert found["width"][:2].tolist() == pytest.approx([12.0, -0.05])
    assert found["colour"][0].tolist() == [255, 0, 0, 255]
    assert found["to"][3].tolist() == [10.0, 22.0, 30.0]  # the arrow
    assert found["from"][4:6].tolist() == [[10.0, 22.0, 30.0]] * 2  # its head
    ways = found["to"][6:] - found["from"][6:]
    assert ways == pytest.approx(np.array([(0.5, 0.0, 0.0), (0.0, -0.5, 0.0), (0.0, 0.0, 0.5)]), abs=1e-6)
    drawings.clear()
    drawings.points(points(1), Pen((0.2140411,), 1.0, 1.0))
    assert np.frombuffer(drawings.present()[0], SEGMENT)["colour"][0].tolist() == [127, 0, 0, 255]  # linear -> sRGB


def fly(folder: Path, *, dash: bool) -> str:
    """Fly a script that draws, with a page that looks at it or without; return the digest."""
    options = ("--scene", "airfield", "--clock", "calls", *(("--dash", "--dash-port", "0") if dash else ()))
    with AirSimProcess(folder, *options) as server:
        client = Client(server.port)
        client.call("simPlotLineStrip", [vector(0, 0, -2), vector(4, 0, -2)], [0, 1, 0, 1], 5.0, -1.0, True)
        client.call("simPlotStrings", ["here"], [vector(0, 0, -2)], 5.0, [1, 1, 1, 1], -1.0)
        client.call("enableApiControl", True, "")
        client.call("takeoff", 20.0, "")
        client.call("simAddVehicle", "Second", "simpleflight", pose(3.0, 0.0, 0.0), "")
        if dash:
            found = re.search(r"dashboard: http://(\S+)/", server.log())
            assert found is not None, server.log()
            see(found.group(1))
        client.call("simGetImage", "0", 0)
        client.close()
        digest: str = server.finish()["digest"]
    return digest


def test_a_page_sees_what_a_script_draws(tmp_path: Path) -> None:
    fly(tmp_path, dash=True)


@pytest.mark.slow
def test_a_page_changes_no_digest(tmp_path: Path) -> None:
    assert fly(tmp_path / "seen", dash=True) == fly(tmp_path / "unseen", dash=False)


def see(host: str) -> None:
    """Look at the page until it has shown the drawings and a picture of the first camera."""
    streams = {"kind": "streams", "streams": ["drawings", "front_center/rgb", "no camera/rgb", "view/camera/rgb"]}
    with connect(f"ws://{host}/live", open_timeout=PATIENCE_S, max_size=None) as page:
        page.send(json.dumps(streams))
        page.send('{"kind": "wind", "velocity_W_mps": [9, 0, 0]}')
        page.send('{"kind": "stop"}')
        shown: dict[str, tuple[dict[str, Any], bytes]] = {}
        vehicles: set[str] = set()
        while set(shown) != {"drawings", "front_center/rgb"} or "Second" not in vehicles:
            page.send('{"kind": "next"}')
            data = page.recv(PATIENCE_S)
            assert isinstance(data, bytes)
            start = 4 + int.from_bytes(data[:4], "little")
            head = json.loads(data[4:start])
            vehicles |= set(head.get("about", {}).get("vehicles", ()))
            for frame in head["frames"]:
                shown[frame["stream"]] = (frame, data[start : start + frame["length"]])
                start += frame["length"]
    head, data = shown["drawings"]
    (line,) = np.frombuffer(data, SEGMENT)
    assert line["to"].tolist() == pytest.approx((line["from"] + (0.0, 4.0, 0.0)).tolist())
    assert line["colour"].tolist() == [0, 255, 0, 255]
    assert [text for _, text, _ in head["texts"]] == ["here"]
    assert shown["front_center/rgb"][0]["shape"] == [144, 256, 3]


def test_a_defect_of_the_page_ends_the_page_alone(tmp_path: Path) -> None:
    with served() as world:
        ours, theirs = socket.socketpair()
        page = ServedPage(world.simulation, LiveRun(theirs), tmp_path)
        ours.sendall(packed({"kind": "next", "streams": ["SimpleFlight/drawings"]}))
        world.simulation.drawings.present = lambda: 1 / 0  # type: ignore[method-assign, assignment, return-value]
        asyncio.run(asyncio.wait_for(page.run(), PATIENCE_S))
        assert "the page ends: ZeroDivisionError" in world.log[-1]
        assert world.client().call("ping") is True
        ours.close()
