"""What can be said about the SLAM: how many particles, which sensors, which height."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Mapping

from hil_companion.errors import OptionError

VLP16_DEG = tuple(
    float(e) for e in range(-15, 16, 2)
)  # by ring: the bench counts them from the lowest, not as they fire


@dataclass(frozen=True)
class SlamSettings:
    """Metres, seconds, radians. The defaults fly a VLP-16 at 10 m."""

    particles: int = 30
    cell_m: float = 0.25
    area_m: float = 256.0  # side of the mapped square, the start in its middle
    flight_height_m: float = 10.0  # above the ground: the grid is of this height
    band_half_m: float = 1.0  # what stands within so much of that height is an obstacle
    ground_z_m: float = 0.0
    map_range_m: float = 30.0  # beyond it the grid takes nothing
    match_range_m: float = 75.0  # beyond it nothing is matched
    match_points: int = 200
    decimation: int = 1  # every which azimuth of a sweep is used
    imu_topic: str = "imu"
    gps_topic: str = "gps"
    baro_topic: str = "baro"
    lidar_topic: str = "lidar"
    lidar_p_BL: tuple[float, float, float] = (0.0, 0.0, 0.12)
    lidar_q_BL: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    lidar_elevation_deg: tuple[float, ...] = VLP16_DEG  # of each ring; empty: unknown, and no beam without echo counts
    lidar_rings_sure: bool = False  # the elevations are told by who made the data: returns beside their ring are errors
    gps_speed_sigma_mps: float = 0.15
    gps_sigma_m: float | None = None  # None: what the receiver says
    lidar_lost_s: float = 0.35  # without a usable sweep for so long, the LiDAR is lost

    def __post_init__(self) -> None:
        problems = []
        for name in ("cell_m", "area_m", "flight_height_m", "band_half_m", "map_range_m", "match_range_m"):
            if not getattr(self, name) > 0.0:
                problems.append(f"{name} {getattr(self, name)!r} must be above 0")
        if not 1 <= self.particles <= 1000:
            problems.append(f"particles {self.particles} must be 1 to 1000")
        if not 10 <= self.match_points <= 5000:
            problems.append(f"match_points {self.match_points} must be 10 to 5000")
        if not 1 <= self.decimation <= 16:
            problems.append(f"decimation {self.decimation} must be 1 to 16")
        if self.cell_m > 0.0 and self.area_m / self.cell_m > 8192.0:
            problems.append(
                f"area_m {self.area_m:g} by cell_m {self.cell_m:g} is more than 8192 cells; take larger cells"
            )
        if problems:
            raise OptionError("slam: " + "; ".join(problems))


def lidar_settings(calibration: Mapping[str, Any]) -> dict[str, Any]:
    """What the bench says of a LiDAR (`welcome.sensors`), as settings."""
    told: dict[str, Any] = {}
    for name, key in (("lidar_p_BL", "p_BC"), ("lidar_q_BL", "q_BC"), ("lidar_elevation_deg", "elevation_deg")):
        if key in calibration:
            told[name] = tuple(float(v) for v in calibration[key])
    told["lidar_rings_sure"] = bool(told.get("lidar_elevation_deg"))
    return told
