"""`hil devices --timing PORT`: measure whether this computer can fly hardware in the loop now.

The line carries what a flight carries, a HIL_SENSOR in each tick, but none of its fields is marked as updated: the
board's estimator takes nothing from it. Between two ticks the bench works as long as in a flight.
"""

from __future__ import annotations

import time

from rich.console import Console
from rich.markup import escape

from firmware_bridge.links.autopilot_link import LinkCaps, LinkTimeouts, TickSamples
from firmware_bridge.links.px4.free_running import FreeRunningLink
from firmware_bridge.links.realtime.processor import RealtimeProducer
from firmware_bridge.transports.serial import SerialTransport
from signals.time import NS_PER_MS

_TICK_NS = 4 * NS_PER_MS
_WORK_NS = 500_000  # of a tick of the default bench, rounded up
_CONNECT_S = 5.0


def check_timing(console: Console, port: str, *, baud: int, seconds: float = 60.0) -> bool:
    """Send at flight rate to the board on `port` for `seconds`, and print how well the timing held.

    Returns True if it was good enough for a flight without any finding. Raises LinkError if the port cannot be opened,
    no MAVLink device answers, or the line fails.
    """
    link = FreeRunningLink(
        SerialTransport(port, baud=baud),
        LinkCaps("timing", lockstep=False, deterministic=False, boot_sensors=0),
        period_ns=_TICK_NS,
        timeouts=LinkTimeouts(reply_s=1e6, connect_s=_CONNECT_S, reconnect_s=0.0),  # no commands come without HITL
        say=lambda _kind, text: console.print(text, markup=False),
    )
    console.print(f"sending to {port} at {1e9 / _TICK_NS:g} Hz for {seconds:g} s", markup=False)
    try:
        link.open()
        with RealtimeProducer() as producer:
            for tick in range(round(seconds * 1e9 / _TICK_NS)):
                link.begin(tick)
                work_until_ns = time.monotonic_ns() + _WORK_NS
                while time.monotonic_ns() < work_until_ns:
                    pass
                link.send(tick, tick * _TICK_NS, TickSamples(), b"")
                link.take_frames()
        sent = link.send_stats()
        assert sent is not None
        findings = link.findings()
        for who, names in (("sender", sent.denied), ("bench", producer.denied)):
            for name in names:
                console.print(f"[dim]not granted[/]  to the {who}: {escape(name)}", markup=True)
        median_ms, p999_ms = (sent.lateness.quantile_ns(q) / 1e6 for q in (0.5, 0.999))
        worst_ms = sent.lateness.max_ns / 1e6
        console.print(
            f"samples      {sent.sent} sent, {sent.dropped + sent.refused} never sent, {sent.late_20ms} over 20 ms; "
            f"late by {median_ms:.2f} ms (median), {p999_ms:.2f} ms (99.9 %), {worst_ms:.2f} ms (worst)",
            markup=False,
        )
        interval = link.age.interval
        if interval.count:
            console.print(
                f"commands     {interval.count + 1} came, {link.age.gap_count} pauses of more than 20 ms, the longest "
                f"{link.age.longest_gap_ns / 1e6:.0f} ms",
                markup=False,
            )
        else:
            console.print("commands     none came: HITL is off, or the board waits for samples", markup=False)
    finally:
        link.close()
    for finding in findings:
        colour = "red" if finding.level == "error" else "yellow"
        console.print(f"[{colour}]{finding.level}[/]  {escape(finding.text)}", markup=True)
    if any(finding.level == "error" for finding in findings):
        console.print("[red]no[/]  this computer cannot fly hardware in the loop now", markup=True)
    elif findings:
        console.print("[yellow]doubtful[/]  a flight's figures may suffer; see the warnings", markup=True)
    else:
        console.print("[green]yes[/]  this computer can fly hardware in the loop now", markup=True)
    return not findings
