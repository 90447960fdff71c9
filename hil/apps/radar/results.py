"""Results of `hil radar`: points and tracks as tables, all results as arrays, some maps and a summary as pictures.

Micro-Doppler shows the speeds near a track, frame by frame. The track follows a person's trunk, and the limbs are
within an arm's length of it. Power is therefore summed over the range bins at most `NEAR_M` from the track's range,
which excludes other objects and noise elsewhere.
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

from signals.time import NS_PER_S
from sim.radar.chirp import Chirp
from sim.radar.processing.points import POINT_DTYPE
from sim.radar.processing.processor import Processed
from sim.radar.processing.tracker import TRACK_DTYPE

PICTURES = 8  # range-Doppler maps plotted, spread over the frames
NEAR_M = 0.9


@dataclass
class TrackSpectra:
    """Speed spectra of one track; the lists have one value per frame in which the track existed."""

    track: int
    frames: list[int] = field(default_factory=list)
    power: list[NDArray[np.float32]] = field(default_factory=list)  # by speed bin
    range_m: list[float] = field(default_factory=list)
    speed_mps: list[float] = field(default_factory=list)

    @property
    def range_span_m(self) -> float:
        """Difference between the track's maximum and minimum range."""
        return max(self.range_m) - min(self.range_m)


class TrackSpectraCollector:
    """Collector of the speed spectra of all tracks, frame by frame."""

    def __init__(self, chirp: Chirp) -> None:
        self._chirp = chirp
        self._tracks: dict[int, TrackSpectra] = {}

    def add(self, frame: int, processed: Processed) -> None:
        """Add the results of frame number `frame`."""
        power = processed.range_doppler
        bin_m = self._chirp.max_range_m / power.shape[1]
        for track in processed.tracks:
            range_m = float(track["range_m"])
            near_bins = np.abs(np.arange(power.shape[1]) * bin_m - range_m) <= max(NEAR_M, bin_m)
            spectra = self._tracks.setdefault(int(track["id"]), TrackSpectra(int(track["id"])))
            spectra.frames.append(frame)
            spectra.power.append(power[:, near_bins].sum(axis=1))
            spectra.range_m.append(range_m)
            spectra.speed_mps.append(float(track["speed_mps"]))

    def longest(self) -> TrackSpectra | None:
        """Return the track with the greatest span of range, because a standing person moves no limbs.

        The first track wins a tie; None if there is no track.
        """
        return max(self._tracks.values(), key=lambda track: track.range_span_m, default=None)


def rows_over_frames(spectra: TrackSpectra) -> tuple[NDArray[np.intp], NDArray[Any]]:
    """Return the frame numbers from the track's first to its last, and power by frame and speed bin.

    Rows of frames without the track are NaN.
    """
    first, last = spectra.frames[0], spectra.frames[-1]
    rows = np.full((last - first + 1, len(spectra.power[0])), np.nan, np.float32)
    rows[np.array(spectra.frames) - first] = spectra.power
    return np.arange(first, last + 1), rows


