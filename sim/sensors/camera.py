"""Camera: pictures of the world from the vehicle, in every channel that has a consumer.

All channels of a sample show one instant, `t_capture_ns`, the time of the tick, with two exceptions:

* rolling shutter: rows are read one after another, the middle row at t_capture. Bands of four rows share the camera
  pose at the middle of the band's readout (sim/frame/mount.py states the error). With a readout time T and h rows, the
  time of a row is wrong by at most 2 T / h. People and vehicles of the scene are posed at t_capture: with T = 20 ms, a
  walker at 1.5 m/s is displaced by at most 15 mm.
* motion blur: colour is the mean of several pictures over the exposure, whose middle is t_capture. People and vehicles
  stand still during the exposure. The other channels belong to the middle of the exposure.

Rain and snow draw streaks (sim/frame/rain_streaks.py), rain drops on the window (lens_drops.py). They, noise, gain
and vignetting change colour only, `depth_noise` the planar depth only, `infrared` the channel of that name only;
every other channel is the truth.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.noise import noise_key
from signals.samples import ImageSample, TruthState
from sim.frame.camera_effects import DepthSensor, LightSensor, vignette
from sim.frame.lens_drops import LensDrops
from sim.frame.mount import Mount
from sim.frame.rain_streaks import USUAL_EXPOSURE_S, RainStreaks
from sim.frame.source import ExposingRenderer, Renderer, channel_array
from sim.frame.thermal_device import ThermalDevice
from sim.sensors.camera_parameters import CameraParameters
from sim.sensors.sensor import Installation, InstalledSensor, Kind

BAND_ROWS = 4  # rows of a rolling shutter that share a pose; also the minimum that a renderer draws


class Camera(InstalledSensor):
    """One camera on the vehicle."""

    sample_type = ImageSample

    def __init__(self, installation: Installation, parameters: CameraParameters) -> None:
        """Raises ValueError without `installation.frames`."""
        p, frames = parameters, installation.geometry_for("a camera")
        super().__init__(installation, p.latency_s, {})
        self.model = p.model()
        self.planes_m = (p.near_m, p.far_m)
        self.mount = Mount(p.mount_m, p.mount_rpy_deg)
        self.channels = p.channels
        self._frames = frames
        self._renderer: Renderer = frames.renderer(
            self.model,
            shadows=p.shadows,
            supersample=p.supersample,
            near_m=p.near_m,
            far_m=p.far_m,
            shading=p.shading(),
            colour=p.colour,
            samples=p.samples,
        )
        self._exposing = self._renderer if isinstance(self._renderer, ExposingRenderer) else None
        self._shared = installation.shared
        if self._shared is not None:
            separate_colour = p.supersample > 1 or p.colour != "native" or p.motion_blur is not None
            self._renderer = self._shared.sharing(self._renderer, separate_colour=separate_colour)
        self._moments = self._exposure_moments(p)
        self._bands = self._row_bands(p)
        self._sensor = self._light_sensor(installation, p) if "rgb" in p.channels else None
        self._raw = channel_array("rgb", self.model) if self._sensor is not None else None
        self._rain = self._falling(installation, p) if "rgb" in p.channels else None
        self._drops: LensDrops | None = None
        falling = installation.scene.weather.precipitation
        if p.lens_drops is not None and falling is not None and not falling.flakes and "rgb" in p.channels:
            self._drops = LensDrops(
                falling, self.model, p.lens_drops, noise_key(installation.seed, f"{self.name}.window")
            )
        self._depth = None
        if p.depth_noise is not None and "depth" in p.channels:
            self._depth = DepthSensor(p.depth_noise, noise_key(installation.seed, f"{self.name}.depth"))

        self._thermal = None
        if p.infrared is not None and "infrared" in p.channels:
            self._thermal = ThermalDevice(p.infrared, noise_key(installation.seed, f"{self.name}.infrared"))

    def sample(self, truth: TruthState, seq: int) -> ImageSample:
        """Return picture `seq`."""
        t_ns = truth.t_ns
        self._frames.expect(t_ns)
        if self._shared is not None:
            self._shared.expect(truth)
        pictures: dict[str, NDArray[Any]] = {name: channel_array(name, self.model) for name in self.channels}
        if self._thermal is not None and "temperature" not in pictures:
            pictures["temperature"] = channel_array("temperature", self.model)
        sensor, raw = self._sensor, self._raw
        if self._exposing is not None and "rgb" in pictures:
            self._draw_exposure(truth, seq, pictures, self._exposing)
        elif sensor is None or raw is None:
            self._draw(truth, 0.0, pictures)
        else:
            self._draw_with_effects(truth, seq, pictures, sensor, raw)
        if self._rain is not None:
            self._rain.draw(pictures["rgb"], self.mount.pose(truth), seq)
        if self._drops is not None:
            self._drops.draw(pictures["rgb"], t_ns)
        if self._depth is not None:
            self._depth.measure(pictures["depth"], seq)
        if self._thermal is not None:
            self._thermal.measure(pictures["temperature"], seq, pictures["infrared"])
            if "temperature" not in self.channels:
                del pictures["temperature"]
        for picture in pictures.values():
            picture.flags.writeable = False
        pose = self.mount.pose(truth)
        return ImageSample(seq, t_ns, t_ns + self.latency_ns, pose.p_WC, self.mount.attitude(truth), pictures)

    def _draw_with_effects(
        self,
        truth: TruthState,
        seq: int,
        pictures: dict[str, NDArray[Any]],
        sensor: LightSensor,
        raw: NDArray[np.uint8],
    ) -> None:
        sensor.begin()
        weight = 1.0 / len(self._moments)
        if len(self._moments) == 1:
            self._draw(truth, 0.0, pictures | {"rgb": raw})
            sensor.add(raw, weight)
        else:
            geometry = {name: picture for name, picture in pictures.items() if name != "rgb"}
            if geometry:
                self._draw(truth, 0.0, geometry)
            for moment_s in self._moments:
                self._draw(truth, moment_s, {"rgb": raw})
                sensor.add(raw, weight)
        sensor.finish(seq, pictures["rgb"])

    def _draw_exposure(
        self, truth: TruthState, seq: int, pictures: dict[str, NDArray[Any]], renderer: ExposingRenderer
    ) -> None:
        """Draw the colour of the whole exposure at once, and the other channels by the raster."""
        geometry = {name: picture for name, picture in pictures.items() if name != "rgb"}
        if geometry:
            self._draw(truth, 0.0, geometry)
        bands = self._bands or [((0, self.model.height), 0.0)]
        renderer.expose(
            [
                [(rows, self.mount.pose(truth, moment_s + delay_s)) for rows, delay_s in bands]
                for moment_s in self._moments
            ],
            pictures["rgb"],
        )
        if self._sensor is not None:
            self._sensor.begin()
            self._sensor.add(pictures["rgb"], 1.0)
            self._sensor.finish(seq, pictures["rgb"])

    @property
    def one_pose(self) -> bool:
        """True if all rows of a picture are drawn from one pose: there is no rolling shutter."""
        return not self._bands

    def draw_by(
        self,
        renderer: Renderer,
        truth: TruthState,
        out: Mapping[str, NDArray[Any]],
        rows: tuple[int, int] | None = None,
    ) -> None:
        """Draw channels of the middle of the exposure by another renderer, row by row as `sample` does.

        `rows`: only these, for a camera of `one_pose`.
        """
        if self._bands:
            self._draw(truth, 0.0, out, renderer)
        else:
            renderer.render(self.mount.pose(truth), out, rows=rows)

    def _draw(
        self, truth: TruthState, moment_s: float, out: Mapping[str, NDArray[Any]], by: Renderer | None = None
    ) -> None:
        """Draw the picture of one instant of the exposure, band by band with a rolling shutter."""
        renderer = by if by is not None else self._renderer
        if not self._bands:
            renderer.render(self.mount.pose(truth, moment_s), out)
            return
        for rows, delay_s in self._bands:
            renderer.render(self.mount.pose(truth, moment_s + delay_s), out, rows=rows)

    def _row_bands(self, p: CameraParameters) -> list[tuple[tuple[int, int], float]]:
        """Return (rows, readout time of their middle after t_capture [s]) of each band; empty: all rows at once."""
        height = self.model.height
        if p.rolling_shutter_s == 0.0 or height <= BAND_ROWS:
            return []
        ends = [(first, min(first + BAND_ROWS, height)) for first in range(0, height, BAND_ROWS)]
        return [(rows, p.rolling_shutter_s * (0.5 * (rows[0] + rows[1]) / height - 0.5)) for rows in ends]

    def _falling(self, installation: Installation, p: CameraParameters) -> RainStreaks | None:
        scene = installation.scene
        falling = scene.weather.precipitation
        if falling is None:
            return None
        return RainStreaks(
            falling,
            self.model,
            exposure_s=USUAL_EXPOSURE_S if p.motion_blur is None else p.motion_blur.exposure_s,
            wind_W_mps=scene.wind_W_mps,
            key=noise_key(installation.seed, f"{installation.name}.rain"),
        )

    @staticmethod
    def _exposure_moments(p: CameraParameters) -> list[float]:
        if p.motion_blur is None:
            return [0.0]
        n = p.motion_blur.frames
        return [p.motion_blur.exposure_s * ((k + 0.5) / n - 0.5) for k in range(n)]

    def _light_sensor(self, installation: Installation, p: CameraParameters) -> LightSensor | None:
        """Return the model of the light sensor; None if no effect is switched on."""
        control, noise = p.exposure, p.noise
        if control.gain == 1.0 and not control.auto and noise is None and p.vignetting == 0.0 and p.motion_blur is None:
            return None
        return LightSensor(
            (self.model.height, self.model.width),
            gain=control.gain,
            auto_target=control.target if control.auto else None,
            gain_limits=(control.min_gain, control.max_gain),
            electrons_at_white=None if noise is None else noise.electrons_at_white,
            read_noise_electrons=0.0 if noise is None else noise.read_noise_electrons,
            vignette=vignette(self.model, p.vignetting),
            key=noise_key(installation.seed, f"{installation.name}.light"),
        )


KIND = Kind(Camera, CameraParameters, parts="channels")
