"""Pictures of the explorer's map and plan: a sequence of PNGs, a film, and a contact sheet of the flight.

The left half shows the map about the vehicle. Cells: occupied dark, free light, unknown grey, too near to an obstacle
reddish. Lines: walls blue, plan green, flown path black. Points: particles orange, newest sweep at the flight's height
red. A cross marks the goal. The right half shows the camera's picture, if there is one, and the legend. The lower right
corner shows the particles about their mean, one metre across, with the world's axes.
"""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from hil_companion.contact_sheet import sheet_of, spread, write_picture
from hil_companion.errors import file_errors
from hil_companion.explore.explorer import Explorer
from hil_companion.frame import Frame

SHEET_NAME, FILM_NAME = "report.png", "film.avi"  # the bench shows the contact sheet on its report page
SIDE_PX, _SPREAD_PX = 480, 110
_SHEET_PICTURES, _SHEET_COLUMNS = 9, 3
_FILM_HZ = 5.0
# Colours in BGR order.
_OCCUPIED, _FREE, _UNKNOWN, _TOO_NEAR = (40, 40, 40), (250, 250, 250), (190, 190, 190), (190, 200, 255)
_PLAN, _FLOWN, _PARTICLE, _SWEEP = (60, 160, 0), (0, 0, 0), (0, 140, 255), (40, 40, 220)
_GOAL, _WALL = (200, 0, 160), (200, 120, 40)
_LEGEND = (
    (_FREE, "free"),
    (_UNKNOWN, "unknown"),
    (_OCCUPIED, "occupied"),
    (_TOO_NEAR, "too near"),
    (_WALL, "wall found"),
    (_SWEEP, "newest sweep"),
    (_PLAN, "plan"),
    (_FLOWN, "flown"),
    (_PARTICLE, "particles"),
    (_GOAL, "goal"),
)


class Pictures:
    """Writes a picture every `every_s` of simulated time. Raises CutError if it cannot be written."""

    def __init__(self, folder: Path, *, every_s: float, camera: str | None) -> None:
        self._folder, self._every_ns, self._camera = folder, round(every_s * 1e9), camera
        self._next_ns = 0
        self._flown: list[tuple[float, float]] = []
        self._small_pictures: list[np.ndarray] = []
        self._film: Any = None
        self._count = 0
        self._camera_picture: np.ndarray | None = None
        with file_errors(f"explore: {folder} cannot be made"):
            folder.mkdir(parents=True, exist_ok=True)

    def add(self, explorer: Explorer, frame: Frame) -> None:
        """Draw and write a picture if the period has passed; call after every step."""
        estimate = explorer.estimate
        if estimate is None:
            return
        x, y = float(estimate.p_W[0]), float(estimate.p_W[1])
        if math.isfinite(x) and math.isfinite(y):
            self._flown.append((x, y))
        if self._camera is not None and self._camera in frame:
            self._camera_picture = np.array(frame[self._camera].array[..., ::-1])  # as BGR, for OpenCV
        if frame.t_ns >= self._next_ns and explorer.map is not None:
            self._next_ns = frame.t_ns + self._every_ns
            self._keep(self._draw(explorer, frame))

    def close(self) -> None:
        """Write the contact sheet: pictures evenly spread over the flight."""
        if self._film is not None:
            self._film.release()
            self._film = None
        pictures = self._small_pictures
        if not pictures:
            return
        chosen = [pictures[i] for i in spread(len(pictures), _SHEET_PICTURES)]
        write_picture("explore", self._folder / SHEET_NAME, sheet_of(chosen, _SHEET_COLUMNS))
        self._small_pictures = []

    def _keep(self, picture: np.ndarray) -> None:
        self._count += 1
        write_picture("explore", self._folder / f"{self._count:04d}.png", picture)
        if self._film is None:
            size = (picture.shape[1], picture.shape[0])
            fourcc = cv2.VideoWriter_fourcc(*"MJPG")  # every build of OpenCV can write it
            self._film = cv2.VideoWriter(str(self._folder / FILM_NAME), fourcc, _FILM_HZ, size)
        with contextlib.suppress(cv2.error):
            self._film.write(picture)
        self._small_pictures.append(cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))

    def _draw(self, explorer: Explorer, frame: Frame) -> np.ndarray:
        plan_map, estimate = explorer.map, explorer.estimate
        assert plan_map is not None
        assert estimate is not None
        height, width = plan_map.distance_m.shape
        picture = np.empty((height, width, 3), np.uint8)
        picture[...] = _FREE
        picture[plan_map.distance_m < explorer.settings.vehicle_radius_m + explorer.settings.clearance_m] = _TOO_NEAR
        picture[plan_map.unknown] = _UNKNOWN
        picture[plan_map.distance_m <= 0.0] = _OCCUPIED
        scale = SIDE_PX / max(height, width)
        size = (max(1, round(width * scale)), max(1, round(height * scale)))
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA if scale < 1.0 else cv2.INTER_NEAREST)

        def at(points: Any) -> np.ndarray:
            cells = (np.asarray(points, float).reshape(-1, 2) - np.asarray(plan_map.origin_W)) / plan_map.cell_m
            return np.round(cells * scale).astype(np.int32)

        for x0, y0, x1, y1 in plan_map.segments_W.tolist():
            a, b = at([(x0, y0), (x1, y1)]).tolist()
            cv2.line(picture, tuple(a), tuple(b), _WALL, 1)
        if explorer.near is not None:
            for x, y in at(explorer.near.level_W[::5]).tolist():
                cv2.circle(picture, (x, y), 1, _SWEEP, -1)
        if explorer.route.found:
            cv2.polylines(picture, [at(explorer.route.points_W)], False, _PLAN, 2, cv2.LINE_AA)
        if len(self._flown) > 1:
            cv2.polylines(picture, [at(self._flown)], False, _FLOWN, 1, cv2.LINE_AA)
        for x, y in at(estimate.particles_xy).tolist():
            cv2.circle(picture, (x, y), 2, _PARTICLE, -1)
        goal = at([explorer.goal_W])[0].tolist()
        cv2.drawMarker(picture, tuple(goal), _GOAL, cv2.MARKER_TILTED_CROSS, 14, 2)
        here = at([estimate.p_W[:2]])[0].tolist()
        nose = (int(here[0] + 12 * math.cos(estimate.yaw_rad)), int(here[1] + 12 * math.sin(estimate.yaw_rad)))
        cv2.arrowedLine(picture, tuple(here), nose, _FLOWN, 2, cv2.LINE_AA, 0, 0.4)
        page = np.full((SIDE_PX, SIDE_PX, 3), 255, np.uint8)
        page[: picture.shape[0], : picture.shape[1]] = picture
        page = page[::-1].copy()  # north is up
        _draw_scale(page, scale / plan_map.cell_m)
        if self._camera_picture is not None:
            height, width = self._camera_picture.shape[:2]
            scaled = cv2.resize(self._camera_picture, (SIDE_PX, round(SIDE_PX * height / width)))
            right_half = np.full((SIDE_PX, SIDE_PX, 3), 255, np.uint8)
            rows = min(SIDE_PX, scaled.shape[0])
            right_half[:rows] = scaled[:rows]
            _draw_legend(right_half, rows)
            page = np.hstack([page, right_half])
        _draw_spread(page, estimate)
        report = explorer.report
        left = f"{report.goal_distance_m:.1f} m left" if math.isfinite(report.goal_distance_m) else ""
        words = f"t {frame.t_ns * 1e-9:.1f} s  {report.phase} {report.outcome}  {left}"
        cv2.putText(page, words, (8, SIDE_PX - 10), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 0), 1, cv2.LINE_AA)
        return page


