"""Small worlds, cameras and radars for tests of radar echoes from pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.rotation import Rotation
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.frame.geometry import FrameGeometry
from sim.frame.renderer import FrameRenderer
from sim.radar.antenna import Antenna, Pattern
from sim.radar.receiver import Receiver
from sim.scene.scene import Scene, load_scene
from sim.scene.world import World
from sim.world_loader import load_world
from tests.worlds.radar_point_targets import CHIRP

RECEIVER = Receiver(tx_power_dbm=5.0, conversion_gain_db=60.0, impedance_ohm=50.0, adc_full_scale_v=1.2, adc_bits=12)
WIDE = Pattern(gain_dbi=6.0, azimuth_beamwidth_deg=179.0, elevation_beamwidth_deg=179.0)
ANTENNA = Antenna(rx_positions_m=((0.0, 0.0, 0.0),), tx=WIDE, rx=WIDE)
EASTWARDS: Rotation = (0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0)  # x_C south, y_C down, z_C east
MIRROR = {"lidar_reflectivity": 0.5, "relative_permittivity": 1.0, "conductivity_s_per_m": 1e8, "roughness_m": 0.0}
LAMBERT = MIRROR | {"roughness_m": 0.05}  # so rough that nothing stays coherent
POWER_SCALE = (
    RECEIVER.counts_per_sqrt_watt**2
    * RECEIVER.tx_power_w
    * WIDE.axis_gain**2
    * CHIRP.wavelength_m**2
    / (4.0 * np.pi) ** 3
)  # on the axis A^2 = POWER_SCALE sigma / R^4


def world_of(folder: Path, bodies: str, surface: dict[str, float] | None = None) -> World:
    """Return a world of geoms of the material "m", without ground."""
    path = folder / "radar_world.xml"
    path.write_text(f'<mujoco><asset><material name="m"/></asset><worldbody>{bodies}</worldbody></mujoco>')
    section: dict[str, Any] = {"mjcf": str(path)}
    if surface is not None:
        section["surfaces"] = {"m": surface}
    plain = load_scene("airfield").model_dump()
    return load_world(Scene.model_validate(plain | {"name": "radar_world", "map": section}))


def picture_of(world: World, camera: CameraModel, channels: tuple[str, ...]) -> dict[str, NDArray[Any]]:
    """Return the picture from the origin to the east."""
    renderer = FrameRenderer(FrameGeometry(world), camera)
    picture = renderer.buffers(*channels)
    renderer.render(CameraPose((0.0, 0.0, 0.0), EASTWARDS), picture)
    return picture
