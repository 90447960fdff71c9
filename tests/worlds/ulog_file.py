"""Writes ULog files byte by byte, after the format's document (docs.px4.io, "ULog File Format"), without pyulog."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

_CODES = {"uint64_t": "Q", "int32_t": "i", "uint8_t": "B", "float": "f", "bool": "?", "uint32_t": "I", "uint16_t": "H"}


def _message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def _key(text: str) -> bytes:
    return struct.pack("<B", len(text)) + text.encode()


class ULogFile:
    """One log: `topic` declares a topic with its fields, `add` appends a message to it."""

    def __init__(self, parameters: Mapping[str, float] | None = None) -> None:
        self._head = b"ULog\x01\x12\x35" + b"\x01" + struct.pack("<Q", 0)
        self._definitions = _message("B", bytes(40))
        for name, value in (parameters or {}).items():
            kind, code = ("int32_t", "i") if isinstance(value, int) else ("float", "f")
            self._definitions += _message("P", _key(f"{kind} {name}") + struct.pack("<" + code, value))
        self._subscriptions = b""
        self._codes = dict(_CODES)
        self._topics: dict[str, tuple[int, str]] = {}
        self._data: list[tuple[int, bytes]] = []

    def info(self, name: str, text: str) -> None:
        self._definitions += _message("I", _key(f"char[{len(text)}] {name}") + text.encode())

    def nested(self, name: str, fields: Sequence[tuple[str, str]]) -> None:
        """Declare a type that topics may have as a field."""
        self._definitions += _message("F", f"{name}:{''.join(f'{kind} {field};' for kind, field in fields)}".encode())
        self._codes[name] = "".join(_CODES[kind] for kind, _ in fields)

    def topic(self, name: str, fields: Sequence[tuple[str, str]]) -> None:
        """Declare a topic; each field is (type, name), the name with [n] for an array. `timestamp` is put first."""
        declared, codes = ["uint64_t timestamp"], "<Q"
        for kind, field in fields:
            count = int(field[field.index("[") + 1 : -1]) if field.endswith("]") else 1
            bare = field.split("[")[0]
            declared.append(f"{kind}[{count}] {bare}" if field.endswith("]") else f"{kind} {bare}")
            codes += self._codes[kind] * count
        number = len(self._topics)
        self._topics[name] = number, codes
        self._definitions += _message("F", f"{name}:{';'.join(declared)};".encode())
        self._subscriptions += _message("A", struct.pack("<BH", 0, number) + name.encode())

    def add(self, name: str, t_us: int, *values: Any) -> None:
        number, codes = self._topics[name]
        self._data.append((t_us, _message("D", struct.pack("<H", number) + struct.pack(codes, t_us, *values))))

    def dropout(self, t_us: int, duration_ms: int) -> None:
        self._data.append((t_us, _message("O", struct.pack("<H", duration_ms))))

    def write(self, path: Path) -> Path:
        messages = b"".join(body for _, body in sorted(self._data, key=lambda item: item[0]))
        path.write_bytes(self._head + self._definitions + self._subscriptions + messages)
        return path
