"""Declared ports, the wiring check, and demand pruning. All of it happens before the first step.

A stage says which ports it reads and writes. `plan_stages` answers three questions: does everything that is read
get written, exactly once; in which order must the stages run within a tick; and which stages does nobody need.

Within one tick data goes one way. An input in `delayed_inputs` is read one tick late (the value of tick k-1), which
is how the one loop of the bench closes: actuators[k-1] -> physics[k]. A loop without such an input is an algebraic
loop and is refused with its whole path.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter

from hil.signals.errors import WiringError
from hil.signals.samples import SAMPLE_FIELDS


@dataclass(frozen=True)
class Port:
    """A named stream of one sample type. Unit and frame of each field: `hil.signals.samples.SAMPLE_FIELDS`."""

    name: str
    type: type

    def __post_init__(self) -> None:
        if self.type not in SAMPLE_FIELDS:
            raise WiringError(
                f"port {self.name!r} carries {self.type.__name__}, which declares no units and frames "
                "(add it to SAMPLE_FIELDS in hil/signals/samples.py)"
            )


@dataclass(frozen=True)
class StageSpec:
    """What a stage reads and writes. `sink` marks a stage that is wanted for its own sake (a link, a recorder)."""

    name: str
    inputs: tuple[Port, ...] = ()
    outputs: tuple[Port, ...] = ()
    delayed_inputs: tuple[Port, ...] = ()
    sink: bool = False


@dataclass(frozen=True)
class Skipped:
    """A stage that is not run, and why: shown in the run report."""

    stage: str
    reason: str


@dataclass(frozen=True)
class StagePlan:
    """Stages in the order in which they run within a tick, and those left out."""

    order: tuple[str, ...]
    skipped: tuple[Skipped, ...] = field(default=())


def plan_stages(stages: Sequence[StageSpec]) -> StagePlan:
    """Check the wiring, drop what no sink needs, and order the rest.

    The order is topological, and a pure function of the input.
    Raises WiringError: duplicate stage names, a port written twice, an input nobody writes, a type mismatch, a loop.
    """
    producer = _producers(stages)
    _check_inputs(stages, producer)
    by_name = {stage.name: stage for stage in stages}
    needed = _demanded(stages, producer, by_name)
    skipped = tuple(
        Skipped(stage.name, "nobody consumes " + ", ".join(port.name for port in stage.outputs))
        for stage in stages
        if stage.name not in needed
    )
    return StagePlan(_topological([s for s in stages if s.name in needed], producer), skipped)


def _producers(stages: Iterable[StageSpec]) -> dict[str, str]:
    producer: dict[str, str] = {}
    names: set[str] = set()
    for stage in stages:
        if stage.name in names:
            raise WiringError(f"two stages are named {stage.name!r}")
        names.add(stage.name)
        for port in stage.outputs:
            if port.name in producer:
                raise WiringError(f"port {port.name!r} is written by both {producer[port.name]!r} and {stage.name!r}")
            producer[port.name] = stage.name
    return producer


def _check_inputs(stages: Iterable[StageSpec], producer: dict[str, str]) -> None:
    written = {port.name: port for stage in stages for port in stage.outputs}
    for stage in stages:
        for port in (*stage.inputs, *stage.delayed_inputs):
            if port.name not in producer:
                raise WiringError(f"stage {stage.name!r} reads port {port.name!r}, which nobody writes")
            if written[port.name].type is not port.type:
                raise WiringError(
                    f"stage {stage.name!r} reads port {port.name!r} as {port.type.__name__}, "
                    f"but {producer[port.name]!r} writes {written[port.name].type.__name__}"
                )


def _demanded(stages: Iterable[StageSpec], producer: dict[str, str], by_name: dict[str, StageSpec]) -> frozenset[str]:
    wanted: set[str] = set()
    queue = [stage.name for stage in stages if stage.sink]
    while queue:
        name = queue.pop()
        if name in wanted:
            continue
        wanted.add(name)
        stage = by_name[name]
        queue.extend(producer[port.name] for port in (*stage.inputs, *stage.delayed_inputs))
    return frozenset(wanted)


def _topological(stages: Sequence[StageSpec], producer: dict[str, str]) -> tuple[str, ...]:
    sorter = TopologicalSorter({stage.name: [producer[port.name] for port in stage.inputs] for stage in stages})
    try:
        return tuple(sorter.static_order())
    except CycleError as loop:
        raise WiringError("algebraic loop: " + " -> ".join(loop.args[1])) from None
