"""Messages of the companion link, version 3, as pure functions: msgpack headers in and out.

Every message is multipart: a msgpack map, then, in frames only, the raw bytes of arrays (C order, little-endian). For a
client that reads shared memory a frame has no second part: the arrays lie in the memory. A client sends hello, credit,
done, view, ping and bye: `decode_client` turns their bytes into frozen dataclasses and refuses all other bytes
(`CodecError`, or `HelloRefused` with the code for the client). The bench sends welcome, refused, frame, pong and end:
the `encode_` functions.

`schema_hash` identifies the meaning of a session's arrays and values: topics, types, units, frames, and the keys of the
messages. A bench refuses a client that was built against another schema.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import isfinite
from typing import Any, NamedTuple

import msgpack

from firmware_bridge.codecs.companion_detections import KEYS as _DETECTIONS_KEYS
from firmware_bridge.codecs.companion_detections import detections_from_map
from firmware_bridge.codecs.companion_view import View, view_from_map
from firmware_bridge.codecs.errors import CodecError
from firmware_bridge.codecs.untrusted import number, shown, whole
from signals.desired import MAX_KNOTS, DesiredState, Knot
from signals.detections import Detections
from signals.samples import CHANNEL_UNITS, RADAR_UNITS, SAMPLE_FIELDS, ImageSample

MAGIC = "hil-companion"
VERSION = 3
MAX_CREDIT = 64  # frames
REFUSALS = ("magic", "version", "schema", "topic", "name", "control", "full", "malformed")
_NAME = re.compile(r"[A-Za-z0-9_.-]{1,64}")
_PATTERN = re.compile(r"[A-Za-z0-9_./*?\[\]!-]{1,128}")
_MAX_TOPICS = 32
_MAX_INT = 2**63 - 1
_MAX_TIME_NS = 2**62  # sums and differences of two times stay within 64 bits
_MAX_REPORT, _MAX_REPORT_TEXT = 32, 200  # entries of a client's report, characters of one
_REPORT_NAME = re.compile(r"[A-Za-z0-9_]{1,64}")
_MAX_REASON = 1000  # characters of a client's reason that are kept
_LARGEST = 1e9  # m, m/s, ...: far above any command, and its square is finite

# Keys of every message: part of the schema, so that a change of the protocol changes the hash.
_KEYS: dict[str, tuple[str, ...]] = {
    "hello": ("magic", "version", "schema", "name", "topics", "control", "credit", "shared_memory"),
    "credit": ("n",),
    "done": ("frame", "t_received_ns", "t_sent_ns", "t2_ns", "desired", "finished", "report", "detections"),
    "view": ("frame", "t_ns", "p_W", "yaw_rad", "goal_W", "plan_W", "particles_W", "map"),
    "ping": ("id", "t_client_ns", "bench_minus_client_ns", "round_trip_ns"),
    "bye": ("reason",),
    "welcome": (
        *("version", "schema", "session", "mode", "tick_ns", "rate_hz"),
        *("topics", "sensors", "waypoints_W", "ports", "ring", "control", "views_every_ns"),
    ),
    "refused": ("code", "text"),
    "frame": ("frame", "tick", "t_ns", "t_sent_ns", "dropped", "samples", "release", "ports_of_frame"),
    "pong": ("id", "t_client_ns", "t_bench_received_ns", "t_bench_sent_ns"),
    "end": ("status", "text"),
}


class HelloRefused(CodecError):
    """A hello that cannot be accepted. The client gets `code`, one of `REFUSALS`, and the text."""

    def __init__(self, code: str, message: str) -> None:
        self.code = code
        super().__init__(message)


def desired_from_map(values: object) -> DesiredState:
    """Validate and convert the map of a message. CodecError names the wrong entry."""
    if type(values) is not dict:
        raise CodecError(f"desired: {shown(values)} is not a map")
    unknown = [str(key)[:40] for key in values if key not in _DESIRED_KEYS]
    if unknown:
        raise CodecError(f"desired: unknown entries {', '.join(sorted(unknown)[:5])}")
    made: dict[str, Any] = {}
    for key, length in _DESIRED_LENGTHS.items():
        value = values.get(key)
        if value is not None:
            made[key] = _number(key, value) if length == 1 else _vector(key, value, length)
    for key in _DESIRED_FLAGS:
        flag = values.get(key)
        if flag is not None and type(flag) is not bool:
            raise CodecError(f"desired.{key}: {shown(flag)} is neither true nor false")
        made[key] = bool(flag)
    ahead = values.get("ahead")
    if ahead is not None:
        made["ahead"] = _knots(ahead)
    try:
        return DesiredState(**made)
    except ValueError as error:
        raise CodecError(f"desired: {error}") from error


def desired_map(desired: DesiredState) -> dict[str, Any]:
    """Return the map that `desired_from_map` takes, without the entries that are not commanded."""
    out: dict[str, Any] = {}
    for key in _DESIRED_LENGTHS:
        value = getattr(desired, key)
        if value is not None:
            out[key] = list(value) if isinstance(value, tuple) else value
    if desired.ahead:
        out["ahead"] = [[knot.dt_s, list(knot.p_W), list(knot.v_W)] for knot in desired.ahead]
    return out | {key: True for key in _DESIRED_FLAGS if getattr(desired, key)}


def _knots(values: object) -> tuple[Knot, ...]:
    if type(values) is not list or len(values) > MAX_KNOTS:
        raise CodecError(f"desired.ahead: {shown(values)}; expected a list of at most {MAX_KNOTS} knots")
    knots = []
    for i, knot in enumerate(values):
        if type(knot) is not list or len(knot) != 3:
            raise CodecError(f"desired.ahead[{i}]: {shown(knot)}; expected a time, a position and a velocity")
        p_W, v_W = (_vector(f"ahead[{i}]", v, 3) for v in knot[1:])
        knots.append(Knot(_number(f"ahead[{i}]", knot[0]), p_W, v_W))  # type: ignore[arg-type]
    return tuple(knots)


_DESIRED_LENGTHS = {
    "p_W": 3,
    "v_W": 3,
    "a_W": 3,
    "yaw_rad": 1,
    "yaw_rate_radps": 1,
    "q_WB": 4,
    "thrust": 1,
    "w_B": 3,
}
_DESIRED_FLAGS = ("land", "hold")
_DESIRED_KEYS = frozenset((*_DESIRED_LENGTHS, *_DESIRED_FLAGS, "ahead"))


ReportValue = str | bool | int | float


@dataclass(frozen=True)
class Hello:
    """A client's request to join; on the port of a sensor: the name of the client that connects."""

    name: str
    topics: tuple[str, ...]  # shell patterns
    control: bool
    credit: int
    shared_memory: bool
    schema: str | None
    session: str | None = None  # on the port of a sensor: the one from the welcome


