"""Notes on declared faults and gusts whose numbers change nothing: a flight under one says nothing about it."""

from __future__ import annotations

from typing import Any

from hil.config.bench import Bench
from hil.config.missions.script import injected_at

_NEUTRAL = {"value": 0.0, "rate_per_s": 0.0, "factor": 1.0, "rate": 0.0}  # numbers with which a fault does nothing


def fault_notes(bench: Bench) -> list[str]:
    """Describe the faults and gusts that cannot have an effect."""
    config = bench.config
    faults = config.faults
    sections = (("rotors", faults.rotors), ("sensors", faults.sensors), ("links", faults.links))
    declared: list[tuple[str, Any]] = [
        (f"faults.{section}[{i}]", fault) for section, entries in sections for i, fault in enumerate(entries)
    ]
    script = bench.script
    for index, spec in enumerate(() if script is None else script.script.actions):
        if script is not None and spec.fault is not None and not spec.in_settings:
            declared.append((script.document.where(("actions", index, "fault")), injected_at(spec, 0.0)))
    notes = [
        f"{place}: {fault.kind} with {key} {neutral:g} changes nothing"
        for place, fault in declared
        for key, neutral in _NEUTRAL.items()
        if getattr(fault, key, None) == neutral
    ]
    for index, gust in enumerate(() if config.wind is None else config.wind.gusts):
        if not any(gust.velocity_W_mps):
            notes.append(f"wind.gusts[{index}]: a gust of 0 m/s changes nothing")
    return notes
