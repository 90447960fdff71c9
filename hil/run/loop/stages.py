"""Declared ports, the wiring check, and the removal of stages without a consumer, all before the first tick.

A stage declares the ports that it reads and writes. `plan_stages` checks that exactly one stage writes each port
that is read, orders the stages within a tick, and drops the stages whose output no sink needs.

Within one tick data flows one way. An input in `delayed_inputs` is read one tick late (the value of tick k-1), which
closes the one loop of the bench: actuators[k-1] -> physics[k]. A loop without such an input is an algebraic loop and
is refused with its whole path.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter

from signals.errors import WiringError
from signals.samples import SAMPLE_FIELDS


@dataclass(frozen=True)
class Port:
    """A named stream of one sample type. Unit and frame of each field: `signals.samples.SAMPLE_FIELDS`."""

    name: str
    type: type

    def __post_init__(self) -> None:
        if self.type not in SAMPLE_FIELDS:
            raise WiringError(
                f"port {self.name!r} carries {self.type.__name__}, which declares no units and frames "
                "(add it to SAMPLE_FIELDS in signals/samples.py)"
            )


@dataclass(frozen=True)
class StageSpec:
    """Inputs and outputs of a stage. `sink` marks a stage that runs for its own effect (a link, a recorder)."""

    name: str
    inputs: tuple[Port, ...] = ()
    outputs: tuple[Port, ...] = ()
    delayed_inputs: tuple[Port, ...] = ()
    sink: bool = False


@dataclass(frozen=True)
class Skipped:
    """A stage that is not run, with the reason that the run report shows."""

    stage: str
    reason: str


@dataclass(frozen=True)
class StagePlan:
    """Stages in the order in which they run within a tick, and the skipped ones."""

    order: tuple[str, ...]
    skipped: tuple[Skipped, ...] = field(default=())


def plan_stages(stages: Sequence[StageSpec]) -> StagePlan:
    """Check the wiring, drop the stages that no sink needs, and order the rest.

    The order is topological, and a pure function of the input.
    Raises WiringError: duplicate stage names, a port written twice, an input that no stage writes, a type mismatch,
    a loop.
    """
    producer = _producers(stages)
    _check_inputs(stages, producer)
    by_name = {stage.name: stage for stage in stages}
    needed = _needed(stages, producer, by_name)
    skipped = tuple(
        Skipped(stage.name, "no consumer for " + ", ".join(port.name for port in stage.outputs))
        for stage in stages
        if stage.name not in needed
    )
    return StagePlan(_topological([s for s in stages if s.name in needed], producer), skipped)


def _producers(stages: Iterable[StageSpec]) -> dict[str, str]:
    """Return port name -> name of the stage that writes it."""
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
                raise WiringError(f"stage {stage.name!r} reads port {port.name!r}, which no stage writes")
            if written[port.name].type is not port.type:
                raise WiringError(
                    f"stage {stage.name!r} reads port {port.name!r} as {port.type.__name__}, "
                    f"but {producer[port.name]!r} writes {written[port.name].type.__name__}"
                )


def _needed(stages: Iterable[StageSpec], producer: dict[str, str], by_name: dict[str, StageSpec]) -> frozenset[str]:
    """Return the names of the sinks and of all stages that they need, directly or through other stages."""
    needed: set[str] = set()
    queue = [stage.name for stage in stages if stage.sink]
    while queue:
        name = queue.pop()
        if name in needed:
            continue
        needed.add(name)
        stage = by_name[name]
        queue.extend(producer[port.name] for port in (*stage.inputs, *stage.delayed_inputs))
    return frozenset(needed)


def _topological(stages: Sequence[StageSpec], producer: dict[str, str]) -> tuple[str, ...]:
    sorter = TopologicalSorter({stage.name: [producer[port.name] for port in stage.inputs] for stage in stages})
    try:
        return tuple(sorter.static_order())
    except CycleError as loop:
        raise WiringError("algebraic loop: " + " -> ".join(loop.args[1])) from None
