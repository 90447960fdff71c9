"""The hub between a run and its pages: newest values only, bounded storage, requests only for open panes."""

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

from hil.apps.dash.past.past_runs import PastRuns
from hil.apps.dash.server.choices import choices, run_arguments
from hil.apps.dash.server.hub import Hub, Page
from hil.config import load_bench
from hil.config.files import dashboard_bench
from hil.run.feed.messages import packed
from hil.run.feed.payloads import array_payload
from signals.errors import RecordingError
from tests.worlds.patience import PATIENCE_S


def head_of(data: bytes) -> dict[str, Any]:
    (length,) = struct.unpack_from("<I", data)
    assert (4 + length) % 4 == 0
    head: dict[str, Any] = json.loads(data[4 : 4 + length])
    return head


class Collecting:
    """A page that keeps the last four updates."""

    def __init__(self) -> None:
        self.got: list[bytes] = []
        self.page = Page(self._take)

    async def _take(self, data: bytes) -> None:
        self.got = [*self.got[-3:], data]


async def request_update(hub: Hub, page: Page) -> None:
    hub.receive(page, {"kind": "next"})
    while page.sender is not None:
        await asyncio.sleep(0)


def state(k: int, *, pictures: bool = True, trail: int = 1500) -> dict[str, Any]:
    picture = {"t_ns": k, "p": (0.0, 0.0, 0.0), "q": (1.0, 0.0, 0.0, 0.0)} | array_payload(
        np.zeros((24, 32), np.float32)
    )
    return {
        "kind": "state",
        "tick": k,
        "t_ns": k * 4_000_000,
        "events": [(k, "status", f"event {k}")],
        "slow": {"links": [], "trail": [(0.2 * k, float(k), 0.0, 1.0)] * trail},
        "frames": {"front/depth": picture} if pictures else {},
        "speed": float("nan"),
    }


async def connected(hub: Hub) -> None:
    """Wait until a hub that has begun to follow a run can send to it."""
    while not hub.running:
        await asyncio.sleep(0)


def test_a_slow_page_gets_the_newest_and_no_queue() -> None:
    async def scenario() -> None:
        hub, slow = Hub(), Collecting()
        hub.pages.add(slow.page)
        hub.receive(slow.page, {"kind": "streams", "streams": ["front/depth"]})
        for k in range(500):
            await hub._handle(state(k, pictures=k > 490))
        assert slow.got == []  # it has not requested an update
        await request_update(hub, slow.page)
        (data,) = slow.got
        head = head_of(data)
        assert head["state"]["tick"] == 499
        assert head["state"]["speed"] is None
        assert [frame["stream"] for frame in head["frames"]] == ["front/depth"]
        assert len(head["events"]) == 300
        await hub._handle(state(500))
        assert len(slow.got) == 1

    asyncio.run(scenario())


def test_slowly_changing_values_are_sent_once_to_each_page() -> None:
    async def scenario() -> None:
        hub, early, late = Hub(), Collecting(), Collecting()
        hub.pages |= {early.page, late.page}
        for k in range(2):
            told = state(k)
            if k:
                del told["slow"]
            await hub._handle(told)
            await request_update(hub, early.page)
        await request_update(hub, late.page)
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
        await connected(hub)
        assert nothing(theirs)
        hub.pages.add(page.page)
        hub.receive(page.page, {"kind": "streams", "streams": ["front/rgb", "view/camera/rgb"]})
        await asyncio.sleep(0.05)
        assert nothing(theirs)
        await request_update(hub, page.page)
        await request_update(hub, page.page)
        await asyncio.sleep(0.05)
        assert theirs.recv(4096) == packed({"kind": "next", "streams": ["front/rgb"]})
        theirs.close()
        await following
        assert hub.running is False

    asyncio.run(scenario())


def test_a_page_that_never_reads_delays_no_other_page_and_is_disconnected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil.apps.dash.server.hub._SEND_LIMIT_S", 0.05)

    async def scenario() -> None:
        async def never(_data: bytes) -> None:
            await asyncio.Event().wait()

        hub, deaf, page = Hub(), Page(never), Collecting()
        ours, theirs = socket.socketpair()
        theirs.setblocking(False)
        following = asyncio.create_task(hub.follow(ours))
        await connected(hub)
        hub.pages |= {deaf, page.page}
        hub.receive(deaf, {"kind": "next"})
        for k in range(3):
            await hub._handle(state(k))
            await request_update(hub, page.page)
        assert head_of(page.got[-1])["state"]["tick"] == 2
        hub.receive(page.page, {"kind": "stop"})
        await asyncio.wait_for(deaf.lost.wait(), PATIENCE_S)
        assert b"stop" in theirs.recv(4096)
        theirs.close()
        await following

    asyncio.run(scenario())


@pytest.mark.parametrize(
    "message",
    [
        {"kind": "streams", "streams": ["\ud800", "x" * 10_000, "a\nb", 3]},
        {"kind": "inject", "fault": {"sensor": "\ud800"}},
        {"kind": "wind", "velocity_W_mps": [1 << 70, 0, 0]},
    ],
)
def test_messages_that_cannot_be_encoded_do_not_end_the_updates(message: dict[str, Any]) -> None:
    async def scenario() -> None:
        hub, page = Hub(), Collecting()
        ours, theirs = socket.socketpair()
        theirs.setblocking(False)
        following = asyncio.create_task(hub.follow(ours))
        await connected(hub)
        hub.pages.add(page.page)
        hub.receive(page.page, message)
        assert page.page.streams == ()
        await request_update(hub, page.page)
        await asyncio.sleep(0.02)
        assert theirs.recv(4096).endswith(packed({"kind": "next", "streams": []}))
        theirs.close()
        await following

    asyncio.run(scenario())


