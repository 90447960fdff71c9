"""`hil bench link`, the part of the companion: flights on this machine, and transfers between two hosts.

Transfers say how much of a bare socket's rate the link reaches with the same bytes between the same processes; their
error is arrays that do not arrive as they were sent. The link has its keys (CURVE), the bare socket sends in clear.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

from firmware_bridge.companion.keys import make_keys
from firmware_bridge.companion.settings import Arrangement
from hil.bench_suite.link_companion_flight import measure_flights
from hil.bench_suite.link_companion_frame import AHEAD, frame_arrays
from hil.bench_suite.link_companion_transfer import Rates, Wire, far_end
from hil.bench_suite.result import BenchmarkResult, Check, Row
from hil.bench_suite.second_host import SecondHost, why_not

Say = Callable[[str], None]

_OF_BARE = 0.8
_WIRED: tuple[Arrangement, ...] = ("one_port", "ports")
_MODES = {"stop-and-wait": 1, "streaming": AHEAD}


def measure_companion(result: BenchmarkResult, folder: Path, say: Say, *, quick: bool) -> None:
    """Rows and checks. HilError if a flight ends as ERROR or a link breaks."""
    folder.mkdir()
    measure_flights(result, folder, say, seconds=1.5 if quick else 10.0)
    reason = why_not()
    if reason is not None:
        result.left_out.append(f"companion: transfers between two hosts ({reason})")
        return
    keys = folder / "keys"
    make_keys(keys, ["peer"])
    with SecondHost() as host:
        if not host.delayed:
            result.left_out.append("companion: 0.2 ms of delay between the two hosts (this kernel has no netem)")
        wire = Wire(host.near, host.command(()), keys)
        for arrangement in _WIRED:
            say(f"transfers between two hosts, {arrangement}")
            measure_transfers(result, wire, arrangement, 0.35 if quick else 3.0, host.shape)


def measure_transfers(
    result: BenchmarkResult, wire: Wire, arrangement: Arrangement, seconds: float, shape: str
) -> None:
    """Both ways of sending; `shape`: of the wire, for people."""
    case = "transfer, two hosts"
    with far_end(wire, arrangement, frame_arrays(0)) as transfer:
        differ = transfer.differing()
        for mode, ahead in _MODES.items():
            rates = transfer.measure(ahead=ahead, seconds=seconds)
            _rows(result, f"{case}, {mode}", arrangement, rates, differ, wire=shape)
            name = f"{case}, {arrangement}, {mode}: rate over the bare socket's"
            result.checks.append(Check(name, rates.of_bare, ">=", _OF_BARE, "1"))
    result.checks.append(Check(f"{case}, {arrangement}: arrays that differ", differ, "<=", 0, "arrays"))


def _rows(result: BenchmarkResult, case: str, arrangement: Arrangement, rates: Rates, differ: int, **told: str) -> None:
    for method, blocks in ((arrangement, rates.link_s), (f"bare socket beside {arrangement}", rates.bare_s)):
        frame_s = median(blocks)
        details: dict[str, Any] = {
            "frames_per_s": 1.0 / frame_s,
            "mb_per_s": rates.payload_bytes / frame_s / 1e6,
            "payload_bytes": rates.payload_bytes,
            "blocks": len(blocks),
            "load_average": os.getloadavg()[0],  # other work on the machine shows
            **told,
        }
        if method == arrangement:
            details["of_bare"] = rates.of_bare
        result.rows.append(Row(case, method, differ if method == arrangement else 0, "arrays", frame_s, details))
