"""The router with real UDP sockets on loopback."""

import socket
import time

import pytest

from firmware_bridge.codecs.mavlink_frame import FrameEncoder
from firmware_bridge.codecs.messages import NAME
from firmware_bridge.router.router import Endpoint, Router
from signals.errors import PortBusy, PortNotFound
from tests.worlds.patience import PATIENCE_S
from tests.worlds.router_clients import UdpClient, address_of, command, framed, heartbeat, raw, until

VEHICLE = FrameEncoder(1, 1)
CLIENT = FrameEncoder(245, 190)


HEARTBEAT = framed(raw(VEHICLE, "HEARTBEAT", 2, 12, 0, 0, 0, 3))
ATTITUDE = framed(raw(VEHICLE, "ATTITUDE", 1, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0))
ACTUATORS = framed(raw(VEHICLE, "HIL_ACTUATOR_CONTROLS", 1, (0.0,) * 16, 1, 1))
HELLO = heartbeat(CLIENT)
ARM = command(CLIENT, 1, 1)


def hears(client, count):
    """Return the names of messages since the last call, once there are `count`, or after a time-out."""
    deadline = time.monotonic() + (PATIENCE_S if count else 0.02)
    while len(client.hear()) < max(count, 1) and time.monotonic() < deadline:
        time.sleep(0.001)
    heard, client.heard = client.heard, []
    return [NAME[frame.msgid] for frame in heard]


@pytest.fixture
def router(client):
    router = Router([Endpoint(client.address)])
    router.open()
    yield router
    router.close()


def collect(router, count):
    """Collect bytes until there are `count`."""
    return until(router, lambda data: len(data) >= count)


def test_only_heartbeats_until_a_client_sends_then_everything_but_hil(router, client):
    router.forward([ATTITUDE, HEARTBEAT, ACTUATORS])
    assert hears(client, 1) == ["HEARTBEAT"]
    router.forward([ATTITUDE, ACTUATORS])
    assert hears(client, 0) == []
    assert not router.received_any
    client.say(HELLO, address_of(router))
    assert collect(router, len(HELLO)) == HELLO
    assert router.received_any
    router.forward([ATTITUDE, HEARTBEAT, ACTUATORS])
    assert hears(client, 2) == ["ATTITUDE", "HEARTBEAT"]
    assert (router.stats.to_clients, router.stats.from_clients, router.stats.clients) == (3, 1, 1)


def test_a_client_from_elsewhere_is_learnt(router, client):
    other = UdpClient()
    other.say(ARM, address_of(router))
    assert collect(router, len(ARM)) == ARM
    router.forward([ATTITUDE])
    assert hears(other, 1) == ["ATTITUDE"]
    assert hears(client, 0) == []  # it has not sent anything yet
    router.forward([HEARTBEAT])
    assert hears(client, 1) == ["HEARTBEAT"]
    other.close()


def test_only_whole_valid_frames_go_on(router, client):
    to = address_of(router)
    broken = bytearray(ARM)
    broken[20] ^= 1
    client.say(b"GET / HTTP/1.1\r\n\r\n" + bytes(broken) + HELLO + b"\xfd\x09", to)
    assert collect(router, len(HELLO)) == HELLO
    assert router.stats.damaged_bytes > 0


def test_half_frames_of_two_clients_are_not_joined(router, client):
    other = UdpClient()
    to = address_of(router)
    client.say(HELLO, to)
    other.say(HELLO, to)
    assert collect(router, 2 * len(HELLO)) == 2 * HELLO
    client.say(ARM[:20], to)
    time.sleep(0.01)
    router.collect()
    other.say(ARM[20:], to)
    time.sleep(0.01)
    assert router.collect() == b""
    client.say(ARM[20:], to)
    assert collect(router, len(ARM)) == ARM
    other.close()


def test_a_flood_is_bounded_per_tick_and_in_memory(router, client):
    to = address_of(router)
    got = []
    for _ in range(40):
        for _ in range(30):
            client.say(ARM * 30, to)
        got.append(len(router.collect()))
    assert max(got) <= 2048
    rest = 0
    while data := router.collect():
        rest += len(data)
    assert rest <= 65536 + 16384  # one read on top of one client's queue
    assert router.stats.dropped > 0
    assert ("warning", "client") in [(kind, text.split()[0]) for kind, text in router.take_events()]


def test_long_telemetry_is_cut_into_datagrams_of_whole_frames(router, client):
    client.say(HELLO, address_of(router))
    collect(router, len(HELLO))
    router.forward([ATTITUDE] * 200)
    sizes = []
    total = 0
    client.socket.setblocking(True)
    while total < 200:
        data = client.socket.recv(65536)
        sizes.append(len(data))
        total += data.count(ATTITUDE.raw)
    assert max(sizes) <= 1400
    assert total == 200


def test_absent_clients_raise_nothing():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        nobody = probe.getsockname()
    router = Router([Endpoint(nobody)])
    router.open()
    for _ in range(50):
        router.forward([HEARTBEAT, ATTITUDE])
        assert router.collect() == b""
    router.close()


def test_busy_and_foreign_addresses_are_named(client):
    with pytest.raises(PortBusy, match=str(client.address[1])):
        Router([Endpoint(("127.0.0.1", 1), client.address)]).open()
    with pytest.raises(PortNotFound):
        Router([Endpoint(("127.0.0.1", 1), ("203.0.113.1", 0))]).open()


def test_close_and_open_again(router, client):
    client.say(HELLO, address_of(router))
    collect(router, len(HELLO))
    router.close()
    router.close()
    assert router.collect() == b""
    router.forward([HEARTBEAT])
    router.open()
    assert not router.received_any
    assert router.stats.from_clients == 0
