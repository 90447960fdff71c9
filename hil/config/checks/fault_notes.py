"""Notes on declared faults and gusts whose numbers change nothing: a flight under one says nothing about it."""

from __future__ import annotations

from hil.config.bench import Bench

_NEUTRAL = {"value": 0.0, "rate_per_s": 0.0, "factor": 1.0, "rate": 0.0}  # numbers with which a fault does nothing


def fault_notes(bench: Bench) -> list[str]:
    """Describe the faults and gusts that cannot have an effect."""
    config = bench.config
    faults = config.faults
    notes = []
    for section, entries in (("rotors", faults.rotors), ("sensors", faults.sensors), ("links", faults.links)):
        for index, fault in enumerate(entries):
            for key, neutral in _NEUTRAL.items():
                if getattr(fault, key, None) == neutral:
                    notes.append(f"faults.{section}[{index}]: {fault.kind} with {key} {neutral:g} changes nothing")
    for index, gust in enumerate(() if config.wind is None else config.wind.gusts):
        if not any(gust.velocity_W_mps):
            notes.append(f"wind.gusts[{index}]: a gust of 0 m/s changes nothing")
    return notes
