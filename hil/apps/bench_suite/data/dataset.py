"""`hil bench dataset`: table 5 of the AirLoop paper on this machine, with the errors of the recorded data.

Measured are frames per second with and without radar, with and without storage, at five qualities, for the default
bench of `hil dataset`. Each rate is given in steady state, and including take-off and the start of the workers. The
paper's figures are for 500 frames of 320 x 240 pixels on a laptop with an RTX 3060.

The lower bound of the time is that of encoding and writing the same arrays alone. Errors are the pixels by which boxes
miss the masks, radar frames against the exact sum, and files that differ between one worker and two.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from hil.apps.bench_suite.data.dataset_cases import (
    Rate,
    box_errors,
    digest,
    floor_s,
    not_stored,
    plan_of,
    radar_error,
    stored,
)
from hil.apps.bench_suite.result import BenchmarkResult, Check, Row, Status
from hil.apps.dataset.make import MakeOptions, cores, make_dataset
from sim.frame.quality import QUALITIES

_PAPER = {(True, True): 7.17, (False, True): 20.1}  # (radar, storage): frames a second
_FRAMES, _QUICK_FRAMES = 500, 250
_FINE_FRAMES = 150  # at the qualities above the lowest
_MIN_FRAMES_PER_S = {True: 110.0, False: 180.0}  # with storage, by radar


def measure(*, quick: bool, status: Status) -> BenchmarkResult:
    """Record data sets in all variants. Raises HilError if a flight or the disk fails."""
    result = BenchmarkResult(time_label="wall seconds a frame, under way")
    with tempfile.TemporaryDirectory(prefix="hil-bench-") as folder:
        errors = _errors(Path(folder), result, status)
        floors = {}
        for radar in (True, False):
            status("the floor: encoding and writing alone")
            with plan_of("low", frames=40, radar=radar) as plan:
                floors[radar] = floor_s(plan) / cores()
        for quality in ("low",) if quick else QUALITIES:
            frames = _QUICK_FRAMES if quick else _FRAMES if quality == "low" else _FINE_FRAMES
            for radar in (True, False):
                for storage in (True, False):
                    name = f"{'with' if radar else 'without'} radar, {'stored' if storage else 'not stored'}"
                    status(f"{quality}, {name}")
                    if storage:
                        rate = stored(Path(folder) / f"{quality}-{radar}", quality, frames=frames, radar=radar)
                    else:
                        with plan_of(quality, frames=frames, radar=radar) as plan:
                            rate = not_stored(plan)
                    _add(result, name, quality, rate, errors, floors[radar] if storage and quality == "low" else None)
                    if quality == "low" and storage:
                        _check(result, rate, radar=radar)
    if quick:
        result.left_out += [f"quality {quality}" for quality in QUALITIES if quality != "low"]
        result.left_out.append(f"rates over {_FRAMES} frames ({_QUICK_FRAMES} were taken)")
    return result


def _add(result: BenchmarkResult, name: str, quality: str, rate: Rate, box_error: float, floor: float | None) -> None:
    per_frame_s = 1.0 / rate.steady_frames_per_s if rate.steady_frames_per_s else rate.wall_s / rate.frames
    details = {
        "quality": quality,
        "frames": rate.frames,
        "frames_per_s": 1.0 / per_frame_s,
        "frames_per_s_with_start": rate.frames / rate.wall_s,
    }
    paper = _PAPER.get((name.startswith("with radar"), name.endswith(", stored")))
    if paper is not None:
        details |= {"paper_frames_per_s": paper, "times_the_paper": 1.0 / per_frame_s / paper}
    if floor is not None:
        details |= {"floor_s": floor, "floor_share": floor / per_frame_s}
    result.rows.append(Row(name, quality, box_error, "px", per_frame_s, details))


def _check(result: BenchmarkResult, rate: Rate, *, radar: bool) -> None:
    name = f"low quality, {'with' if radar else 'without'} radar, stored"
    result.checks.append(Check(name, rate.steady_frames_per_s, ">=", _MIN_FRAMES_PER_S[radar], "frames/s"))


def _errors(folder: Path, result: BenchmarkResult, status: Status) -> float:
    """Add the checks of the data's errors and return the mean error of a box's edges [px]."""
    status("one worker and two")
    with plan_of("low", frames=20, radar=True) as plan:
        for count in (1, 2):
            make_dataset(plan, folder / f"by-{count}", MakeOptions(workers=count, quiet=True))
        digests = {digest(folder / f"by-{count}") for count in (1, 2)}
        boxes, wrong = box_errors(folder / "by-1")
        status("the radar's exact sum")
        error, tolerance = radar_error(plan)
    result.checks += [
        Check("different trees by one worker and two", len(digests) - 1, "<=", 0, "trees"),
        Check(f"pixels by which {boxes} boxes miss the masks", wrong, "<=", 0, "px"),
        Check("radar frame against the exact sum", error, "<=", tolerance, "relative"),
    ]
    return wrong / max(boxes, 1)
