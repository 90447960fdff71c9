"""Time mode of the companion link, rate of the frames, and timeouts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from signals.time import RateAccumulator

TimeMode = Literal["lockstep", "realtime", "latency_true"]


@dataclass(frozen=True)
class Timeouts:
    """Timeouts for a client in wall-clock time, and the consequence for the run."""

    reply_s: float  # until the answer to a frame
    reconnect_s: float  # until a lost client in control reconnects
    loss_is_error: bool  # True: the loss of a client in control ends the run


@dataclass(frozen=True)
class FramePacing:
    """Settings that decide when frames are made, and from which time on an answer applies."""

    mode: TimeMode
    rate: RateAccumulator  # of frames in ticks; its state advances once per tick
    timeouts: Timeouts
    link_delay_ns: int | None = None  # latency_true: charged per frame; None: the measured delay
