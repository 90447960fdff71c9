"""What `hil radar` leaves: points and tracks as tables, everything as arrays, some maps and a summary as pictures.

Micro-Doppler: the speeds of what is near a track, frame by frame.

A person's limbs are within an arm's length of the trunk that the track follows, and nothing else should be: power is
summed over the range bins at most `NEAR_M` from the track's range, so that noise and things elsewhere stay out.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.signals.time import NS_PER_S
from sim.radar.chirp import Chirp
from sim.radar.processing.points import POINT_DTYPE
from sim.radar.processing.processor import Processed
from sim.radar.processing.tracker import TRACK_DTYPE

PICTURES = 8  # maps drawn, spread over the frames
NEAR_M = 0.9


@dataclass
class TrackSpectra:
    """One track; lists have one value a frame in which it was there."""

    track: int
    frames: list[int] = field(default_factory=list)
    power: list[NDArray[np.float32]] = field(default_factory=list)  # over the speeds
    range_m: list[float] = field(default_factory=list)
    speed_mps: list[float] = field(default_factory=list)

    @property
    def way_m(self) -> float:
        """From its nearest to its farthest range."""
        return max(self.range_m) - min(self.range_m)


class SpectraOfTracks:
    """Collects the frames one by one."""

    def __init__(self, chirp: Chirp) -> None:
        self._chirp = chirp
        self._tracks: dict[int, TrackSpectra] = {}

    def add(self, frame: int, processed: Processed) -> None:
        """Take in one frame."""
        power = processed.range_doppler
        bin_m = self._chirp.max_range_m / power.shape[1]
        for track in processed.tracks:
            range_m = float(track["range_m"])
            near = np.abs(np.arange(power.shape[1]) * bin_m - range_m) <= max(NEAR_M, bin_m)
            found = self._tracks.setdefault(int(track["id"]), TrackSpectra(int(track["id"])))
            found.frames.append(frame)
            found.power.append(power[:, near].sum(axis=1))
            found.range_m.append(range_m)
            found.speed_mps.append(float(track["speed_mps"]))

    def farthest(self) -> TrackSpectra | None:
        """The track that came the farthest in range, of equals the first: one that stands shows no limbs."""
        return max(self._tracks.values(), key=lambda track: track.way_m, default=None)


def rows_over_frames(spectra: TrackSpectra) -> tuple[NDArray[np.intp], NDArray[Any]]:
    """The frames from its first to its last, and the power of each: of none (NaN) where the track was not there."""
    first, last = spectra.frames[0], spectra.frames[-1]
    rows = np.full((last - first + 1, len(spectra.power[0])), np.nan, np.float32)
    rows[np.array(spectra.frames) - first] = spectra.power
    return np.arange(first, last + 1), rows


class Results:
    """Collects the frames one by one."""

    def __init__(self, chirp: Chirp, count: int) -> None:
        self.chirp = chirp
        self.t_ns: list[int] = []
        self.points: list[NDArray[Any]] = []
        self.tracks: list[NDArray[Any]] = []
        self.over_range: list[NDArray[np.float32]] = []  # greatest power over the speeds
        self.over_speed: list[NDArray[np.float32]] = []  # sum of power over the ranges
        self.spectra = SpectraOfTracks(chirp)
        self.shown: dict[int, Processed] = {}
        self.rgb: dict[int, NDArray[np.uint8]] = {}  # what a camera saw, by the time [ns] of the frame
        self._wanted = set(np.linspace(0, max(count - 1, 0), min(PICTURES, max(count, 1))).astype(int).tolist())

    def add(self, t_ns: int, processed: Processed) -> None:
        """Take in one frame."""
        if len(self.t_ns) in self._wanted:
            self.shown[len(self.t_ns)] = processed
        self.spectra.add(len(self.t_ns), processed)
        self.t_ns.append(t_ns)
        self.points.append(processed.points)
        self.tracks.append(processed.tracks)
        self.over_range.append(processed.range_doppler.max(axis=0))
        self.over_speed.append(processed.range_doppler.sum(axis=1))

    @property
    def t_s(self) -> NDArray[np.float64]:
        """Middle of each frame."""
        return np.array(self.t_ns, np.float64) / NS_PER_S

    def write(self, folder: Path, *, what: str) -> list[Path]:
        """Tables, arrays and pictures; returns their paths, the summary's picture first. OSError."""
        files = [
            _table(folder / "points.csv", self.t_s, self.points, POINT_DTYPE),
            _table(folder / "tracks.csv", self.t_s, self.tracks, TRACK_DTYPE),
            self._arrays(folder / "radar.npz"),
            self._summary(folder / "summary.json", what),
        ]
        return [*self._pictures(folder, what), *files]

    def _arrays(self, path: Path) -> Path:
        np.savez_compressed(
            path,
            t_ns=np.array(self.t_ns, np.int64),
            points=_joined(self.points, POINT_DTYPE),
            points_per_frame=np.array([len(points) for points in self.points], np.int64),
            tracks=_joined(self.tracks, TRACK_DTYPE),
            tracks_per_frame=np.array([len(tracks) for tracks in self.tracks], np.int64),
            range_time=np.array(self.over_range),
            speed_time=np.array(self.over_speed),
        )
        return path

    def _summary(self, path: Path, what: str) -> Path:
        chirp = self.chirp
        seen = [len(tracks) for tracks in self.tracks]
        summary = {
            "source": what,
            "frames": len(self.t_ns),
            "points": sum(len(points) for points in self.points),
            "frames_with_track": sum(count > 0 for count in seen),
            "tracks": len({int(i) for tracks in self.tracks for i in tracks["id"]}),
            "chirp": chirp.model_dump(mode="json"),
            "range_resolution_m": chirp.range_resolution_m,
            "max_range_m": chirp.max_range_m,
            "speed_resolution_mps": chirp.speed_resolution_mps,
            "max_speed_mps": chirp.max_speed_mps,
        }
        path.write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
        return path

    def _pictures(self, folder: Path, what: str) -> list[Path]:
        from hil.report import figures, radar_pictures  # half a second of matplotlib

        files = []
        with figures.style():
            figure = radar_pictures.waterfall_figure(
                what, self.t_s, np.array(self.over_range), np.array(self.over_speed), self.tracks, self.chirp
            )
            files.append(folder / "summary.png")
            figures.save(figure, files[-1])
            farthest = self.spectra.farthest()
            if farthest is not None:
                frames, power = rows_over_frames(farthest)
                figure = radar_pictures.micro_doppler_figure(
                    f"{what}, track {farthest.track}",
                    self.t_s[frames],
                    power,
                    self.t_s[farthest.frames],
                    np.array(farthest.speed_mps),
                    self.chirp,
                )
                files.append(folder / "micro_doppler.png")
                figures.save(figure, files[-1])
            for index, processed in self.shown.items():
                title = f"frame {index}, {self.t_ns[index] / NS_PER_S:.2f} s"
                channels = {name: getattr(processed, name) for name in ("range_doppler", "points", "tracks")}
                files.append(folder / f"range_doppler_{index:05d}.png")
                rgb = self.rgb.get(self.t_ns[index])
                figures.save(radar_pictures.radar_figure(title, channels, self.chirp, rgb), files[-1])
        return files


def _joined(arrays: Sequence[NDArray[Any]], dtype: np.dtype[Any]) -> NDArray[Any]:
    return np.concatenate([np.empty(0, dtype), *arrays])


def _table(path: Path, t_s: NDArray[np.float64], frames: Sequence[NDArray[Any]], dtype: np.dtype[Any]) -> Path:
    """One row a record, its frame and time before it; vectors are three columns."""
    names = dtype.names or ()
    columns = [
        column for name in names for column in ([f"{name}_{axis}" for axis in "xyz"] if dtype[name].shape else [name])
    ]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["frame", "t_s", *columns])
        for index, records in enumerate(frames):
            for record in records:
                values = [value for name in names for value in np.atleast_1d(record[name]).tolist()]
                writer.writerow(
                    [index, f"{t_s[index]:.6f}", *(f"{v:.6g}" if isinstance(v, float) else v for v in values)]
                )
    return path
