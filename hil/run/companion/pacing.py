"""Kinds of time in which frames go to the clients, the rate of the frames, and the limits of waiting."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from signals.time import RateAccumulator

TimeMode = Literal["lockstep", "realtime", "latency_true"]


@dataclass(frozen=True)
class Timeouts:
    """Limits of waiting for a client, wall clock, and the consequence for the run."""

    reply_s: float  # for the answer to a frame
    reconnect_s: float  # for a lost client in control
    loss_is_error: bool  # True: the loss of a client in control ends the run


@dataclass(frozen=True)
class FramePacing:
    """Decides when frames are made, and from when on an answer applies."""

    mode: TimeMode
    rate: RateAccumulator  # of frames in ticks; its state advances once per tick
    timeouts: Timeouts
    link_delay_ns: int | None = None  # latency_true: charged per frame; None: the measured delay