def _draw_spread(page: np.ndarray, estimate: Any) -> None:
    """Draw the particles, magnified, in the lower right corner."""
    side = _SPREAD_PX
    corner = page[-side:, -side:]
    corner[...] = 255
    cv2.rectangle(corner, (0, 0), (side - 1, side - 1), _UNKNOWN, 1)
    middle = side // 2
    cv2.line(corner, (0, middle), (side, middle), _UNKNOWN, 1)
    cv2.line(corner, (middle, 0), (middle, side), _UNKNOWN, 1)
    xy = estimate.particles_xy
    off = (xy - xy.mean(axis=0)) * side  # about their own mean, because the estimate is one frame newer
    for x, y in off[np.isfinite(off).all(axis=1)].tolist():
        if max(abs(x), abs(y)) < middle:
            cv2.circle(corner, (round(middle + x), round(middle - y)), 2, _PARTICLE, -1)
    cv2.putText(corner, "1 m", (4, 12), cv2.FONT_HERSHEY_SIMPLEX, 0.35, _FLOWN, 1, cv2.LINE_AA)


def _draw_scale(page: np.ndarray, px_per_m: float) -> None:
    """Draw a scale bar in the lower right corner of the map."""
    length_m = next((m for m in (100, 50, 20, 10, 5) if m * px_per_m < 0.3 * SIDE_PX), 2)
    right, y = SIDE_PX - _SPREAD_PX - 12, SIDE_PX - 30
    left = right - round(length_m * px_per_m)
    cv2.line(page, (left, y), (right, y), _FLOWN, 2)
    for x in (left, right):
        cv2.line(page, (x, y - 4), (x, y + 4), _FLOWN, 2)
    cv2.putText(page, f"{length_m} m", (left, y - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.4, _FLOWN, 1, cv2.LINE_AA)


def _draw_legend(page: np.ndarray, top: int) -> None:
    """Draw the legend of the colours, below `top` and left of the particles."""
    for i, (colour, name) in enumerate(_LEGEND):
        x, y = 12 + (i % 2) * 170, top + 22 + (i // 2) * 19
        if y > SIDE_PX - 6:
            return
        cv2.rectangle(page, (x, y - 9), (x + 16, y), colour, -1)
        cv2.rectangle(page, (x, y - 9), (x + 16, y), _UNKNOWN, 1)
        cv2.putText(page, name, (x + 24, y), cv2.FONT_HERSHEY_SIMPLEX, 0.42, _FLOWN, 1, cv2.LINE_AA)
