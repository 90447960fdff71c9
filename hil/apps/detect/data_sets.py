"""`hil detect data`: the data sets on which the shipped detector is trained and evaluated, each of a different world.

Data set i of a series uses scene i mod 3 with `map_seed` and `seed` equal to `first_seed` + i. The course changes after
each round of the scenes. Side, height, speed, camera pitch and quality follow additive recurrences on irrational
numbers (Roberts's R_5), which fill the space evenly for any number of sets and need no random numbers. Series share no
world if their seeds do not overlap.

Each set is one call of `hil dataset` on the same bench file, so it can be made again alone. Complete sets are kept if
they are those of the series: one of another seed would put pictures of a training into its test. A course may lead into
a wall; then it is flown over what stands there.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from hil.config import load_bench
from hil.config.layers import parse_setting
from hil.config.saved import resolved_data
from hil.data_set_files import MANIFEST
from hil.run_files import BENCH_NAME
from signals.documents.validate import nearest
from signals.documents.yaml_lines import dotted, read_yaml
from signals.errors import ConfigError, Problem, RecordingError, file_errors
from sim.frame.quality import QUALITIES as LEVELS
from sim.scene.map_section import GeneratedMap
from sim.scene.scene import load_scene

BENCH = Path(__file__).resolve().parents[3] / "rigs" / "datasets" / "detect.yaml"
SCENES = ("city_park", "urban_delivery", "training_village")
COURSES = ("survey", "figure_eight", "circle", "square")
# Of four sets, one has no textures and only one has shadows, because `high` takes four times as long as `medium`.
QUALITIES = ("medium", "low", "medium", "high")
MIN_HEIGHT_M, MAX_HEIGHT_M = 2.0, 20.0
_OF_SERIES = ("randomize.people.count", "randomize.objects.count", "sensors.front.resolution")  # by default the bench's
_FLIGHT_FAILED = 3  # status of `hil dataset`
_NOT_KNOWN = object()
_ROOT = 1.1347241384015194  # positive root of x^6 = x + 1, the constant of R_5


@dataclass(frozen=True)
class DataSetPlan:
    """One data set of a series: the values that replace those of the bench file."""

    name: str
    scene: str
    seed: int  # of the map, the appearance and the noise
    quality: str
    course: str
    side_m: float
    height_m: float
    speed_mps: float
    pitch_deg: float  # camera pitch, downwards positive

    def settings(self) -> list[str]:
        """Return the values as `KEY=VALUE` settings of `hil dataset`."""
        has_map_seed = isinstance(load_scene(self.scene).map, GeneratedMap)
        return [
            f"scene={self.scene}",
            *([f"map_seed={self.seed}"] if has_map_seed else []),
            f"dataset.trajectory.preset={self.course}",
            f"dataset.trajectory.side_m={self.side_m:g}",
            f"dataset.trajectory.height_m={self.height_m:g}",
            f"dataset.trajectory.speed_mps={self.speed_mps:g}",
            f"sensors.front.mount_rpy_deg=[0, {self.pitch_deg:g}, 0]",
        ]


@dataclass(frozen=True)
class DataSetSeries:
    """A series of data sets: their number, frames per set and first seed.

    `people` and `objects` are the minimum and maximum number to add to those of the map, `size_px` the width and height
    of the pictures; None: as in the bench file. `quality` replaces those of the plans.
    """

    sets: int
    frames: int
    first_seed: int
    scenes: Sequence[str] = SCENES
    people: tuple[int, int] | None = None
    objects: tuple[int, int] | None = None
    size_px: tuple[int, int] | None = None
    quality: str | None = None

    def __post_init__(self) -> None:
        """Raises ConfigError for a quality that there is not."""
        if self.quality is not None and self.quality not in LEVELS:
            hint = nearest(self.quality, LEVELS)
            raise ConfigError.at("--quality", f"there is no quality {self.quality!r}", hint)

    def plans(self) -> list[DataSetPlan]:
        """Return one plan per data set, in order."""
        plans = [plan(i, self.first_seed, self.scenes) for i in range(self.sets)]
        return plans if self.quality is None else [replace(p, quality=self.quality) for p in plans]

    def settings(self) -> list[str]:
        """Return the `KEY=VALUE` settings that all data sets of the series share."""
        added = [
            f"randomize.{name}.count=[{count[0]}, {count[1]}]"
            for name, count in (("people", self.people), ("objects", self.objects))
            if count is not None
        ]
        size = [] if self.size_px is None else [f"sensors.front.resolution=[{self.size_px[0]}, {self.size_px[1]}]"]
        return added + size


def plan(index: int, first_seed: int, scenes: Sequence[str] = SCENES) -> DataSetPlan:
    """Return the plan of data set number `index`. The camera points ahead on low flights, further down on high ones."""
    side, height, speed, pitch, quality = ((first_seed + index) / _ROOT**k % 1.0 for k in range(1, 6))
    height_m = MIN_HEIGHT_M * (MAX_HEIGHT_M / MIN_HEIGHT_M) ** height
    height_share = (height_m - MIN_HEIGHT_M) / (MAX_HEIGHT_M - MIN_HEIGHT_M)
    min_pitch_deg, max_pitch_deg = 20.0 * height_share, 35.0 + 55.0 * height_share
    scene = scenes[index % len(scenes)]
    return DataSetPlan(
        name=f"{index:03d}-{scene}",
        scene=scene,
        seed=first_seed + index,
        quality=QUALITIES[int(quality * len(QUALITIES))],
        course=COURSES[index // len(scenes) % len(COURSES)],
        side_m=round(14.0 + 26.0 * side, 1),
        height_m=round(height_m, 1),
        speed_mps=round(2.0 + 3.0 * speed, 1),
        pitch_deg=round(min_pitch_deg + (max_pitch_deg - min_pitch_deg) * pitch, 0),
    )


def make_data_sets(
    out: Path, console: Console, series: DataSetSeries, *, jobs: int | None = None, quiet: bool = False
) -> list[Path]:
    """Make those data sets of `series` that are not yet complete in `out`, and return the folders of all.

    `jobs` data sets are made at a time, by default one per core. Raises ConfigError for a scene that does not
    exist, and if complete ones are of another series; RecordingError with the data sets that could not be made, after
    all others have been.
    """
    plans = series.plans()
    settings = [[*plan.settings(), *series.settings()] for plan in plans]  # names a wrong scene before a folder is made
    complete = [(p, texts) for p, texts in zip(plans, settings, strict=True) if _is_complete(out / p.name)]
    own = _of_series(series) if complete else {}
    if others := [problem for p, texts in complete for problem in _differences(p, out / p.name, own, texts)]:
        raise ConfigError(others)
    with file_errors(out, "cannot be made"):
        out.mkdir(parents=True, exist_ok=True)
    commands = _Commands()
    columns = (TextColumn("data sets"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=quiet) as progress:
        task = progress.add_task("", total=len(plans))
        with ThreadPoolExecutor(jobs or os.cpu_count() or 1) as pool:
            futures = [
                pool.submit(_make, plan, out / plan.name, series.frames, texts, commands)
                for plan, texts in zip(plans, settings, strict=True)
            ]
            failed: list[RecordingError] = []
            for future in futures:
                try:
                    future.result()
                except RecordingError as error:
                    failed.append(error)
                except BaseException:  # Ctrl-C: without it the pool makes all the rest first
                    commands.stop()
                    pool.shutdown(cancel_futures=True)
                    raise
                progress.advance(task)
    if failed:
        made = len(plans) - len(failed)
        raise RecordingError("\n".join([f"{made} of {len(plans)} data sets made", *map(str, failed)])) from failed[0]
    return [out / p.name for p in plans]


class _Commands:
    """Commands that run side by side until `stop`.

    Ctrl-C at the terminal does not reach them: they would end with the status of a flight that failed.
    """

    def __init__(self) -> None:
        self.stopped = False
        self._lock = threading.Lock()
        self._running: set[subprocess.Popen[str]] = set()

    def run(self, command: Sequence[str]) -> subprocess.CompletedProcess[str]:
        """Run a command to its end, with what it prints. Raises RecordingError after `stop`."""
        pipe = subprocess.PIPE
        with self._lock:
            if self.stopped:
                raise RecordingError("stopped")
            process = subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, start_new_session=True)
            self._running.add(process)
        with process:
            printed, told = process.communicate()
        with self._lock:
            self._running.remove(process)
        return subprocess.CompletedProcess(command, process.returncode, printed, told)

    def stop(self) -> None:
        """Let all end, and none begin."""
        with self._lock:
            self.stopped = True
            for process in self._running:
                process.terminate()


def _make(plan: DataSetPlan, folder: Path, frames: int, settings: Sequence[str], commands: _Commands) -> None:
    """Make a data set, anew if it is incomplete; where its flight fails, once more over what is in its way."""
    if _is_complete(folder):
        return
    command = [sys.executable, "-P", "-m", "hil.cli", "dataset", str(BENCH), "--quiet", "--workers", "1"]
    command += ["--frames", str(frames), "--out", str(folder)]
    command += ["--seed", str(plan.seed), "--quality", plan.quality]
    for setting in settings:
        command += ["--set", setting]
    for more in ([], ["--set", "dataset.trajectory.clear=true"]):
        if (folder / MANIFEST).is_file():  # nothing but a data set is deleted
            shutil.rmtree(folder)
        process = commands.run([*command, *more])
        if process.returncode != _FLIGHT_FAILED or commands.stopped:
            break
    if process.returncode != 0:
        output = " ".join((process.stderr or process.stdout).split())[-400:]
        raise RecordingError(f"{folder}: `hil dataset` ended with status {process.returncode}: {output}")


def _is_complete(folder: Path) -> bool:
    try:
        return bool(json.loads((folder / MANIFEST).read_text())["complete"])
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _of_series(series: DataSetSeries) -> dict[str, Any]:
    """Return what all data sets of a series have in common by dotted key, also where the bench file gives it."""
    config = load_bench(BENCH, seed=series.first_seed, settings=series.settings(), flown=False).config
    data = resolved_data(config)
    return {"frames": series.frames} | {key: _at(data, key) for key in _OF_SERIES}


def _differences(plan: DataSetPlan, folder: Path, own: dict[str, Any], settings: Sequence[str]) -> Iterator[Problem]:
    """Yield the first value with which a complete data set was made, and that the series has otherwise.

    `own`: the values of the series. No bench is resolved here, which takes a second: a series has hundreds of sets.
    """
    bench = read_yaml(folder / BENCH_NAME).data
    manifest = json.loads((folder / MANIFEST).read_text())
    wanted: dict[str, Any] = {"seed": plan.seed, "quality": plan.quality}
    for place, value, _ in map(parse_setting, settings):
        wanted[dotted(place)] = value
    # The scene is a part of the folder's name: a data set names its own copy.
    for key, now in (wanted | own).items():
        was = _at(manifest, "made_from.frames") if key == "frames" else _at(bench, key)
        if key != "scene" and was not in (now, _NOT_KNOWN):
            hint = "name another folder with --out, or remove this one"
            yield Problem(str(folder), f"holds a data set with another {key}: {was}, not {now}", hint)
            return


def _at(data: Any, key: str) -> Any:
    """Return the value of a dotted key: None below what is off, _NOT_KNOWN where a file of an older bench lacks it."""
    for word in key.split("."):
        if not isinstance(data, dict):
            return None
        if word not in data:
            return _NOT_KNOWN
        data = data[word]
    return data
