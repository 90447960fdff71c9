"""Apparent temperature in 8 to 14 um: of the black body that sends as much light as a pixel receives [K].

    L = tau(r) (e L(T_s) + (1 - e) (F L_sky + (1 - F) L(T_a))) + (1 - tau(r)) L(T_a)

with the temperature T_s and the emissivity e of the surface and the share F of the sky that it sees
(sim/scene/heat.py), the band radiance L (band_radiance.py), L_sky = e_sky L(T_a), and the transmission tau of the air
over the range r (infrared_air.py). Surfaces reflect diffusely. Where there is no surface, L = e_sky(elevation) L(T_a)
above the horizon and L(T_a) below it.

With the camera's `shadows`, a ray from each sunlit point towards the sun finds what is in the shade. Bonnets are the
front 27 % of a vehicle that drives, above two fifths of its height.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from signals.rotation import applied_back, applied_to_rows, dot, matrix_of
from sim.frame.band_radiance import band_radiance, radiance_of, temperature_of
from sim.frame.camera_pose import CameraPose
from sim.frame.derived import View
from sim.frame.infrared_air import AirTransmission
from sim.scene.heat import BONNET_K, CLOTHES_SHARE, HAIR_SHARE, SKIN_K, TYRE_K, climate_of, heat_of
from sim.scene.scene_map import actor_pose
from sim.scene.surfaces import CLOTH, HAIR, RUBBER, SKIN

Float64 = NDArray[np.float64]

_ALIVE = ("person", "dog", "bird")
_SKY_NODES = 1024
_OFF_SURFACE_M, _SHADOW_M = 0.02, 500.0
_BONNET_LENGTH, _BONNET_HEIGHT = 0.27, 0.4


class Filler:
    """Temperatures in one camera's pictures."""

    def __init__(self, view: View) -> None:
        self._geometry, self._shadows = view.geometry, view.shadows
        self._rays_C = view.camera.rays()
        world = view.geometry.world
        climate = self._climate = climate_of(world.scene)
        self._air = AirTransmission(world.scene, climate.air_k)
        self._air_radiance = band_radiance(climate.air_k)
        self._sky_radiance = climate.sky_hemisphere * self._air_radiance
        sines = [k / (_SKY_NODES - 1) for k in range(_SKY_NODES)]
        self._sky = np.array([climate.sky_emissivity(sine) for sine in sines]) * self._air_radiance
        self._by_geom(world)
        self._bonnets = _bonnets(world)

    def _by_geom(self, world: Any) -> None:
        """Make tables by geom: emissivity, temperature without sun and sky, and kelvins per W/m2."""
        climate, of_surface = self._climate, [heat_of(surface) for surface in world.surfaces]
        alive = {world.class_names.index(name) for name in _ALIVE if name in world.class_names}
        n = int(world.model.ngeom)
        self._emissivity, self._base_k = np.empty(n), np.full(n, climate.air_k)
        self._sun_k, self._sky_k = np.empty(n), np.empty(n)  # per W/m2 of sunlight, per W/m2 of loss to the sky
        drives = np.array([actor >= 0 for actor in world.geom_actor.tolist()]) if n else np.zeros(0, bool)
        surface_of = [world.surfaces[k] for k in world.geom_surface.tolist()]
        for geom, (surface, class_id) in enumerate(zip(surface_of, world.geom_class.tolist(), strict=True)):
            heat = of_surface[world.geom_surface[geom]]
            per_w = heat.share / climate.exchange_w_per_m2_k
            self._emissivity[geom], self._sun_k[geom] = heat.emissivity, heat.absorptance * per_w
            self._sky_k[geom] = heat.emissivity * per_w
            share = {SKIN: 1.0, HAIR: HAIR_SHARE}.get(surface, CLOTHES_SHARE)
            if class_id in alive or surface in (SKIN, HAIR, CLOTH):
                self._base_k[geom] += share * (SKIN_K - climate.air_k)
            elif drives[geom] and surface == RUBBER:
                self._base_k[geom] += TYRE_K

    def fill(
        self, pictures: Mapping[str, NDArray[Any]], pose: CameraPose, first_row: int, out: NDArray[np.float32]
    ) -> None:
        """Write the temperatures of rows from `first_row` on."""
        climate = self._climate
        R = pose.R_WC
        rays_C = self._rays_C[first_row : first_row + len(out)].reshape(-1, 3)
        geom = pictures["geom"].reshape(-1)
        radiance = self._empty(rays_C, geom, R)
        pixel = np.flatnonzero(geom >= 0)
        if pixel.size:
            at, axes = geom[pixel], np.reshape(R, (3, 3))
            range_m = pictures["range"].reshape(-1)[pixel].astype(np.float64)
            rays_W = applied_to_rows(axes, rays_C[pixel])
            n_W = applied_to_rows(axes, pictures["normal"].reshape(-1, 3)[pixel].astype(np.float64))
            facing = np.maximum(dot(n_W.T, climate.to_sun_W), 0.0)
            point_W = np.array(pose.p_WC) + range_m[:, None] * rays_W
            if self._shadows and climate.beam_w_per_m2 > 0.0:
                self._shade(point_W, n_W, facing)
            open_sky = 0.5 * (1.0 + n_W[:, 2])
            sun = climate.beam_w_per_m2 * facing + climate.diffuse_w_per_m2 * open_sky
            surface_k = self._base_k[at] + self._sun_k[at] * sun
            surface_k -= self._sky_k[at] * climate.loss_w_per_m2 * np.maximum(n_W[:, 2], 0.0)
            self._warm_bonnets(at, point_W, surface_k)
            e, tau = self._emissivity[at], self._air.of(range_m)
            around = open_sky * self._sky_radiance + (1.0 - open_sky) * self._air_radiance
            sent = e * radiance_of(surface_k) + (1.0 - e) * around
            radiance[pixel] = tau * sent + (1.0 - tau) * self._air_radiance
        out[:] = temperature_of(radiance).reshape(out.shape).astype(np.float32)

    def _empty(self, rays_C: Float64, geom: NDArray[np.int32], R: Any) -> Float64:
        """Return the radiance of the sky, and of the air below the horizon; undefined where there is a surface."""
        radiance = np.full(len(geom), self._air_radiance)
        pixel = np.flatnonzero(geom < 0)
        sine = dot(R[6:], rays_C[pixel].T)
        place = np.minimum(np.maximum(sine, 0.0), 1.0) * (_SKY_NODES - 1)
        node = np.minimum(place.astype(np.int64), _SKY_NODES - 2)
        sky = self._sky[node] + (place - node) * (self._sky[node + 1] - self._sky[node])
        radiance[pixel] = np.where(sine > 0.0, sky, self._air_radiance)
        return radiance

    def _shade(self, point_W: Float64, n_W: Float64, facing: Float64) -> None:
        """Take the sun from points that something hides from it."""
        lit = np.flatnonzero(facing > 0.0)
        if lit.size == 0:
            return
        self._geometry.pose_within()  # what is out of sight may cast a shadow
        origins = np.ascontiguousarray(point_W[lit] + _OFF_SURFACE_M * n_W[lit])
        directions = np.ascontiguousarray(np.broadcast_to(self._climate.to_sun_W, origins.shape))
        range_m, hit = np.empty(lit.size), np.empty(lit.size, np.int32)
        self._geometry.caster.cast(origins, directions, 0.0, _SHADOW_M, range_m, hit)
        facing[lit[hit >= 0]] = 0.0

    def _warm_bonnets(self, geom: NDArray[np.int32], point_W: Float64, surface_k: Float64) -> None:
        for bonnet in self._bonnets:
            pixel = np.flatnonzero(bonnet.is_part[geom])
            if pixel.size == 0:
                continue
            p, R = bonnet.pose(self._geometry.t_ns)
            d = point_W[pixel] - p
            forward, _, up = applied_back(R, d.T)
            surface_k[pixel[(forward >= bonnet.least_x_m) & (up >= bonnet.least_z_m)]] += BONNET_K


