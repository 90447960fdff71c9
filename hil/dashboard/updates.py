"""What goes to a page in one message: a head in JSON, and the bytes of the streams that it announces.

uint32 length of the head, the head, then the bodies one behind the other in the order of `frames`, each of `length`.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hil.dashboard.pictures import Shown

HEAD = struct.Struct("<I")
_JSON = json.JSONEncoder(separators=(",", ":"), allow_nan=False)


def packed_update(head: Mapping[str, Any], frames: Iterable[Shown]) -> bytes:
    """The message."""
    shown = list(frames)
    whole = dict(head) | {"frames": [one.head | {"length": len(one.data)} for one in shown]}
    try:
        text = _JSON.encode(whole).encode()
    except ValueError:
        text = _JSON.encode(_finite(whole)).encode()
    text += b" " * (-(len(text) + HEAD.size) % 4)  # so that floats in what follows are aligned
    return HEAD.pack(len(text)) + text + b"".join(one.data for one in shown)


def _finite(value: Any) -> Any:
    """JSON has no NaN: null instead."""
    if isinstance(value, float):
        return value if value - value == 0.0 else None
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value
