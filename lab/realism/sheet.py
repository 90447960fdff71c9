"""Pictures of `hil bench realism`: sheets of frames with the boxes of truth and networks, and a plot of bars."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.result import Row, save_figure
from lab.realism.frames import Truth
from lab.realism.networks import Found
from signals.errors import file_errors

_COLUMNS = 4
_SIDE_PX = (480, 360)  # of a tile
_TRUTH, _IGNORED = (255, 255, 255), (150, 150, 150)
_NETWORK_COLOURS = ((255, 60, 60), (60, 160, 255), (255, 200, 0), (200, 80, 255))


@dataclass(frozen=True)
class Tile:
    """Picture with its truth, and the boxes of each network from its threshold."""

    title: str
    rgb: NDArray[np.uint8]
    truths: tuple[Truth, ...]
    boxes: tuple[tuple[str, tuple[Found, ...]], ...]


def draw_tile(tile: Tile) -> NDArray[np.uint8]:
    """Return the picture with boxes: truth white, ignored objects grey, one colour for each network."""
    picture = np.ascontiguousarray(tile.rgb)
    for truth in tile.truths:
        _box(picture, truth.box_px, _TRUTH if truth.counts else _IGNORED, "", 3 if truth.counts else 1)
    for number, (_, boxes) in enumerate(tile.boxes):
        colour = _NETWORK_COLOURS[number % len(_NETWORK_COLOURS)]
        for one in boxes:
            _box(picture, one.box_px, colour, f"{one.label} {one.score:.2f}", 1, line=number)
    picture[462:] = picture[462:] // 3
    cv2.putText(picture, tile.title, (6, 475), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA)
    return picture


def _box(
    picture: NDArray[np.uint8],
    box_px: Sequence[float],
    colour: tuple[int, int, int],
    text: str,
    thickness: int,
    line: int = 0,
) -> None:
    x_min, y_min, x_max, y_max = (round(value) for value in box_px)
    cv2.rectangle(picture, (x_min, y_min), (x_max, y_max), colour, thickness)
    if text:
        place = (x_min + 2, max(12, y_min + 12 + 13 * line))
        cv2.putText(picture, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.42, colour, 1, cv2.LINE_AA)


def write_sheet(tiles: Sequence[Tile], path: Path) -> None:
    """Write tiles to one PNG. Raises RecordingError."""
    width, height = _SIDE_PX
    rows = -(-len(tiles) // _COLUMNS)
    sheet = np.zeros((rows * height, _COLUMNS * width, 3), np.uint8)
    for number, tile in enumerate(tiles):
        row, column = divmod(number, _COLUMNS)
        small = cv2.resize(draw_tile(tile), _SIDE_PX, interpolation=cv2.INTER_AREA)
        sheet[row * height : (row + 1) * height, column * width : (column + 1) * width] = small
    ok, data = cv2.imencode(".png", sheet[:, :, ::-1])
    with file_errors(path, "the sheet cannot be written"):
        if not ok:
            raise OSError("not encoded")
        path.write_bytes(data.tobytes())


def recall_plot(rows: Sequence[Row], title: str, path: Path) -> None:
    """Plot the recall of each network as bars, one group for each case. Raises RecordingError."""
    from matplotlib.figure import Figure  # slow to import, and only needed here

    cases = list(dict.fromkeys(row.case for row in rows))
    networks = list(dict.fromkeys(row.method for row in rows))
    figure = Figure(figsize=(10.0, 1.5 + 0.45 * len(cases)), layout="constrained")
    ax = figure.subplots()
    height = 0.8 / max(1, len(networks))
    for number, network in enumerate(networks):
        of_network = [row for row in rows if row.method == network]
        places = [cases.index(row.case) + (number - 0.5 * (len(networks) - 1)) * height for row in of_network]
        colour = [value / 255.0 for value in _NETWORK_COLOURS[number % len(_NETWORK_COLOURS)]]
        ax.barh(places, [1.0 - row.error for row in of_network], height, label=network, color=colour)
    ax.set_yticks(range(len(cases)), cases)
    ax.invert_yaxis()
    ax.set(xlim=(0.0, 1.0), xlabel="recall at the network's score", title=title)
    ax.grid(True, axis="x", color="#e6e9ed")
    ax.legend(fontsize=8, frameon=False)
    save_figure(figure, path)