def test_a_stop_is_passed_on_whatever_else_fills_the_buffer() -> None:
    async def scenario() -> None:
        hub, page = Hub(), Collecting()
        ours, theirs = socket.socketpair()
        following = asyncio.create_task(hub.follow(ours))
        await connected(hub)
        for _ in range(1000):
            hub.receive(page.page, {"kind": "inject", "fault": "x" * 10_000})
        assert hub._run_link is not None
        full = hub._run_link.transport.get_write_buffer_size()
        assert full < 400_000
        hub.receive(page.page, {"kind": "stop"})
        assert hub._run_link.transport.get_write_buffer_size() > full
        theirs.close()
        await following

    asyncio.run(scenario())


def nothing(link: socket.socket) -> bool:
    try:
        return not link.recv(1)
    except BlockingIOError:
        return True


def test_one_page_flies_at_a_time_and_a_closed_page_releases_its_switch() -> None:
    async def scenario() -> None:
        hub, first, second = Hub(), Collecting().page, Collecting().page
        said: list[dict[str, Any]] = []
        hub._send_to_run = said.append  # type: ignore[method-assign]
        held = {"kind": "sticks", "held": True, "axes": [0, 0, 0, 0]}
        hub.receive(first, held)
        hub.receive(second, held)
        assert said == [held]
        hub.remove(first)
        assert said[-1]["held"] is False
        hub.receive(second, held)
        assert said[-1] is held

    asyncio.run(scenario())


def test_many_updates_do_not_grow_the_memory() -> None:
    """Feed enough updates to exceed every bound of the hub many times."""

    async def scenario() -> None:
        hub, page = Hub(), Collecting()
        hub.pages.add(page.page)
        hub.receive(page.page, {"kind": "streams", "streams": ["front/depth"]})

        async def hammered(count: int) -> int:
            for k in range(count):
                await hub._handle(state(k, trail=40))
                await request_update(hub, page.page)
            return tracemalloc.get_traced_memory()[0]

        await hammered(320)
        tracemalloc.start()
        begun = await hammered(50)
        ended = await hammered(400)
        tracemalloc.stop()
        # A hub that kept every update would hold more than 400 pictures.
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
    assert lists is not None
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


def test_the_page_opens_on_the_park_with_camera_lidar_and_radar(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lists: Any = choices(None)  # in the checkout ./hil.yaml is the installation's own
    assert Path(lists["bench"][0]).name == "dashboard.yaml"
    assert any(Path(bench).name == "hil.yaml" for bench in lists["bench"])
    assert lists["defaults"]["scene"] == "city_park"
    bench = load_bench(Path(lists["bench"][0]))
    assert {"camera", "lidar", "radar"} <= {sensor.kind for sensor in bench.config.sensors.values()}
    assert bench.mission is not None
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hil.yaml").write_text("rig: mock\nscene: airfield\n")
    lists = choices(None)
    assert lists["bench"][0] == "hil.yaml"  # the user's own comes first
    assert lists["defaults"]["scene"] == "airfield"


def test_the_form_shows_the_values_of_the_chosen_bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "rigs/benches"
    folder.mkdir(parents=True)
    (folder / "mine.yaml").write_text("scene: village\nseed: 7\npace: 2\n")
    lists = choices(None, bench="rigs/benches/mine.yaml")
    assert lists is not None
    wanted = {"rig": "mock", "scene": "village", "mission": None, "seed": 7, "pace": 2}
    assert lists["defaults"] == wanted  # the rig is the schema's
    assert choices(None, bench="/etc/passwd") is None


def test_panes_show_the_scene_before_the_first_run() -> None:
    async def scenario() -> set[str]:
        streams = ["view/camera/rgb", "view/lidar/points", "view/radar/range_doppler"]
        hub, one = Hub(dashboard_bench), Collecting()
        hub.pages.add(one.page)
        hub.receive(one.page, {"kind": "streams", "streams": streams})
        for _ in range(2400):
            if len(one.page.frames) == len(streams):
                break
            hub.receive(one.page, {"kind": "next"})
            await asyncio.sleep(0.05)
        return set(one.page.frames)

    assert asyncio.run(scenario()) == {"view/camera/rgb", "view/lidar/points", "view/radar/range_doppler"}


def test_past_runs_serve_no_other_files(tmp_path: Path) -> None:
    run = tmp_path / "runs" / "one"
    run.mkdir(parents=True)
    (run / "run.json").write_text('{"status": "PASS", "digest": "ab"}')
    (run / "report.html").write_text("<p>report</p>")
    (tmp_path / "secret.json").write_text("{}")
    (run / "link.json").symlink_to(tmp_path / "secret.json")
    (tmp_path / "runs" / "latest").symlink_to(run)
    (tmp_path / "runs" / "empty").mkdir()
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
