"""Type hashes of ROS 2, which nodes compare when they discover each other (REP 2011, "RIHS01").

    RIHS01_ + SHA-256 of the type's description as JSON: its fields, then those of all types that it contains, sorted by
    name; without constants, default values and comments

Numbers of the field types: type_description_interfaces/msg/FieldType.msg. An array is 48 and a sequence 144 higher.
"""

from __future__ import annotations

import hashlib
import json
from functools import cache
from typing import Any

from hil.run.recorder.mcap.cdr import fields

_NESTED = 1
_FIELD_TYPES = {
    "int8": 2,
    "uint8": 3,
    "int16": 4,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float32": 10,
    "float64": 11,
    "bool": 15,
    "byte": 16,
    "string": 17,
}
_ARRAY, _SEQUENCE = 48, 144


def full_name(type_name: str) -> str:
    """Return "package/msg/Name" of "package/Name"."""
    package, name = type_name.split("/")
    return f"{package}/msg/{name}"


def _description(type_name: str) -> dict[str, Any]:
    described = []
    for field in fields(type_name):
        nested = field.type not in _FIELD_TYPES
        length = field.length
        kind = (_NESTED if nested else _FIELD_TYPES[field.type]) + (
            0 if length is None else _SEQUENCE if length == -1 else _ARRAY
        )
        described.append(
            {
                "name": field.name,
                "type": {
                    "type_id": kind,
                    "capacity": max(length or 0, 0),
                    "string_capacity": 0,
                    "nested_type_name": full_name(field.type) if nested else "",
                },
            }
        )
    return {"type_name": full_name(type_name), "fields": described}


def _contained(type_name: str) -> set[str]:
    direct = {field.type for field in fields(type_name) if field.type not in _FIELD_TYPES}
    return direct.union(*map(_contained, direct))


@cache
def type_hash(type_name: str) -> str:
    """Return the hash of a type "package/Name" as "RIHS01_...", 71 characters."""
    description = {
        "type_description": _description(type_name),
        "referenced_type_descriptions": [_description(name) for name in sorted(_contained(type_name), key=full_name)],
    }
    text = json.dumps(description, separators=(", ", ": "))
    return f"RIHS01_{hashlib.sha256(text.encode()).hexdigest()}"
