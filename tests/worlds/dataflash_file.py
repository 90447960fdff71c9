"""Writes ArduPilot DataFlash logs byte by byte, after AP_Logger's LogStructure.h, without pymavlink."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

_CODES = {
    "Q": "Q",
    "B": "B",
    "H": "H",
    "I": "I",
    "f": "f",
    "i": "i",
    "L": "i",
    "c": "h",
    "C": "H",
    "N": "16s",
    "M": "B",
}
_FMT = 0x80


class DataFlashFile:
    """One log: `message` declares a message, `add` appends one; a format's characters are those of ArduPilot."""

    def __init__(self, parameters: Mapping[str, float] | None = None) -> None:
        self._head = self._format(_FMT, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns", 89)
        self._types: dict[str, tuple[int, str]] = {}
        self._data: list[tuple[int, bytes]] = []
        self.message("PARM", "QNf", "TimeUS,Name,Value")
        for name, value in (parameters or {}).items():
            self.add("PARM", 0, name.encode(), value)

    def _format(self, number: int, name: str, characters: str, columns: str, length: int) -> bytes:
        body = struct.pack("<BB4s16s64s", number, length, name.encode(), characters.encode(), columns.encode())
        return b"\xa3\x95" + bytes([_FMT]) + body

    def message(self, name: str, characters: str, columns: str) -> None:
        number = 130 + len(self._types)
        codes = "<" + "".join(_CODES[c] for c in characters)
        self._types[name] = number, codes
        self._head += self._format(number, name, characters, columns, struct.calcsize(codes) + 3)

    def add(self, name: str, t_us: int, *values: Any) -> None:
        number, codes = self._types[name]
        self._data.append((t_us, b"\xa3\x95" + bytes([number]) + struct.pack(codes, t_us, *values)))

    def write(self, path: Path) -> Path:
        path.write_bytes(self._head + b"".join(body for _, body in sorted(self._data, key=lambda item: item[0])))
        return path
