"""From what a page asks to break to the fault that begins now: a rotor, a sensor, a link, or a gust."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from firmware_bridge.faults.link_fault import LinkFault
from hil.companion.link_faults import CompanionFault
from sim.physics.faults import RotorFault
from sim.scene.wind import GustEvent
from sim.sensors.faults import FAULT_LIST

AUTOPILOT = "autopilot"  # the link of that name; every other is a companion's


def fault_of(asked: Mapping[str, Any], at_s: float) -> tuple[Any, str]:
    """The fault, and the words for it. ValueError, KeyError, TypeError and pydantic's where there is no such thing.

    `for_s` in place of an end; `link`: `autopilot`, or the name of a client.
    """
    fault = dict(asked)
    lasts_s = fault.pop("for_s", None)
    ending = "" if lasts_s is None else f" for {float(lasts_s):g} s"
    if "rotor" in fault:
        rotor = RotorFault.model_validate(fault | {"at_s": at_s})
        return rotor, rotor.text
    if "sensor" in fault:
        until = {} if lasts_s is None else {"until_s": at_s + float(lasts_s)}
        return FAULT_LIST.validate_python([fault | {"at_s": at_s} | until])[
            0
        ], f"{fault['sensor']}: {fault.get('kind')}"
    if "link" in fault:
        link = str(fault.pop("link"))
        fault |= {"at_s": at_s} | ({} if lasts_s is None else {"for_s": float(lasts_s)})
        if link == AUTOPILOT:
            names = fault.get("messages")
            wire = LinkFault.model_validate(fault | ({"messages": tuple(names)} if isinstance(names, list) else {}))
            return wire, f"link of the autopilot: {_link_words(wire)}{ending}"
        other = CompanionFault.model_validate(fault | {"client": link})
        return other, f"link of {link}: {_link_words(other)}{ending}"
    gust = GustEvent.model_validate(fault | {"at_s": at_s})
    return gust, gust.text


def _link_words(fault: LinkFault | CompanionFault) -> str:
    rate = "" if fault.rate is None else f" {100 * fault.rate:g} %"
    named = f" of {', '.join(fault.messages)}" if isinstance(fault, LinkFault) and fault.messages else ""
    late = "" if fault.delay_s is None else f" by {fault.delay_s:g} s"
    return f"{fault.kind}{rate}{named}{late}"
