"""From a rig's `autopilot` section to the link that speaks to it. What is started, and with what, is decided here."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from firmware_bridge.links.autopilot_link import AutopilotLink
from firmware_bridge.links.px4_process import px4_sitl_process
from firmware_bridge.links.registry import MOCK_BOOT_SENSORS, make_link
from firmware_bridge.mock_pixhawk.autopilot import MockPixhawk
from firmware_bridge.mock_pixhawk.faults import parse_fault
from hil.config import Bench, BenchConfig

LOG_NAME = "autopilot.log"
WORK_FOLDER = "autopilot"  # of firmware that the bench starts: parameters, missions, its own logs


def make_autopilot(bench: Bench, out: Path) -> AutopilotLink:
    """The link of this bench's autopilot, not yet open. What it starts logs into `out`."""
    return _MAKERS[bench.config.autopilot.kind](bench, out)


def _mock(bench: Bench, out: Path) -> AutopilotLink:
    config = bench.config
    autopilot = config.autopilot
    # Unknown (null) cannot be for the mock: it is told the number.
    boot_sensors = MOCK_BOOT_SENSORS if autopilot.boot_sensors is None else autopilot.boot_sensors
    common: dict[str, Any] = {
        "boot_sensors": boot_sensors,
        "reply_limit_s": autopilot.reply_timeout_s,
        "heartbeat_limit_s": autopilot.connect_timeout_s,
    }
    if autopilot.port is not None:
        return make_link("mock_serial", port=autopilot.port, baud=autopilot.baud, **common)
    if autopilot.transport == "loopback":
        peer = MockPixhawk(
            airframe=autopilot.airframe,
            boot_sensors=boot_sensors,
            params=_param_texts(config),
            faults=[parse_fault(text) for text in autopilot.faults.texts()],
        )
        return make_link("mock_memory", peer=peer, **common)
    return make_link("mock_pty", arguments=_mock_arguments(config), stderr_path=out / LOG_NAME, **common)


def _param_texts(config: BenchConfig) -> list[str]:
    return [f"{name}={value!r}" for name, value in config.autopilot.params.items()]


def _mock_arguments(config: BenchConfig) -> list[str]:
    arguments = ["--airframe", config.autopilot.airframe]
    for text in _param_texts(config):
        arguments += ["--param", text]
    for text in config.autopilot.faults.texts():
        arguments += ["--fault", text]
    return arguments


def _px4_sitl(bench: Bench, out: Path) -> AutopilotLink:
    config = bench.config
    autopilot = config.autopilot
    process = None
    if autopilot.start:
        process = px4_sitl_process(
            Path(str(autopilot.binary)),
            folder=out / WORK_FOLDER,
            log=out / LOG_NAME,
            airframe=autopilot.airframe,
            tick_hz=config.tick_hz,
            params=autopilot.params,
            env=autopilot.env,
            arguments=autopilot.arguments,
            instance=autopilot.instance,
        )
    return make_link(
        "px4_sitl",
        instance=autopilot.instance,
        start=None if process is None else lambda: process,
        reply_limit_s=autopilot.reply_timeout_s,
        heartbeat_limit_s=autopilot.connect_timeout_s,
    )


_MAKERS: dict[str, Callable[[Bench, Path], AutopilotLink]] = {
    "mock": _mock,
    "px4_sitl": _px4_sitl,
}