class Results:
    """Results of all frames, collected one by one. `rgb` holds camera pictures by the time of their frame [ns]."""

    def __init__(self, chirp: Chirp, count: int) -> None:
        self.chirp = chirp
        self.t_ns: list[int] = []
        self.points: list[NDArray[Any]] = []
        self.tracks: list[NDArray[Any]] = []
        self.power_by_range: list[NDArray[np.float32]] = []  # by range bin: greatest power over all speeds
        self.power_by_speed: list[NDArray[np.float32]] = []  # by speed bin: sum of power over all ranges
        self.spectra = TrackSpectraCollector(chirp)
        self.plotted: dict[int, Processed] = {}  # frames to plot, by number
        self.rgb: dict[int, NDArray[np.uint8]] = {}
        self._plot_numbers = set(np.linspace(0, max(count - 1, 0), min(PICTURES, max(count, 1))).astype(int).tolist())

    def add(self, t_ns: int, processed: Processed) -> None:
        """Add the results of the next frame, whose middle is at `t_ns`."""
        if len(self.t_ns) in self._plot_numbers:
            self.plotted[len(self.t_ns)] = processed
        self.spectra.add(len(self.t_ns), processed)
        self.t_ns.append(t_ns)
        self.points.append(processed.points)
        self.tracks.append(processed.tracks)
        self.power_by_range.append(processed.range_doppler.max(axis=0))
        self.power_by_speed.append(processed.range_doppler.sum(axis=1))

    @property
    def t_s(self) -> NDArray[np.float64]:
        """Time of the middle of each frame [s]."""
        return np.array(self.t_ns, np.float64) / NS_PER_S

    def write(self, folder: Path, *, title: str) -> list[Path]:
        """Write tables, arrays and pictures; return their paths, the summary's picture first. Raises OSError.

        `title` names the source in the pictures and in summary.json.
        """
        files = [
            _write_table(folder / "points.csv", self.t_s, self.points, POINT_DTYPE),
            _write_table(folder / "tracks.csv", self.t_s, self.tracks, TRACK_DTYPE),
            self._write_arrays(folder / "radar.npz"),
            self._write_summary(folder / "summary.json", title),
        ]
        return [*self._write_pictures(folder, title), *files]

    def _write_arrays(self, path: Path) -> Path:
        np.savez_compressed(
            path,
            t_ns=np.array(self.t_ns, np.int64),
            points=_joined(self.points, POINT_DTYPE),
            points_per_frame=np.array([len(points) for points in self.points], np.int64),
            tracks=_joined(self.tracks, TRACK_DTYPE),
            tracks_per_frame=np.array([len(tracks) for tracks in self.tracks], np.int64),
            range_time=np.array(self.power_by_range),
            speed_time=np.array(self.power_by_speed),
        )
        return path

    def _write_summary(self, path: Path, title: str) -> Path:
        chirp = self.chirp
        tracks_per_frame = [len(tracks) for tracks in self.tracks]
        summary = {
            "source": title,
            "frames": len(self.t_ns),
            "points": sum(len(points) for points in self.points),
            "frames_with_track": sum(count > 0 for count in tracks_per_frame),
            "tracks": len({int(i) for tracks in self.tracks for i in tracks["id"]}),
            "chirp": chirp.model_dump(mode="json"),
            "range_resolution_m": chirp.range_resolution_m,
            "max_range_m": chirp.max_range_m,
            "speed_resolution_mps": chirp.speed_resolution_mps,
            "max_speed_mps": chirp.max_speed_mps,
            # Rows of tracks.csv whose speed is beyond max_speed_mps: a fast object, or a track that was lost.
            "track_rows_beyond_max_speed": sum(
                int(np.count_nonzero(np.abs(tracks["speed_mps"]) > chirp.max_speed_mps)) for tracks in self.tracks
            ),
        }
        path.write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
        return path

    def _write_pictures(self, folder: Path, title: str) -> list[Path]:
        from hil.run.report import figures, radar_pictures  # imported late: matplotlib takes half a second

        files = []
        with figures.style():
            figure = radar_pictures.waterfall_figure(
                title, self.t_s, np.array(self.power_by_range), np.array(self.power_by_speed), self.tracks, self.chirp
            )
            files.append(figures.save(figure, folder / "summary.png"))
            longest = self.spectra.longest()
            if longest is not None:
                frames, power = rows_over_frames(longest)
                figure = radar_pictures.micro_doppler_figure(
                    f"{title}, track {longest.track}",
                    self.t_s[frames],
                    power,
                    self.t_s[longest.frames],
                    np.array(longest.speed_mps),
                    self.chirp,
                )
                files.append(figures.save(figure, folder / "micro_doppler.png"))
            for index, processed in self.plotted.items():
                frame_title = f"frame {index}, {self.t_ns[index] / NS_PER_S:.2f} s"
                channels = {name: getattr(processed, name) for name in ("range_doppler", "points", "tracks")}
                rgb = self.rgb.get(self.t_ns[index])
                figure = radar_pictures.radar_figure(frame_title, channels, self.chirp, rgb)
                files.append(figures.save(figure, folder / f"range_doppler_{index:05d}.png"))
        return files


def _joined(arrays: Sequence[NDArray[Any]], dtype: np.dtype[Any]) -> NDArray[Any]:
    return np.concatenate([np.empty(0, dtype), *arrays])


def _write_table(path: Path, t_s: NDArray[np.float64], frames: Sequence[NDArray[Any]], dtype: np.dtype[Any]) -> Path:
    """Write one row per record: frame, time, then the fields; a vector has three columns."""
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
