"""The rules of MAVLink routing at the router, endpoints of every kind, floods and stalls."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from firmware_bridge.codecs.mavlink_frame import FrameEncoder
from firmware_bridge.codecs.messages import NAME, target
from firmware_bridge.router.router import Endpoint, Router
from tests.worlds.router_clients import TcpClient, UdpClient, address_of, command, framed, heartbeat, raw, until

VEHICLE = FrameEncoder(1, 1)
HEARTBEAT = framed(raw(VEHICLE, "HEARTBEAT", 2, 12, 0, 0, 0, 3))
ATTITUDE = framed(raw(VEHICLE, "ATTITUDE", 1, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0))


def ack_to(system: int, component: int):
    return framed(raw(VEHICLE, "COMMAND_ACK", 400, 0, 0, 0, system, component))


@pytest.fixture
def router() -> Iterator[Router]:
    """Clients come to it over UDP at the first address, over TCP at the second."""
    router = Router([
        Endpoint(None, ("127.0.0.1", 0), name="sdk"),
        Endpoint(None, ("127.0.0.1", 0), tcp=True, name="tcp"),
    ])  # fmt: skip
    router.open()
    router.forward([HEARTBEAT])
    yield router
    router.close()


def joined(router: Router, *clients: UdpClient) -> None:
    """Let each client send once, so that the router knows it."""
    for client in clients:
        hello = heartbeat(client.encoder)
        client.say(hello, address_of(router))
        until(router, lambda data, hello=hello: hello in data)
    for client in clients:
        client.hear()
        client.heard.clear()


def names(client: UdpClient) -> list[str]:
    heard, client.heard = client.hear(), []
    return [NAME[frame.msgid] for frame in heard]


def hears(router: Router, client: UdpClient, count: int = 1) -> list[str]:
    until(router, lambda _: len(client.hear()) >= count)
    return names(client)


def test_positions_of_target_fields() -> None:
    encoder = FrameEncoder(1, 1)
    assert target(framed(command(encoder, 7, 8))) == (7, 8)
    assert target(ack_to(245, 190)) == (245, 190)  # extension fields
    assert target(framed(raw(encoder, "SET_MODE", 9, 1, 0))) == (9, 0)
    assert target(framed(raw(encoder, "PARAM_SET", 3, 4, "A", 1.0, 9))) == (3, 4)
    assert target(HEARTBEAT) == (0, 0)


def test_targeted_messages_of_the_autopilot_go_to_that_system_only(router: Router) -> None:
    a, b = UdpClient(245, 190), UdpClient(246, 190)
    joined(router, a, b)
    router.forward([ack_to(245, 190), ack_to(99, 1), ATTITUDE])
    assert hears(router, a, 2) == ["COMMAND_ACK", "ATTITUDE"]
    assert hears(router, b) == ["ATTITUDE"]
    assert router.stats.unroutable == 1
    a.close(), b.close()


def test_clients_see_each_others_messages_but_not_their_own(router: Router) -> None:
    a, b = UdpClient(245, 190), UdpClient(246, 190)
    joined(router, a, b)
    order = command(a.encoder, 1, 1)
    a.say(heartbeat(a.encoder) + order, address_of(router))
    until(router, lambda data: data.endswith(order))
    # The heartbeat goes to all; the command goes to the autopilot alone.
    assert hears(router, b) == ["HEARTBEAT"]
    assert names(a) == []
    a.close(), b.close()


def test_a_message_for_a_client_does_not_reach_the_autopilot(router: Router) -> None:
    a, b, c = UdpClient(245, 190), UdpClient(246, 191), UdpClient(247, 1)
    joined(router, a, b, c)
    order = command(a.encoder, 246, 191)
    end = heartbeat(a.encoder)
    a.say(order + end, address_of(router))
    data = until(router, lambda data: end in data)
    assert data == end
    assert hears(router, b, 2) == ["COMMAND_LONG", "HEARTBEAT"]
    assert hears(router, c) == ["HEARTBEAT"]
    assert [frame.raw for frame in router.take_between_clients()] == [order]
    a.close(), b.close(), c.close()


def test_a_companion_of_the_vehicles_own_system(router: Router) -> None:
    a, companion = UdpClient(245, 190), UdpClient(1, 191)
    joined(router, a, companion)
    to_companion, to_all_of_it, to_autopilot = (command(a.encoder, 1, component) for component in (191, 0, 1))
    a.say(to_companion + to_all_of_it + to_autopilot, address_of(router))
    assert until(router, lambda data: to_autopilot in data) == to_all_of_it + to_autopilot
    assert hears(router, companion, 2) == ["COMMAND_LONG"] * 2
    assert router.stats.looped == 0
    a.close(), companion.close()


def test_unknown_targets_go_to_the_autopilot(router: Router) -> None:
    """It may know a system that has not sent anything yet."""
    a, b = UdpClient(245, 190), UdpClient(246, 190)
    joined(router, a, b)
    order = command(a.encoder, 77, 1)
    a.say(order, address_of(router))
    assert until(router, lambda data: order in data) == order
    assert names(b) == []
    a.close(), b.close()


def test_hil_messages_and_keys_are_sent_to_no_client(router: Router) -> None:
    a, b = UdpClient(245, 190), UdpClient(246, 190)
    joined(router, a, b)
    key = raw(a.encoder, "SETUP_SIGNING", 0, 0, tuple(range(32)), 1)
    sensor = raw(a.encoder, "HIL_SENSOR", 0, *[0.0] * 13, 0x1FFF, 0)
    end = heartbeat(a.encoder)
    a.say(sensor + key + end, address_of(router))
    assert until(router, lambda data: end in data) == key + end
    assert hears(router, b) == ["HEARTBEAT"]
    router.forward([framed(key), ATTITUDE])
    assert hears(router, b) == ["ATTITUDE"]
    assert router.stats.rejected == 1
    a.close(), b.close()


def test_loops_end(router: Router) -> None:
    a, b = UdpClient(245, 190), UdpClient(246, 190)
    joined(router, a, b)
    word = heartbeat(a.encoder)
    a.say(word, address_of(router))
    assert hears(router, b) == ["HEARTBEAT"]
    end = heartbeat(b.encoder)
    # A router behind b returns the frames of the client and of the autopilot.
    b.say(word + HEARTBEAT.raw + end, address_of(router))
    assert until(router, lambda data: end in data) == end
    assert router.stats.looped == 2
    assert sum("loop" in text for _, text in router.take_events()) == 2
    # A frame that arrives twice does not circulate for ever.
    word = heartbeat(a.encoder)
    a.say(word * 100 + heartbeat(a.encoder), address_of(router))
    data = until(router, lambda data: len(data) > 40 * len(word))
    assert data.count(word) <= 51
    a.close(), b.close()


def test_tcp_and_udp_clients_side_by_side(router: Router) -> None:
    udp = UdpClient(245, 190)
    joined(router, udp)
    tcp = TcpClient(address_of(router, 1), 246, 190)
    router.collect()
    router.forward([HEARTBEAT, ATTITUDE])
    assert hears(router, udp, 2) == ["HEARTBEAT", "ATTITUDE"]
    assert hears(router, tcp) == ["HEARTBEAT"]  # not known yet
    hello = heartbeat(tcp.encoder)
    tcp.say(hello[:9])
    router.collect()
    tcp.say(hello[9:])
    assert until(router, lambda data: hello in data) == hello
    router.forward([ATTITUDE] * 3)
    assert hears(router, tcp, 3) == ["ATTITUDE"] * 3
    tcp.close()
    events = []
    until(router, lambda _: events.extend(router.take_events()) or any("left" in text for _, text in events))
    hears(router, udp, 4)
    names(udp)
    router.forward([ATTITUDE])
    assert hears(router, udp) == ["ATTITUDE"]
    udp.close()


def test_a_stalled_tcp_client_is_disconnected_and_delays_no_other(router: Router) -> None:
    udp = UdpClient(245, 190)
    joined(router, udp)
    tcp = TcpClient(address_of(router, 1), 246, 190, receive_buffer=4096)
    hello = heartbeat(tcp.encoder)
    tcp.say(hello)
    until(router, lambda data: hello in data)
    events: list[tuple[str, str]] = []
    for _ in range(4000):
        router.forward([ATTITUDE] * 40)
        router.collect()
        events += router.take_events()
        if any("stalled" in text for _, text in events):
            break
        udp.hear()
    assert ("warning", True) in [(kind, "stalled" in text) for kind, text in events]
    udp.heard.clear()
    router.forward([ATTITUDE])
    assert "ATTITUDE" in hears(router, udp)
    tcp.close(), udp.close()


def test_a_flood_of_one_client_does_not_silence_another(router: Router) -> None:
    flooder, quiet = UdpClient(245, 190), UdpClient(246, 190)
    joined(router, flooder, quiet)
    word = command(flooder.encoder, 1, 1)
    for _ in range(40):
        flooder.say(word * 30, address_of(router))
    order = command(quiet.encoder, 1, 1, 176)
    quiet.say(order, address_of(router))
    data = until(router, lambda data: order in data)
    assert data.index(order) <= 64 * 1024
    assert router.stats.dropped > 0
    assert any("more than the autopilot" in text for _, text in router.take_events())
    flooder.close(), quiet.close()


def test_the_number_of_clients_is_limited(router: Router) -> None:
    clients = [UdpClient(2 + i, 190) for i in range(20)]
    for client in clients:
        client.say(heartbeat(client.encoder), address_of(router))
    until(router, lambda _: router.stats.turned_away >= 4)
    assert router.stats.clients == 16
    for client in clients:
        client.close()


@pytest.mark.parametrize(
    ("text", "endpoint"),
    [
        ("udp:127.0.0.1:14550", Endpoint(("127.0.0.1", 14550), ("127.0.0.1", 0))),
        ("udp:10.0.0.5:14550", Endpoint(("10.0.0.5", 14550), ("", 0))),
        ("udpin:127.0.0.1:14551", Endpoint(None, ("127.0.0.1", 14551))),
        ("tcp:localhost:5790", Endpoint(None, ("localhost", 5790), tcp=True)),
    ],
)
def test_endpoints_as_written(text: str, endpoint: Endpoint) -> None:
    assert Endpoint.parse(text) == endpoint
    assert not endpoint.is_open_to_others
    for wrong in (text.replace(":", " "), text + "0000", "serial:" + text, text.rpartition(":")[0] + ":0"):
        with pytest.raises(ValueError, match="must look like"):
            Endpoint.parse(wrong)


def test_an_endpoint_open_to_the_network_gives_a_warning() -> None:
    router = Router([Endpoint(None, ("0.0.0.0", 0), name="companion")])
    router.open()
    assert [(kind, "any machine" in text) for kind, text in router.take_events()] == [("warning", True)]
    router.close()
