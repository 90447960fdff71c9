"""Frames to the clients and their replies, as the rest of the bench sees them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from firmware_bridge.codecs.companion import ReportValue, TopicSchema
from signals.desired import DesiredState
from signals.detections import Detections


@dataclass(frozen=True)
class CompanionSample:
    """A sample of one topic. The arrays are sent C-contiguous and little-endian.

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
    """The samples released since the previous frame, in order."""

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
    t2_ns: int  # run time of its function
    t_received_ns: int  # client's clock
    t_sent_ns: int  # client's clock
    t_arrived_ns: int  # bench's clock
    clock_offset_ns: int  # client's clock minus the bench's
    t_frame_sent_ns: int = 0  # bench's clock
    report: Mapping[str, ReportValue] | None = None  # values that it reports; None: no new ones
    detections: Detections | None = None  # found in a picture; None: it examined none


@dataclass(frozen=True)
class SessionFacts:
    """Facts about the run that every client gets in its welcome, and the available topics."""

    topics: Mapping[str, TopicSchema]
    mode: str  # lockstep, realtime, latency_true
    tick_ns: int
    rate_hz: float
    sensors: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)  # calibration, by sensor
    waypoints_W: tuple[tuple[float, float, float], ...] = ()
    control: bool = True  # a client may control the vehicle
    views_every_ns: int = 0  # simulated time between the maps that a client sends for display; 0: none


@dataclass(frozen=True)
class ClientInfo:
    """A client that has joined."""

    name: str
    topics: frozenset[str]
    control: bool
    credit: int
    returned: int  # how often it reconnected after it was lost
