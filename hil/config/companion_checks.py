"""What only the whole bench can tell about its companion link."""

from __future__ import annotations

from pathlib import Path

from firmware_bridge.companion.keys import read_allowed, read_bench_keys
from hil.companion.settings import link_settings
from hil.companion.started import known_clients, unknown_clients
from hil.config.layers import Settings
from hil.config.schema import BenchConfig
from hil.documents.validate import at, nearest
from hil.signals.errors import ConfigError, Problem


def companion_problems(config: BenchConfig, settings: Settings, *, scripted: bool) -> list[Problem]:
    """`scripted`: the mission is a script, with actions of its own."""
    companion = config.companion
    if not companion.on:
        return []
    problems: list[Problem] = []

    def wrong(key: str, message: str, hint: str = "") -> None:
        problems.append(at(settings, ("companion", key), message, hint))

    real_time = not config.autopilot.lockstep or config.pace == 1.0
    if companion.time == "realtime" and not real_time:
        wrong("time", "is 'realtime', but the run does not keep it", "--set pace=1")
    if companion.time != "realtime" and not config.autopilot.lockstep:
        message = f"is {companion.time!r}, but {config.autopilot.kind} waits for nobody"
        wrong("time", message, "--set companion.time=realtime")
    for name in unknown_clients(companion.start):
        wrong("start", f"names a client that does not exist: {name!r}", nearest(name, known_clients()))
    if companion.rate_hz > config.tick_hz:
        wrong("rate_hz", f"must be at most the tick's rate, {config.tick_hz} Hz, not {companion.rate_hz:g} Hz")
    elif abs(companion.rate_hz * 1000 - round(companion.rate_hz * 1000)) > 1e-6 or companion.rate_hz < 0.001:
        wrong("rate_hz", f"must be a whole number of millihertz, not {companion.rate_hz!r} Hz")
    if companion.setpoint_hz > config.tick_hz:
        wrong("setpoint_hz", f"must be at most the tick's rate, {config.tick_hz} Hz, not {companion.setpoint_hz:g} Hz")
    if companion.control and scripted:
        wrong("control", "is true, but the mission is a script", "name its plan as the mission, or do without control")
    if companion.control and config.manual.device is not None:
        wrong("control", f"is true, but manual.device is {config.manual.device!r}: two would fly", "leave one out")
    if companion.trace is not None and not Path(companion.trace).is_file():
        wrong("trace", f"names a file that does not exist: {companion.trace}")
    try:
        made = link_settings(companion)
        if made.keys is not None:
            read_bench_keys(made.keys)
            read_allowed(made.keys)
    except ConfigError as error:
        for p in error.problems:
            where = "" if p.where == "companion" else f"{p.where} "
            problems.append(at(settings, ("companion",), f": {where}{p.message}", p.hint))
    return problems
