"""Checks of the section `companion` against the rest of the bench."""

from __future__ import annotations

import os

from firmware_bridge.companion.keys import read_allowed, read_bench_keys
from hil.config.checks.cross_checks import rate_problem
from hil.config.companion.clients import client_name, known_clients, missing_modules, unknown_clients
from hil.config.companion.link_settings import link_settings
from hil.config.layers import Settings
from hil.config.schema import BenchConfig
from signals.documents.validate import at, nearest
from signals.errors import ConfigError, Problem


def companion_problems(config: BenchConfig, settings: Settings, *, scripted: bool) -> list[Problem]:
    """Report problems of the companion link. `scripted`: the mission is a script."""
    companion = config.companion
    problems: list[Problem] = []

    def report(key: str, message: str, hint: str = "") -> None:
        problems.append(at(settings, ("companion", key), message, hint))

    if not companion.on:
        if companion.control:
            report("control", "is true, but there are no clients", "name some in companion.start, or their number")
        return problems
    real_time = not config.autopilot.lockstep or config.pace == 1.0
    if companion.time == "realtime" and not real_time:
        report("time", "is 'realtime', but the run is not paced to real time", "--set pace=1")
    if companion.time != "realtime" and not config.autopilot.lockstep:
        message = f"is {companion.time!r}, but {config.autopilot.kind} runs on wall-clock time"
        report("time", message, "--set companion.time=realtime")
    cuts = [started.name for started in companion.start]
    for name in unknown_clients(cuts):
        report("start", f"names a client that does not exist: {name!r}", nearest(name, known_clients()))
    names = [client_name(cut) for cut in cuts]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        report(
            "start", f"names {', '.join(repeated)} twice: names of clients must differ", "start one, or as MODULE:NAME"
        )
    if companion.trace is not None and companion.time == "realtime" and companion.control:
        report("trace", "cannot replay a run in real time: its answers belong to no ticks", "leave it out")
    if message := rate_problem(companion.rate_hz, config):
        report("rate_hz", message)
    if companion.setpoint_hz > config.tick_hz:
        report("setpoint_hz", f"must be at most the tick's rate, {config.tick_hz} Hz, not {companion.setpoint_hz:g} Hz")
    if companion.control and scripted:
        report("control", "is true, but the mission is a script", "name its plan as the mission, or do without control")
    if companion.control and config.manual.device is not None:
        report(
            "control",
            f"is true, but manual.device is {config.manual.device!r}: both would command the vehicle",
            "leave one out",
        )
    if companion.trace is not None and not os.path.isfile(companion.trace):
        report("trace", f"names a file that does not exist: {companion.trace}")
    if companion.trace is not None:
        return problems  # a trace needs no link
    groups = len(config.sensors) + 1  # one more for the true state
    first = companion.sensor_port
    if companion.arrangement == "ports" and first is not None:
        if first <= companion.port < first + groups:
            report("port", f"lies among the sensors' ports, {first} to {first + groups - 1}")
        elif first + groups > 65536:
            report("sensor_port", f"leaves no room for {groups} ports", f"at most {65536 - groups}")
    key = "host"
    try:
        link = link_settings(companion)
        key = "keys"
        if link.keys is not None:
            read_bench_keys(link.keys)
            missing = sorted({*names} - {*read_allowed(link.keys).values()})
            if missing and companion.arrangement != "shared_memory":
                hint = f"hil keys {link.keys} {' '.join(missing)}"
                report("keys", f"names a folder without keys of {', '.join(missing)}", hint)
    except ConfigError as error:
        for problem in error.problems:
            place = "" if problem.where == "companion" else f"{problem.where}: "
            report(key, f"cannot be used: {place}{problem.message}", problem.hint)
    return problems


def missing_client_problems(config: BenchConfig, settings: Settings) -> list[Problem]:
    """Report clients of the user's own that cannot be found, before a flight: who only reads its files needs none."""
    companion = config.companion
    names = [started.name for started in companion.start] if companion.trace is None else []
    hint = "start hil from the folder of its file, or name that in the variable PYTHONPATH"
    return [
        at(settings, ("companion", "start"), f"names a client of the module {module!r}, which cannot be found", hint)
        for module in missing_modules(names)
    ]
