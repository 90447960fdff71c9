"""Pictures in memory that a run and its page's server share, and updates that say only what is new."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import struct
import sys
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hil.dashboard import pictures
from hil.dashboard import shelf as shelf_module
from hil.dashboard.hub import Hub, Page
from hil.dashboard.pictures import shown
from hil.dashboard.shelf import Shelf, ShelfReader
from hil.dashboard.snapshot import array_body
from hil.dashboard.wire import Unpacker, packed
from hil.signals.classes import Classes

linux = pytest.mark.skipif(sys.platform != "linux", reason="there is no such memory")
PLACE = {"t_ns": 5, "p": (0.0, 0.0, 1.0), "q": (1.0, 0.0, 0.0, 0.0)}


def picture(seed: int) -> NDArray[np.float32]:
    return np.random.default_rng(seed).uniform(0.5, 90.0, (24, 32)).astype(np.float32)


@linux
def test_an_update_leaves_the_one_before_it_alone() -> None:
    shelf = Shelf()
    assert shelf.path is not None
    reader = ShelfReader(shelf.path)
    put: list[tuple[NDArray[np.float32], Any]] = []
    for k in range(6):
        shelf.turn()
        put += [(picture(2 * k), shelf.put(picture(2 * k))), (picture(2 * k + 1), shelf.put(picture(2 * k + 1)))]
        for array, place in put[-4:]:
            assert bytes(reader.found(place)) == array.tobytes()
    shelf.turn()
    thinned = picture(0)[::2, ::2]
    assert bytes(reader.found(shelf.put(thinned))) == thinned.tobytes()
    shelf.close()
    assert bytes(reader.found(put[-1][1])) == put[-1][0].tobytes()


@linux
def test_what_has_no_room_goes_over_the_wire(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shelf_module, "_SLOT_BYTES", 4096)
    shelf = Shelf()
    shelf.turn()
    assert isinstance(shelf.put(picture(0)), list)
    assert shelf.put(picture(1)) == picture(1).tobytes()
    shelf.close()
    assert shelf.put(picture(2)) == picture(2).tobytes()


class Watched:
    """A hub with one page, and the run's end of its wire."""

    def __init__(self, path: str | None) -> None:
        self.hub, self.got, self.page = Hub(), list[bytes](), Page(self._take)
        self.page.streams = ("front/depth",)
        self.hub.pages.add(self.page)
        ours, self.wire = socket.socketpair()
        self.wire.setblocking(False)
        self._following = asyncio.create_task(self.hub.follow(ours))
        self._unpacker = Unpacker()
        self.wire.send(packed({"kind": "begin", "shelf": path}))

    async def _take(self, data: bytes) -> None:
        self.got.append(data)

    async def asked(self) -> dict[str, Any]:
        """The request for an update: it comes when the page has all that there is, and waits for more."""
        while True:
            await asyncio.sleep(0.01)
            await self.hub.hear(self.page, {"kind": "next"})
            with contextlib.suppress(BlockingIOError):
                (message,) = self._unpacker.feed(self.wire.recv(4096))
                return message

    async def told(self, state: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        """Head and bodies of the update that comes of a state."""
        count = len(self.got)
        self.wire.send(packed({"kind": "state", "t_ns": 5} | state))
        for _ in range(500):
            await asyncio.sleep(0.01)
            if len(self.got) > count:
                break
        data = self.got[-1]
        (length,) = struct.unpack_from("<I", data)
        return json.loads(data[4 : 4 + length]), data[4 + length :]

    async def end(self) -> None:
        self.wire.close()
        await self._following


@linux
def test_a_page_sees_the_same_picture_either_way() -> None:
    async def scenario() -> None:
        shelf = Shelf()
        expected = shown("front/depth", PLACE | array_body(picture(1)))
        for path, sees in ((shelf.path, True), ("/proc/self/fd/99999", False), (None, False)):
            watched = Watched(path)
            assert (await watched.asked()).get("shelf", False) is sees
            shelf.turn()
            body = PLACE | array_body(picture(1), shelf.put) if sees else PLACE | array_body(picture(1))
            head, data = await watched.told({"frames": {"front/depth": body}})
            assert data == expected.data
            assert head["frames"][0]["shape"] == [24, 32]
            await watched.end()
        shelf.close()

    asyncio.run(scenario())


def test_what_changes_slowly_is_told_once_to_each_page() -> None:
    async def scenario() -> None:
        watched = Watched(None)
        await watched.asked()
        head, _ = await watched.told({"slow": {"battery": [1.0, 2.0, 3.0]}})
        assert head["slow"] == {"battery": [1.0, 2.0, 3.0]}
        await watched.asked()
        head, _ = await watched.told({"tick": 2})
        assert head["state"]["tick"] == 2
        assert "slow" not in head
        late = Page(watched._take)
        watched.hub.pages.add(late)
        await watched.hub.hear(late, {"kind": "next"})
        assert b'"slow":{"battery"' in watched.got[-1]
        await watched.end()

    asyncio.run(scenario())


def test_depth_is_shown_to_a_level_and_nothing_is_grey() -> None:
    """Against the logarithm itself; each distance in a square that is large enough for a JPEG to keep its colour."""
    distances = np.array([0.5, 0.7, 1.5, 4.0, 11.0, 60.0, 199.0, 1000.0, np.inf, np.nan], np.float32)
    levels = pictures._depth_levels()[distances.view(np.uint32) >> 16]
    shares = 1.0 - np.log(np.clip(distances[:8].astype(float), 0.5, 200.0) / 0.5) / np.log(400.0)
    assert np.abs(levels[:8] - (1.0 + 254.0 * shares)).max() <= 0.8
    assert levels[8:].tolist() == [0, 0]
    array = np.repeat(distances[:, None], 16, axis=1).repeat(16, axis=0)
    _, data = pictures.picture("depth", array, Classes())
    bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    viridis = cv2.applyColorMap(levels[:8, None], cv2.COLORMAP_VIRIDIS)[:, 0].astype(int)
    assert np.abs(bgr[8::16, 8][:8].astype(int) - viridis).max() <= 6
    assert np.abs(bgr[8::16, 8][8:].astype(int) - 190).max() <= 2
