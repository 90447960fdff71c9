"""The companion link between two hosts: a network namespace behind a shaped wire, with keys."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from firmware_bridge.companion.keys import make_keys
from firmware_bridge.companion.settings import Arrangement
from hil.apps.bench_suite.link.second_host import Host, second_host
from hil.apps.bench_suite.link.transfer import MAX_IN_FLIGHT, Endpoints, open_transfer
from signals.errors import ConfigError, HandshakeError, PortNotFound
from tests.worlds.patience import PATIENCE_S

SCALE = 0.1


@pytest.fixture(scope="module")
def host() -> Iterator[Host]:
    with ExitStack() as stack:
        try:
            made = stack.enter_context(second_host())
        except PortNotFound as error:
            pytest.skip(str(error))
        yield made
    name = made.command[3]
    assert name not in _namespaces()
    assert name not in _devices()


@pytest.fixture
def endpoints(host: Host, tmp_path: Path) -> Endpoints:
    make_keys(tmp_path / "keys", ["peer", "other"])
    return Endpoints(host.bench_address, host.command, tmp_path / "keys")


@pytest.mark.parametrize("arrangement", ["one_port", "ports"])
def test_frames_cross_the_wire_whole(endpoints: Endpoints, arrangement: Arrangement) -> None:
    with open_transfer(endpoints, arrangement, scale=SCALE) as transfer:
        assert transfer.differing == 0
        rates = transfer.measure(in_flight=MAX_IN_FLIGHT, seconds=0.2, min_pairs=1)
    # Not faster than the wire, or the frames took another way. A burst may pass at once.
    assert min(rates.link_s + rates.bare_s) > 0.5 * rates.payload_bytes * 8 / 1e9


def test_a_key_that_is_not_allowed_is_refused(endpoints: Endpoints, monkeypatch: pytest.MonkeyPatch) -> None:
    assert endpoints.keys is not None
    (endpoints.keys / "peer.pub").unlink()
    for limit_s in (8.0, 60.0, PATIENCE_S):  # on a busy machine it takes longer until the far side has begun
        monkeypatch.setattr("hil.apps.bench_suite.link.transfer.LIMIT_S", limit_s)
        with pytest.raises(HandshakeError) as caught, open_transfer(endpoints, "one_port", scale=SCALE):
            pass
        if "refused" in str(caught.value):
            break
    assert "not among the allowed" in str(caught.value)


def test_a_second_host_without_keys_is_refused(endpoints: Endpoints) -> None:
    with (
        pytest.raises(ConfigError, match="make keys"),
        open_transfer(endpoints._replace(keys=None), "one_port", scale=SCALE),
    ):
        pass


def test_the_host_has_devices_of_its_own(host: Host) -> None:
    assert host.command[3] in _namespaces()
    assert host.command[3] in _devices()


def _namespaces() -> str:
    return subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True).stdout


def _devices() -> str:
    return subprocess.run(["ip", "link", "show"], capture_output=True, text=True, check=True).stdout
