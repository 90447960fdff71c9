"""Start of a flight: pose of the vehicle and time of the scene at tick 0."""

from __future__ import annotations

from dataclasses import dataclass

from signals.samples import Vec3
from sim.physics.launch import Launch


@dataclass(frozen=True)
class FlightStart:
    """Pose of the vehicle at tick 0: level, at rest, rotors stopped."""

    p_WB: Vec3 | None = None  # None: standing on the ground at `ground_W`
    ground_W: Vec3 = (0.0, 0.0, 0.0)  # place on the ground between the feet
    yaw_rad: float = 0.0  # counter-clockwise from east
    launch: Launch | None = None  # from above `ground_W`; None: the vehicle stands, or begins at `p_WB`
    t_ns: int = 0  # time at which the scene's actors are posed
