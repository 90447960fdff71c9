"""Cases of `hil bench radar`: random echoes, and echoes of pictures of the scenes.

Random echoes are the hardest case for the transform: consecutive echoes are not neighbours, and all speeds between the
limits occur. In pictures, consecutive echoes are neighbours.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.apps.bench_suite.sensors.raster_cases import View
from sim.frame.camera_model import CameraModel
from sim.frame.geometry import FrameGeometry
from sim.frame.renderer import FrameRenderer
from sim.radar.chirp import Chirp
from sim.radar.echoes import Echoes
from sim.radar.rotor_blades import RotorBlades
from sim.radar.scatterers import Scatterers
from sim.radar.synthesis import Synthesizer
from sim.scene.world import World
from sim.sensors.catalog import PRESETS
from sim.sensors.radar_parameters import RadarParameters

Float64 = NDArray[np.float64]
PIXELS = 320 * 240
_MIN_RANGE_M, _MAX_RANGE_M = 0.3, 12.0


def radar_parameters(preset: str = "bgt60tr13c") -> RadarParameters:
    """Return the parameters of a radar preset."""
    parameters = PRESETS[preset].parameters
    assert isinstance(parameters, RadarParameters)
    return parameters


def synthesizer(p: RadarParameters, method: str, tolerance: float) -> Synthesizer:
    """Return a synthesizer with the filters of the sensor, for `method` "nufft" or "direct"."""
    return Synthesizer(
        p.chirp,
        p.antenna.array,
        hp_cutoff_hz=p.receiver.hp_cutoff_hz,
        aaf_cutoff_hz=p.receiver.aaf_cutoff_hz,
        method=method,
        tolerance=tolerance,
    )


def random_echoes(
    count: int,
    *,
    seed: int = 1,
    range_m: tuple[float, float] = (_MIN_RANGE_M, _MAX_RANGE_M),
    speed_mps: tuple[float, float] = (-3.0, 3.0),
) -> Echoes:
    """Return `count` echoes, uniform in range and speed within 90 degrees across and 74 up.

    Amplitudes are Rayleigh distributed and inversely proportional to range.
    """
    rng = np.random.Generator(np.random.Philox(seed))
    range_ = rng.uniform(*range_m, count)
    speed = rng.uniform(*speed_mps, count)
    across, up = rng.uniform(-1.0, 1.0, count), rng.uniform(-0.75, 0.75, count)
    direction = np.stack([np.ones(count), across, up], axis=1)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    amplitude = rng.rayleigh(1.0, count) / range_
    return Echoes(range_, speed, np.ascontiguousarray(direction), amplitude)


@dataclass
class RadarView:
    """A camera in a world, and the radar echoes of its pictures."""

    world: World
    chirp: Chirp
    scatterers: Scatterers
    blades: RotorBlades
    renderer: FrameRenderer
    picture: Mapping[str, NDArray[Any]]

    def draw(self, view: View) -> None:
        """Render the picture of a view."""
        self.renderer.geometry.expect(view.t_ns)
        self.renderer.render(view.pose, self.picture)

    def echoes(self, view: View) -> Echoes:
        """Return the echoes of the picture last rendered, valid until the next call."""
        return self.scatterers.collect(self.blades.with_seen_speeds(self.picture, self.chirp), view.pose)


def radar_view(world: World, parameters: RadarParameters, *extra: str, camera: CameraModel | None = None) -> RadarView:
    """Return a radar's view of a world, by default 320 x 240 pixels over 90 degrees; `extra` names further channels."""
    model = camera if camera is not None else CameraModel.from_fov(320, 240, 90.0)
    p = parameters
    scatterers = Scatterers(model, world, p.chirp, p.antenna, p.receiver, p.mask)
    renderer = FrameRenderer(FrameGeometry(world), model)
    return RadarView(
        world,
        p.chirp,
        scatterers,
        RotorBlades(world),
        renderer,
        renderer.buffers(*dict.fromkeys((*scatterers.channels, *extra))),
    )
