"""Texture coordinates and materials of a world's geoms, for the path tracer.

Coordinates follow the rules of the raster (sim/native/frame/surface_colour.hpp): a mesh's own, a cube map by direction
from the middle of the geom's box, else a projection along the axis that the triangle faces most. Here they are stored
at the corners, with the repetitions applied: u along the columns of the image, v down its rows, 1 for a whole image.
The faces of a cube map stand one below the other.

A surface has a diffuse base below a dielectric coat (metals: a coat of their own colour). Its reflectance at normal
incidence and the width of its highlight follow from MJCF's specular and shininess:

    f0 = 0.08 specular,    n = 128 shininess,    alpha = sqrt(2 / (n + 2))       (Walter et al., EGSR 2007, eq. 35)

or from `metallic` and `roughness` where the MJCF gives them. Glass and water are recognised by their surface.
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.frame.path_traced.protocol import LEAFY, WATERY
from sim.frame.scenery import relief_of, rgb_texture, texels_of, texture_image
from sim.scene.semantics import has_material_colour
from sim.scene.surface_appearance import shifted
from sim.scene.surfaces import GLASS, GRASS, LEAVES, WATER
from sim.scene.world import World

Float64 = NDArray[np.float64]

_MESH = int(mujoco.mjtGeom.mjGEOM_MESH)
_OPAQUE = 128  # least alpha of a texel that is not a hole
_INFINITE_M = 1e6

# Columns of the table of materials.
COLUMNS = ("red", "green", "blue", "texture", "f0", "alpha", "metallic", "emission", "kind", "holes", "relief")


class Looks(NamedTuple):
    """Materials and textures of a world."""

    material: NDArray[np.float32]  # (ngeom, COLUMNS): colour linear, the texture -1 for none
    textures: list[NDArray[np.uint8]]  # (H, W, 4) sRGB and alpha; a cube map has H = 6 W
    is_cube: list[bool]
    repeat: Float64  # (ngeom, 2)
    per_metre: NDArray[np.bool_]

    def plain(self) -> NDArray[np.float32]:
        """Return the materials without textures: each surface has its mean colour. Holes stay."""
        changed = self.material.copy()
        for number, image in enumerate(self.textures):
            rows = changed[:, 3] == number
            if np.any(rows):
                opaque = image[..., 3] >= _OPAQUE
                mean = decoded(image[..., :3][opaque] if opaque.any() else image[..., :3]).reshape(-1, 3).mean(axis=0)
                changed[rows, :3] *= mean
        changed[changed[:, 9] == 0.0, 3] = -1.0
        return changed


def decoded(code: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return linear light of sRGB codes (IEC 61966-2-1)."""
    return _LINEAR[code]


def _linear(c: Float64) -> Float64:
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


_LINEAR = _linear(np.arange(256) / 255.0).astype(np.float32)


def make_looks(world: World) -> Looks:
    """Return the materials and textures of a world, with its random appearance applied."""
    model = world.model
    uses_material = has_material_colour(model)
    appearances = world.geom_appearance
    numbers: dict[tuple[int, object], int] = {}
    textures: list[NDArray[np.uint8]] = []
    is_cube: list[bool] = []
    material = np.zeros((model.ngeom, len(COLUMNS)), np.float32)
    repeat, per_metre = np.ones((model.ngeom, 2)), np.zeros(model.ngeom, bool)
    for geom in range(model.ngeom):
        look, appearance = material[geom], appearances[geom]
        rgba, number = model.geom_rgba[geom], int(model.geom_matid[geom])
        texture, has_holes = -1, False
        specular, shininess, metallic, roughness = 0.0, 0.0, -1.0, -1.0
        if number >= 0:
            if uses_material[geom]:
                rgba = model.mat_rgba[number]
            specular, shininess = float(model.mat_specular[number]), float(model.mat_shininess[number])
            metallic, roughness = float(model.mat_metallic[number]), float(model.mat_roughness[number])
            look[7] = model.mat_emission[number]
            source = rgb_texture(model, number)
            if source >= 0:
                key = (source, appearance)
                if key not in numbers:
                    numbers[key] = len(textures)
                    image, alpha, cube = texture_image(model, source, appearance)
                    textures.append(_with_alpha(image, alpha))
                    is_cube.append(cube)
                texture = numbers[key]
                has_holes = _has_uv(model, geom) and bool((textures[texture][..., 3] < _OPAQUE).any())
            if not has_holes:
                repeat[geom] = model.mat_texrepeat[number]
                per_metre[geom] = bool(model.mat_texuniform[number])
        rgb = tuple(float(x) for x in rgba[:3])
        if appearance is not None:
            if texture < 0:
                rgb = appearance.colour(rgb)  # type: ignore[arg-type]
            elif not has_holes:
                repeat[geom] /= appearance.scale
        look[:3] = _linear(np.clip(rgb, 0.0, 1.0))
        look[3], look[9], look[10] = texture, has_holes, -1.0
        if number >= 0:
            source, shift = relief_of(model, number, appearance)
            if source >= 0:
                look[10] = numbers.setdefault((source, shift), len(textures))
                if look[10] == len(textures):
                    textures.append(_with_alpha(shifted(texels_of(model, source), shift), None))
                    is_cube.append(False)
                if appearance is not None and texture < 0 and not has_holes:
                    repeat[geom] /= appearance.scale
        surface = world.surfaces[int(world.geom_surface[geom])]
        look[4:7] = _gloss(specular, shininess, metallic, roughness)
        if surface == WATER:
            look[4:7], look[8] = (0.02, 0.03, 0.0), WATERY
        elif surface == GLASS:
            look[4:7] = (0.06, 0.02, 0.0)
        elif surface in (LEAVES, GRASS) and has_holes:
            look[8] = LEAFY
    return Looks(material, textures, is_cube, repeat, per_metre)


