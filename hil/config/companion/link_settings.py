"""Settings of the companion link from the section `companion` of a bench."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from firmware_bridge.companion.settings import CompanionSettings
from hil.config.schema import Companion


def link_settings(companion: Companion) -> CompanionSettings:
    """Translate the section. Raises ConfigError for values that exclude each other."""
    keys = None if companion.keys is None else Path(os.path.expanduser(companion.keys))
    return CompanionSettings(
        bind=bind_address(companion),
        arrangement=companion.arrangement,
        keys=keys,
        first_sensor_port=companion.sensor_port,
        max_clients=32,
        ring_bytes=companion.ring_mb << 20,
    )


def bind_address(companion: Companion) -> str:
    """Return the ZeroMQ address that the bench listens on; '*' lets the system choose."""
    if companion.arrangement == "shared_memory":
        if companion.port == 0:
            return "ipc://*"
        return f"ipc://{Path(tempfile.gettempdir()) / f'hil-companion-{companion.port}'}"
    return f"tcp://{companion.host}:{companion.port or '*'}"
