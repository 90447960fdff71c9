"""Type hashes of ROS 2, which nodes compare when they discover each other (REP 2011, "RIHS01")."""

from __future__ import annotations

from functools import cache

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from hil.run.recorder.mcap.ros2_messages import DEFINITIONS


def _full_name(type_name: str) -> str:
    """Return "package/msg/Name" of "package/Name"."""
    return type_name.replace("/", "/msg/")


@cache
def _types() -> Typestore:
    """Return the types of the recording, and no others: a distribution's own may differ from them."""
    store = get_typestore(Stores.EMPTY)
    for name, definition in DEFINITIONS.items():
        store.register(get_types_from_msg(definition, _full_name(name)))
    return store


@cache
def type_hash(type_name: str) -> str:
    """Return the hash of a type "package/Name" as "RIHS01_...", 71 characters."""
    return _types().hash_rihs01(_full_name(type_name))
