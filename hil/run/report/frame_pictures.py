"""Pictures of camera and LiDAR frames with colour bars, legends and units.

matplotlib is slow to import: import this module at the end of a run, not at its start.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from signals.channels import CHANNELS
from signals.classes import Classes
from signals.samples import FrameSample, ImageSample, PointCloudSample
from sim.scene.view_point import ViewPoint

Rgb = NDArray[np.uint8]

_NO_CLASSES = Classes()
_DISTANCE_MAP, _SPEED_MAP, _VALUE_MAP, _HEIGHT_MAP = "viridis_r", "RdBu_r", "inferno", "viridis"
_NO_SURFACE = (232, 235, 239)  # for pixels without a surface
_ID_ZERO = (52, 59, 68)  # class, instance or surface 0
_FAR_PERCENTILE = 98.0  # of the finite distances, at which the colour bar ends
_MIN_SPEED_SCALE_MPS = 0.5  # the colour bar of speed never ends below this
_MAX_LEGEND_NAMES = 14
_MAX_CLOUD_M = 120.0  # from the LiDAR to the edge of the picture
_INK = "#20262e"
_WIDTH_IN, _HEAD_IN, _SPACE_IN = 13.5, 0.5, 0.45  # of a figure; of its title; under a picture
_PICTURE_SHARE = 0.76  # of a panel's width; the legend takes the rest
_MIN_RATIO, _MAX_RATIO = 0.1, 2.5  # height to width of the room for a picture
_MAX_PICTURE_IN = 6.2  # width of a single picture


def coloured(channel: str, picture: NDArray[Any], classes: Classes = _NO_CLASSES) -> Rgb:
    """Return the channel in display colours, (height, width, 3)."""
    look = CHANNELS[channel].look
    if look == "colour":
        return np.asarray(picture, np.uint8)
    if look in _SCALES:
        scale, name, _ = _SCALES[look]
        finite = np.isfinite(picture)
        mapped = mpl.colormaps[name](scale(picture)(np.where(finite, picture, 0.0)))
        colours = (mapped[:, :, :3] * 255.0 + 0.5).astype(np.uint8)
        colours[~finite] = _NO_SURFACE
        return colours
    if look == "direction":
        hit = np.any(picture != 0.0, axis=2) & np.all(np.isfinite(picture), axis=2)
        # Right is red, up is green, towards the camera is blue, as such pictures are usually drawn.
        towards = np.where(hit[:, :, None], picture, 0.0) * np.array([1.0, -1.0, -1.0])
        colours = (np.clip(0.5 + 0.5 * towards, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
        colours[~hit] = _NO_SURFACE
        return colours
    ids = picture.astype(np.int64) - int(CHANNELS[channel].nothing or 0)
    count = int(ids.max(initial=0)) + 1
    return (_class_colours(classes, count) if look == "classes" else palette(count))[ids]


def palette(count: int) -> Rgb:
    """Return colours (count, 3) of the ids 0 to count - 1; hues are a golden ratio apart, so neighbours differ."""
    k = np.arange(count)
    hue = (k * 0.6180339887498949) % 1.0
    value = np.array([0.95, 0.75, 0.58])[k % 3]
    saturation = np.array([0.62, 0.85, 0.70, 0.45])[k % 4]
    colours = (mpl.colors.hsv_to_rgb(np.stack([hue, saturation, value], axis=1)) * 255.0 + 0.5).astype(np.uint8)
    colours[:1] = _ID_ZERO
    return np.asarray(colours, np.uint8)


def _class_colours(classes: Classes, count: int) -> Rgb:
    """Return the scene's class colours, and palette colours for classes without one."""
    colours = palette(max(count, len(classes.colours)))
    if classes.colours:
        colours[: len(classes.colours)] = classes.colours
    return colours


def draw_channel(panel: Axes, channel: str, picture: NDArray[Any], classes: Classes = _NO_CLASSES) -> None:
    """Draw one channel, with its colour bar or legend beside it."""
    _draw_rgb(panel, coloured(channel, picture, classes))
    kind = CHANNELS[channel]
    panel.set_title(kind.title, fontsize=9.5, loc="left")
    if kind.look in _SCALES:
        scale, name, (after_unit, extend) = _SCALES[kind.look]
        colour_bar(panel, scale(picture), name, f"[{kind.unit}]{after_unit}", extend)
    elif kind.look == "classes":
        _draw_class_legend(panel, picture, classes)
    elif kind.look == "direction":
        note(panel, "red: to the right\ngreen: up\nblue: to the\ncamera")
    elif kind.look == "ids":
        note(panel, f"{len(np.unique(picture))} ids")


