"""Micro-Doppler of a track: the ranges about it, over the frames in which it was there."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from hil.apps.radar.results import Results, TrackSpectraCollector, rows_over_frames
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


def test_speeds_beyond_the_unambiguous_span_are_drawn_where_the_map_shows_them(tmp_path: Path) -> None:
    from hil.run.report.radar_pictures import micro_doppler_figure, waterfall_figure  # matplotlib

    v_max = CHIRP.max_speed_mps
    results = Results(CHIRP, 3)
    for k, speed_mps in enumerate((0.5 * v_max, 1.25 * v_max, -2.5 * v_max)):
        shown = frame((1, 5.0))
        shown.tracks["speed_mps"] = speed_mps
        results.add(50_000_000 * k, shown)
    rows = np.array(results.power_by_speed)
    figures = {
        1: waterfall_figure("walk", results.t_s, np.array(results.power_by_range), rows, results.tracks, CHIRP),
        0: micro_doppler_figure(
            "walk", results.t_s, rows, results.t_s,
            np.array([float(tracks["speed_mps"][0]) for tracks in results.tracks]), CHIRP,
        ),
    }  # fmt: skip
    step = 2.0 * v_max / 64
    for panel, figure in figures.items():
        axes = figure.axes[panel]
        within, beyond = axes.get_lines()
        assert np.asarray(within.get_ydata())[0] == pytest.approx(0.5 * v_max)
        assert np.isnan(np.asarray(within.get_ydata())[1:]).all()
        assert np.asarray(beyond.get_ydata()) == pytest.approx([-0.75 * v_max, -0.5 * v_max], rel=1e-5)
        assert axes.get_ylim() == pytest.approx((-v_max - 0.5 * step, v_max - 0.5 * step))
        assert f"unambiguous within ±{v_max:.2f} m/s" in axes.get_title(loc="left")
        legend = axes.get_legend()
        assert legend is not None
        assert "folded" in legend.get_texts()[1].get_text()
    results.write(tmp_path, title="walk")
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["track_rows_beyond_max_speed"], summary["max_speed_mps"]) == (2, v_max)


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
