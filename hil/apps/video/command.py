"""`hil video`: a film of a recorded run, drawn again from its true states.

A film has one picture every 1 / `rate_hz` of simulated time; with `speed` 2 it runs twice as fast as the flight did.
The scene, the vehicles and the cameras are those of the run's own bench.yaml.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hil.config import load_bench
from hil.run.film.film import ALONE, CHASE, Film
from hil.run.film.movie import Movie
from hil.run.recorder.reading import RecordedMessage, Recording
from hil.run.replay import run_files
from signals.errors import ConfigError, RecordingError
from signals.samples import TruthState
from signals.time import NS_PER_S

FILE_NAME = "video.mp4"
DEFAULT_SIZE = (1280, 720)
_LIMITS = (64, 4096)  # pixels along an edge
_TRUTH = (
    "/truth/pose",
    "/truth/velocity",
    "/truth/angular_velocity",
    "/truth/acceleration",
    "/truth/angular_acceleration",
    "/truth/rotors",
)


@dataclass(frozen=True)
class VideoOptions:
    """Choices of a film."""

    view: str = CHASE  # chase, split, or a camera of the bench
    vehicle: str = ""  # of several; default the first
    size: str | None = None  # 'WxH' [px]
    rate_hz: float = 30.0
    speed: float = 1.0
    start_s: float = 0.0
    end_s: float | None = None


def film_run(
    run_dir: Path, out: Path | None, options: VideoOptions, progress: Callable[[float], None] = lambda _: None
) -> tuple[Path, int]:
    """Film a run into `out` (default video.mp4 in its folder) and return the file and its number of pictures.

    `progress` gets the simulated time of each picture [s]. Raises ConfigError for wrong options, RecordingError for a
    run without a recording or a film that cannot be written.
    """
    size = _size(options.size)
    config, recorded = run_files(run_dir, "filmed", whole="hil video {run} --vehicle {vehicle}")
    names = Recording(recorded).scan().vehicles
    bench = load_bench(config, flown=False)
    path = out if out is not None else run_dir / FILE_NAME
    period_ns = max(1, round(NS_PER_S * options.speed / options.rate_hz))
    begin_ns, end_ns = round(options.start_s * NS_PER_S), None
    if options.end_s is not None:
        end_ns = round(options.end_s * NS_PER_S)
    film = Film(bench, size, options.view, options.vehicle, threads=2)
    flights = {name or ALONE: _states(recorded, name, begin_ns, end_ns, period_ns) for name in names or ("",)}
    try:
        with Movie(path, size, options.rate_hz) as movie:
            for states in zip(*flights.values(), strict=False):
                movie.add(film.picture(dict(zip(flights, states, strict=True))))
                progress(states[0].t_ns / NS_PER_S)
            if not movie.count:
                raise RecordingError(f"{run_dir}: has no states from {options.start_s:g} s on; see --start and --end")
    finally:
        film.close()
    return path, movie.count


def _states(recorded: Path, vehicle: str, begin_ns: int, end_ns: int | None, period_ns: int) -> Iterator[TruthState]:
    """Yield the state of a vehicle at each picture: the last one that is not later than it."""
    picture_ns, last = begin_ns, None
    for tick in _ticks(recorded, vehicle):
        while last is not None and picture_ns < tick[0]:
            if end_ns is not None and picture_ns > end_ns:
                return
            yield _state(*last)
            picture_ns += period_ns
        last = tick
    if last is not None and picture_ns <= last[0] and (end_ns is None or picture_ns <= end_ns):
        yield _state(*last)


def _ticks(recorded: Path, vehicle: str) -> Iterator[tuple[int, dict[str, RecordedMessage]]]:
    """Yield time and messages of each recorded state. Raises RecordingError for a damaged recording."""
    parts: dict[str, RecordedMessage] = {}
    now_ns = -1
    for message in Recording(recorded, vehicle).messages():
        if message.topic not in _TRUTH:
            continue
        if message.log_time_ns != now_ns and parts:
            yield now_ns, parts
            parts = {}
        now_ns = message.log_time_ns
        parts[message.topic] = message
    if parts:
        yield now_ns, parts


def _state(t_ns: int, parts: dict[str, RecordedMessage]) -> TruthState:
    """Return the state in the messages of a tick."""
    (x, y, z, qx, qy, qz, qw), v, w, a, alpha, rotors = (_numbers(parts[topic].decode()) for topic in _TRUTH)
    return TruthState(0, t_ns, (x, y, z), (qw, qx, qy, qz), v, w, a, alpha, rotors, False)  # type: ignore[arg-type]


def _numbers(values: dict[str, Any]) -> tuple[float, ...]:
    """Return the numbers of a message in the order of its fields, without its header."""
    return tuple(value for name, value in values.items() if not name.startswith("header."))


def _size(text: str | None) -> tuple[int, int]:
    """Return width and height of 'WxH'. Raises ConfigError."""
    if text is None:
        return DEFAULT_SIZE
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    width, height = (int(found[1]), int(found[2])) if found else (0, 0)
    least, most = _LIMITS
    if not (least <= width <= most and least <= height <= most and width % 4 == 0 and height % 2 == 0):
        message = f"must be WIDTHxHEIGHT, each from {least} to {most}, the width a multiple of 4, the height of 2"
        raise ConfigError.at("--size", f"{text!r}: {message}", "such as 1280x720")
    return width, height