def camera_figure(title: str, sample: ImageSample, classes: Classes = _NO_CLASSES) -> Figure:
    """Draw all channels of one camera frame."""
    names = [name for name in CHANNELS if name in sample.channels]
    return channels_figure(title, {name: sample.channels[name] for name in names}, classes)


def channels_figure(title: str, channels: Mapping[str, NDArray[Any]], classes: Classes = _NO_CLASSES) -> Figure:
    """Draw channels side by side, three in a row."""
    first = next(iter(channels.values()))
    figure, panels = make_panels(title, len(channels), first.shape[0] / first.shape[1])
    for panel, (name, picture) in zip(panels, channels.items(), strict=True):
        draw_channel(panel, name, picture, classes)
    return figure


def sheet_figure(
    views: Sequence[tuple[ViewPoint, str, Mapping[str, NDArray[Any]]]],
    cloud: PointCloudSample | None,
    classes: Classes = _NO_CLASSES,
    *,
    more: Sequence[Callable[[Axes], None]] = (),
) -> Figure:
    """Draw every channel of the first view, the colour of the other views, a LiDAR sweep, and one panel per `more`."""
    first, title, channels = views[0]
    names = [name for name in CHANNELS if name in channels]
    shape = channels[names[0]].shape
    clouds = [cloud] if cloud is not None else []
    figure, panels = make_panels(title, len(names) + len(views) - 1 + len(clouds) + len(more), shape[0] / shape[1])
    free_panels = iter(panels)
    for name in names:
        draw_channel(next(free_panels), name, channels[name], classes)
    for point, _, pictures in views[1:]:
        panel = next(free_panels)
        _draw_rgb(panel, pictures["rgb"])
        panel.set_title(f"colour from {point.name}", fontsize=9.5, loc="left")
    for sweep in clouds:
        panel = next(free_panels)
        draw_cloud(panel, sweep)
        panel.set(xlabel="", ylabel="")
        panel.set_title(
            f"LiDAR at {first.name}, from above [m], {len(sweep.range_m)} returns", fontsize=9.5, loc="left"
        )
    for draw in more:
        draw(next(free_panels))
    return figure


def cloud_figure(title: str, sample: PointCloudSample, classes: Classes = _NO_CLASSES) -> Figure:
    """Draw one sweep from above, by height and by class."""
    figure, panels = make_panels(title, 2, 1.0, columns=2)
    draw_cloud(panels[0], sample)
    draw_cloud(panels[1], sample, classes, by_class=True)
    return figure


def draw_cloud(
    panel: Axes, sample: PointCloudSample, classes: Classes = _NO_CLASSES, *, by_class: bool = False
) -> None:
    """Draw a sweep from above, forward up."""
    points = sample.points_L
    x, y, z = points[:, 0], points[:, 1], points[:, 2]
    if by_class:
        ids = sample.segmentation
        panel.scatter(-y, x, s=1.2, c=_class_colours(classes, 256)[ids] / 255.0, linewidths=0)
        _draw_class_legend(panel, ids, classes)
    elif len(points):
        low, high = np.percentile(z, [2.0, 98.0])
        norm = Normalize(low, max(high, low + 0.1))
        panel.scatter(-y, x, s=1.2, c=z, cmap=_HEIGHT_MAP, norm=norm, linewidths=0)
        colour_bar(panel, norm, _HEIGHT_MAP, "height over the LiDAR [m]", "both")
    panel.plot(0.0, 0.0, "^", ms=7, color="#d55e00", mec="white")
    far = float(np.percentile(sample.range_m, 99.0)) * 1.05 if len(points) else 1.0
    far = min(max(far, 1.0), _MAX_CLOUD_M)
    panel.set(xlim=(-far, far), ylim=(-far, far), aspect="equal", xlabel="to the right [m]", ylabel="forward [m]")
    panel.tick_params(labelsize=7.5)
    panel.set_title(f"from above, {len(points)} returns", fontsize=9.5, loc="left")


