"""The checksum of files and recordings, against zlib's."""

from __future__ import annotations

import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim._kernels import crc32

NOISE = bytes((i * i * 2654435761 >> 13) & 255 for i in range(1 << 15))


@given(st.integers(0, 1200), st.integers(0, 70), st.integers(0, 2**32 - 1), st.booleans())
def test_any_length_any_place_any_start(size: int, skip: int, before: int, tables: bool) -> None:
    data = memoryview(NOISE)[skip : skip + size]
    assert crc32(data, before, tables) == zlib.crc32(data, before)


@pytest.mark.parametrize("tables", [False, True])
def test_long_ones_and_pieces(tables: bool) -> None:
    data = NOISE * 9 + b"end"
    assert crc32(data, 0, tables) == zlib.crc32(data)
    for cut in (1, 63, 64, 65, 4095, len(data) - 1):
        assert crc32(data[cut:], crc32(data[:cut], 0, tables), tables) == zlib.crc32(data)
    assert crc32(b"123456789", 0, tables) == 0xCBF43926  # the standard's own check value


def test_every_bit_counts() -> None:
    data = bytearray(NOISE[:200])
    whole = crc32(data)
    for at in range(200):
        data[at] ^= 1 << (at % 8)
        assert crc32(data) != whole
        data[at] ^= 1 << (at % 8)
    assert crc32(data) == whole


@pytest.mark.parametrize("wrong", ["text", 3, None])
def test_only_bytes(wrong: object) -> None:
    with pytest.raises(TypeError):
        crc32(wrong)  # type: ignore[arg-type]
