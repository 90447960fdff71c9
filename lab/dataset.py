"""`hil bench dataset`: table 5 of the AirLoop paper on this machine, with the errors of the recorded data.

Frames per second are measured with and without radar, with and without storage, at five qualities, for the default
bench of `hil dataset`. Each rate is given in steady state, and including take-off and the start of the workers. The
paper's figures are for 500 frames of 320 x 240 pixels on a laptop with an RTX 3060.

The lower bound of the time is that of encoding and writing the same arrays alone. Errors are the pixels by which boxes
miss the masks, radar frames against the exact sum, and files that differ between one worker and two.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, ShowStatus
from hil.apps.dataset.make import MakeOptions, make_dataset
from hil.apps.dataset.plan import BATCH_FRAMES
from lab.dataset_cases import (
    Rate,
    box_errors,
    differing_files,
    lower_bound_s,
    measure_stored,
    measure_unstored,
    plan_of,
    radar_error,
)
from signals.processors import usable_processors
from sim.frame.quality import QUALITIES

TITLE = "Data sets: time per frame and errors of the labels"
_PAPER_FRAMES_PER_S = {(True, True): 7.17, (False, True): 20.1}  # by (radar, storage)
_FRAMES, _QUICK_FRAMES, _SHORT_FRAMES = 500, 250, 50
_HIGHER_QUALITY_FRAMES = 150  # at each quality above the lowest
_MIN_FRAMES_PER_S = {True: 110.0, False: 180.0}  # with storage, by radar


@dataclass(frozen=True)
class _Sizes:
    """Rates that are measured: qualities, with radar and without, frames of the lowest quality and of the others."""

    qualities: Sequence[str] = ("low",)
    radar: Sequence[bool] = (True, False)
    frames: int = _FRAMES
    higher_frames: int = _HIGHER_QUALITY_FRAMES
    short_frames: int = _SHORT_FRAMES
    bound_frames: int = 40


_SMALLEST = _Sizes(radar=(True,), frames=2 * BATCH_FRAMES + 1, short_frames=BATCH_FRAMES + 1, bound_frames=1)


def measure(*, quick: bool, status: ShowStatus, errors_only: bool = False) -> BenchmarkResult:
    """Record data sets in all variants; `errors_only`: those that are compared, and each step of speed once.

    Raises HilError if a flight or the disk fails.
    """
    result = BenchmarkResult(time_label="wall time per frame, steady state [s]")
    with tempfile.TemporaryDirectory(prefix="hil-bench-") as folder:
        box_error_px = _errors(Path(folder), result, status)
        if errors_only:
            unread = BenchmarkResult(time_label=result.time_label)  # what breaks is an error; how fast it is, is none
            _rates(unread, Path(folder), box_error_px, status, _SMALLEST)
        elif quick:
            _rates(result, Path(folder), box_error_px, status, _Sizes(frames=_QUICK_FRAMES))
            result.left_out += [f"quality {quality}" for quality in QUALITIES if quality != "low"]
            result.left_out.append(f"rates over {_FRAMES} frames ({_QUICK_FRAMES} were taken)")
        else:
            _rates(result, Path(folder), box_error_px, status, _Sizes(qualities=tuple(QUALITIES)))
    return result


def _rates(result: BenchmarkResult, folder: Path, box_error_px: float, status: ShowStatus, sizes: _Sizes) -> None:
    """Measure the lower bounds and the rates, and add their rows and checks."""
    bounds_s = {}
    for radar in sizes.radar:
        status("lower bound: encoding and writing alone")
        with plan_of("low", frames=sizes.bound_frames, radar=radar) as plan:
            bounds_s[radar] = lower_bound_s(plan, folder / f"bound-{radar}") / usable_processors()
    for quality, radar, storage in product(sizes.qualities, sizes.radar, (True, False)):
        frames = sizes.frames if quality == "low" else sizes.higher_frames
        name = f"{'with' if radar else 'without'} radar, {'stored' if storage else 'not stored'}"
        status(f"{quality}, {name}")
        if storage:
            rate = measure_stored(folder / f"{quality}-{radar}", quality, frames=frames, radar=radar)
        else:
            with plan_of(quality, frames=frames, radar=radar) as plan:
                rate = measure_unstored(plan)
        bound_s = bounds_s[radar] if storage and quality == "low" else None
        _add(result, name, quality, rate, box_error_px, bound_s)
        if quality == "low" and storage:
            shorter = measure_stored(folder / f"short-{radar}", quality, frames=sizes.short_frames, radar=radar)
            _check(result, rate.per_processor_s(shorter), radar=radar)


def _add(
    result: BenchmarkResult, name: str, quality: str, rate: Rate, box_error_px: float, bound_s: float | None
) -> None:
    per_frame_s = 1.0 / rate.steady_frames_per_s if rate.steady_frames_per_s else rate.wall_s / rate.frames
    details = {
        "quality": quality,
        "frames": rate.frames,
        "frames_per_s": 1.0 / per_frame_s,
        "frames_per_s_with_start": rate.frames / rate.wall_s,
    }
    paper_rate = _PAPER_FRAMES_PER_S.get((name.startswith("with radar"), name.endswith(", stored")))
    if paper_rate is not None:
        details |= {"paper_frames_per_s": paper_rate, "times_the_paper": 1.0 / per_frame_s / paper_rate}
    if bound_s is not None:
        details |= {"floor_s": bound_s, "floor_share": bound_s / per_frame_s}
    result.rows.append(Row(name, quality, box_error_px, "px", per_frame_s, details))


def _check(result: BenchmarkResult, frames_per_s: float, *, radar: bool) -> None:
    name = f"low quality, {'with' if radar else 'without'} radar, stored"
    result.checks.append(
        Check(f"{name}: rate by processor time", frames_per_s, ">=", _MIN_FRAMES_PER_S[radar], "frames/s", "speed")
    )


def _errors(folder: Path, result: BenchmarkResult, status: ShowStatus) -> float:
    """Add the checks of the data's errors and return the mean error of a box's edges [px]."""
    status("data sets with one worker and with two")
    with plan_of("low", frames=20, radar=True) as plan:
        for count in (1, 2):
            make_dataset(plan, folder / f"by-{count}", MakeOptions(workers=count, quiet=True))
        differing = differing_files(folder / "by-1", folder / "by-2")
        boxes, miss_px = box_errors(folder / "by-1")
        status("the radar's exact sum")
        error, tolerance = radar_error(plan)
    result.checks += [
        Check(", ".join(["files that differ with one worker and with two", *differing]), len(differing), "<=", 0, ""),
        Check(f"pixels by which {boxes} boxes miss the masks", miss_px, "<=", 0, "px"),
        Check("radar frame against the exact sum", error, "<=", tolerance, "relative"),
    ]
    return miss_px / max(boxes, 1)
