"""Pictures of what a radar measured: its range-Doppler map in decibels, its points and tracks from above.

matplotlib is slow to import: import this module at the end of a run, not at its start.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hil.run.report.frame_pictures import colour_bar, draw_channel, make_panels, note
from sim.radar.chirp import Chirp
from sim.radar.spinning import Beam, cartesian

POWER_MAP = "inferno"
_SPEED_MAP = "RdBu_r"
_MAX_SPAN_DB = 70.0  # of the colour scale, below the peak
_FLOOR_PERCENTILE = 20.0  # of a map, taken as the noise floor
_MIN_POWER = 1e-12  # counts squared
_PIXELS = 700  # across a picture from above
_PANEL_RATIO = 0.8  # height to width

Power = NDArray[np.floating[Any]]
_TRACK, _FOLDED = "#35d0ff", "#7dff6a"


def radar_figure(
    title: str, channels: Mapping[str, NDArray[Any]], chirp: Chirp, rgb: NDArray[np.uint8] | None = None
) -> Figure:
    """Draw the outputs of a radar frame; raw data alone is shown as its range-Doppler map.

    `rgb`: picture of a camera at the same time, drawn first.
    """
    power = channels.get("range_doppler")
    if power is None and "raw" in channels:
        power = plain_map(channels["raw"])
    from_above = "points" in channels or "tracks" in channels
    has_rgb = rgb is not None
    count = has_rgb + (power is not None) + from_above
    figure, panels = make_panels(title, count, _PANEL_RATIO, columns=2)
    if rgb is not None:
        draw_channel(panels[0], "rgb", rgb)
        panels[0].set_aspect("equal", anchor="N")
    if power is not None:
        draw_map(panels[has_rgb], power, chirp)
    if from_above:
        draw_from_above(panels[-1], channels.get("points"), channels.get("tracks"), chirp)
    return figure


def plain_map(raw: NDArray[Any]) -> Power:
    """Return a map for display, (chirps, samples / 2), with Hann windows after subtraction of each chirp's mean."""
    _, chirps, samples = raw.shape
    signal = raw - raw.mean(axis=2, keepdims=True)
    fast = np.fft.rfft(signal * np.hanning(samples), axis=2)[:, :, : samples // 2]
    slow = np.fft.fftshift(np.fft.fft(fast * np.hanning(chirps)[:, None], axis=1), axes=1)
    return np.asarray(np.mean(np.abs(slow) ** 2, axis=0))


def decibels(power: Power) -> Power:
    """Return power in dB, with a floor so that zero power stays finite."""
    return np.asarray(10.0 * np.log10(np.maximum(power, _MIN_POWER)))


def colour_scale(level_db: Power) -> Normalize:
    """Return the colour scale from the noise floor to the peak."""
    finite = level_db[np.isfinite(level_db)]
    if not finite.size:
        return Normalize(0.0, 1.0)
    peak = float(finite.max())
    floor = max(float(np.percentile(finite, _FLOOR_PERCENTILE)), peak - _MAX_SPAN_DB)
    return Normalize(min(floor, peak - 1.0), peak)


def draw_map(panel: Axes, power: Power, chirp: Chirp, name: str = "range-Doppler", *, plain_axes: bool = False) -> None:
    """Draw a map, range to the right, speed upwards; approaching is negative. `plain_axes`: axes named in the title."""
    level = decibels(power)
    norm = colour_scale(level)
    show_levels(panel, level, norm, range_extent(chirp, level.shape[1]), speed_extent(chirp, len(level)))
    if plain_axes:
        name += " [m] by [m/s]"
        panel.tick_params(axis="y", direction="in", pad=-22.0, labelcolor="white")
    else:
        panel.set(xlabel="range [m]", ylabel="radial speed [m/s], + goes away")
    panel.set_title(name, fontsize=9.5, loc="left")
    colour_bar(panel, norm, POWER_MAP, "power [dB re 1 count²]", "min")


def range_extent(chirp: Chirp, bins: int) -> tuple[float, float]:
    """Return the outer edges of the range bins [m]; bin i is centred at i times the bin width."""
    step = chirp.max_range_m / bins
    return -0.5 * step, chirp.max_range_m - 0.5 * step


def speed_extent(chirp: Chirp, rows: int) -> tuple[float, float]:
    """Return the outer edges of the speed rows [m/s]; row `rows` / 2 is at rest."""
    step, rest = 2.0 * chirp.max_speed_mps / rows, rows // 2
    return (-rest - 0.5) * step, (rows - rest - 0.5) * step


def show_levels(
    axes: Axes, level_db: Power, norm: Normalize, across: tuple[float, float], upward: tuple[float, float]
) -> None:
    """Draw levels [dB] with row 0 at the bottom, between these edges of both axes."""
    axes.imshow(
        level_db, origin="lower", aspect="auto", interpolation="nearest", extent=(*across, *upward), cmap=POWER_MAP,
        norm=norm,
    )  # fmt: skip
    axes.grid(visible=False)
    axes.tick_params(labelsize=7.5)


def draw_from_above(panel: Axes, points: NDArray[Any] | None, tracks: NDArray[Any] | None, chirp: Chirp) -> None:
    """Draw points coloured by speed and tracks with velocity arrows from above; forward is up."""
    norm = Normalize(-chirp.max_speed_mps, chirp.max_speed_mps)
    counts = []
    if points is not None:
        x, y = points["x_R"], points["y_R"]
        panel.scatter(
            -y, x, s=16.0, c=points["speed_mps"], cmap=_SPEED_MAP, norm=norm, linewidths=0.4, edgecolors="0.3"
        )
        colour_bar(panel, norm, _SPEED_MAP, "radial speed [m/s], + goes away", "neither")
        counts.append(_counted(len(points), "point"))
    if tracks is not None:
        for track in tracks:
            (x, y), (vx, vy) = track["p_R_m"][:2], track["v_R_mps"][:2]
            panel.plot(-y, x, "o", ms=11, mfc="none", mec="#009e73", mew=1.6)
            arrow = panel.annotate(
                f" {int(track['id'])}", (-y, x), (-(y + vy), x + vx), fontsize=8, color="#009e73", clip_on=True,
                arrowprops={"arrowstyle": "<-", "color": "#009e73", "clip_on": True},
            )  # fmt: skip
            arrow.set_in_layout(False)  # the end of a fast track's arrow may lie far outside
        counts.append(_counted(len(tracks), "track"))
        if points is None:
            note(panel, "arrows: distance\nin one second")
    far = chirp.max_range_m
    panel.plot(0.0, 0.0, "^", ms=7, color="#d55e00", mec="white")
    panel.set(xlim=(-0.62 * far, 0.62 * far), ylim=(-0.04 * far, far), xlabel="to the right [m]", ylabel="forward [m]")
    panel.tick_params(labelsize=7.5)
    panel.set_title("from above, " + " and ".join(counts), fontsize=9.5, loc="left")


def revolution_figure(title: str, codes: NDArray[np.uint8], beam: Beam, points_L: NDArray[np.floating[Any]]) -> Figure:
    """Draw a revolution of a spinning radar: power by azimuth and range, and from above with its points."""
    figure = Figure(figsize=(13.5, 6.2), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
    polar, above = figure.subplots(1, 2, gridspec_kw={"width_ratios": (1.25, 1.0)})
    low_dbm, high_dbm = beam.noise_dbm, beam.noise_dbm + _MAX_SPAN_DB
    norm = Normalize(low_dbm, high_dbm)
    step_deg = 360.0 / len(codes)
    extent = (-0.5 * beam.bin_m, beam.max_range_m + 0.5 * beam.bin_m, 360.0 - 0.5 * step_deg, -0.5 * step_deg)
    polar.imshow(
        beam.floor_dbm + beam.step_db * codes, aspect="auto", interpolation="nearest", extent=extent, cmap=POWER_MAP,
        norm=norm,
    )  # fmt: skip
    polar.set(xlabel="range [m]", ylabel="azimuth [deg], clockwise from ahead", yticks=range(0, 361, 45))
    polar.set_title("power by azimuth and range", fontsize=9.5, loc="left")
    half_m = 0.5 * beam.max_range_m
    picture = cartesian(codes, beam.bin_m, half_width_m=half_m, pixels=_PIXELS)
    above.imshow(
        beam.floor_dbm + beam.step_db * picture, extent=(-half_m, half_m, -half_m, half_m), cmap=POWER_MAP, norm=norm,
        interpolation="nearest",
    )  # fmt: skip
    above.plot(-points_L[:, 1], points_L[:, 0], ".", ms=1.2, color=_TRACK, label=f"{len(points_L)} points")
    above.plot(0.0, 0.0, "^", ms=7, color="#d55e00", mec="white")
    above.set(xlim=(-half_m, half_m), ylim=(-half_m, half_m), xlabel="to the right [m]", ylabel="ahead [m]")
    above.set_title("from above", fontsize=9.5, loc="left")
    above.legend(loc="upper right", fontsize=8)
    for axes in (polar, above):
        axes.grid(visible=False)
        axes.tick_params(labelsize=7.5)
    bar = figure.colorbar(ScalarMappable(norm, POWER_MAP), ax=above, extend="both", pad=0.01)
    bar.set_label("[dBm]", fontsize=8)
    return figure


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def waterfall_figure(
    title: str,
    t_s: NDArray[np.float64],
    range_time: NDArray[np.float32],
    speed_time: NDArray[np.float32],
    tracks: Sequence[NDArray[Any]],
    chirp: Chirp,
) -> Figure:
    """Draw range and speed over time with the tracks. Rows of `range_time` and `speed_time` are frames."""
    figure = Figure(figsize=(13.5, 8.2), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
    range_axes, speed_axes = figure.subplots(2, 1, sharex=True)
    time_extent = _time_extent(t_s)
    _draw_rows(figure, range_axes, range_time, time_extent, range_extent(chirp, max(range_time.shape[-1], 1)))
    range_axes.set(ylabel="range [m]")
    range_axes.set_title("range over time: greatest power of all speeds", fontsize=9.5, loc="left")
    _draw_rows(figure, speed_axes, speed_time, time_extent, speed_extent(chirp, max(speed_time.shape[-1], 1)))
    speed_axes.set(ylabel="radial speed [m/s], + goes away", xlabel="time [s]")
    speed_axes.set_title(f"speed over time: power of all ranges; {span_text(chirp)}", fontsize=9.5, loc="left")
    times_s = np.array([t for t, frame_tracks in zip(t_s, tracks, strict=True) for _ in frame_tracks])
    range_m, speed_mps = (
        np.array([value for frame_tracks in tracks for value in frame_tracks[field].tolist()])
        for field in ("range_m", "speed_mps")
    )
    range_axes.plot(times_s, range_m, ".", ms=3.5, color=_TRACK, label="tracks")
    _draw_speeds(speed_axes, times_s, speed_mps, chirp, "tracks", {"marker": ".", "ms": 3.5, "lw": 0.0})
    if len(times_s):
        for axes in (range_axes, speed_axes):
            axes.legend(loc="upper right", fontsize=8, labelcolor="white")
    return figure


def micro_doppler_figure(
    title: str,
    t_s: NDArray[np.float64],
    speed_time: NDArray[np.float32],
    track_t_s: NDArray[np.float64],
    track_speed_mps: NDArray[np.float64],
    chirp: Chirp,
) -> Figure:
    """Draw the speed spectrum around one track over time, with the track's speed as a line.

    Rows of `speed_time` are frames.
    """
    figure = Figure(figsize=(13.5, 4.6), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold")
    axes = figure.subplots()
    _draw_rows(figure, axes, speed_time, _time_extent(t_s), speed_extent(chirp, speed_time.shape[-1]))
    _draw_speeds(axes, track_t_s, track_speed_mps, chirp, "the track's speed", {"lw": 0.8})
    axes.legend(loc="upper right", fontsize=8, labelcolor="white")
    axes.set(ylabel="radial speed [m/s], + goes away", xlabel="time [s]")
    title = f"micro-Doppler: speed over time, power of the ranges about the track; {span_text(chirp)}"
    axes.set_title(title, fontsize=9.5, loc="left")
    return figure


def folded(speed_mps: NDArray[np.floating[Any]], chirp: Chirp) -> NDArray[np.float64]:
    """Return speeds as the map shows them: modulo 2 v_max, in -v_max to v_max."""
    speed, whole = np.asarray(speed_mps, np.float64), 2.0 * chirp.max_speed_mps
    return np.asarray(speed - whole * np.floor(speed / whole + 0.5))


def is_folded(speed_mps: NDArray[np.floating[Any]], chirp: Chirp) -> NDArray[np.bool_]:
    """Return True for speeds outside the unambiguous span, which the map shows elsewhere."""
    return np.asarray(np.abs(np.asarray(speed_mps, np.float64)) > chirp.max_speed_mps)


def span_text(chirp: Chirp) -> str:
    """Return the unambiguous span of speeds in words."""
    return f"unambiguous within ±{chirp.max_speed_mps:.2f} m/s"


def _draw_speeds(
    axes: Axes,
    t_s: NDArray[np.float64],
    speed_mps: NDArray[np.float64],
    chirp: Chirp,
    label: str,
    style: Mapping[str, Any],
) -> None:
    """Draw speeds of tracks where the map shows them; those outside the unambiguous span in a colour of their own."""
    shown, beyond = folded(speed_mps, chirp), is_folded(speed_mps, chirp)
    of_map = axes.get_ylim() if axes.get_images() else None
    axes.plot(t_s, np.where(beyond, np.nan, shown), color=_TRACK, label=label, **style)
    if beyond.any():
        name = f"faster than ±{chirp.max_speed_mps:.2f} m/s, or lost: folded"
        axes.plot(t_s[beyond], shown[beyond], "o", ms=4.0, mfc="none", mew=0.8, color=_FOLDED, label=name)
    if of_map is not None:
        axes.set_ylim(of_map)


def _time_extent(t_s: NDArray[np.float64]) -> tuple[float, float]:
    """Return the outer edges of the frames on the time axis [s]."""
    step = float(np.median(np.diff(t_s))) if len(t_s) > 1 else 1.0
    return (float(t_s[0]) - 0.5 * step, float(t_s[-1]) + 0.5 * step) if len(t_s) else (0.0, 1.0)


def _draw_rows(
    figure: Figure, axes: Axes, power: NDArray[np.float32], across: tuple[float, float], upward: tuple[float, float]
) -> None:
    if not power.size:
        return
    level = decibels(power.T)
    norm = colour_scale(level)
    show_levels(axes, level, norm, across, upward)
    bar = figure.colorbar(ScalarMappable(norm, POWER_MAP), ax=axes, extend="min", pad=0.01)
    bar.set_label("[dB re 1 count²]", fontsize=8)