class _Bonnet:
    """Place of a driving vehicle's engine: in front of `least_x_m` and above `least_z_m` of its first body."""

    def __init__(self, actor: Any, is_part: NDArray[np.bool_], low: Float64, high: Float64) -> None:
        self._actor, self.is_part = actor, is_part
        self.least_x_m = float(high[0] - _BONNET_LENGTH * (high[0] - low[0]))
        self.least_z_m = float(low[2] + _BONNET_HEIGHT * (high[2] - low[2]))

    def pose(self, t_ns: int) -> tuple[Float64, tuple[float, ...]]:
        """Return position and rotation of the first body at a time."""
        p, q, _, _ = actor_pose(self._actor, t_ns)
        a, b, c, d = q[0].tolist()
        return p[0], tuple(matrix_of((a, b, c, d)))


def _bonnets(world: Any) -> list[_Bonnet]:
    """Return the bonnets of all vehicles that drive."""
    model, found = world.model, []
    vehicle = world.class_names.index("vehicle") if "vehicle" in world.class_names else -1
    for index, actor in enumerate(world.map.actors):
        geoms = np.flatnonzero(world.geom_actor == index)
        if not geoms.size or not (world.geom_class[geoms] == vehicle).all():
            continue
        chassis = geoms[model.geom_bodyid[geoms] == model.body(actor.bodies[0]).id]
        if not chassis.size:
            continue
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for geom in chassis:
            R = np.empty(9)
            mujoco.mju_quat2Mat(R, model.geom_quat[geom])
            middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
            size = np.abs(R.reshape(3, 3)) @ half
            centre = model.geom_pos[geom] + R.reshape(3, 3) @ middle
            low, high = np.minimum(low, centre - size), np.maximum(high, centre + size)
        is_part = np.zeros(int(model.ngeom), bool)
        is_part[chassis] = True
        found.append(_Bonnet(actor, is_part, low, high))
    return found
