"""MessagePack of replies, with the number types of AirSim's structs.

A Python float becomes a float32 and a `Double` a float64, because AirSim's structs hold `float` nearly everywhere and
clients see the difference. A numpy array of one dimension becomes an array of float32 (floating types) or of integers.
Bytes are `bin`, mappings are maps with keys in their order, and every other sequence is an array.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

_PACKER = msgpack.Packer(use_single_float=True, unicode_errors="surrogateescape")
_DOUBLES = msgpack.Packer()
_FLOAT32_MAX = 3.4028235677973366e38  # half a step above the greatest float32
_FLOAT_ITEM = np.dtype([("code", "u1"), ("value", ">f4")])
_INT_ITEM = np.dtype([("code", "u1"), ("value", ">i4")])


class Double(float):
    """Number that AirSim sends as float64: latitudes and longitudes."""


def pack(value: Any) -> bytes:
    """Return the MessagePack of a value. Raises TypeError for a type that has none here."""
    out = bytearray()
    _put(out, value)
    return bytes(out)


def _put(out: bytearray, value: Any) -> None:
    put = _PUT.get(type(value))
    if put is not None:
        put(out, value)
    elif isinstance(value, tuple):  # a NamedTuple is a struct: a map
        fields = getattr(value, "_fields", None)
        if fields is None:
            _put_array(out, value)
        else:
            _put_map(out, dict(zip(fields, value, strict=True)))
    elif isinstance(value, np.ndarray):
        _put_numbers(out, value)
    elif isinstance(value, np.floating):
        _put_float(out, float(value))
    elif isinstance(value, np.integer | int):  # an enumeration is an int
        _put_int(out, int(value))
    elif isinstance(value, str):
        _put_plain(out, str(value))
    else:
        raise TypeError(f"a reply cannot hold a {type(value).__name__}")


def _put_plain(out: bytearray, value: Any) -> None:
    out += _PACKER.pack(value)


def _put_float(out: bytearray, value: float) -> None:
    if abs(value) >= _FLOAT32_MAX:  # NaN passes
        value = float("inf") if value > 0.0 else float("-inf")
    out += _PACKER.pack(value)


def _put_double(out: bytearray, value: Double) -> None:
    out += _DOUBLES.pack(value)


def _put_int(out: bytearray, value: int) -> None:
    if 0 <= value < 0x80:
        out.append(value)
    elif -32 <= value < 0:
        out.append(value & 0xFF)
    elif 0 <= value < 1 << 32:
        out += struct.pack(">BI", 0xCE, value)
    elif 0 <= value < 1 << 64:
        out += struct.pack(">BQ", 0xCF, value)
    else:
        out += struct.pack(">Bq", 0xD3, value)


def _put_array(out: bytearray, value: Sequence[Any]) -> None:
    out += _PACKER.pack_array_header(len(value))
    for item in value:
        _put(out, item)


def _put_map(out: bytearray, value: Mapping[Any, Any]) -> None:
    out += _PACKER.pack_map_header(len(value))
    for key, item in value.items():
        _put(out, key)
        _put(out, item)


def _put_numbers(out: bytearray, value: NDArray[Any]) -> None:
    if value.ndim != 1:
        raise TypeError(f"a reply cannot hold an array of shape {value.shape}")
    out += _PACKER.pack_array_header(len(value))
    floating = value.dtype.kind == "f"
    items = np.empty(len(value), _FLOAT_ITEM if floating else _INT_ITEM)
    items["code"] = 0xCA if floating else 0xD2
    items["value"] = value
    out += items.tobytes()


_PUT: dict[type, Callable[[bytearray, Any], None]] = {
    type(None): _put_plain,
    bool: _put_plain,
    int: _put_int,
    float: _put_float,
    Double: _put_double,
    str: _put_plain,
    bytes: _put_plain,
    bytearray: _put_plain,
    memoryview: _put_plain,
    list: _put_array,
    tuple: _put_array,
    dict: _put_map,
}