def frame_figure(name: str, sample: ImageSample | PointCloudSample, classes: Classes = _NO_CLASSES) -> Figure:
    """Draw a frame of a camera or LiDAR."""
    title = frame_title(name, sample)
    if isinstance(sample, ImageSample):
        return camera_figure(title, sample, classes)
    return cloud_figure(title, sample, classes)


def frame_title(name: str, sample: FrameSample) -> str:
    """Return the title of a figure: sensor name and time of capture."""
    return f"{name}, {sample.t_capture_ns * 1e-9:.2f} s"


def _distance_scale(picture: NDArray[Any]) -> Normalize:
    finite = picture[np.isfinite(picture)]
    far = max(float(np.percentile(finite, _FAR_PERCENTILE)), 0.1) if finite.size else 1.0
    return PowerNorm(0.5, 0.0, far, clip=True)  # near distances get more of the colours


def _speed_scale(picture: NDArray[Any]) -> Normalize:
    speeds = np.abs(picture[np.isfinite(picture)])
    end = max(float(np.percentile(speeds, 99.5)), _MIN_SPEED_SCALE_MPS) if speeds.size else _MIN_SPEED_SCALE_MPS
    return Normalize(-end, end)


def _value_scale(picture: NDArray[Any]) -> Normalize:
    finite = picture[np.isfinite(picture)]
    low, high = np.percentile(finite, (1.0, 99.0)) if finite.size else (0.0, 1.0)
    return Normalize(float(low), float(max(high, low + 1e-9)), clip=True)


# By look: scale of the colour bar, its colours, and what stands after its unit and extends beyond its ends.
_SCALES: dict[str, tuple[Callable[[NDArray[Any]], Normalize], str, tuple[str, str]]] = {
    "distance": (_distance_scale, _DISTANCE_MAP, ("", "max")),
    "speed": (_speed_scale, _SPEED_MAP, (", + goes away", "both")),
    "value": (_value_scale, _VALUE_MAP, ("", "both")),
}


def make_panels(title: str, count: int, ratio: float, *, columns: int = 3) -> tuple[Figure, list[Axes]]:
    """Return a figure of `count` panels with room for a legend beside each. `ratio`: height to width of a picture."""
    columns = min(columns, count)
    rows = math.ceil(count / columns)
    picture_in = min(_WIDTH_IN / columns * _PICTURE_SHARE, _MAX_PICTURE_IN)
    height_in = rows * (picture_in * min(max(ratio, _MIN_RATIO), _MAX_RATIO) + _SPACE_IN) + _HEAD_IN
    figure = Figure(figsize=(_WIDTH_IN, height_in), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, fontweight="bold", color=_INK)
    panels = list(figure.subplots(rows, columns, squeeze=False).flat)
    for unused in panels[count:]:
        unused.set_visible(False)
    return figure, panels[:count]


def _draw_rgb(axes: Axes, rgb: Rgb) -> None:
    axes.imshow(rgb, interpolation="nearest", aspect="equal")
    axes.set(xticks=[], yticks=[])
    axes.grid(visible=False)


def colour_bar(panel: Axes, norm: Normalize, name: str, label: str, extend: str) -> None:
    """Draw a colour bar beside a picture."""
    figure: Any = panel.figure
    bar_axes = panel.inset_axes((1.02, 0.02, 0.04, 0.96))
    bar = figure.colorbar(ScalarMappable(norm, name), cax=bar_axes, extend=extend)
    bar.set_label(label, fontsize=8)
    bar.ax.tick_params(labelsize=7.5)
    bar.outline.set_visible(False)


def _draw_class_legend(panel: Axes, ids: NDArray[Any], classes: Classes) -> None:
    found, counts = np.unique(ids, return_counts=True)
    if not found.size:
        return
    frequent = found[np.argsort(counts, kind="stable")[::-1]][:_MAX_LEGEND_NAMES]
    colours = _class_colours(classes, 256) / 255.0
    panel.legend(
        handles=[Patch(color=colours[i], label=classes.name(i)) for i in sorted(int(i) for i in frequent)],
        loc="upper left",
        bbox_to_anchor=(1.0, 1.02),
        fontsize=7.5,
        handlelength=0.9,
        handleheight=0.9,
        borderaxespad=0.2,
        labelspacing=0.3,
        frameon=False,
    )


def note(panel: Axes, text: str) -> None:
    """Write a short text beside a picture."""
    panel.text(1.02, 1.0, text, transform=panel.transAxes, va="top", ha="left", fontsize=7.5, color="#5b636e")
