"""The part `dca1000`: a radar's raw frames as the stream of a DCA1000, live, for programs written for the card.

A program binds `host` on the data port, and talks to the card at `board_host` on the command port. With `on_command`
the stream begins with the command that starts a recording, as the card's does, and ends with the one that stops it;
otherwise it begins with the run. Both addresses are loopback unless the bench says otherwise. The stream never delays
the flight but by `packet_delay_s` after each packet, as the card waits, so that receivers keep up; what it sends is not
in the digest.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import Field

from firmware_bridge.codecs.dca1000 import (
    COMMAND_PORT,
    DATA_PORT,
    RECORD_START,
    RECORD_STOP,
    DataStream,
    answer,
    command_code,
)
from firmware_bridge.transports.loopback_host import is_loopback
from firmware_bridge.transports.udp import UdpInbox
from hil.config import Bench
from hil.run.part import Part, RunContext
from signals.documents.validate import Section
from signals.errors import ConfigError
from signals.samples import RadarSample, Sample, TruthState
from sim.radar.dca1000 import frame_words
from sim.sensors.radar_parameters import RadarParameters

_BATCH = 16  # packets between two waits: a shorter wait takes longer than it says
_Port = Annotated[int, Field(ge=1, le=65535)]


class Settings(Section):
    sensor: str
    host: str = "127.0.0.1"  # of the program that receives
    board_host: str = "127.0.0.2"  # of the card: an address of this machine, another one than the program's
    data_port: _Port = DATA_PORT
    command_port: _Port = COMMAND_PORT
    on_command: bool = False
    packet_delay_s: Annotated[float, Field(ge=0.0, le=0.01)] = 25e-6


class Dca1000Part(Part):
    """Stream of one radar; its own exchange with the tick loop."""

    name = "dca1000"
    free_running = False

    def __init__(self, settings: Settings, parameters: RadarParameters) -> None:
        self._settings, self._p = settings, parameters
        self._port = f"{settings.sensor}/raw"
        self._commands = UdpInbox(settings.command_port, host=settings.board_host)
        self._data = UdpInbox(0, host=settings.board_host)
        self._stream: DataStream | None = None if settings.on_command else DataStream()
        self._frames = self._packets = 0

    def watched_ports(self) -> frozenset[str]:
        return frozenset({self._port})

    def open(self, run: RunContext) -> None:
        """Bind the card's addresses. Raises PortBusy or PortNotFound."""
        self._commands.open()
        self._data.open()
        if not is_loopback(self._settings.host) or not is_loopback(self._settings.board_host):
            run.say("dca1000", f"samples of {self._settings.sensor!r} go to {self._settings.host} in the network")

    def exchange(self) -> Dca1000Part:
        return self

    def step(self, truth: TruthState, released: Sequence[tuple[str, Sample]]) -> None:  # noqa: ARG002
        """Send the frames that this tick released."""
        self._serve_commands()
        for port, sample in released:
            if port == self._settings.sensor and isinstance(sample, RadarSample) and "raw" in sample.channels:
                self._send(sample)

    def serve(self, limit_s: float) -> None:  # noqa: ARG002
        """Answer commands between ticks."""
        self._serve_commands()

    def _send(self, sample: RadarSample) -> None:
        p, board = self._p, self._p.board
        if self._stream is None or board is None:
            return
        words = frame_words(sample.channels["raw"], p.chirp, board, p.receiver.adc_bits)
        to = (self._settings.host, self._settings.data_port)
        for packet in self._stream.packets_of(words.tobytes()):
            self._data.send(packet, to)
            self._packets += 1
            if self._packets % _BATCH == 0:
                time.sleep(_BATCH * self._settings.packet_delay_s)
        self._frames += 1

    def _serve_commands(self) -> None:
        while (found := self._commands.receive()) is not None:
            datagram, sender = found
            code = command_code(datagram)
            if code is None:
                continue
            if self._settings.on_command and code == RECORD_START:
                self._stream = DataStream()
            elif self._settings.on_command and code == RECORD_STOP:
                self._stream = None
            self._commands.send(answer(code), sender)

    def close(self) -> None:
        self._commands.close()
        self._data.close()

    def run_keys(self) -> dict[str, Any]:
        return {"dca1000": {"frames": self._frames, "packets": self._packets}}


def make(bench: Bench, settings: Settings) -> Part:
    sensor = bench.config.sensors.get(settings.sensor)
    p = None if sensor is None else sensor.parameters
    place = "parts.dca1000.sensor"
    if not isinstance(p, RadarParameters):
        radars = [name for name, s in bench.config.sensors.items() if isinstance(s.parameters, RadarParameters)]
        hint = f"one of {', '.join(radars)}" if radars else "add a radar, such as {preset: awr1843boost, rate_hz: 10}"
        raise ConfigError.at(place, f"names no radar of this bench: {settings.sensor!r}", hint)
    if p.board is None:
        problem = f"{settings.sensor!r} has no `board` section with its ramp and lanes"
        raise ConfigError.at(place, problem, "use a preset of a TI board, such as awr1843boost")
    if "raw" not in p.outputs:
        raise ConfigError.at(place, f"{settings.sensor!r} has no output `raw`", "add it to its outputs")
    return Dca1000Part(settings, p)
