"""Signing at the router: passed through, required of clients, added for the autopilot. pymavlink is the client."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as dialect

from firmware_bridge.codecs.mavlink_frame import FrameEncoder
from firmware_bridge.codecs.signing import Signer, SigningKey, is_signed, stamp, strip_signature, wall_timestamp
from firmware_bridge.router.router import Endpoint, Router
from firmware_bridge.router.signing import (
    AutopilotSigning,
    ClientSigning,
    SignedCommands,
    copy_for_autopilot,
    for_autopilot,
    read_key,
)
from signals.errors import ConfigError
from tests.worlds.router_clients import UdpClient, address_of, command, framed, heartbeat, raw, until

KEY = SigningKey(bytes(range(32)))
OTHER_KEY = SigningKey(bytes(range(1, 33)))
VEHICLE = FrameEncoder(1, 1)
HEARTBEAT = framed(raw(VEHICLE, "HEARTBEAT", 2, 12, 0, 0, 0, 3))
ATTITUDE = framed(raw(VEHICLE, "ATTITUDE", 1, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0))


def pymavlink(key: SigningKey | None) -> dialect.MAVLink:
    peer = dialect.MAVLink(None, srcSystem=200, srcComponent=190)
    if key is not None:
        peer.signing.secret_key = key.secret
        peer.signing.sign_outgoing = True
        peer.signing.timestamp = wall_timestamp()
    peer.robust_parsing = True
    return peer


def said(peer: dialect.MAVLink) -> bytes:
    return bytes(peer.heartbeat_encode(6, 8, 0, 0, 4).pack(peer))


def opened(**options) -> Router:
    router = Router([Endpoint(None, name="gcs")], **options)
    router.open()
    router.forward([HEARTBEAT])
    return router


@pytest.fixture
def demanding() -> Iterator[Router]:
    router = opened(client_signing=ClientSigning(KEY))
    yield router
    router.close()


def test_signed_frames_pass_untouched_both_ways_where_the_bench_has_no_key(client: UdpClient) -> None:
    router = opened()
    peer = pymavlink(KEY)
    words = said(peer)
    client.say(words, address_of(router))
    assert until(router, lambda data: words in data) == words
    signed = framed(Signer(KEY, 0).sign(ATTITUDE.raw))
    router.forward([signed, ATTITUDE])
    until(router, lambda _: len(client.hear()) == 2)
    assert [frame.raw for frame in client.heard] == [signed.raw, ATTITUDE.raw]
    router.close()


def test_signed_clients_are_served_with_signed_frames(demanding: Router, client: UdpClient) -> None:
    peer = pymavlink(KEY)
    words = said(peer)
    client.say(words, address_of(demanding))
    # The signature is kept: an autopilot with the same key can check it too.
    assert until(demanding, lambda data: words in data) == words
    already = framed(Signer(KEY, 0).sign(HEARTBEAT.raw))
    demanding.forward([ATTITUDE, already])
    until(demanding, lambda _: len(client.hear()) == 2)
    heard = [frame.raw for frame in client.heard]
    assert heard[1] == already.raw
    assert strip_signature(heard[0]) == ATTITUDE.raw
    assert [m.get_type() for data in heard for m in peer.parse_buffer(data)] == ["ATTITUDE", "HEARTBEAT"]


def test_unsigned_clients_are_neither_read_nor_served(demanding: Router, client: UdpClient) -> None:
    to = address_of(demanding)
    good = UdpClient()
    signed = said(pymavlink(KEY))
    client.say(heartbeat(client.encoder) + command(client.encoder, 1, 1), to)
    client.say(said(pymavlink(OTHER_KEY)), to)
    good.say(signed, to)
    assert until(demanding, lambda data: signed in data) == signed
    client.say(signed, to)  # recorded and replayed from another address
    until(demanding, lambda _: demanding.stats.replayed)
    demanding.forward([ATTITUDE])
    until(demanding, lambda _: good.hear())
    assert client.hear() == []
    stats = demanding.stats
    assert (stats.unsigned, stats.forged, stats.replayed, stats.from_clients) == (2, 1, 1, 1)
    assert [kind for kind, _ in demanding.take_events()] == ["warning", "warning", "status", "warning"]
    good.close()


def test_refused_datagrams_warn_once_an_address_and_leave_room_for_other_events(
    demanding: Router, client: UdpClient
) -> None:
    to = address_of(demanding)
    for n in range(1, 601):
        client.say(heartbeat(client.encoder), to)
        until(demanding, lambda _: demanding.stats.unsigned == n)  # noqa: B023 (called at once)
    assert [kind for kind, _ in demanding.take_events()] == ["warning"]
    others = [UdpClient() for _ in range(30)]
    for other in others:
        other.say(heartbeat(other.encoder), to)
    until(demanding, lambda _: demanding.stats.unsigned == 630)
    texts = [text for _, text in demanding.take_events()]
    assert len(texts) == 19
    assert texts[-1].endswith("further addresses are only counted")
    signed = said(pymavlink(KEY))
    client.say(signed, to)
    until(demanding, lambda data: signed in data)
    assert [kind for kind, _ in demanding.take_events()] == ["status"]
    for other in others:
        other.close()


def test_a_radio_need_not_sign(demanding: Router, client: UdpClient) -> None:
    status = raw(client.encoder, "RADIO_STATUS", 1, 1, 1, 1, 1, 0, 0)
    client.say(status, address_of(demanding))
    assert until(demanding, lambda data: status in data) == status


def test_the_benchs_own_messages_are_signed_for_the_autopilot() -> None:
    words = [heartbeat(FrameEncoder(255, 190)) + command(FrameEncoder(255, 190), 1, 1), b""]

    class Station:
        def step(self, t_ns, frames):
            return words.pop(0)

    source = SignedCommands(Station(), AutopilotSigning(KEY))
    autopilot = pymavlink(KEY)
    # The clock of the autopilot is ahead, as after a simulated GPS fix, and is followed: older frames would be refused.
    autopilot.signing.timestamp += 10**9
    ahead = framed(said(autopilot))
    sent = source.step(0, [ahead])
    assert [m.get_type() for m in autopilot.parse_buffer(sent)] == ["HEARTBEAT", "COMMAND_LONG"]
    assert source.step(4_000_000, []) == b""


def test_which_frames_are_signed_anew() -> None:
    plain = heartbeat(FrameEncoder(200, 190))
    signed = Signer(KEY, 0).sign(plain)
    clients, same, other = ClientSigning(KEY), AutopilotSigning(KEY), AutopilotSigning(OTHER_KEY)
    assert for_autopilot(signed, clients, None) == signed
    assert for_autopilot(signed, None, other) == signed  # not checked by the bench
    assert for_autopilot(signed, clients, same) == signed
    anew = for_autopilot(signed, clients, other)
    assert [m.get_type() for m in pymavlink(OTHER_KEY).parse_buffer(anew)] == ["HEARTBEAT"]
    # A copy with the old signature would be a replay.
    assert copy_for_autopilot(signed, None, None) == plain
    again = copy_for_autopilot(signed, None, same)
    assert stamp(again)[1] > stamp(signed)[1]
    assert copy_for_autopilot(signed, None, other) == signed
    assert not is_signed(copy_for_autopilot(plain, None, same))


def test_key_files(tmp_path: Path) -> None:
    path = tmp_path / "key"
    path.write_text(KEY.secret.hex())
    path.chmod(0o600)
    assert read_key(path) == (KEY, "")
    path.chmod(0o640)
    key, warning = read_key(path)
    assert key == KEY
    assert "chmod 600" in warning
    path.write_text("\n")
    with pytest.raises(ConfigError, match="holds no signing key"):
        read_key(path)
    with pytest.raises(ConfigError, match="cannot be read"):
        read_key(tmp_path / "nowhere")
