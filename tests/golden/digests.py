"""The golden digests: what each flight and episode of digests.yaml must give, on every machine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

_ALL: dict[str, dict[str, Any]] = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text())
FLIGHTS = {name: each for name, each in _ALL.items() if "arguments" in each}
EPISODES = {name: each for name, each in _ALL.items() if "environment" in each}
