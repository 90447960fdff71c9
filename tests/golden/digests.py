"""The golden digests: what each flight of digests.yaml must give, on every machine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

FLIGHTS: dict[str, dict[str, Any]] = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text())
