"""Faults of the link to the autopilot (the section `faults.links`): bytes lost, late, repeated or damaged."""

from __future__ import annotations

from typing import Any

from firmware_bridge.faults.faulty_transport import FaultyTransport
from firmware_bridge.faults.link_fault import LinkFault
from firmware_bridge.transports.transport import Transport
from hil.config import Bench
from hil.config.checks.intake_checks import link_refusal
from hil.run.part import Part, RunContext


class LinkFaultsPart(Part):
    name = "faults"

    def __init__(self, bench: Bench) -> None:
        self._config = bench.config
        self._run: RunContext | None = None
        self._transport: FaultyTransport | None = None

    @property
    def can_have_faults(self) -> bool:
        """True if faults can be injected into the link to the autopilot."""
        return self._transport is not None

    def open(self, run: RunContext) -> None:
        self._run = run

    def wrap_link(self, transport: Transport) -> Transport:
        run, faults = self._run, self._config.faults.links
        if run is None or not (faults or any(part.injects for part in run.parts)):
            return transport  # the wrapper takes time for every frame, even without a fault
        self._transport = FaultyTransport(transport, faults, self._config.noise_seed, run.now_ns, run.recorder.event)
        return self._transport

    def inject(self, fault: Any, *, declared: bool) -> bool:  # noqa: ARG002 (makes no difference here)
        if not isinstance(fault, LinkFault):
            return False
        if self._transport is None:
            raise ValueError("the link to this autopilot is not MAVLink: no faults can be injected into it")
        if (refused := link_refusal(self._config, fault)) is not None:
            raise ValueError("messages {} ({})".format(*refused))
        self._transport.inject(fault)
        return True

    @property
    def unmet(self) -> list[tuple[LinkFault, int]]:
        """Return the faults that hit nothing, each with the number of units that it could have hit."""
        transport = self._transport
        return [] if transport is None else [(transport.faults[i], count) for i, count in transport.unmet().items()]

    def run_keys(self) -> dict[str, Any]:
        faults = self._config.faults.links if self._transport is None else self._transport.faults
        hits = {} if self._transport is None else self._transport.hits()
        links = [{"kind": fault.kind, "hits": hits.get(index, 0)} for index, fault in enumerate(faults)]
        return {"faults": {"links": links}}


def make(bench: Bench) -> Part:
    return LinkFaultsPart(bench)
