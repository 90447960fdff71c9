"""The hub between a run and its pages: newest only, bounded, and asked for only by whoever looks."""

from __future__ import annotations

import asyncio
import json
import socket
import struct
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hil.dashboard.choices import choices, run_arguments
from hil.dashboard.hub import Hub, Page
from hil.dashboard.past_runs import PastRuns
from hil.dashboard.snapshot import array_body
from hil.dashboard.wire import packed
from hil.signals.errors import RecordingError


def head_of(data: bytes) -> dict[str, Any]:
    (length,) = struct.unpack_from("<I", data)
    assert (4 + length) % 4 == 0
    head: dict[str, Any] = json.loads(data[4 : 4 + length])
    return head


class Collecting:
    """A page that keeps what it got, or only the last of it."""

    def __init__(self) -> None:
        self.got: list[bytes] = []
        self.page = Page(self._take)

    async def _take(self, data: bytes) -> None:
        self.got = [*self.got[-3:], data]


def state(k: int, *, pictures: bool = True) -> dict[str, Any]:
    picture = {"t_ns": k, "p": (0.0, 0.0, 0.0), "q": (1.0, 0.0, 0.0, 0.0)} | array_body(np.zeros((24, 32), np.float32))
    return {
        "kind": "state",
        "tick": k,
        "t_ns": k * 4_000_000,
        "events": [(k, "status", f"event {k}")],
        "slow": {"links": [], "trail": [(0.2 * k, float(k), 0.0, 1.0)] * 1500},
        "frames": {"front/depth": picture} if pictures else {},
        "speed": float("nan"),
    }


def test_a_slow_page_gets_the_newest_and_no_queue() -> None:
    async def scenario() -> None:
        hub, slow = Hub(), Collecting()
        hub.pages.add(slow.page)
        await hub.hear(slow.page, {"kind": "streams", "streams": ["front/depth"]})
        for k in range(500):
            await hub._take(state(k, pictures=k > 490))
        assert slow.got == []  # it has not said that it can take one
        await hub.hear(slow.page, {"kind": "next"})
        (data,) = slow.got
        head = head_of(data)
        assert head["state"]["tick"] == 499
        assert head["state"]["speed"] is None
        assert [frame["stream"] for frame in head["frames"]] == ["front/depth"]
        assert len(head["events"]) == 300
        await hub._take(state(500))
        assert len(slow.got) == 1

    asyncio.run(scenario())


def test_what_changes_slowly_is_told_once_to_each_page() -> None:
    async def scenario() -> None:
        hub, early, late = Hub(), Collecting(), Collecting()
        hub.pages |= {early.page, late.page}
        for k in range(2):
            told = state(k)
            if k:
                del told["slow"]
            await hub._take(told)
            await hub.hear(early.page, {"kind": "next"})
        await hub.hear(late.page, {"kind": "next"})
        first, second = (head_of(data) for data in early.got)
        assert first["slow"]["links"] == []
        assert "slow" not in second
        assert head_of(late.got[-1])["slow"] == first["slow"]

    asyncio.run(scenario())


def test_the_run_is_asked_only_for_what_open_panes_show() -> None:
    async def scenario() -> None:
        hub, page = Hub(), Collecting()
        ours, theirs = socket.socketpair()
        theirs.setblocking(False)
        following = asyncio.create_task(hub.follow(ours))
        await asyncio.sleep(0.05)
        assert nothing(theirs)
        hub.pages.add(page.page)
        await hub.hear(page.page, {"kind": "streams", "streams": ["front/rgb", "view/camera/rgb"]})
        await asyncio.sleep(0.05)
        assert nothing(theirs)
        await hub.hear(page.page, {"kind": "next"})
        await hub.hear(page.page, {"kind": "next"})
        await asyncio.sleep(0.05)
        assert theirs.recv(4096) == packed({"kind": "next", "streams": ["front/rgb"]})
        theirs.close()
        await following
        assert hub.going is False

    asyncio.run(scenario())


