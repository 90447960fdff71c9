"""Datagrams of the DCA1000: packets in order, and the commands of TI's user guide as openradar writes them."""

from __future__ import annotations

import struct

import pytest

from firmware_bridge.codecs.dca1000 import DataStream, answer, command_code


def test_packets_hold_the_samples_in_order() -> None:
    stream, samples = DataStream(), bytes(range(256)) * 40
    sent = [packet for k in range(0, len(samples), 1000) for packet in stream.packets_of(samples[k : k + 1000])]
    assert len(sent) == len(samples) // 1456
    for k, packet in enumerate(sent):
        number, low, high = struct.unpack_from("<IIH", packet)
        assert (number, low | high << 32, len(packet)) == (k + 1, 1456 * k, 1466)
    assert b"".join(packet[10:] for packet in sent) == samples[: 1456 * len(sent)]


def test_the_count_of_bytes_has_48_bits() -> None:
    stream = DataStream()
    stream._sent_bytes = (1 << 32) + 5
    (packet,) = stream.packets_of(bytes(1456))
    assert packet[4:10] == bytes([5, 0, 0, 0, 1, 0])


@pytest.mark.parametrize(
    ("command", "code", "answered"),
    [
        ("5aa509000000aaee", 0x09, "5aa509000000aaee"),  # connect
        ("5aa50e000000aaee", 0x0E, "5aa50e000204aaee"),  # version 2.8
        ("5aa50b000600c005350c0000aaee", 0x0B, "5aa50b000000aaee"),  # packet size and delay
        ("5aa505000000aaee", 0x05, "5aa505000000aaee"),  # start
    ],
)
def test_commands_are_answered(command: str, code: int, answered: str) -> None:
    assert command_code(bytes.fromhex(command)) == code
    assert answer(code).hex() == answered


@pytest.mark.parametrize(
    "datagram", ["", "5aa5", "5ba509000000aaee", "5aa509000000aaef", "5aa509000100aaee", "5aa50f000000aaee"]
)
def test_anything_else_is_no_command(datagram: str) -> None:
    assert command_code(bytes.fromhex(datagram)) is None
