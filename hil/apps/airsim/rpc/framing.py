"""Splits the bytes of one client into MessagePack messages, without making objects of them.

Objects of a hostile message need many times its bytes: `msgpack.Unpacker` makes them as the bytes come, for a message
of any length. Here a message is complete, and within both limits, before it is decoded.

An item is a value or the head of an array or map. A message is complete when no item is due: one is at its beginning, n
more with an array of n, and 2 n more with a map of n. Format: https://github.com/msgpack/msgpack/blob/master/spec.md
"""

from __future__ import annotations

MOST_BYTES = 8 << 20  # of one message: a path of 90 000 points
MOST_ITEMS = 3 << 19  # of one message; MOST_BYTES of AirSim's structs have fewer. An object has 90 bytes at most

MOST_DEPTH = 64  # of arrays and maps in each other

# Bytes of an item by its first one; 0: its length follows, in as many bytes as `_LENGTHS` says.
_SIZES = bytes(
    [1] * 0x80  # positive fixint
    + [1] * 0x20  # fixmap, fixarray
    + [1 + n for n in range(32)]  # fixstr
    + [1, 1, 1, 1]  # nil, (never used), false, true
    + [0] * 6  # bin, ext
    + [5, 9]  # float
    + [2, 3, 5, 9] * 2  # uint, int
    + [3, 4, 6, 10, 18]  # fixext
    + [0] * 7  # str, array, map
    + [1] * 0x20  # negative fixint
)
_BINS, _EXTENSIONS, _STRINGS = range(0xC4, 0xC7), range(0xC7, 0xCA), range(0xD9, 0xDC)
_ARRAYS, _MAPS = range(0xDC, 0xDE), range(0xDE, 0xE0)
_WIDTHS = (1, 2, 4)
_LENGTHS = {code: width for kind in (_BINS, _EXTENSIONS, _STRINGS) for code, width in zip(kind, _WIDTHS, strict=True)}
_LENGTHS |= {code: width for kind in (_ARRAYS, _MAPS) for code, width in zip(kind, _WIDTHS[1:], strict=True)}


class TooLarge(ValueError):
    """Message beyond a limit; the text says which one."""


class Framer:
    """Stream of one client."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._at = 0  # of the next item; beyond the bytes, if the present one is not complete
        self._items = 0  # of the message so far
        self._due = [1]  # items that are missing: of the message, of the array or map in it, of that in this, ...

    def __len__(self) -> int:
        """Bytes that are kept."""
        return len(self._bytes)

    def feed(self, data: bytes) -> None:
        """Add bytes of the client."""
        self._bytes += data

    def next(self) -> bytes | None:
        """Return the next complete message; None if there is none yet. Raises TooLarge, for good."""
        self._scan()
        if self._at > MOST_BYTES:
            raise TooLarge(f"a message of more than {MOST_BYTES} bytes")
        if self._due or self._at > len(self._bytes):
            return None
        message = bytes(memoryview(self._bytes)[: self._at])
        del self._bytes[: self._at]
        self._at, self._items, self._due = 0, 0, [1]
        return message

    def _scan(self) -> None:
        """Go over the items that have come."""
        data, at, items, due = self._bytes, self._at, self._items, self._due
        end = len(data)
        while due and at < end:
            code = data[at]
            size, more = _SIZES[code], 0
            if not size:
                size = 1 + _LENGTHS[code]
                if at + size > end:
                    break
                count = int.from_bytes(data[at + 1 : at + size], "big")
                if code in _ARRAYS:
                    more = count
                elif code in _MAPS:
                    more = 2 * count
                else:
                    size += count + (code in _EXTENSIONS)
            elif 0x80 <= code < 0xA0:
                more = code & 0x0F if code >= 0x90 else 2 * (code & 0x0F)
            at += size
            items += 1
            due[-1] -= 1
            if more:
                due.append(more)
                if len(due) > MOST_DEPTH:
                    raise TooLarge(f"a message of arrays and maps more than {MOST_DEPTH} deep")
            if items + more > MOST_ITEMS:
                raise TooLarge(f"a message of more than {MOST_ITEMS} values")
            while due and not due[-1]:
                due.pop()
        self._at, self._items = at, items
