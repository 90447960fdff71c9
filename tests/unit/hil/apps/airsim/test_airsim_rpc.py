"""The RPC server: messages, errors in rpclib's words, limits, and clients that misbehave."""

from __future__ import annotations

import random
import struct
from collections.abc import Iterator
from pathlib import Path

import msgpack
import numpy as np
import pytest

from hil.apps.airsim.rpc.arguments import Pose, Vector
from hil.apps.airsim.rpc.framing import MOST_BYTES
from hil.apps.airsim.rpc.packing import Double, pack
from lab.airsim_server import RpcFailed
from tests.worlds.airsim_server import Client, Served, served


@pytest.fixture(scope="module")
def world() -> Iterator[Served]:
    with served() as running:
        yield running


@pytest.fixture
def client(world: Served) -> Client:
    return world.client()


def test_ping(client: Client) -> None:
    assert client.call("ping") is True


def test_versions_suit_both_clients(client: Client) -> None:
    assert client.call("getServerVersion") >= 4  # what cosysairsim 3.5 asks for; airsim 1.8.1 asks for 1
    assert client.call("getMinRequiredClientVersion") <= 1  # the version of airsim 1.8.1


def test_an_unknown_name_has_rpclibs_text_and_is_logged(world: Served, client: Client) -> None:
    with pytest.raises(RpcFailed, match=r"^rpclib: server could not find function 'fly_away' with argument count 2\.$"):
        client.call("fly_away", 1, "x")
    assert any("'fly_away' with argument count 2" in line for line in world.log)
    assert world.server.methods.unknown["fly_away(2)"] == 1


def test_a_wrong_number_of_arguments_has_rpclibs_text(client: Client) -> None:
    expected = (
        r"^rpclib: client error C0001: Function 'ping' was called with an invalid number of arguments. "
        r"Expected: 0, got: 1$"
    )
    with pytest.raises(RpcFailed, match=expected):
        client.call("ping", 1)
    with pytest.raises(RpcFailed, match=r"'armDisarm' .* Expected: 1 to 2, got: 0$"):
        client.call("armDisarm")


@pytest.mark.parametrize(
    ("name", "arguments", "told"),
    [
        ("armDisarm", (1,), r"argument 1 \(arm\): expected true or false, got 1"),
        ("enableApiControl", (True, 5), r"argument 2 \(vehicle_name\): expected a text, got 5"),
        ("simContinueForTime", (float("nan"),), r"argument 1 \(seconds\): expected a finite number, got nan"),
        ("simContinueForTime", (-1.0,), "takes 0 to 1e"),
        ("simContinueForFrames", (1.5,), "expected an integer, got 1.5"),
        ("simContinueForFrames", (-1,), "expected an integer from 0"),
        ("simSetVehiclePose", (7, True, ""), "expected a Pose"),
        ("simSetVehiclePose", ({"position": {"x_val": "a"}}, True), "position: x_val: expected a number, got 'a'"),
        ("enableApiControl", (True, "Nobody"), "Vehicle API for 'Nobody' is not available.*SimpleFlight"),
    ],
)
def test_a_wrong_argument_is_an_error_of_this_client(
    client: Client, name: str, arguments: tuple[object, ...], told: str
) -> None:
    with pytest.raises(RpcFailed, match=rf"^rpclib: function '{name}' \(called with \d arg\(s\)\) threw.*{told}"):
        client.call(name, *arguments)
    assert client.call("ping") is True


def test_a_notification_has_no_reply(client: Client) -> None:
    client.socket.sendall(msgpack.packb([2, "simPrintLogMessage", ["hello ", "you", 0]]))
    assert client.call("ping") is True


def test_a_log_message_is_shown(world: Served, client: Client) -> None:
    client.call("simPrintLogMessage", "battery ", "low", 1)
    assert "warning: battery low" in world.log


def test_several_calls_in_one_packet(client: Client) -> None:
    client.socket.sendall(b"".join(msgpack.packb([0, 100 + i, "ping", []]) for i in range(5)))
    assert [client.join(100 + i) for i in range(5)] == [True] * 5


