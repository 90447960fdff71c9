"""The page that the dashboard's benchmark has instead of a browser."""

from __future__ import annotations

import json
import threading

from websockets.sync.server import ServerConnection, serve

from hil.bench_suite.dash import follow


def test_it_takes_every_update_and_asks_for_the_next_until_the_server_is_gone() -> None:
    heard: list[dict[str, object]] = []

    def live(page: ServerConnection) -> None:
        heard.extend(json.loads(page.recv()) for _ in range(2))
        for size in (0, 200, 2_000_000):
            page.send(bytes(size))
            heard.append(json.loads(page.recv()))

    with serve(live, "127.0.0.1", 0) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        came_s = follow(f"127.0.0.1:{server.socket.getsockname()[1]}", ["front/rgb"])
        server.shutdown()
        thread.join()
    assert heard == [{"kind": "streams", "streams": ["front/rgb"]}, *[{"kind": "next"}] * 4]
    assert len(came_s) == 3
    assert came_s == sorted(came_s)
