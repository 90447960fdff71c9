"""Views of clients: thinned to the bench's limits, checked by the bench, recorded for replays."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest

from firmware_bridge.codecs.companion import decode_client
from firmware_bridge.codecs.companion_view import MAX_CELL_BYTES, MAX_POINTS, View, view_from_map
from firmware_bridge.codecs.errors import CodecError
from hil.run.companion.view_log import VIEWS_EVERY_NS, ViewLog, read_views
from hil.run.feed.companion_views import view_streams
from hil.run.feed.streams import map_client, map_stream
from hil.run_files import VIEWS_NAME
from tests.worlds.scripted_bench import CLIENT

from hil_companion.errors import CutError  # isort: skip
from hil_companion import view as shown  # isort: skip
from hil_companion.link import protocol  # isort: skip

assert CLIENT.is_dir()  # importing it adds the client's package to sys.path


def sent(**parts: Any) -> View:
    """Encode a view and decode it as the bench does."""
    made = shown.View(**{"p_W": (1.0, 2.0, 3.0), "yaw_rad": 0.5, **parts})
    decoded = decode_client(protocol.message("view", frame=7, t_ns=9_000_000, **made.as_map()))
    assert isinstance(decoded, View)
    return decoded


def test_a_view_comes_through() -> None:
    cells = np.zeros((4, 6), np.uint8)
    cells[1, 2], cells[3, 5] = shown.OCCUPIED, shown.FREE
    view = sent(
        goal_W=(7.0, 8.0),
        plan_W=np.array([[0.0, 1.0], [2.0, 3.0]]),
        particles_W=np.array([[0.25, 0.5]]),
        grid=shown.Grid(cells, (-3.0, -4.0), 0.5),
    )
    assert (view.frame, view.t_ns, view.p_W, view.yaw_rad, view.goal_W) == (7, 9_000_000, (1, 2, 3), 0.5, (7, 8))
    assert np.frombuffer(view.plan_W, "<f4").tolist() == [0, 1, 2, 3]
    assert np.frombuffer(view.particles_W, "<f4").tolist() == [0.25, 0.5]
    assert view.map is not None
    assert (view.map.rows, view.map.columns, view.map.cell_m, view.map.origin_W) == (4, 6, 0.5, (-3, -4))
    assert view.map.unpacked() == cells.tobytes()


def test_a_large_map_is_thinned_and_keeps_its_thinnest_wall() -> None:
    cells = np.full((1000, 700), shown.FREE, np.uint8)
    cells[:, 333] = shown.OCCUPIED
    view = sent(grid=shown.Grid(cells, (0.0, 0.0), 0.2))
    assert view.map is not None
    assert (view.map.rows, view.map.columns, view.map.cell_m) == (250, 175, 0.8)
    small = np.frombuffer(view.map.unpacked(), np.uint8).reshape(250, 175)
    assert (small[:, 333 // 4] == shown.OCCUPIED).all()
    assert (small == shown.OCCUPIED).sum() == 250


def test_the_worst_map_fits_into_a_message() -> None:
    cells = np.random.default_rng(1).integers(0, 4, (256, 256)).astype(np.uint8)
    noise = np.random.default_rng(2).normal(size=(256, 2))
    made = shown.View((0.0, 0.0, 0.0), 0.0, None, noise, noise, shown.Grid(cells, (0.0, 0.0), 0.2))
    packet = protocol.message("view", frame=2**62, t_ns=2**62, **made.as_map())
    assert len(packet) < 48 << 10
    assert isinstance(decode_client(packet), View)


@pytest.mark.parametrize("count", [1, 2, 255, 256, 257, 1000])
def test_points_are_thinned_from_the_first_to_the_last(count: int) -> None:
    plan = np.arange(2.0 * count).reshape(-1, 2)
    got = np.frombuffer(sent(plan_W=plan).plan_W, "<f4").reshape(-1, 2)
    assert len(got) <= MAX_POINTS
    assert got[0].tolist() == plan[0].tolist()
    assert got[-1].tolist() == plan[-1].tolist()


@pytest.mark.parametrize(
    "parts",
    [
        {"p_W": (0.0, 1.0)},
        {"yaw_rad": float("nan")},
        {"plan_W": np.array([[np.inf, 0.0]])},
        {"plan_W": np.zeros((2, 3))},
        {"grid": shown.Grid(np.full((2, 2), 4, np.uint8), (0.0, 0.0), 0.5)},
        {"grid": shown.Grid(np.zeros((2, 2)), (0.0, 0.0), 0.5)},
    ],
)
def test_a_cut_is_told_what_cannot_be_shown(parts: dict[str, Any]) -> None:
    with pytest.raises(CutError):
        sent(**parts)


def _good() -> dict[str, Any]:
    cells = {"rows": 2, "columns": 2, "cell_m": 0.5, "origin_W": [0.0, 0.0], "cells": zlib.compress(bytes(4))}
    whole = {"frame": 1, "t_ns": 2, "p_W": [0.0, 0.0, 0.0], "yaw_rad": 0.0, "goal_W": None}
    return whole | {"plan_W": b"", "particles_W": b"", "map": cells}


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("frame", -1),
        ("t_ns", 1.5),
        ("p_W", [0.0, 0.0]),
        ("p_W", [0.0, 0.0, float("inf")]),
        ("yaw_rad", True),
        ("goal_W", "here"),
        ("plan_W", bytes(7)),
        ("plan_W", bytes(8 * (MAX_POINTS + 1))),
        ("particles_W", np.array([np.nan, 0.0], "<f4").tobytes()),
        ("map", 3),
        ("map.rows", 0),
        ("map.columns", 257),
        ("map.cell_m", 0.0),
        ("map.origin_W", [1.0]),
        ("map.cells", b"no zlib"),
        ("map.cells", zlib.compress(bytes(3))),
        ("map.cells", zlib.compress(bytes(1 << 26))),  # a decompression bomb is not unpacked beyond its fifth byte
        ("map.cells", zlib.compress(bytes(4))[:-2]),
        ("map.cells", zlib.compress(bytes([0, 0, 0, 4]))),
        ("map.cells", bytes(MAX_CELL_BYTES + 1)),
    ],
)
def test_garbage_is_refused_by_name(key: str, value: Any) -> None:
    good = _good()
    assert view_from_map(good).map is not None
    *inside, name = key.split(".")
    (good["map"] if inside else good)[name] = value
    with pytest.raises(CodecError, match=name):
        decode_client(msgpack.packb({"k": "view", **good}))


def test_the_log_keeps_the_newest_and_reads_back_what_was_shown(tmp_path: Path) -> None:
    log = ViewLog(tmp_path)
    log.begin()
    view = view_from_map(_good())
    views = [view._replace(t_ns=k * VIEWS_EVERY_NS // 2, frame=k) for k in range(5)]
    for one in views:
        log.take("explore", one)
    log.close()
    log.close()
    assert log.newest == {"explore": views[4]}
    assert list(read_views(tmp_path / VIEWS_NAME)) == [
        ("explore", views[k]) for k in (0, 2, 4)
    ]  # at most once per period
    log.take("explore", view._replace(t_ns=9 * VIEWS_EVERY_NS))  # after the end of the flight: shown on the page only
    with (tmp_path / VIEWS_NAME).open("a") as file:
        file.write('{"client": "explore", "frame":')  # a run that was killed
    assert len(list(read_views(tmp_path / VIEWS_NAME))) == 3
    log.begin()
    assert list(read_views(tmp_path / VIEWS_NAME)) == []


def test_a_full_disk_ends_the_log_and_nothing_else(tmp_path: Path) -> None:
    log = ViewLog(tmp_path / "no such folder")
    log.take("explore", view_from_map(_good()))
    assert log.newest


def test_a_page_gets_each_map_once() -> None:
    view = view_from_map(_good())
    stream, told = map_stream("my.client"), {}
    assert map_client(stream) == "my.client"
    assert map_client("front/rgb") is None
    made = view_streams({"my.client": view}, [stream, "front/rgb", map_stream("nobody")], told)
    assert made[stream]["data"] == bytes(4)
    assert made[stream]["view"]["map"]["rows"] == 2
    assert view_streams({"my.client": view}, [stream], told) == {}