def test_a_call_byte_by_byte(client: Client) -> None:
    for byte in msgpack.packb([0, 7, "ping", []]):
        client.socket.sendall(bytes([byte]))
    assert client.join(7) is True


MALFORMED = [
    b"\xc1",  # never used in MessagePack
    b"GET / HTTP/1.1\r\n\r\n",
    msgpack.packb(17),
    msgpack.packb({"a": 1}),
    msgpack.packb([]),
    msgpack.packb([0]),
    msgpack.packb([0, 1, "ping"]),
    msgpack.packb([0, "one", "ping", []]),
    msgpack.packb([0, -1, "ping", []]),
    msgpack.packb([0, 1, 2, []]),
    msgpack.packb([0, 1, "ping", "no array"]),
    msgpack.packb([3, 1, "ping", []]),
    msgpack.packb([True, 1, "ping", []]),
    msgpack.packb([2, 1, []]),
    b"\x91" * 3000,  # deeper than a call ever is
    b"\xdd\xff\xff\xff\xff",  # an array of 4 billion
    b"\xc9\x00\x00\x00\x01\x05\x00",  # an extension
]


@pytest.mark.parametrize("data", MALFORMED, ids=lambda data: data[:8].hex())
def test_a_malformed_message_closes_only_its_connection(world: Served, data: bytes) -> None:
    bad, good = world.client(), world.client()
    assert good.call("ping") is True
    bad.socket.sendall(data)
    assert bad.is_closed()
    assert good.call("ping") is True


@pytest.mark.parametrize("announced", [MOST_BYTES + 1, 0xFFFF_FFFF])
def test_a_message_that_is_too_long_closes_the_connection(world: Served, announced: int) -> None:
    bad = world.client()
    head = b"\x94\x00\x01\xa4ping\x91\xc6" + struct.pack(">I", announced)
    try:
        bad.socket.sendall(head + bytes(MOST_BYTES + 1))
    except ConnectionError:
        return  # closed while it was sent
    assert bad.is_closed()


def test_a_name_that_is_not_utf_8(client: Client) -> None:
    with pytest.raises(RpcFailed, match="could not find function"):
        client.join(_send_raw(client, b"\x94\x00\x05\xa2\xff\xfe\x90", 5))


def _send_raw(client: Client, data: bytes, number: int) -> int:
    client.socket.sendall(data)
    client._unpacker = msgpack.Unpacker(raw=False, strict_map_key=False, unicode_errors="surrogateescape")
    return number


