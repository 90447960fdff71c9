"""From a bench's `companion` section to the settings of the wire."""

from __future__ import annotations

import tempfile
from pathlib import Path

from firmware_bridge.companion.settings import CompanionSettings
from hil.config.schema import Companion


def link_settings(companion: Companion) -> CompanionSettings:
    """ConfigError for what cannot be."""
    keys = None if companion.keys is None else Path(companion.keys).expanduser()
    return CompanionSettings(
        bind=address(companion),
        arrangement=companion.arrangement,
        keys=keys,
        first_port=companion.sensor_port,
        max_clients=32,
        ring_bytes=companion.ring_mb << 20,
    )


def address(companion: Companion) -> str:
    """Where clients on this machine find the bench."""
    if companion.arrangement == "shared_memory":
        if companion.port == 0:
            return "ipc://*"
        return f"ipc://{Path(tempfile.gettempdir()) / f'hil-companion-{companion.port}'}"
    return f"tcp://{companion.host}:{companion.port or '*'}"
