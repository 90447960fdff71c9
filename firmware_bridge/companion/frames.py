"""What goes to the clients and what comes back, as the bench sees it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from firmware_bridge.codecs.companion import ReportValue, TopicSchema
from hil.signals.desired import DesiredState
from hil.signals.detections import Detections


@dataclass(frozen=True)
class CompanionSample:
    """A sample of one topic. The arrays are C-contiguous and little-endian, or made so.

    `values` holds what msgpack can: numbers, texts, booleans, lists of them.
    """

    topic: str
    seq: int
    t_capture_ns: int
    t_available_ns: int
    values: Mapping[str, Any] = field(default_factory=dict)
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class CompanionFrame:
    """The samples released since the frame before, in order."""

    frame: int
    tick: int
    t_ns: int  # simulated
    samples: tuple[CompanionSample, ...]


class Reply(NamedTuple):
    """A client's answer to a frame."""

    client: str
    frame: int
    desired: DesiredState | None
    finished: bool
    t2_ns: int  # what its function took
    t_received_ns: int  # client's clock
    t_sent_ns: int  # client's clock
    t_arrived_ns: int  # bench's clock
    clock_offset_ns: int  # client's clock minus the bench's
    t_frame_sent_ns: int = 0  # bench's clock: when the frame went
    report: Mapping[str, ReportValue] | None = None  # what it says of itself; None: nothing new
    detections: Detections | None = None  # what it made out in a picture; None: it looked at none


@dataclass(frozen=True)
class SessionFacts:
    """What every client is told about the run, and the topics there are."""

    topics: Mapping[str, TopicSchema]
    mode: str  # lockstep, realtime, latency_true
    tick_ns: int
    rate_hz: float
    sensors: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # calibration, by sensor
    waypoints_W: tuple[tuple[float, float, float], ...] = ()
    control: bool = True  # whether what a client desires is flown at all
    views_every_ns: int = 0  # simulated; 0: no client need show anything


@dataclass(frozen=True)
class ClientInfo:
    """A client that has its place."""

    name: str
    topics: frozenset[str]
    control: bool
    credit: int
    returned: int  # how often it came back after it was lost
