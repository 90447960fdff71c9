"""The section `router`: ground stations, SDKs and companions share the autopilot's MAVLink."""

from __future__ import annotations

from typing import Any

from firmware_bridge.router.router import Router, RouterSource
from firmware_bridge.router.signing import ClientSigning
from hil.config import Bench, BenchConfig
from hil.run.part import Part, RunContext
from hil.run.parts.links.signing import signing_key


class RouterPart(Part):
    name = "router"

    def __init__(self, config: BenchConfig) -> None:
        self._config = config
        self._router: Router | None = None
        self._source: RouterSource | None = None

    def build(self, run: RunContext) -> None:
        config, key = self._config, self._config.router.signing_key_file
        signing = run.part("signing")
        faster_than_real_time = config.autopilot.lockstep and (config.pace is None or config.pace > 1.0)
        self._router = Router(
            config.router.endpoints(),
            hold=config.router.repeat_heartbeats and faster_than_real_time,
            client_signing=None if key is None else ClientSigning(signing_key(key, run.recorder)),
            autopilot_signing=None if signing is None else signing.autopilot_signing,
        )
        self._router.open()
        self._source = RouterSource(self._router, run.recorder.event, run.recorder.routed)

    def command_sources(self) -> list[RouterSource]:
        return [] if self._source is None else [self._source]

    def repeatable(self) -> bool:
        return self._router is None or not self._router.received_any

    def run_keys(self) -> dict[str, Any]:
        return {} if self._router is None else {"router": self._router.report()}

    def close(self) -> None:
        if self._router is not None:
            self._router.close()


def make(bench: Bench) -> Part:
    return RouterPart(bench.config)