@dataclass(frozen=True)
class Credit:
    n: int


class Done(NamedTuple):
    """The answer to a frame. Times are the client's monotonic clock."""

    frame: int
    t_received_ns: int
    t_sent_ns: int
    t2_ns: int  # run time of the client's function
    desired: DesiredState | None
    finished: bool
    report: Mapping[str, ReportValue] | None = None  # None: no new values
    detections: Detections | None = None  # None: it examined no picture


@dataclass(frozen=True)
class Ping:
    """A request for the bench's clock, with the client's own reading of the offset so far, if it has one."""

    id: int
    t_client_ns: int
    bench_minus_client_ns: int | None = None
    round_trip_ns: int | None = None


@dataclass(frozen=True)
class Bye:
    reason: str


ClientMessage = Hello | Credit | Done | View | Ping | Bye


@dataclass(frozen=True)
class TopicSchema:
    """The contents of a topic's samples: the type's name, and unit and frame of every field."""

    type: str
    fields: Mapping[str, tuple[str, str]]


def topic_schema(sample_type: type, channel: str | None = None) -> TopicSchema:
    """Return the schema from `SAMPLE_FIELDS`; for a camera or radar, whose topics are channels, of that channel."""
    fields = dict(SAMPLE_FIELDS[sample_type])
    if channel is not None:
        units = CHANNEL_UNITS if sample_type is ImageSample else RADAR_UNITS
        del fields["channels"]
        fields[channel] = units[channel]
    return TopicSchema(sample_type.__name__, fields)


