"""The part `dca1000`: what it sends for a radar's frames, when, and to whom."""

from __future__ import annotations

import socket
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from firmware_bridge.codecs.dca1000 import MAX_SAMPLES_BYTES
from hil.run.parts.dca1000 import Dca1000Part, Settings, make
from signals.errors import ConfigError
from signals.samples import RadarSample
from sim.radar.dca1000 import frame_words
from tests.worlds.radar_presets import preset

P = preset("iwr6843isk")
RAW = np.random.default_rng(1).integers(0, 65536, P.raw_shape).astype(np.uint16)
SAMPLE = RadarSample(0, 0, 0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), {"raw": RAW})
START, STOP = bytes.fromhex("5aa505000000aaee"), bytes.fromhex("5aa506000000aaee")


def receiver() -> socket.socket:
    found = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
    found.bind(("127.0.0.1", 0))
    found.settimeout(2.0)
    return found


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def part_to(data: socket.socket, **changes: Any) -> tuple[Dca1000Part, int]:
    port = free_port()
    settings = Settings.model_validate(
        {
            "sensor": "radar",
            "board_host": "127.0.0.1",
            "data_port": data.getsockname()[1],
            "command_port": port,
            "packet_delay_s": 0.0,
        }
        | changes
    )
    part = Dca1000Part(settings, P)
    part.open(SimpleNamespace(say=lambda *_: pytest.fail("loopback needs no warning")))  # type: ignore[arg-type]
    return part, port


def step(part: Dca1000Part, *released: tuple[str, Any]) -> None:
    part.step(None, released)  # type: ignore[arg-type]


def test_a_frame_is_sent_in_packets() -> None:
    with receiver() as data:
        part, _ = part_to(data)
        step(part, ("imu", object()), ("radar", SAMPLE))
        assert P.board is not None
        samples = frame_words(RAW, P.chirp, P.board, 16).tobytes()
        count = len(samples) // MAX_SAMPLES_BYTES
        got = b"".join(data.recv(2048)[10:] for _ in range(count))
        assert got == samples[: count * MAX_SAMPLES_BYTES]
        assert part.run_keys() == {"dca1000": {"frames": 1, "packets": count}}
        assert part.watched_ports() == {"radar/raw"}
        part.close()


def test_on_command_nothing_is_sent_before_the_start_or_after_the_stop() -> None:
    with receiver() as data, receiver() as program:
        part, port = part_to(data, on_command=True)
        step(part, ("radar", SAMPLE))
        program.sendto(START, ("127.0.0.1", port))
        step(part, ("radar", SAMPLE))
        assert program.recv(64) == bytes.fromhex("5aa505000000aaee")
        assert data.recv(2048)[:4] == b"\x01\x00\x00\x00"
        program.sendto(b"nonsense", ("127.0.0.1", port))
        program.sendto(STOP, ("127.0.0.1", port))
        part.serve(0.0)
        assert program.recv(64) == bytes.fromhex("5aa506000000aaee")
        step(part, ("radar", SAMPLE))
        assert part.run_keys()["dca1000"]["frames"] == 1
        part.close()


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        (None, "names no radar of this bench: 'radar'"),
        (preset("bgt60tr13c"), "no `board` section"),
        (P.model_copy(update={"outputs": ("points",)}), "no output `raw`"),
    ],
)
def test_refusals(parameters: Any, words: str) -> None:
    sensors = {} if parameters is None else {"radar": SimpleNamespace(parameters=parameters)}
    bench: Any = SimpleNamespace(config=SimpleNamespace(sensors=sensors))
    with pytest.raises(ConfigError, match=words):
        make(bench, Settings(sensor="radar"))
