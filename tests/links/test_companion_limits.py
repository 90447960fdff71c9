"""The companion server with clients that send valid messages with extreme contents, or too many of them."""

from __future__ import annotations

import errno
import gc
import itertools
import os
import socket
import stat
import sys
import tempfile
import time
from pathlib import Path

import pytest
import zmq

from firmware_bridge.companion.server import CompanionServer
from firmware_bridge.companion.settings import CompanionSettings
from firmware_bridge.companion.shared_ring import SharedRing
from firmware_bridge.companion.sockets import RECEIVE_HWM
from hil.config.companion.link_settings import link_settings
from hil.config.schema import Companion
from signals.errors import PortNotFound
from tests.worlds.companion_server import FACTS, RawClient, answered, frame_of, join, serving, step, told, until
from tests.worlds.patience import PATIENCE_S, raised_by


def test_times_at_the_end_of_64_bits_are_counted() -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        join(server, client)
        client.say("ping", id=1, t_client_ns=0, bench_minus_client_ns=2**62, round_trip_ns=0)
        told(server, client, "pong")
        server.send(frame_of(0))
        client.expect("frame")
        client.done(0, t_received_ns=2**62, t_sent_ns=2**62)
        (reply,) = answered(server)
        assert reply.clock_offset_ns == -(2**62)
        assert reply.t_received_ns - reply.clock_offset_ns == 2**63
        client.done(1)
        assert told(server, client, "refused")["code"] == "malformed"
        step(server, client, 2)


def test_function_cannot_have_taken_longer_than_the_frame_was_away() -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        join(server, client)
        server.send(frame_of(0))
        client.expect("frame")
        client.done(0, t2_ns=3_600_000_000_000)
        until(server, lambda: server.malformed == 1)
        assert "t2_ns" in client.expect("refused")["text"]
        client.done(0)  # it can still be answered
        (reply,) = answered(server)
        assert reply.t2_ns == 0


def test_poll_with_zero_timeout_ends_in_spite_of_a_flood() -> None:
    """The clock advances by 0.1 ms per reading, so that the test does not depend on the machine."""
    looks = itertools.count()
    server = CompanionServer(CompanionSettings(bind="tcp://127.0.0.1:*"), FACTS, clock_ns=lambda: next(looks) * 100_000)
    server.open()
    try:
        with RawClient(server.endpoint) as client:
            for number in range(200):
                client.say("ping", id=number, t_client_ns=0)
            time.sleep(0.2)  # for them to arrive; fewer would make the test easier
            server.poll(0.0)
            assert 0 < server.malformed < 10
    finally:
        server.close()


def test_bytes_that_are_zmtp_1_by_chance_disturb_nobody() -> None:
    """A port scanner, or a program of another protocol: ZeroMQ states no descriptor for messages of such a peer."""
    with serving() as server, RawClient(server.endpoint) as client:
        join(server, client)
        port = int(server.endpoint.rpartition(":")[2])
        with socket.create_connection(("127.0.0.1", port)) as stranger:
            stranger.sendall(b"\x02\x00A" + b"\x03\x00hi" + b"\x03\x01hi" + b"\x01\x00")
            until(server, lambda: server.malformed == 2)
        step(server, client, 0)


def test_second_hello_is_malformed_and_a_repeated_one_is_ignored() -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        join(server, client, topics=["imu"])
        client.hello(topics=["imu"])
        client.hello(topics=["*"])
        until(server, lambda: server.malformed == 1)
        assert "bye" in client.expect("refused")["text"]
        assert server.topics == {"imu"}
        assert server.lost == {}
        step(server, client, 0)
        client.say("bye", reason="")
        until(server, lambda: "cut" in server.lost)
        join(server, client, topics=["*"])


def test_a_connection_has_one_name_and_a_session_at_most_256() -> None:
    with serving() as server, RawClient(server.endpoint) as client:
        join(server, client, "first")
        client.say("bye", reason="")
        client.hello("second")
        until(server, lambda: bool(server.refused))
        assert client.expect("refused")["code"] == "name"
        for number in range(255):
            with RawClient(server.endpoint) as other:
                join(server, other, f"n{number}")
        with RawClient(server.endpoint) as late:
            late.hello("late")
            until(server, lambda: len(server.refused) == 2)
            refused = late.expect("refused")
            assert (refused["code"], "256" in refused["text"]) == ("full", True)
        assert len(server.stats()) == 256
        join(server, client, "first")  # a known client may reconnect