@dataclass(frozen=True)
class Ring:
    """The shared memory that holds the arrays of frames."""

    name: str
    bytes: int


@dataclass(frozen=True)
class Welcome:
    """The reply to an accepted hello."""

    schema: str
    session: str
    mode: str
    tick_ns: int
    rate_hz: float
    topics: Mapping[str, TopicSchema]
    sensors: Mapping[str, Mapping[str, Any]]
    waypoints_W: Sequence[Sequence[float]]
    ports: Mapping[str, str]
    ring: Ring | None
    control: bool
    views_every_ns: int = 0  # simulated time between wanted views; 0: none


def schema_hash(topics: Mapping[str, TopicSchema]) -> str:
    """Return the first 16 hex digits of the SHA-256 over these topics and the messages of this version."""
    described = {name: [schema.type, {f: list(u) for f, u in schema.fields.items()}] for name, schema in topics.items()}
    messages = {k: list(v) for k, v in _KEYS.items()}
    parts = {"desired": sorted(_DESIRED_KEYS), "detections": list(_DETECTIONS_KEYS)}
    whole = {"version": VERSION, "topics": described, "messages": messages, **parts}
    text = json.dumps(whole, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode("ascii")).hexdigest()[:16]


def decode_client(raw: bytes | memoryview) -> ClientMessage:
    """Decode one message of a client. CodecError (HelloRefused for a hello) describes the fault."""
    try:
        message = msgpack.unpackb(
            raw, raw=False, strict_map_key=True, max_str_len=4096, max_array_len=1024, max_map_len=64, max_ext_len=0
        )
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        raise CodecError(f"{len(raw)} bytes are not a msgpack map ({str(error)[:100]})") from error
    if type(message) is not dict:
        raise CodecError(f"{shown(message)} is not a map")
    kind = message.get("k")
    decoder = _DECODERS.get(kind) if type(kind) is str else None
    if decoder is None:
        raise CodecError(f"k: {shown(kind)}; a client sends one of {', '.join(_DECODERS)}")
    return decoder(message)


def encode_welcome(welcome: Welcome) -> bytes:
    return pack({"k": "welcome", "version": VERSION, **asdict(welcome)})


def encode_refused(code: str, text: str) -> bytes:
    return pack({"k": "refused", "code": code, "text": text})


def encode_pong(ping: Ping, t_bench_received_ns: int, t_bench_sent_ns: int) -> bytes:
    times = {"t_bench_received_ns": t_bench_received_ns, "t_bench_sent_ns": t_bench_sent_ns}
    return pack({"k": "pong", "id": ping.id, "t_client_ns": ping.t_client_ns, **times})


def encode_end(status: str, text: str) -> bytes:
    return pack({"k": "end", "status": status, "text": text})


def pack(message: object) -> bytes:
    """Encode as msgpack."""
    return msgpack.packb(message, use_bin_type=True)


def _hello(m: dict[str, Any]) -> Hello:
    try:
        if m.get("magic") != MAGIC:
            raise HelloRefused("magic", f"magic {shown(m.get('magic'))}; expected {MAGIC!r}: is it another program?")
        if type(m.get("version")) is not int or m["version"] != VERSION:
            problem = f"version {shown(m.get('version'))}; the bench has {VERSION}: use the client from its rigs/jetson"
            raise HelloRefused("version", problem)
        name = m.get("name")
        if type(name) is not str or not _NAME.fullmatch(name):
            raise HelloRefused("name", f"name {shown(name)}; expected 1 to 64 characters of A-Z a-z 0-9 _ . -")
        topics = m.get("topics")
        if type(topics) is not list or not 1 <= len(topics) <= _MAX_TOPICS:
            raise CodecError(f"topics {shown(topics)}; expected a list of 1 to {_MAX_TOPICS} patterns")
        for topic in topics:
            if type(topic) is not str or not _PATTERN.fullmatch(topic):
                raise CodecError(f"topics: {shown(topic)} is not a pattern of topic names")
        schema, session = m.get("schema"), m.get("session")
        for key, text in (("schema", schema), ("session", session)):
            if text is not None and (type(text) is not str or len(text) > 64):
                raise CodecError(f"{key} {shown(text)}; expected text of at most 64 characters, or nil")
        return Hello(
            name,
            tuple(topics),
            _flag(m, "control"),
            _integer(m, "credit", 1, MAX_CREDIT),
            _flag(m, "shared_memory"),
            schema,
            session,
        )
    except HelloRefused:
        raise
    except CodecError as error:
        raise HelloRefused("malformed", f"hello: {error}") from error