def test_a_result_that_no_reply_can_hold_ends_nothing(
    world: Served, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = world.server.methods
    monkeypatch.setitem(table._methods, "ping", table._methods["ping"]._replace(call=object))
    with pytest.raises(RpcFailed, match="function 'ping' returned what no reply can hold"):
        client.call("ping")
    monkeypatch.undo()
    assert client.call("ping") is True


def test_a_defect_of_a_method_ends_nothing(world: Served, client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise ZeroDivisionError("x")

    table = world.server.methods
    monkeypatch.setitem(table._methods, "ping", table._methods["ping"]._replace(call=broken))
    with pytest.raises(RpcFailed, match=r"ZeroDivisionError: x .a defect of the server"):
        client.call("ping")
    monkeypatch.undo()
    assert client.call("ping") is True


def test_fifty_clients(world: Served) -> None:
    clients = [world.client() for _ in range(50)]
    requests = [client.send("ping") for client in clients]
    assert all(client.join(request) for client, request in zip(clients, requests, strict=True))


def test_a_client_that_does_not_read_its_replies_holds_up_nobody(world: Served) -> None:
    lazy, good = world.client(), world.client()
    lazy.socket.settimeout(0.2)
    message = msgpack.packb([0, 1, "getSettingsString", []]) * 1000
    try:
        for _ in range(200):
            lazy.socket.sendall(message)
    except TimeoutError:
        pass
    assert good.call("ping") is True


def test_a_flood_of_calls_is_answered_in_turns(world: Served) -> None:
    flood, good = world.client(), world.client()
    flood.socket.sendall(b"".join(msgpack.packb([0, i, "ping", []]) for i in range(20_000)))
    before = world.server.replies
    assert good.call("ping") is True
    assert world.server.replies - before < 15_000
    assert all(flood.join(i) for i in range(20_000))


def _fuzz(world: Served, count: int, seed: int) -> None:
    """Send mutated requests, and count on the server to serve others."""
    draw = random.Random(seed)
    names = world.server.methods.names
    good = world.client()
    values: list[object] = [None, True, 0, -1, 1 << 40, 1.5, float("nan"), float("inf"), "", "x" * 50, b"\xff", [], {},
                            [[]], {"x_val": 1.0}, {"position": {"x_val": 1e300}}, {1: 2}]  # fmt: skip
    bad = world.client()
    never = {"simContinueForTime", "simContinueForFrames"}
    for number in range(count):
        name = draw.choice(names)
        arguments = [draw.choice(values) for _ in range(draw.randrange(8))]
        message = bytearray(msgpack.packb([0, number, name if name not in never else "ping", arguments]))
        kind = draw.randrange(4)
        if kind == 0:
            for _ in range(draw.randrange(1, 4)):
                message[draw.randrange(len(message))] = draw.randrange(256)
        elif kind == 1:
            message = message[: draw.randrange(1, len(message) + 1)]
        try:
            bad.socket.sendall(bytes(message))
            bad.socket.setblocking(False)
            try:
                closed = bad.socket.recv(1 << 20) == b""
            except BlockingIOError:
                closed = False
            bad.socket.setblocking(True)
        except ConnectionError:
            closed = True
        if closed or number % 50 == 49:
            bad.close()
            bad = world.client()
        if number % 1000 == 0:
            assert good.call("ping") is True
    assert good.call("ping") is True


@pytest.mark.parametrize("mode", ["Multirotor", "ComputerVision"])
def test_ten_thousand_malformed_requests(tmp_path: Path, mode: str) -> None:
    with served(f'{{"SettingsVersion": 1.2, "SimMode": "{mode}"}}') as world:
        world.simulation.recorder.folder = tmp_path
        _fuzz(world, 5_000, seed=1)
        assert not [line for line in world.log if "defect" in line]


@pytest.mark.slow
def test_a_hundred_thousand_malformed_requests(tmp_path: Path) -> None:
    with served() as world:
        world.simulation.recorder.folder = tmp_path
        _fuzz(world, 100_000, seed=2)
        assert not [line for line in world.log if "defect" in line]


def test_numbers_have_airsims_types() -> None:
    assert pack(1.5) == b"\xca" + struct.pack(">f", 1.5)
    assert pack(Double(1.5)) == b"\xcb" + struct.pack(">d", 1.5)
    assert pack(1e300) == b"\xca" + struct.pack(">f", float("inf"))
    assert msgpack.unpackb(pack(Vector(1.0, 2.0, 3.0))) == {"x_val": 1.0, "y_val": 2.0, "z_val": 3.0}
    assert msgpack.unpackb(pack(Pose())) == {
        "position": {"x_val": 0.0, "y_val": 0.0, "z_val": 0.0},
        "orientation": {"w_val": 1.0, "x_val": 0.0, "y_val": 0.0, "z_val": 0.0},
    }
    cloud = np.array([0.1, -2.0, 3e5], np.float32)
    assert msgpack.unpackb(pack(cloud)) == cloud.tolist()
    assert msgpack.unpackb(pack(np.array([1, -2], np.int32))) == [1, -2]


@pytest.mark.parametrize(
    "value",
    [None, True, False, 0, 127, 128, -1, -32, -33, -70_000, 1 << 31, (1 << 64) - 1, "", "a" * 31, "ä" * 40, "b" * 300,
     "c" * 70_000, b"", b"x" * 300, b"y" * 70_000, [], [1, [2]], list(range(20)), list(range(70_000)), {},
     {"a": {"b": 1}},
     {i: i for i in range(20)}],
    ids=lambda value: f"{type(value).__name__}{len(value) if hasattr(value, '__len__') else value}",
)  # fmt: skip
def test_packing_agrees_with_msgpack(value: object) -> None:
    assert msgpack.unpackb(pack(value), strict_map_key=False, raw=False) == value


def test_a_type_that_no_reply_can_hold() -> None:
    with pytest.raises(TypeError, match="a reply cannot hold a object"):
        pack(object())
