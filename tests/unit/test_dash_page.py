"""The page that the dashboard's benchmark has instead of a browser."""

from __future__ import annotations

import json
import struct
import threading

import pytest
from websockets.sync.server import ServerConnection, serve

from hil.bench_suite.dash_page import follow


def update(size: int, frames: int) -> bytes:
    head = json.dumps({"frames": [{"length": size}] * frames}, separators=(",", ":")).encode()
    return struct.pack("<I", len(head)) + head + b'"length":' + bytes(size)


@pytest.mark.parametrize("how", ["says goodbye", "is gone", "refuses"])
def test_it_takes_every_update_and_answers_pings(how: str) -> None:
    """`websockets` is the other side: it checks masks, lengths and the hand-shake."""
    sizes = [0, 3, 200, 70_000, 2_000_000, 5]
    heard: list[str] = []

    def live(page: ServerConnection) -> None:
        heard.append(str(page.recv()))
        if how == "refuses":
            return
        for k, size in enumerate(sizes):
            heard.append(str(page.recv()))
            assert page.ping().wait(10.0)
            page.send("words are nothing to it")
            page.send(update(size, k % 3))
        heard.append(str(page.recv()))
        if how == "is gone":
            page.socket.close()

    with serve(live, "127.0.0.1", 0) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        told = follow(f"127.0.0.1:{server.socket.getsockname()[1]}", ["front/rgb", "x" * 300])
        server.shutdown()
        thread.join()
    assert json.loads(heard[0]) == {"kind": "streams", "streams": ["front/rgb", "x" * 300]}
    if how == "refuses":
        assert told["updates"] == 0
        return
    assert heard[1:] == ['{"kind":"next"}'] * (len(sizes) + 1)
    assert told["updates"] == len(sizes)
    assert told["frames"] == sum(k % 3 for k in range(len(sizes)))
    assert told["bytes"] == sum(len(update(size, k % 3)) for k, size in enumerate(sizes))


def test_a_server_that_is_none_is_no_page() -> None:
    with serve(lambda page: None, "127.0.0.1", 0, process_request=lambda page, _: page.respond(403, "no\n")) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        assert follow(f"127.0.0.1:{server.socket.getsockname()[1]}", [])["updates"] == 0
        server.shutdown()
        thread.join()
