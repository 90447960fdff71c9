"""Makes the fault that a page requests: of a rotor, a surface, a sensor or a link, or a gust."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from firmware_bridge.faults.companion_fault import CompanionFault
from firmware_bridge.faults.link_fault import LinkFault
from sim.physics.faults import RotorFault
from sim.physics.surface_faults import SurfaceFault
from sim.scene.wind import GustEvent
from sim.sensors.faults import FAULT_LIST

AUTOPILOT = "autopilot"  # name of the autopilot's link; any other name is a companion


def requested_fault(request: Mapping[str, Any], at_s: float) -> tuple[Any, str]:
    """Return the fault that begins at `at_s`, and its description for the log.

    The request has the fields of a fault in a bench file, that of a sensor or link with `for_s` [s] in place of its
    end; `link` is `autopilot` or the name of a companion. Raises ValueError, KeyError, TypeError, OverflowError or
    pydantic's ValidationError for anything else.
    """
    fields = dict(request)
    if "rotor" in fields:
        rotor = RotorFault.model_validate(fields | {"at_s": at_s})
        return rotor, rotor.text
    if "surface" in fields:
        surface = SurfaceFault.model_validate(fields | {"at_s": at_s})
        return surface, surface.text
    if not ("sensor" in fields or "link" in fields):
        gust = GustEvent.model_validate(fields | {"at_s": at_s})
        return gust, gust.text
    for_s = fields.pop("for_s", None)
    if "sensor" in fields:
        until = {} if for_s is None else {"until_s": at_s + float(for_s)}
        (fault,) = FAULT_LIST.validate_python([fields | {"at_s": at_s} | until])
        return fault, f"{fields['sensor']}: {fields.get('kind')}"
    link = str(fields.pop("link"))
    fields |= {"at_s": at_s} | ({} if for_s is None else {"for_s": float(for_s)})
    if link == AUTOPILOT:
        names = fields.get("messages")
        messages = {"messages": tuple(names)} if isinstance(names, list) else {}
        autopilot_fault = LinkFault.model_validate(fields | messages)
        return autopilot_fault, f"link of the autopilot: {_link_text(autopilot_fault)}"
    companion_fault = CompanionFault.model_validate(fields | {"client": link})
    return companion_fault, f"link of {link}: {_link_text(companion_fault)}"


def _link_text(fault: LinkFault | CompanionFault) -> str:
    rate = "" if fault.rate is None else f" {100 * fault.rate:g} %"
    messages = f" of {', '.join(fault.messages)}" if isinstance(fault, LinkFault) and fault.messages else ""
    delay = "" if fault.delay_s is None else f" by {fault.delay_s:g} s"
    duration = "" if fault.for_s is None else f" for {fault.for_s:g} s"
    return f"{fault.kind}{rate}{messages}{delay}{duration}"
