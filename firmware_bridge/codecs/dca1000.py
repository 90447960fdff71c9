"""Datagrams of TI's DCA1000 capture card in raw mode (TI SPRUIJ4, DCA1000EVM user guide): data, and its commands.

    data      uint32 number of the packet, from 1; uint48 bytes sent before it; up to 1456 bytes of samples
    command   0xA55A, uint16 code, uint16 size, data, 0xEEAA
    answer    0xA55A, uint16 code, uint16 status (0: done), 0xEEAA

All little endian. The card's program receives data on port 4098 and answers on port 4096.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

DATA_PORT, COMMAND_PORT = 4098, 4096
MAX_SAMPLES_BYTES = 1456
RECORD_START, RECORD_STOP, READ_FPGA_VERSION = 0x05, 0x06, 0x0E
CODES = frozenset(range(0x01, 0x0F))
_HEADER, _FOOTER = 0xA55A, 0xEEAA
_COMMAND, _ANSWER, _UINT16 = struct.Struct("<HHH"), struct.Struct("<HHHH"), struct.Struct("<H")
_VERSION = 2 | 8 << 7  # major, minor: as boards of 2019 on answer


class DataStream:
    """Packets of one recording: samples are cut without regard to frames, and their rest waits for the next call."""

    def __init__(self) -> None:
        self.packets = 0
        self._sent_bytes = 0
        self._rest = b""

    def packets_of(self, samples: bytes) -> Iterator[bytes]:
        """Yield the full packets that these bytes complete."""
        data = self._rest + samples
        full = len(data) // MAX_SAMPLES_BYTES * MAX_SAMPLES_BYTES
        self._rest = data[full:]
        for first in range(0, full, MAX_SAMPLES_BYTES):
            self.packets += 1
            head = struct.pack("<I", self.packets) + self._sent_bytes.to_bytes(6, "little")
            self._sent_bytes += MAX_SAMPLES_BYTES
            yield head + data[first : first + MAX_SAMPLES_BYTES]


def command_code(datagram: bytes) -> int | None:
    """Return the code of a command; None for anything else."""
    if len(datagram) < _COMMAND.size + _UINT16.size:
        return None
    header, code, size = _COMMAND.unpack_from(datagram)
    if header != _HEADER or code not in CODES or len(datagram) != _COMMAND.size + size + _UINT16.size:
        return None
    return code if _UINT16.unpack_from(datagram, _COMMAND.size + size)[0] == _FOOTER else None


def answer(code: int) -> bytes:
    """Return the card's answer to a command, which it always carries out."""
    return _ANSWER.pack(_HEADER, code, _VERSION if code == READ_FPGA_VERSION else 0, _FOOTER)
