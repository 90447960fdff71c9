"""Settings of the SLAM: particles, map, LiDAR."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Callable, Mapping

from hil_companion.errors import OptionError

# By ring number: the bench numbers rings from the lowest up, not in firing order.
VLP16_DEG = tuple(float(e) for e in range(-15, 16, 2))


@dataclass(frozen=True)
class SlamSettings:
    """Settings in metres, seconds, radians; the defaults are for a VLP-16 at 10 m. Raises OptionError."""

    particles: int = 30
    cell_m: float = 0.25
    area_m: float = 256.0  # side of the mapped square, centred on the start
    flight_height_m: float = 10.0  # height of the grid above the ground
    band_half_m: float = 1.0  # half height of the band about the flight's height in which hits are obstacles
    ground_z_m: float = 0.0
    map_range_m: float = 30.0  # longest range used for the grid
    match_range_m: float = 75.0  # longest range used for matching
    match_points: int = 200
    decimation: int = 1  # factor on the width of an azimuth slot
    lidar_topic: str = "lidar"
    lidar_p_BL: tuple[float, float, float] = (0.0, 0.0, 0.12)
    lidar_q_BL: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    # Elevation of each ring; empty: unknown, then beams without a return are not used.
    lidar_elevation_deg: tuple[float, ...] = VLP16_DEG
    lidar_rings_sure: bool = False  # True: the elevations come from the bench, so returns beside their ring are errors
    gps_sigma_m: float | None = None  # None: as the receiver reports
    lidar_lost_s: float = 0.35  # longest time without a usable sweep

    def __post_init__(self) -> None:
        problems = [
            f"{name} {getattr(self, name)!r} must be {what}"
            for name, (what, is_legal) in _RULES.items()
            if not is_legal(getattr(self, name))
        ]
        if problems:
            raise OptionError("slam: " + "; ".join(problems))
        if self.area_m / self.cell_m > 8192.0:
            raise OptionError(
                f"slam: area_m {self.area_m:g} by cell_m {self.cell_m:g} is more than 8192 cells; take larger cells"
            )


def _number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _numbers(values: Any, count: int | None = None) -> bool:
    return isinstance(values, (tuple, list)) and all(map(_number, values)) and count in (None, len(values))


def _whole(low: int, high: int) -> tuple[str, Callable[[Any], bool]]:
    return f"a whole number from {low} to {high}", lambda v: type(v) is int and low <= v <= high


_LENGTHS = ("cell_m", "area_m", "flight_height_m", "band_half_m", "map_range_m", "match_range_m", "lidar_lost_s")
_RULES: dict[str, tuple[str, Callable[[Any], bool]]] = {
    "particles": _whole(1, 1000),
    "match_points": _whole(10, 5000),
    "decimation": _whole(1, 16),
    **dict.fromkeys(_LENGTHS, ("above 0", lambda v: _number(v) and v > 0.0)),
    "lidar_topic": ("a topic", lambda v: isinstance(v, str) and v != ""),
    "gps_sigma_m": ("null or above 0", lambda v: v is None or (_number(v) and v > 0.0)),
    "ground_z_m": ("a number", _number),
    "lidar_p_BL": ("three numbers", lambda v: _numbers(v, 3)),
    "lidar_q_BL": (
        "a quaternion of unit norm",
        lambda v: _numbers(v, 4) and abs(sum(c * c for c in v) - 1.0) < 1e-3,
    ),
    "lidar_elevation_deg": ("angles, -90 to 90", lambda v: _numbers(v) and all(abs(e) < 90.0 for e in v)),
    "lidar_rings_sure": ("true or false", lambda v: isinstance(v, bool)),
}


def lidar_settings(calibration: Mapping[str, Any]) -> dict[str, Any]:
    """Convert a LiDAR's calibration (`welcome.sensors`) to settings."""
    settings: dict[str, Any] = {}
    for name, key in (("lidar_p_BL", "p_BC"), ("lidar_q_BL", "q_BC"), ("lidar_elevation_deg", "elevation_deg")):
        if key in calibration:
            settings[name] = tuple(float(v) for v in calibration[key])
    settings["lidar_rings_sure"] = bool(settings.get("lidar_elevation_deg"))
    return settings