def nothing(wire: socket.socket) -> bool:
    try:
        return not wire.recv(1)
    except BlockingIOError:
        return True


def test_one_page_flies_at_a_time_and_a_page_that_leaves_lets_go() -> None:
    async def scenario() -> None:
        hub, first, second = Hub(), Collecting().page, Collecting().page
        said: list[dict[str, Any]] = []
        hub._to_run = said.append  # type: ignore[method-assign]
        held = {"kind": "sticks", "held": True, "axes": [0, 0, 0, 0]}
        await hub.hear(first, held)
        await hub.hear(second, held)
        assert said == [held]
        await hub.leave(first)
        assert said[-1]["held"] is False
        await hub.hear(second, held)
        assert said[-1] is held

    asyncio.run(scenario())


def test_eight_hours_of_updates_leave_nothing_behind() -> None:
    """As many updates as matter to memory: every bound is met many times over."""

    async def scenario() -> None:
        hub, page = Hub(), Collecting()
        hub.pages.add(page.page)
        await hub.hear(page.page, {"kind": "streams", "streams": ["front/depth"]})

        async def hammered(count: int) -> int:
            for k in range(count):
                await hub._take(state(k))
                await hub.hear(page.page, {"kind": "next"})
            return tracemalloc.get_traced_memory()[0]

        await hammered(320)
        tracemalloc.start()
        begun = await hammered(50)
        ended = await hammered(400)
        tracemalloc.stop()
        # Every update kept would be 400 pictures and more.
        assert ended - begun < 400_000
        assert len(page.got) <= 4

    asyncio.run(scenario())


@pytest.mark.parametrize(
    "form",
    [
        {"rig": "--help"},
        {"bench": "/etc/passwd"},
        {"mission": "../../x.plan"},
        {"scene": ["city_park"]},
        {"seed": -1},
        {"seed": 1.5},
        {"seed": True},
        {"pace": float("inf")},
        {"pace": True},
        {"pace": "1; rm"},
    ],
)
def test_a_page_starts_only_what_is_on_the_lists(form: dict[str, Any]) -> None:
    with pytest.raises(ValueError):  # noqa: PT011 (whatever it says)
        run_arguments(form, None)


def test_a_form_becomes_the_arguments_of_hil_run() -> None:
    lists = choices(None)
    mission = next(path for path in lists["mission"] if path.endswith("rectangle.plan"))
    form = {
        "kind": "start",
        "rig": "mock",
        "scene": "city_park",
        "mission": mission,
        "seed": 7,
        "pace": 2,
        "paused": True,
    }
    assert run_arguments(form, None) == [
        "--rig=mock",
        "--scene=city_park",
        f"--mission={mission}",
        "--seed=7",
        "--dash-pace=2",
        "--dash-paused",
    ]


def test_past_runs_give_out_nothing_else(tmp_path: Path) -> None:
    run = tmp_path / "runs" / "one"
    run.mkdir(parents=True)
    (run / "run.json").write_text('{"status": "PASS", "digest": "ab"}')
    (run / "report.html").write_text("<p>report</p>")
    (tmp_path / "secret.json").write_text("{}")
    (run / "link.json").symlink_to(tmp_path / "secret.json")
    (tmp_path / "runs" / "latest").symlink_to(run)
    (tmp_path / "runs" / "broken").mkdir()
    (tmp_path / "runs" / "broken" / "run.json").write_text("{")
    past = PastRuns(tmp_path / "runs")
    assert [found["name"] for found in past.listed()] == ["one"]
    assert past.file("one", "report.html") == run / "report.html"
    for name, path in [("one", "../../secret.json"), ("one", "link.json"), ("..", "secret.json"), ("one", "run.mcap")]:
        assert past.file(name, path) is None
    assert past.folder("latest") is None
    assert past.summary("none") is None
    with pytest.raises(RecordingError, match="nothing was recorded"):
        past.track("one")
    assert PastRuns(tmp_path / "nowhere").listed() == []
