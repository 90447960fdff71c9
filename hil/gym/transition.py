"""Step of an environment as functions of the user see it."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from numpy.typing import NDArray

from signals.samples import TruthState


class Transition(NamedTuple):
    """One step of a vehicle in `hil/Bench-v0` or `parallel_env`, for their functions `reward` and `end`."""

    before: TruthState
    after: TruthState
    action: tuple[float, ...]  # -1..1
    observation: Mapping[str, NDArray[Any]]  # after the step
    t_s: float  # simulated time after the step
    departed: bool  # the vehicle left the range of the model and was stopped
    vehicle: str = ""  # its name in a bench with several
    others: Mapping[str, TruthState] = MappingProxyType({})  # states of the other vehicles after the step
    met: tuple[str, ...] = ()  # vehicles that it touched, reported in this step
    touched: bool = False  # anything, in any tick of this step: also a bounce that ended before `after`
