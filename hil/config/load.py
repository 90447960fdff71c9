"""Reads a bench: its files, the command-line options, and its vehicles if it has several."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from hil.config.bench import Bench
from hil.config.files import bench_file, default_bench, is_rig
from hil.config.loading import BenchLoading
from hil.config.vehicles.resolve import lone_vehicle_problems, with_vehicles
from signals.errors import ConfigError, Problem

MAX_PROBLEMS = 100


def load_bench(
    path: Path | str | None = None,
    *,
    rig: str | None = None,
    scene: str | None = None,
    mission: str | None = None,
    seed: int | None = None,
    settings: Sequence[str] = (),
    flown: bool = True,
) -> Bench:
    """Read, merge and check everything that a bench consists of.

    `path` is the bench file, by default ./hil.yaml or, if there is none, the one of the installation; a file of a rig
    is a bench of defaults on it. `settings` are the texts of `--set`. `flown`: of several vehicles each must have
    somebody who flies it, a search must have something to find, and clients of the user's own must be there. Raises
    ConfigError with every problem found.
    """
    options = {"rig": rig, "scene": scene, "mission": mission, "seed": seed}
    options = {key: value for key, value in options.items() if value is not None}
    try:
        file = default_bench() if path is None else bench_file(Path(path))
        if path is not None and file is not None and is_rig(file):
            options, file = {"rig": str(file), **options}, None  # defaults on that rig
        loading = BenchLoading(file, options, settings)
        bench = loading.bench(flown=flown)
        if bench.config.vehicles:
            return with_vehicles(bench, loading, flown=flown)
        if problems := lone_vehicle_problems(bench, loading):
            raise ConfigError(problems)
        return bench
    except ConfigError as error:
        raise ConfigError(_shortened(error.problems)) from None


def _shortened(problems: list[Problem]) -> list[Problem]:
    """Return the first MAX_PROBLEMS problems and the number of the others."""
    excess = len(problems) - MAX_PROBLEMS
    if excess <= 0:
        return problems
    return [*problems[:MAX_PROBLEMS], Problem("and", f"{excess} more problems")]
