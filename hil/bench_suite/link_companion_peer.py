"""The far end of `hil bench link`'s transfers: a companion's client and a bare socket in one process.

    python -m hil.bench_suite.link_companion_peer ADDRESS HOST:PORT BYTES [KEY BENCH_KEY]

It does what its standard input says, a line at a time: `link N` takes N frames by the link and answers each, `bare N`
takes N times BYTES from the bare socket into one buffer and answers each by 20 bytes, `check N` is `link N` and prints
a line of JSON for each frame: CRC-32 by topic and array. It ends with its input.
"""

from __future__ import annotations

import json
import socket
import sys
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hil.bench_suite.link_companion_frame import AHEAD, ANSWER_BYTES

_LIMIT_S = 20.0


def main(arguments: Sequence[str]) -> None:
    """Until the input ends."""
    from hil_companion.client import Client

    address, place, size = arguments[:3]
    key, bench_key = (Path(arguments[3]), Path(arguments[4])) if len(arguments) > 3 else (None, None)
    client = Client.connect(address, name="peer", credit=AHEAD, key=key, bench_key=bench_key, wait_s=_LIMIT_S)
    host, _, port = place.rpartition(":")
    with client, socket.create_connection((host, int(port)), _LIMIT_S) as bare:
        bare.settimeout(None)
        bare.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        room = memoryview(bytearray(int(size)))
        for line in sys.stdin:
            kind, count = line.split()
            for _ in range(int(count)):
                if kind == "bare":
                    _take_bare(bare, room)
                else:
                    _take(client, check=kind == "check")


def _take(client: Any, *, check: bool) -> None:
    frame = client.receive(_LIMIT_S)
    if frame is None:
        raise SystemExit("no frame came")
    if check:
        sums = {
            f"{sample.topic}.{name}": zlib.crc32(array.tobytes())
            for sample in frame.samples.values()
            for name, array in sample.arrays.items()
        }
        sys.stdout.write(json.dumps(sums) + "\n")
        sys.stdout.flush()
    client.done(frame)


def _take_bare(bare: socket.socket, room: memoryview) -> None:
    at = 0
    while at < len(room):
        got = bare.recv_into(room[at:])
        if got == 0:
            raise SystemExit("the bare socket ended")
        at += got
    bare.sendall(bytes(ANSWER_BYTES))


if __name__ == "__main__":
    main(sys.argv[1:])
