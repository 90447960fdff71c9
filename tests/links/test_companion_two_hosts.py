"""The companion link between two hosts: a network namespace behind a shaped wire, with keys."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from firmware_bridge.companion.keys import make_keys
from firmware_bridge.companion.settings import Arrangement
from hil.bench_suite.link_companion_frame import AHEAD, frame_arrays, size_of
from hil.bench_suite.link_companion_transfer import Wire, far_end
from hil.bench_suite.second_host import SecondHost, why_not
from hil.signals.errors import ConfigError, HandshakeError

SCALE = 0.1


@pytest.fixture(scope="module")
def host() -> Iterator[SecondHost]:
    reason = why_not()
    if reason is not None:
        pytest.skip(reason)
    with SecondHost() as made:
        yield made


@pytest.fixture
def wire(host: SecondHost, tmp_path: Path) -> Wire:
    make_keys(tmp_path / "keys", ["peer", "other"])
    return Wire(host.near, host.command(()), tmp_path / "keys")


@pytest.mark.parametrize("arrangement", ["one_port", "ports"])
def test_frames_cross_the_wire_whole(wire: Wire, arrangement: Arrangement) -> None:
    arrays = frame_arrays(0, scale=SCALE)
    with far_end(wire, arrangement, arrays) as transfer:
        assert transfer.differing(2) == 0
        rates = transfer.measure(ahead=AHEAD, seconds=0.2, least_pairs=1)
    assert rates.payload_bytes == size_of(arrays)
    # No faster than the wire is: else the frames went some other way. A burst may pass at once.
    assert min(rates.link_s + rates.bare_s) > 0.5 * size_of(arrays) * 8 / 1e9


def test_a_key_that_is_not_allowed_stays_outside(wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    assert wire.keys is not None
    (wire.keys / "peer.pub").unlink()
    monkeypatch.setattr("hil.bench_suite.link_companion_transfer.LIMIT_S", 1.5)
    with (
        pytest.raises(HandshakeError, match="not among the allowed"),
        far_end(wire, "one_port", frame_arrays(0, scale=SCALE)),
    ):
        pass


def test_no_keys_no_second_host(wire: Wire) -> None:
    with (
        pytest.raises(ConfigError, match="make keys"),
        far_end(Wire(wire.near, wire.far), "one_port", frame_arrays(0, scale=SCALE)),
    ):
        pass


def test_nothing_is_left_behind() -> None:
    reason = why_not()
    if reason is not None:
        pytest.skip(reason)
    with SecondHost() as made:
        name = made.command(())[3]
        assert name in _namespaces()
        assert name in _devices()
    assert name not in _namespaces()
    assert name not in _devices()


def _namespaces() -> str:
    return subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True).stdout


def _devices() -> str:
    return subprocess.run(["ip", "link", "show"], capture_output=True, text=True, check=True).stdout
