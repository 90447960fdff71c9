"""A page without a browser, as a process of its own: takes every update as fast as it comes.

    python -m hil.bench_suite.dash_page HOST:PORT STREAM...

It writes one line of JSON when the server hangs up: updates, bytes, frames, and seconds from the first to the last.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect


def follow(host: str, streams: Sequence[str]) -> dict[str, float]:
    """Until the server is gone."""
    updates, size, frames, began_s, last_s = 0, 0, 0, 0.0, 0.0
    with connect(f"ws://{host}/live", compression=None, max_size=None) as page:
        page.send(json.dumps({"kind": "streams", "streams": list(streams)}))
        try:
            while True:
                page.send('{"kind":"next"}')
                data = page.recv()
                if not isinstance(data, bytes):
                    continue
                last_s = time.monotonic()
                began_s = began_s or last_s
                updates += 1
                size += len(data)
                frames += data.count(b'"length":', 0, 4 + int.from_bytes(data[:4], "little"))
        except ConnectionClosed:
            pass
    return {"updates": updates, "bytes": size, "frames": frames, "seconds": last_s - began_s}


if __name__ == "__main__":
    sys.stdout.write(json.dumps(follow(sys.argv[1], sys.argv[2:])) + "\n")
