"""The link to the autopilot, and its punctuality (`autopilot` in run.json)."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import reduce
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from firmware_bridge.autopilots.installation import LOG_NAME, WORK_FOLDER, Surroundings
from firmware_bridge.links.autopilot_link import AutopilotLink
from firmware_bridge.links.realtime.health import Finding, Punctuality
from firmware_bridge.links.realtime.processor import LockstepProcessors, RealtimeProducer
from firmware_bridge.transports.transport import Transport
from hil.config import Bench
from hil.run.autopilot import check_ports, installation_of
from hil.run.part import Part, RunContext
from hil.run.report.page import Report
from hil.run.report.quantiles import quantiles_us

_LINK_KEYS = (
    "tx_bytes", "rx_bytes", "bad_crc", "garbage_bytes", "lost_frames", "bad_controls", "unanswered", "repeated"
)  # fmt: skip
_CLOCK_S = 1.0  # by which the time of a file may be behind
_BUSY_WAIT_NS = 300_000  # PX4 answers within about 60 us


class AutopilotPart(Part):
    name = "autopilot"
    _run: RunContext  # from `build` on

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._link: AutopilotLink | None = None
        self._processors: LockstepProcessors | None = None
        self._denied: dict[str, list[str]] = {}  # scheduling that the sender and the bench were not granted
        self._began_s = 0.0  # by `time.time`
        self._shared: LockstepProcessors | None = None  # with a processor that both share, while it is watched
        self.every_ticks = bench.config.tick_hz  # between two looks at it

    def check(self) -> None:
        check_ports(self._bench)

    def build(self, run: RunContext) -> None:
        def wrap(transport: Transport) -> Transport:
            return reduce(lambda wrapped, part: part.wrap_link(wrapped), run.parts, transport)

        self._run, self._began_s = run, time.time()
        installation = installation_of(self._bench, run.physics.state)
        around = Surroundings(run.out, wrap, run.event, run.say)
        self._link = self._bench.config.autopilot.profile.make_link(installation, around)
        run.link = self._link
        watchers = [part.link_waits for part in run.parts if type(part).link_waits is not Part.link_waits]
        if watchers:

            def while_waiting() -> None:
                for watch in watchers:
                    watch()

            self._link.while_waiting = while_waiting
        self._link.open()

    @contextmanager
    def around_flight(self) -> Iterator[None]:
        link, run, config = self._link, self._run, self._bench.config
        assert link is not None
        if not link.caps.lockstep:
            # The thread that prepares samples for a free-running autopilot must not wait for a processor.
            with self._in_real_time(link):
                yield
        elif link.caps.lockstep and link.caps.busy_processors > 1 and config.pace is None and not config.name:
            # The autopilots of several vehicles compute side by side, on all processors.
            with LockstepProcessors(link.pid, share=config.autopilot.share_processor) as self._processors:
                if self._processors.shared:
                    run.scheduler.record_first = True
                    self._shared = self._processors
                elif self._processors.separate:
                    link.busy_wait_ns = _BUSY_WAIT_NS
                yield
        else:
            yield

    @contextmanager
    def _in_real_time(self, link: AutopilotLink) -> Iterator[None]:
        """Fly with real-time scheduling, after telling the user what of it was not granted."""
        with RealtimeProducer() as producer:
            timing = link.punctuality()
            refused = {"sender": timing.sent.denied if timing is not None else (), "bench": producer.denied}
            texts = [f"{who}: {', '.join(names)}" for who, names in refused.items() if names]
            self._denied = {who: list(names) for who, names in refused.items()}
            if texts:
                self._run.say("timing", "not granted to the " + "; to the ".join(texts))
            yield

    def after_tick(self, tick: int) -> None:  # noqa: ARG002 (only the time between two calls counts)
        if self._shared is None:
            return
        warning = self._shared.watch(self.every_ticks * self._bench.config.tick_ns)
        if warning is not None:
            self._shared = None
            self._run.scheduler.record_first = False
            self._run.event("warning", warning)

    def close(self) -> None:
        if self._link is not None:
            self._link.close()

    def finish(self, run: RunContext) -> None:
        for finding in () if self._link is None else self._link.findings():
            run.event(finding.level, finding.text)

    def repeatable(self) -> bool:
        return self._link is not None and self._link.caps.deterministic

    def run_keys(self) -> dict[str, Any]:
        stats = None if self._link is None else self._link.stats
        rtt = None if stats is None else stats.rtt
        section = {
            "kind": self._bench.config.autopilot.kind,
            "steps": stats.steps if stats else 0,
            "late": stats.late if stats else 0,
            "rtt_us": {
                "p50": rtt.quantile_ns(0.5) / 1000 if rtt else None,
                "p99": rtt.quantile_ns(0.99) / 1000 if rtt else None,
                "max": rtt.max_ns / 1000 if rtt else None,
            },
            "link": {name: getattr(stats, name) for name in _LINK_KEYS} if stats else {},
        }
        if self._link is not None and not self._link.caps.lockstep:
            timing, findings = self._link.punctuality(), self._link.findings()
            section["realtime"] = _timing_keys(timing, findings) | {"not_granted": self._denied}
        return {"autopilot": section}

    def report(self, run: RunContext) -> Report:
        from hil.run.report.pictures import punctuality_pictures, timing_pictures

        link = self._link
        if link is None:
            return Report()
        pictures = timing_pictures(run.out, link.stats.rtt.bins(), run.mean_phase_us())
        timing = link.punctuality()
        if timing is not None:
            pictures += punctuality_pictures(run.out, timing.sent.lateness.bins(), timing.age.age.bins())
        return Report(pictures, self._logs(run.out))

    def _logs(self, out: Path) -> list[tuple[str, str]]:
        """Return a section with links to what the firmware has written in this run; none if it wrote nothing."""
        own = self._bench.config.autopilot.profile.firmware.flight_logs
        patterns = {LOG_NAME: "output", f"{WORK_FOLDER}/*.log": "output"}
        patterns |= {f"{WORK_FOLDER}/{pattern}": what for pattern, what in own.items()}
        items = [
            f"<li><a href='{quote(file)}'>{escape(file)}</a> {escape(what)}</li>"
            for pattern, what in patterns.items()
            for file in sorted(path.relative_to(out).as_posix() for path in out.glob(pattern) if self._is_new(path))
        ]
        return [("Logs of the firmware", f"<ul>{''.join(items)}</ul>")] if items else []

    def _is_new(self, path: Path) -> bool:
        """Return True for a file of this run; its folder may have those of an earlier one."""
        return path.is_file() and path.stat().st_size > 0 and path.stat().st_mtime >= self._began_s - _CLOCK_S


def _timing_keys(timing: Punctuality | None, findings: Sequence[Finding]) -> dict[str, Any]:
    """Return the punctuality of the samples sent to a free-running autopilot and of its motor commands."""
    if timing is None:
        return {}
    sent, clock = timing.sent, timing.clock
    best = clock.best()
    return {
        "send_lateness_us": quantiles_us(sent.lateness) | {"p999": sent.lateness.quantile_ns(0.999) / 1000},
        "late_2ms": sent.late_2ms,
        "late_20ms": sent.late_20ms,
        "sent": sent.sent,
        "dropped": sent.dropped + sent.refused,
        "longest_gap_ms": sent.longest_gap_ns / 1e6,
        "scheduling": sent.scheduling,
        "slips": timing.schedule.slip_count,
        "slipped_ms": timing.schedule.slipped_ns / 1e6,
        "actuator_age_us": quantiles_us(timing.age.age),
        "actuator_interval_us": quantiles_us(timing.age.interval),
        "actuator_gaps": timing.age.gap_count,
        "clock_offset_us": best.offset_ns / 1000 if best else None,
        "clock_drift_ppm": clock.drift_ppm,
        "clock_resets": clock.resets,
        "clock_slips": clock.slips,
        "clock_slipped_ms": clock.slipped_ns / 1e6,
        "reconnects": timing.reconnects,
        "findings": [{"level": f.level, "text": f.text} for f in findings],
    }


def make(bench: Bench) -> Part:
    return AutopilotPart(bench)
