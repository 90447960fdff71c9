"""Selection of a bench on the command line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

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

    def load(self) -> Bench:
        """Read and check the bench. Raises ConfigError with every problem found."""
        from hil.config import load_bench  # most of a command's memory: `fly` tells in run.json if there is none

        return load_bench(
            self.config,
            rig=self.rig,
            scene=self.scene,
            mission=self.mission,
            seed=self.seed,
            settings=self.settings,
        )
