"""Objects in a radar's picture, with the mean and the expected power of their echoes: labels of a radar frame.

An object is an instance with at least one echo in the antenna pattern, the mask and the chirp's unambiguous range. With
A_i the amplitudes of its echoes and |H| the receiver's filters at their beat frequencies (sim/radar/synthesis.py):

    P = sum of A_i^2 |H(f_i)|^2        range, speed and direction: means with these powers as weights

The speed of a vehicle is the mean without its rotor blades, unless nothing else of it has an echo. Phases of the echoes
are independent, so P is the expectation of the power of their sum. One echo of power P in counts^2 has P at its peak in
a range-Doppler map; the echoes of an object are spread over several cells.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim._kernels import azimuth_elevation
from sim.frame.camera_model import CameraModel
from sim.frame.camera_pose import CameraPose
from sim.radar.antenna import Antenna
from sim.radar.chirp import SPEED_OF_LIGHT_MPS, Chirp
from sim.radar.mask import Mask
from sim.radar.receiver import Receiver
from sim.radar.rotor_blades import RotorBlades
from sim.radar.scatterers import Scatterers
from sim.scene.world import World

Float64 = NDArray[np.float64]


class ObjectEcho(NamedTuple):
    """Echoes of one object in one frame. Angles in R: azimuth to the left, elevation upwards."""

    instance: int
    range_m: float
    nearest_m: float  # range of its nearest echo
    speed_mps: float  # radial, + receding; not folded into the chirp's unambiguous speeds
    azimuth_rad: float
    elevation_rad: float
    power_counts2: float  # behind the receiver's filters
    power_w: float  # at the antenna's port, before the filters


class ObjectEchoes:
    """Finds the objects in pictures of one camera. The picture needs the channel `instance`, too.

    `wanted`, (65536,) bool: True for the instances to find; by default all but 0.
    """

    def __init__(
        self,
        camera: CameraModel,
        world: World,
        chirp: Chirp,
        antenna: Antenna,
        receiver: Receiver,
        mask: Mask,
        wanted: NDArray[np.bool_] | None = None,
    ) -> None:
        """Raises the errors of `Scatterers`."""
        self._wanted = np.arange(65536) > 0 if wanted is None else wanted
        limit_m = chirp.max_range_m if mask.max_range_m is None else min(mask.max_range_m, chirp.max_range_m)
        in_range = mask.model_copy(update={"max_range_m": limit_m})
        self._scatterers = Scatterers(camera, world, chirp, antenna, receiver, in_range)
        self._hz_per_m = 2.0 * chirp.slope_hz_per_s / SPEED_OF_LIGHT_MPS
        self._receiver = receiver
        self._blades = RotorBlades(world)
        # Passed for the radial velocity, so that the kernel returns the pixel of each echo in its place.
        self._pixel = np.arange(camera.width * camera.height, dtype=np.float32).reshape(camera.height, camera.width)

    def find(self, picture: Mapping[str, NDArray[Any]], pose: CameraPose) -> list[ObjectEcho]:
        """Return the objects by rising instance id."""
        # Most pixels show ground and sky: their surfaces are taken away, so that they make no echoes.
        material = picture["material"] * self._wanted.take(picture["instance"])
        echoes = self._scatterers.collect({**picture, "material": material, "radial_velocity": self._pixel}, pose)
        of_pixels = self._scatterers.last.kept
        pixel = echoes.speed_mps[:of_pixels].astype(np.int64)
        speed_mps = echoes.speed_mps.copy()
        speed_mps[:of_pixels] = picture["radial_velocity"].reshape(-1)[pixel]
        # A corner reflector's echo has no pixel of its own: it belongs to the object seen in its direction.
        corners = [int(np.argmax(self._scatterers.direction_R @ d_R)) for d_R in echoes.direction_R[of_pixels:]]
        instance = picture["instance"].reshape(-1)[[*pixel.tolist(), *corners] if corners else pixel]

        input_power = echoes.amplitude * echoes.amplitude
        power = input_power * self._receiver.filter_power(echoes.range_m * self._hz_per_m)
        count = int(instance.max(initial=0)) + 1
        total = np.bincount(instance, power, count)
        total_input = np.bincount(instance, input_power, count)
        nearest_m = np.full(count, np.inf)
        np.minimum.at(nearest_m, instance, echoes.range_m)
        found = np.flatnonzero((total > 0.0) & self._wanted[:count])  # a corner's direction may show any instance

        def mean(values: Float64) -> Float64:
            return np.bincount(instance, power * values, count)[found] / total[found]

        range_m, radial_mps = mean(echoes.range_m), mean(speed_mps)
        blades = self._blades.mask(picture)
        if blades is not None:
            weight = power.copy()
            weight[:of_pixels][blades.reshape(-1)[pixel]] = 0.0
            rest = np.bincount(instance, weight, count)[found]
            of_rest = np.bincount(instance, weight * speed_mps, count)[found]
            radial_mps = np.divide(of_rest, rest, out=radial_mps, where=rest > 0.0)
        direction_R = np.ascontiguousarray(np.stack([mean(echoes.direction_R[:, axis]) for axis in range(3)], axis=1))
        azimuth_rad, elevation_rad = np.empty(len(found)), np.empty(len(found))
        azimuth_elevation(direction_R, azimuth_rad, elevation_rad)
        power_w = total_input[found] / self._receiver.counts_per_sqrt_watt**2
        columns = (range_m, nearest_m[found], radial_mps, azimuth_rad, elevation_rad, total[found], power_w)
        rows = zip(found.tolist(), *(column.tolist() for column in columns), strict=True)
        return [ObjectEcho(*row) for row in rows]