def _credit(m: dict[str, Any]) -> Credit:
    return Credit(_integer(m, "n", 1, MAX_CREDIT))


def _done(m: dict[str, Any]) -> Done:
    desired = m.get("desired")
    return Done(
        _integer(m, "frame", 0, _MAX_INT),
        _integer(m, "t_received_ns", 0, _MAX_TIME_NS),
        _integer(m, "t_sent_ns", 0, _MAX_TIME_NS),
        _integer(m, "t2_ns", 0, _MAX_TIME_NS),
        None if desired is None else desired_from_map(desired),
        _flag(m, "finished"),
        None if m.get("report") is None else report_from_map(m["report"]),
        None if m.get("detections") is None else detections_from_map(m["detections"]),
    )


def report_from_map(values: object) -> dict[str, ReportValue]:
    """Validate a client's report: a flat map of texts, booleans and finite numbers. CodecError."""
    if type(values) is not dict or len(values) > _MAX_REPORT:
        raise CodecError(f"report: {shown(values)}; expected a map of at most {_MAX_REPORT} entries")
    made: dict[str, ReportValue] = {}
    for name, value in values.items():
        if type(name) is not str or not _REPORT_NAME.fullmatch(name):
            raise CodecError(f"report: {shown(name)} is not a name of 1 to 64 letters, digits and _")
        whole = type(value) is int and abs(value) < 2**53
        if not (type(value) is bool or whole or (type(value) is float and isfinite(value))) and (
            type(value) is not str or len(value) > _MAX_REPORT_TEXT
        ):
            raise CodecError(f"report.{name}: {shown(value)} is neither text, boolean nor finite number")
        made[name] = value
    return made


def _ping(m: dict[str, Any]) -> Ping:
    number, t_client_ns = _integer(m, "id", 0, _MAX_INT), _integer(m, "t_client_ns", 0, _MAX_TIME_NS)
    if m.get("bench_minus_client_ns") is None or m.get("round_trip_ns") is None:
        return Ping(number, t_client_ns)
    offset_ns = _integer(m, "bench_minus_client_ns", -_MAX_TIME_NS, _MAX_TIME_NS)
    return Ping(number, t_client_ns, offset_ns, _integer(m, "round_trip_ns", 0, _MAX_TIME_NS))


def _bye(m: dict[str, Any]) -> Bye:
    reason = m.get("reason")
    if type(reason) is not str:
        raise CodecError(f"bye.reason: {shown(reason)} is not a text")
    return Bye(reason[:_MAX_REASON])


_DECODERS: dict[str, Callable[[dict[str, Any]], ClientMessage]] = {
    "hello": _hello,
    "credit": _credit,
    "done": _done,
    "view": view_from_map,
    "ping": _ping,
    "bye": _bye,
}


def _integer(m: dict[str, Any], key: str, low: int, high: int) -> int:
    return whole(f"{m['k']}.{key}", m.get(key), low, high)


def _flag(m: dict[str, Any], key: str) -> bool:
    value = m.get(key)
    if type(value) is not bool:
        raise CodecError(f"{m['k']}.{key}: {shown(value)} is neither true nor false")
    return value


def _number(key: str, value: object) -> float:
    return number(f"desired.{key}", value, _LARGEST)


def _vector(key: str, value: object, length: int) -> tuple[float, ...]:
    if type(value) is not list or len(value) != length:
        raise CodecError(f"desired.{key}: {shown(value)}; expected {length} numbers")
    return tuple(_number(f"{key}[{i}]", v) for i, v in enumerate(value))
