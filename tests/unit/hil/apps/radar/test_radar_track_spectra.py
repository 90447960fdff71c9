"""Micro-Doppler of a track: the ranges about it, over the frames in which it was there."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.radar.results import TrackSpectraCollector, rows_over_frames
from sim.radar.processing.points import POINT_DTYPE
from sim.radar.processing.processor import Processed
from sim.radar.processing.tracker import TRACK_DTYPE
from tests.worlds.radar_point_targets import CHIRP

BIN_M = CHIRP.max_range_m / 32


def frame(*places: tuple[int, float]) -> Processed:
    """A map whose power is the number of the range bin, at every speed, and tracks: (identity, range [m])."""
    power = np.tile(np.arange(32, dtype=np.float32), (64, 1))
    tracks = np.zeros(len(places), TRACK_DTYPE)
    for track, (identity, range_m) in zip(tracks, places, strict=True):
        track["id"], track["range_m"], track["speed_mps"] = identity, range_m, 0.1 * identity
    return Processed(power, np.empty(0, POINT_DTYPE), tracks)


def test_the_ranges_about_the_track_that_came_the_farthest() -> None:
    spectra = TrackSpectraCollector(CHIRP)
    spectra.add(3, frame((7, 5.0), (8, 10.0 * BIN_M)))
    spectra.add(4, frame((7, 5.1)))
    spectra.add(5, frame((7, 5.0), (8, 12.0 * BIN_M)))
    longest = spectra.longest()
    assert longest is not None
    assert longest.track == 8
    assert longest.speed_mps == pytest.approx([0.8, 0.8])
    frames, rows = rows_over_frames(longest)
    assert frames.tolist() == [3, 4, 5]
    # 0.9 m are two bins to each side.
    assert np.all(rows[0] == sum(range(8, 13)))
    assert np.all(np.isnan(rows[1]))
    assert np.all(rows[2] == sum(range(10, 15)))
    from hil.run.report.radar_pictures import micro_doppler_figure  # matplotlib

    t_s = 0.05 * frames
    figure = micro_doppler_figure("walk", t_s, rows, t_s[[0, 2]], np.array(longest.speed_mps), CHIRP)
    shown = figure.axes[0].get_images()[0]
    assert shown.get_extent()[:2] == pytest.approx([0.125, 0.275])
    assert np.asarray(shown.get_array()).shape == (64, 3)


def test_without_tracks_there_is_none() -> None:
    spectra = TrackSpectraCollector(CHIRP)
    spectra.add(0, frame())
    assert spectra.longest() is None


def test_a_frame_beside_what_the_camera_saw() -> None:
    from hil.run.report.radar_pictures import radar_figure  # matplotlib

    shown = frame((1, 5.0))
    channels = {name: getattr(shown, name) for name in ("range_doppler", "points", "tracks")}
    rgb = np.arange(12 * 16 * 3, dtype=np.uint8).reshape(12, 16, 3)

    def titles(picture: NDArray[np.uint8] | None) -> list[str]:
        figure = radar_figure("walk", channels, CHIRP, picture)
        return [title for axes in figure.axes if (title := axes.get_title(loc="left"))]

    plain = ["range-Doppler", "from above, 0 points and 1 track"]
    assert titles(None) == plain
    assert titles(rgb) == ["colour", *plain]
    first = radar_figure("walk", channels, CHIRP, rgb).axes[0].get_images()[0]
    assert np.array_equal(np.asarray(first.get_array()), rgb)
