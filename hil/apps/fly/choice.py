"""Selection of a bench on the command line."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from signals.errors import ConfigError

if TYPE_CHECKING:
    from hil.config import Bench


@dataclass(frozen=True)
class BenchChoice:
    """A bench file and the values that the command line overrides; None keeps the file's value.

    `settings` are the texts of `--set`.
    """

    config: Path | None = None
    rig: str | None = None
    scene: str | None = None
    mission: str | None = None
    seed: int | None = None
    settings: tuple[str, ...] = ()
    follow: Path | None = None  # log of a flight that is flown again in place of the mission
    flight: int | None = None  # of that log

    def load(self) -> Bench:
        """Read and check the bench. Raises ConfigError with every problem found."""
        settings = self.settings
        if self.follow is not None:
            settings = (*self._followed(self.follow), *settings)
        elif self.flight is not None:
            raise ConfigError.at("--flight", "chooses one of a log's flights", "name the log: --follow LOG")
        from hil.config import load_bench  # most of a command's memory: `fly` tells in run.json if there is none

        return load_bench(
            self.config,
            rig=self.rig,
            scene=self.scene,
            mission=self.mission,
            seed=self.seed,
            settings=settings,
        )

    def _followed(self, log: Path) -> tuple[str, ...]:
        """Return the settings with which a log is flown in place of the bench's mission."""
        if self.mission is not None:
            raise ConfigError.at("--mission", "cannot go with --follow: one of them flies", "leave it out")
        flight = () if self.flight is None else (f"follow.flight={self.flight}",)
        return ("mission=null", f"follow.log={json.dumps(str(log), ensure_ascii=False)}", *flight)