def _gloss(specular: float, shininess: float, metallic: float, roughness: float) -> tuple[float, float, float]:
    """Return f0, alpha and metallic; MJCF's default of metallic and roughness is -1, not given."""
    alpha = roughness * roughness if roughness >= 0.0 else (2.0 / (128.0 * shininess + 2.0)) ** 0.5
    return 0.08 * specular, min(max(alpha, 0.02), 1.0), min(max(metallic, 0.0), 1.0)


def _with_alpha(rgb: NDArray[np.uint8], alpha: NDArray[np.uint8] | None) -> NDArray[np.uint8]:
    return np.dstack([rgb, np.full(rgb.shape[:2], 255, np.uint8) if alpha is None else alpha])


def _has_uv(model: mujoco.MjModel, geom: int) -> bool:
    return int(model.geom_type[geom]) == _MESH and int(model.mesh_texcoordadr[model.geom_dataid[geom]]) >= 0


def corner_uv(
    corner: Float64,
    edge_m: tuple[float, float, float],
    repeat: Float64,
    *,
    per_metre: bool,
    cube: bool,
    mesh_uv: Float64 | None = None,
) -> Float64:
    """Return the coordinates (n, 3, 2) of triangles (n, 3, 3) in the frame of their geom.

    `edge_m`: edges of the geom's box, 0 for infinite ones. `mesh_uv`: the mesh's own, v upwards from the last row.
    """
    if mesh_uv is not None:
        return np.stack([mesh_uv[..., 0] * repeat[0], 1.0 - mesh_uv[..., 1] * repeat[1]], axis=-1)
    edge = np.array(edge_m)
    finite = (edge > 0.0) & (edge < _INFINITE_M)
    facing = np.abs(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]))
    along_z = (facing[:, 2] >= facing[:, 0]) & (facing[:, 2] >= facing[:, 1])
    along_x = ~along_z & (facing[:, 0] >= facing[:, 1])
    if cube:
        return _cube_uv(corner * np.where(finite, 2.0 / np.where(finite, edge, 1.0), 1.0))
    along_x, along_z = along_x[:, None], along_z[:, None]
    x, y, z = (corner[..., i] for i in range(3))
    half = np.where(edge < _INFINITE_M, 0.5 * edge, 0.0)
    u = np.where(along_x, y + half[1], x + half[0])
    v = np.where(along_z, y - half[1], z - half[2])
    if per_metre:
        du, dv = 0.5 * repeat[0], 0.5 * repeat[1]  # MuJoCo's unit of length for this is 2 m
    else:
        per = np.where(finite, 1.0 / np.where(finite, edge, 1.0), 1.0)
        du = np.where(along_x, per[1], per[0]) * repeat[0]
        dv = np.where(along_z, per[1], per[2]) * repeat[1]
    return np.stack([u * du, 1.0 - v * dv], axis=-1)


def _cube_uv(q: Float64) -> Float64:
    """Return coordinates in the six faces below one another, for points (n, 3, 3) around the middle of a cube."""
    middle = q.mean(axis=1)
    size = np.abs(middle)
    face_z = (size[:, 2] >= size[:, 0]) & (size[:, 2] >= size[:, 1])
    face_x = ~face_z & (size[:, 0] >= size[:, 1])
    axis = np.where(face_x, 0, np.where(face_z, 2, 1))
    negative = np.take_along_axis(middle, axis[:, None], axis=1) < 0.0  # (n, 1)
    major = np.take_along_axis(q, axis[:, None, None].repeat(3, axis=1), axis=2)[..., 0]
    sign = np.where(negative, -1.0, 1.0)
    x, y, z = (q[..., i] for i in range(3))
    fx, fz = face_x[:, None], face_z[:, None]
    u = np.where(fx, -sign * z, np.where(fz, sign * x, x))
    v = np.where(fx | fz, y, -sign * z)
    per = 0.5 / np.maximum(np.abs(major), 1e-20)
    u, v = (np.clip(c * per + 0.5, 0.001, 0.999) for c in (u, v))
    face = (np.where(face_x, 0, np.where(face_z, 4, 2)) + negative[:, 0])[:, None]
    return np.stack([u, (face + 1.0 - v) / 6.0], axis=-1)
