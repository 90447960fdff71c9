"""`hil radar`: a recording through the processing chain, or radar frames out of recorded pictures.

Writes into the folder: `summary.png` (range and speed over time, with the tracks), `micro_doppler.png` (speed over time
about the track that came the farthest, where there is one), some `range_doppler_N.png` (beside the camera's picture of
the same instant, where that was recorded), `points.csv`, `tracks.csv`, `radar.npz` with all of it, `summary.json`, and
where the frames were made here, `raw.npz` with `raw.json`, which `hil radar` and `hil calibrate radar` read.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from hil.radar_offline.results import Results
from hil.radar_offline.sources import Frame, Source, open_source, pictures_at
from hil.signals.errors import ConfigError, Problem, RecordingError
from hil.signals.time import NS_PER_S
from sim.radar.processing.processor import Processor
from sim.radar.recording import Recording, save_recording

FOLDER = "radar"


def process_radar(
    target: Path,
    console: Console,
    *,
    out: Path | None = None,
    preset: str | None = None,
    sensor: str | None = None,
    settings: Sequence[str] = (),
    from_s: float | None = None,
    until_s: float | None = None,
    quiet: bool = False,
) -> list[Path]:
    """Process the frames whose middle is from `from_s` to `until_s`, without them every one; returns what was written,
    the summary's picture first. ConfigError, RecordingError."""
    source = open_source(target, preset=preset, texts=settings, sensor=sensor)
    if from_s is not None or until_s is not None:
        source = _within(source, -math.inf if from_s is None else from_s, math.inf if until_s is None else until_s)
    folder = out if out is not None else _folder(target)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        results, made = _process(source, console, quiet=quiet)
        results.rgb = pictures_at(source, {results.t_ns[index] for index in results.shown})
        files = results.write(folder, what=f"{_name(target)}: {source.what}")
        if source.made and made:
            save_recording(folder / "raw.npz", _recording(source, made))
            files += [folder / "raw.npz", folder / "raw.json"]
    except OSError as error:
        raise RecordingError(f"{folder}: the results cannot be written ({error.strerror or error})") from error
    return files


def _folder(target: Path) -> Path:
    if target.is_dir():
        return target / FOLDER
    return target.parent / (FOLDER if target.suffix == ".mcap" else f"{target.stem}-{FOLDER}")


def _name(target: Path) -> str:
    """Of the run or the recording, wherever it lies and by whatever link it was reached."""
    path = target.resolve()
    return path.parent.name if path.suffix == ".mcap" else path.name if path.is_dir() else path.stem


def _within(source: Source, from_s: float, until_s: float) -> Source:
    """The frames of a part of the time."""
    times: list[float] = []
    frames: list[Frame] = []
    for frame in source.frames:
        times.append(frame.t_ns / NS_PER_S)
        if from_s <= times[-1] <= until_s:
            frames.append(frame)
    if not frames:
        lasts = f"the frames are from {times[0]:.3f} to {times[-1]:.3f} s" if times else "there is no frame at all"
        raise ConfigError([Problem("--from, --until", f"no frame from {from_s:g} to {until_s:g} s", lasts)])
    return replace(source, count=len(frames), frames=iter(frames))


def _process(source: Source, console: Console, *, quiet: bool) -> tuple[Results, list[Frame]]:
    """Results, and where the frames were made here, the frames."""
    p = source.parameters
    processor = Processor(p.chirp, p.antenna.rx_positions_m, p.processing)
    results = Results(p.chirp, source.count)
    made: list[Frame] = []
    shown = quiet or not console.is_terminal
    for frame in track(source.frames, source.what, source.count, console=console, transient=True, disable=shown):
        results.add(frame.t_ns, processor.process(frame.raw, frame.t_ns))
        if source.made:
            made.append(frame)
    return results, made


def _recording(source: Source, frames: Sequence[Frame]) -> Recording:
    p = source.parameters
    times = [frame.t_ns for frame in frames]
    period_s = float(np.median(np.diff(times))) / NS_PER_S if len(times) > 1 else None
    return Recording(
        np.array([frame.raw for frame in frames]),
        p.chirp,
        tuple(range(1, len(p.antenna.rx_positions_m) + 1)),
        period_s,
        p.receiver.hp_cutoff_hz,
        p.receiver.aaf_cutoff_hz,
    )
