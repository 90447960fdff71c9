"""`hil bench link`, the part of the companion: flights, transfers on this machine, and between two hosts.

Transfers say how much of a bare socket's rate the link reaches with the same bytes between the same processes; their
error is arrays that do not arrive as they were sent. Between two hosts the link has its keys (CURVE), the bare socket
sends in clear.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

from firmware_bridge.companion.keys import make_keys
from firmware_bridge.companion.settings import Arrangement
from hil.bench_suite.link_companion_flight import ARRANGEMENTS, measure_flights
from hil.bench_suite.link_companion_frame import AHEAD, frame_arrays
from hil.bench_suite.link_companion_transfer import Rates, Wire, far_end
from hil.bench_suite.result import BenchmarkResult, Check, Row
from hil.bench_suite.second_host import SecondHost, why_not

Say = Callable[[str], None]

_OF_BARE = 0.8
_SCALES = (0.01, 0.1, 1.0, 4.0)  # of the frame's 1 MB
_WIRED: tuple[Arrangement, ...] = ("one_port", "ports")
_MODES = {"stop-and-wait": 1, "streaming": AHEAD}


def measure_companion(result: BenchmarkResult, folder: Path, say: Say, *, quick: bool) -> None:
    """Rows, checks and panels. HilError if a flight ends as ERROR or a link breaks."""
    folder.mkdir()
    measure_flights(result, folder, say, seconds=1.5 if quick else 10.0)
    seconds = 0.35 if quick else 3.0
    times: dict[str, Rates] = {}
    for arrangement in ARRANGEMENTS:
        say(f"transfers, {arrangement}")
        times[arrangement] = _transfers(result, "transfer, loopback", Wire(), arrangement, folder, seconds)
    result.panels.append(lambda ax: draw_times(times, ax))
    if quick:
        result.left_out.append("companion: transfers of other sizes than 1 MB")
    else:
        swept: dict[str, list[Rates]] = {
            arrangement: _sweep(result, arrangement, folder, say) for arrangement in ARRANGEMENTS
        }
        result.panels.append(lambda ax: draw_sizes(swept, ax))
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
            _transfers(result, "transfer, two hosts", wire, arrangement, folder, seconds, host.shape)


def _transfers(
    result: BenchmarkResult,
    case: str,
    wire: Wire,
    arrangement: Arrangement,
    folder: Path,
    seconds: float,
    shape: str = "loopback",
) -> Rates:
    """Both ways of sending; the rates of stop-and-wait."""
    found = {}
    with far_end(wire, arrangement, folder, frame_arrays(0)) as transfer:
        differ = transfer.differing()
        for mode, ahead in _MODES.items():
            rates = found[mode] = transfer.measure(ahead=ahead, seconds=seconds)
            _rows(result, f"{case}, {mode}", arrangement, rates, differ, wire=shape)
            name = f"{case}, {arrangement}, {mode}: rate over the bare socket's"
            result.checks.append(Check(name, rates.of_bare, ">=", _OF_BARE, "1"))
    result.checks.append(Check(f"{case}, {arrangement}: arrays that differ", differ, "<=", 0, "arrays"))
    return found["stop-and-wait"]


def _rows(result: BenchmarkResult, case: str, arrangement: Arrangement, rates: Rates, differ: int, **told: str) -> None:
    for method, blocks, times in (
        (arrangement, rates.link_s, rates.link_ns),
        (f"bare socket beside {arrangement}", rates.bare_s, rates.bare_ns),
    ):
        frame_s = median(blocks)
        details: dict[str, Any] = {
            "frames_per_s": 1.0 / frame_s,
            "mb_per_s": rates.payload_bytes / frame_s / 1e6,
            "payload_bytes": rates.payload_bytes,
            "blocks": len(blocks),
            "load_average": os.getloadavg()[0],  # other work on the machine shows
            **told,
        }
        if times.count:
            quantiles = {"p50": times.quantile_ns(0.5), "p99": times.quantile_ns(0.99), "max": float(times.max_ns)}
            details |= {f"round_trip_ms_{q}": ns / 1e6 for q, ns in quantiles.items()}
        if method == arrangement:
            details["of_bare"] = rates.of_bare
        result.rows.append(Row(case, method, differ if method == arrangement else 0, "arrays", frame_s, details))


def _sweep(result: BenchmarkResult, arrangement: Arrangement, folder: Path, say: Say) -> list[Rates]:
    """Stop-and-wait with frames of other sizes."""
    swept = []
    for scale in _SCALES:
        arrays = frame_arrays(0, scale=scale)
        with far_end(Wire(), arrangement, folder, arrays) as transfer:
            rates = transfer.measure(ahead=1, seconds=1.0)
        say(f"transfers of {rates.payload_bytes / 1e6:.2g} MB, {arrangement}")
        if scale != 1.0:  # that one has its rows already
            _rows(result, f"transfer, {rates.payload_bytes / 1e6:.2g} MB", arrangement, rates, 0)
        swept.append(rates)
    return swept


def draw_times(times: dict[str, Rates], ax: Any) -> None:
    """How long single frames take, from send to answer: share of them against time."""
    for name, rates in times.items():
        for label, histogram, style in ((name, rates.link_ns, "-"), (f"bare, {name}", rates.bare_ns, ":")):
            seen, x, y = 0, [], []
            for middle_ns, count in histogram.bins():
                seen += count
                x.append(middle_ns / 1e6)
                y.append(seen / histogram.count)
            ax.step(x, y, style, where="post", label=label, linewidth=1.2)
    ax.set_xscale("log")
    ax.xaxis.set_minor_formatter(lambda *_: "")
    ax.set_xlabel("from send to answer, 1 MB [ms]")
    ax.set_ylabel("share of frames")
    ax.set_title("companion: time of a frame on loopback", loc="left", fontsize=10, fontweight="bold")
    ax.grid(True, which="both", color="#e6e9ed", linewidth=0.7)
    ax.legend(fontsize=7, frameon=False)


def draw_sizes(swept: dict[str, list[Rates]], ax: Any) -> None:
    """Rate of stop-and-wait against size."""
    all_rates: list[Rates] = []
    for name, all_rates in swept.items():
        x = [rates.payload_bytes / 1e6 for rates in all_rates]
        ax.plot(x, [r.payload_bytes / median(r.link_s) / 1e6 for r in all_rates], "o-", markersize=4, label=name)
    x = [rates.payload_bytes / 1e6 for rates in all_rates]
    bare = [median([s for rates in at_size for s in rates.bare_s]) for at_size in zip(*swept.values(), strict=True)]
    ax.plot(x, [mb / s for mb, s in zip(x, bare, strict=True)], "k:", label="bare socket")
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlabel("payload [MB]")
    ax.set_ylabel("rate [MB/s]")
    ax.set_title("companion: stop-and-wait on loopback", loc="left", fontsize=10, fontweight="bold")
    ax.grid(True, which="both", color="#e6e9ed", linewidth=0.7)
    ax.legend(fontsize=7, frameon=False)
