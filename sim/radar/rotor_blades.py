"""Rotor blades of other vehicles in a radar's picture. They are known by their surface.

The synthesis moves an echo at its radial speed v for the whole frame. A blade turns several times in a frame and stays
where it is, so its echo gets the speed that the chirps see of it:

    v_seen = v - 2 v_max round(v / (2 v_max))

The phase from chirp to chirp is then exact, and the echo leaves its range by less than v_max times half a frame. Over
many frames at random angles of the rotor, the spectrum of speeds is that of the blades. What is lost is the shift in
range of (v - v_seen) f_c / S.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.radar.chirp import Chirp
from sim.scene.surfaces import PROPELLER
from sim.scene.world import World


class RotorBlades:
    """Finds the pixels of rotor blades in pictures of one world."""

    def __init__(self, world: World) -> None:
        self._surface = world.surfaces.index(PROPELLER) if PROPELLER in world.surfaces else None

    def mask(self, picture: Mapping[str, NDArray[Any]]) -> NDArray[np.bool_] | None:
        """Return True for pixels of blades, (height, width); None if the world has none."""
        return None if self._surface is None else picture["material"] == self._surface

    def seen_speeds(
        self, speed_mps: NDArray[np.float64], surface: NDArray[np.int64], chirp: Chirp
    ) -> NDArray[np.float64]:
        """Return speeds with those of blades as the chirps see them; `surface` of each."""
        if self._surface is None:
            return speed_mps
        span_mps = 2.0 * chirp.max_speed_mps
        return np.where(surface == self._surface, speed_mps - span_mps * np.rint(speed_mps / span_mps), speed_mps)

    def with_seen_speeds(self, picture: Mapping[str, NDArray[Any]], chirp: Chirp) -> Mapping[str, NDArray[Any]]:
        """Return the picture with the speeds of blades as the chirps see them."""
        blades = self.mask(picture)
        if blades is None or not blades.any():
            return picture
        speed_mps = picture["radial_velocity"].copy()
        span_mps = np.float32(2.0 * chirp.max_speed_mps)
        speed_mps[blades] -= span_mps * np.rint(speed_mps[blades] / span_mps)
        return {**picture, "radial_velocity": speed_mps}
