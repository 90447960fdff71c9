"""The companion protocol, version 3, on the client's side: packing of headers, and checked reading of received headers.

Every message is multipart. Part 0 is the header, a msgpack map. Part 1 holds the bytes of arrays (C order, little
endian) unless they lie in shared memory. Types, ranges and sizes of a header are checked before any of it is used.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Any, Dict, Mapping

import msgpack

from hil_companion.errors import BadMessage, CutError
from hil_companion.link.checks import Fields

MAGIC = "hil-companion"
VERSION = 3
MODES = ("lockstep", "realtime", "latency_true")
REFUSALS = ("magic", "version", "schema", "topic", "name", "control", "full", "malformed")

MAX_HEADER_BYTES = 1 << 20
MAX_TOPICS = 1024
MAX_CREDIT = 64
MAX_WAYPOINTS = 10_000
MAX_REPORT_ENTRIES, MAX_REPORT_TEXT = 32, 200
_REPORT_NAME = re.compile(r"[A-Za-z0-9_]{1,64}\Z")

Header = Dict[str, Any]


def message(kind: str, **entries: Any) -> bytes:
    """Pack a header of this kind."""
    data: bytes = msgpack.packb({"k": kind, **entries}, use_bin_type=True)
    return data


def unpack(data: Any) -> Header:
    """Unpack a header: a map with its kind under `k`. Raises BadMessage."""
    size = len(data)
    if size > MAX_HEADER_BYTES:
        raise BadMessage(f"a header of {size} bytes; the limit is {MAX_HEADER_BYTES}")
    try:
        header = msgpack.unpackb(data, raw=False)
    # msgpack's errors for damaged bytes have no common base class.
    except (ValueError, TypeError, RecursionError, OverflowError, msgpack.UnpackException) as error:
        raise BadMessage(f"no msgpack in a header of {size} bytes ({type(error).__name__})") from error
    if not isinstance(header, dict) or not isinstance(header.get("k"), str):
        raise BadMessage("a header that does not say its kind (k)")
    return header


def checked_report(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return a CUT's report, a small flat map, with plain values. Raises CutError for what the bench would refuse."""
    if not isinstance(report, Mapping):
        kind = type(report).__name__
        raise CutError(f"the report of a CUT is a mapping of names to values or None, not a {kind}: use an attribute")
    if len(report) > MAX_REPORT_ENTRIES:
        raise CutError(f"a report of {len(report)} entries; the bench takes at most {MAX_REPORT_ENTRIES}")
    checked: dict[str, Any] = {}
    for name, value in report.items():
        if not isinstance(name, str) or not _REPORT_NAME.match(name):
            raise CutError(f"report {name!r}: names are 1 to 64 letters, digits and _")
        if isinstance(value, str):
            checked[name] = value[:MAX_REPORT_TEXT]
        elif isinstance(value, (bool, int)) and abs(value) < 2**53:
            checked[name] = value
        elif isinstance(value, float) and math.isfinite(value):
            checked[name] = float(value)
        else:
            raise CutError(f"report {name} {value!r}: a text, a boolean or a finite number is needed")
    return checked


@dataclass(frozen=True)
class Ring:
    """Shared memory into which the bench writes arrays."""

    name: str
    bytes: int


@dataclass(frozen=True)
class Welcome:
    """Description of the bench and of the session, sent to an accepted client."""

    schema: str
    session: str  # identifies one run of the bench; differs after a restart
    mode: str  # one of MODES
    tick_ns: int
    rate_hz: float
    topics: dict[str, dict[str, Any]]  # topic -> {"type": str, "fields": {name: [unit, frame]}}
    sensors: dict[str, dict[str, Any]]  # sensor -> calibration
    waypoints_W: tuple[tuple[float, float, float], ...]
    ports: dict[str, str]  # topic -> address; empty: all on the one socket
    ring: Ring | None
    control: bool
    views_every_ns: int = 0  # period of views in simulated time; 0: the bench wants none


@dataclass(frozen=True)
class End:
    """The bench's last message: PASS, FAIL, ERROR or "dropped", with a text."""

    status: str
    text: str


def read_welcome(header: Header) -> Welcome:
    """Check and convert a welcome. Raises BadMessage."""
    fields = Fields(header, "welcome")
    fields.integer("version", VERSION, VERSION)
    topics = fields.mapping("topics")
    if len(topics) > MAX_TOPICS:
        raise BadMessage(f"welcome.topics: {len(topics)}; the limit is {MAX_TOPICS}")
    for topic, described in topics.items():
        description = Fields(described, f"welcome.topics.{topic}")
        description.text("type", 100)
        description.mapping("fields")
    ports = fields.mapping("ports")
    if not all(isinstance(address, str) and len(address) < 512 for address in ports.values()):
        raise BadMessage("welcome.ports: addresses are text")
    sensors = fields.mapping("sensors")
    if not all(isinstance(sensor, dict) for sensor in sensors.values()):
        raise BadMessage("welcome.sensors: each is a map")
    return Welcome(
        schema=fields.text("schema", 64),
        session=fields.text("session", 64),
        mode=fields.choice("mode", MODES),
        tick_ns=fields.integer("tick_ns", 1),
        rate_hz=fields.number("rate_hz", 0.0, 1e6),
        topics=topics,
        sensors=sensors,
        waypoints_W=tuple(_point(p, i) for i, p in enumerate(fields.sequence("waypoints_W", MAX_WAYPOINTS))),
        ports=ports,
        ring=_ring(fields.optional_map("ring")),
        control=fields.boolean("control"),
        views_every_ns=fields.integer("views_every_ns") if fields.entries.get("views_every_ns") is not None else 0,
    )


def _point(point: Any, i: int) -> tuple[float, float, float]:
    path = f"welcome.waypoints_W[{i}]"
    if not isinstance(point, list) or len(point) != 3:
        raise BadMessage(f"{path}: three numbers are needed")
    fields = Fields(dict(zip("xyz", point)), path)
    return fields.number("x"), fields.number("y"), fields.number("z")


def _ring(entries: Header | None) -> Ring | None:
    if entries is None:
        return None
    fields = Fields(entries, "welcome.ring")
    name = fields.text("name", 255).lstrip("/")
    if not name or "/" in name or name.startswith("."):
        raise fields.type_error("name", "the plain name of a shared memory")
    return Ring(name, fields.integer("bytes", 1))


def read_end(header: Header) -> End:
    fields = Fields(header, "end")
    return End(fields.text("status", 40), fields.text("text"))


def ports_of_frame(header: Header) -> list[str] | None:
    """Return all topics of a frame that travels over several ports; None for a frame on one port. Raises BadMessage."""
    if header.get("ports_of_frame") is None:
        return None
    topics = Fields(header, "frame").sequence("ports_of_frame", MAX_TOPICS)
    if not all(isinstance(topic, str) for topic in topics) or len(set(topics)) != len(topics):
        raise BadMessage("frame.ports_of_frame: different topics are needed")
    return topics