def test_ring_for_which_there_is_no_memory_is_refused_not_touched(monkeypatch: pytest.MonkeyPatch) -> None:
    """A container's /dev/shm has 64 MB; a page that cannot be had ends the process at the first touch (SIGBUS)."""
    before = sorted(Path("/dev/shm").iterdir())
    asked: list[int] = []

    def nothing_left(descriptor: int, start: int, size: int) -> None:
        asked.append(size)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", nothing_left)
    with pytest.raises(PortNotFound, match=r"/dev/shm: 3 MiB .*--shm-size.*ring_mb.*arrangement=one_port"):
        SharedRing(3 << 20)
    assert asked == [3 << 20]
    assert sorted(Path("/dev/shm").iterdir()) == before


def test_shared_memory_of_a_run_that_was_stopped_leaves_nothing_and_says_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A signal raises anywhere: while the memory is reserved, or while a view of it is in a frame of the traceback."""
    before = sorted(Path("/dev/shm").iterdir())
    told: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", told.append)
    ring = SharedRing(1 << 20)
    assert ring._view is not None
    view = ring._view[8:]
    ring.close()
    del ring
    gc.collect()
    view.release()

    def interrupted(*_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "posix_fallocate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        SharedRing(1 << 20)
    gc.collect()
    assert told == []
    assert sorted(Path("/dev/shm").iterdir()) == before


@pytest.mark.parametrize("named", [False, True])
def test_local_socket_is_the_users_own_and_leaves_nothing(
    named: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    bind = f"ipc://{tmp_path}/own" if named else link_settings(Companion(port=0, clients=1)).bind
    with serving(arrangement="shared_memory", bind=bind, ring_bytes=1 << 20) as server:
        file = Path(server.endpoint.removeprefix("ipc://"))
        assert file.is_absolute()
        assert stat.S_IMODE(file.stat().st_mode) == 0o600
        assert file.parent == tmp_path if named else stat.S_IMODE(file.parent.stat().st_mode) == 0o700
        assert tmp_path in file.parents
        with RawClient(server.endpoint) as client, serving(arrangement="shared_memory", bind="ipc://*") as second:
            assert second.endpoint != server.endpoint
            join(server, client)
            step(server, client, 0)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize("way", ["tcp", "ipc"])
def test_a_part_that_is_too_large_ends_the_connection(way: str, parts: int, tmp_path: Path) -> None:
    bind = f"ipc://{tmp_path}/socket" if way == "ipc" else "tcp://127.0.0.1:*"
    with serving(bind=bind) as server, RawClient(server.endpoint) as client:
        join(server, client)
        client.send(*[bytes(server.settings.max_message_bytes + 1)] * parts)
        until(server, lambda: "cut" in server.lost)
        assert (server.lost["cut"], server.malformed) == ("its connection ended", 0)


@pytest.mark.parametrize("way", ["tcp", "ipc"])
def test_unread_messages_wait_at_the_sender(way: str, tmp_path: Path) -> None:
    """The client sends messages of the greatest size, as fast as they are taken, while the bench does not read."""
    bind = f"ipc://{tmp_path}/socket" if way == "ipc" else "tcp://127.0.0.1:*"
    with (
        serving(bind=bind) as server,
        RawClient(server.endpoint, sndhwm=1) as client,
        RawClient(server.endpoint) as other,
    ):
        join(server, client)
        join(server, other, "other")
        size = server.settings.max_message_bytes
        taken = 0
        while client.socket.poll(500, zmq.POLLOUT):  # nothing was taken for so long: the sender is blocked
            client.socket.send(bytes(size), zmq.NOBLOCK)
            taken += 1
            assert taken < 4 * RECEIVE_HWM  # the bench queues so many, the kernel's buffers some more
        step(server, other, 0, "other")
        until(server, lambda: "cut" in server.lost)
        assert server.lost["cut"].startswith("10 malformed messages in a row")
        step(server, other, 1, "other")


def test_slot_of_a_client_found_gone_while_sending_is_free_again(tmp_path: Path) -> None:
    bind = f"ipc://{tmp_path}/socket"
    with serving(arrangement="shared_memory", bind=bind, ring_bytes=4096) as server:
        for number in range(17):  # many more than fit
            with RawClient(bind) as client:
                join(server, client)
            end_s = time.monotonic() + PATIENCE_S
            while server.ready_names and time.monotonic() < end_s:
                time.sleep(0.01)  # for ZeroMQ to notice; the server is not asked meanwhile
                server.send(frame_of(number))
            assert server.ready_names == ()
        with RawClient(bind) as client:
            join(server, client)
            step(server, client, 100)


def test_a_socket_that_cannot_be_set_up_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_descriptor(*_: object) -> None:
        raise zmq.ZMQError(errno.EMFILE)

    monkeypatch.setattr(zmq.Socket, "get_monitor_socket", no_descriptor)
    error = raised_by(CompanionServer(CompanionSettings(bind="tcp://127.0.0.1:*"), FACTS).open)
    assert isinstance(error, zmq.ZMQError)
    assert error.errno == errno.EMFILE
