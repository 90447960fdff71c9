"""`hil radar`: runs a recording through the processing chain, making radar frames from recorded pictures if needed.

It writes `summary.png` (range and speed over time, with the tracks), `micro_doppler.png` (speed over time around the
track with the greatest span of range, if there is a track), some `range_doppler_N.png` (beside the camera's picture of
the same instant, if recorded), `points.csv`, `tracks.csv`, `radar.npz` with all results and `summary.json`. Frames
made from pictures are saved in `raw.npz` with `raw.json`, which `hil radar` and `hil calibrate radar` read. With
`dca1000`, the frames are also written as TI's capture card does (hil/apps/radar/dca1000.py).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from hil.apps.radar.dca1000 import Dca1000File
from hil.apps.radar.dca1000_source import open_capture
from hil.apps.radar.raw_codes import RawCodes
from hil.apps.radar.results import Results
from hil.apps.radar.sources import Frame, Source, open_source, pictures_at
from hil.run.report.run_folder import locked_folder
from signals.errors import ConfigError, file_errors
from signals.time import NS_PER_S
from sim.radar.processing.processor import Processor
from sim.radar.recording import Recording, save_recording

FOLDER = "radar"


@dataclass(frozen=True)
class TimeSpan:
    """Part of a recording, both ends included [s]; None leaves an end open."""

    from_s: float | None = None
    until_s: float | None = None


@dataclass(frozen=True)
class Outputs:
    """Places of the results."""

    folder: Path | None = None  # None: beside the recording
    dca1000: Path | None = None  # file for the raw frames as TI's capture card writes them; None: they are not written


def process_radar(
    target: Path,
    console: Console,
    *,
    outputs: Outputs = Outputs(),
    preset: str | None = None,
    sensor: str | None = None,
    settings: Sequence[str] = (),
    span: TimeSpan = TimeSpan(),
    quiet: bool = False,
) -> list[Path]:
    """Process the frames whose middle lies in `span` and return the files written, the summary's picture first.

    Raises ConfigError, RecordingError.
    """
    if target.suffix == ".bin":
        if sensor is not None:
            raise ConfigError.at("--sensor", f"{target} holds one radar without a name", "leave it out")
        source = open_capture(target, preset=preset, texts=settings)
    else:
        source = open_source(target, preset=preset, texts=settings, sensor=sensor)
    if span != TimeSpan():
        source = _frames_in_span(source, span)
    folder = outputs.folder if outputs.folder is not None else _folder(target)
    dca1000 = outputs.dca1000
    capture = None if dca1000 is None else Dca1000File(dca1000, source.parameters, source.part)
    with file_errors(folder, "the results cannot be written"), locked_folder(folder), capture or nullcontext():
        results, made_frames = _process(source, console, capture, quiet=quiet)
        results.rgb = pictures_at(source, {results.t_ns[index] for index in results.plotted})
        files = results.write(folder, title=f"{_name(target)}: {source.description}")
        if source.from_pictures and made_frames:
            save_recording(folder / "raw.npz", _recording(source, made_frames))
            files += [folder / "raw.npz", folder / "raw.json"]
    if capture is not None:
        files += [capture.path, *capture.settings_files]
    return files


def _folder(target: Path) -> Path:
    if target.is_dir():
        return target / FOLDER
    return target.parent / (FOLDER if target.suffix == ".mcap" else f"{target.stem}-{FOLDER}")


def _name(target: Path) -> str:
    """Return the name of the run or recording, with links resolved."""
    path = target.resolve()
    return path.parent.name if path.suffix == ".mcap" else path.name if path.is_dir() else path.stem


def _frames_in_span(source: Source, span: TimeSpan) -> Source:
    """Keep the frames of a time span."""
    from_s = -math.inf if span.from_s is None else span.from_s
    until_s = math.inf if span.until_s is None else span.until_s
    times: list[float] = []
    frames: list[Frame] = []
    for frame in source.frames:
        times.append(frame.t_ns / NS_PER_S)
        if from_s <= times[-1] <= until_s:
            frames.append(frame)
    if not frames:
        hint = f"the frames are from {times[0]:.3f} to {times[-1]:.3f} s" if times else "there is no frame at all"
        raise ConfigError.at("--from, --until", f"no frame from {from_s:g} to {until_s:g} s", hint)
    return replace(source, count=len(frames), frames=iter(frames))


def _process(
    source: Source, console: Console, capture: Dca1000File | None, *, quiet: bool
) -> tuple[Results, list[Frame]]:
    """Process all frames; return the results and, if they were made from pictures, the frames."""
    p = source.parameters
    processor = Processor(p.chirp, p.antenna.array, p.processing)
    results = Results(p.seen, source.count)
    made_frames: list[Frame] = []
    codes = RawCodes(p.receiver.adc_bits)
    hidden = quiet or not console.is_terminal
    for frame in track(
        source.frames, source.description, source.count, console=console, transient=True, disable=hidden
    ):
        codes.add(frame.raw)
        results.add(frame.t_ns, processor.process(frame.raw, frame.t_ns))
        if capture is not None:
            capture.add(frame.t_ns, frame.raw)
        if source.from_pictures:
            made_frames.append(frame)
    for warning in codes.warnings():
        console.print(f"warning: {warning}", markup=False)
    return results, made_frames


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
