"""Colours and textures of a MuJoCo model, for the native raster.

The colour of a geom follows MuJoCo's rules: it is the geom's own rgba, or the material's if the geom has a material and
its own rgba is the default grey; a texture multiplies it. Textures repeat per metre (`texuniform`) or per edge of the
geom. Images whose edges are not powers of two are resampled to the next power, at least 4. Each level of the pyramid is
the mean of 2 x 2 texels of the previous level, in integers.

The alpha channel of a texture on a mesh with texture coordinates makes holes: texels below one half are open. There the
texture is laid by the mesh's coordinates alone, without repetition factors and random changes of the pattern.

A material's layer with the role `normal` is a texture of surface normals; it is laid, and randomly shifted, as the
texture of the colour.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim._kernels import Geometry, Scenery
from sim.frame.wet_surface import wet_colour, wet_gloss
from sim.scene.semantics import has_material_colour
from sim.scene.surface_appearance import NO_SHIFT, SurfaceAppearance, shifted

_CUBE = int(mujoco.mjtTexture.mjTEXTURE_CUBE)
_MESH = int(mujoco.mjtGeom.mjGEOM_MESH)
_MIN_EDGE, _MAX_EDGE = 4, 4096  # texels along an edge
_OPAQUE = 128  # least alpha of a texel that is not a hole


def make_scenery(
    model: mujoco.MjModel,
    *,
    appearances: Sequence[SurfaceAppearance | None] = (),
    wet: Sequence[float] = (),
) -> Scenery:
    """Return colours and textures of every geom of `model`.

    `appearances`: random change of each geom's surface; None: unchanged. `wet`: share of the wet look of each geom
    (sim/frame/wet_surface.py); empty: all are dry.
    """
    scenery = Scenery()
    textures: dict[tuple[int, SurfaceAppearance | None], int] = {}
    means: dict[int, tuple[float, float, float]] = {}
    reliefs: dict[tuple[int, tuple[float, float]], int] = {}
    uses_material = has_material_colour(model)
    masked = open_texels(model)
    for geom in range(model.ngeom):
        rgba = model.geom_rgba[geom]
        material = int(model.geom_matid[geom])
        appearance = appearances[geom] if appearances else None
        emission, texture, relief, repeat, uniform = 0.0, -1, -1, (1.0, 1.0), False
        gloss = (0.0, 0.0, 0.0)
        if material >= 0:
            if uses_material[geom]:
                rgba = model.mat_rgba[material]
            emission = float(model.mat_emission[material])
            source = rgb_texture(model, material)
            if source >= 0:
                key = (source, appearance)
                if key not in textures:
                    textures[key] = _add_texture(scenery, model, source, appearance)
                texture = textures[key]
            source, shift = relief_of(model, material, appearance)
            if source >= 0:
                if (source, shift) not in reliefs:
                    image = shifted(texels_of(model, source), shift)
                    reliefs[source, shift] = int(scenery.add_texture(_pyramid([image]), False, linear=True))
                relief = reliefs[source, shift]
            gloss = _gloss(model, material)
            u, v = (float(x) for x in model.mat_texrepeat[material])
            repeat, uniform = (u, v), bool(model.mat_texuniform[material])
        r, g, b = (float(x) for x in rgba[:3])
        if geom in masked:
            repeat, uniform = (1.0, 1.0), False
        if appearance is not None:
            if max(texture, relief) >= 0 and geom not in masked:
                repeat = (repeat[0] / appearance.scale, repeat[1] / appearance.scale)
            if texture < 0:  # texels are changed already
                r, g, b = appearance.colour((r, g, b))
        if wet and wet[geom] > 0.0:
            mean = (1.0, 1.0, 1.0) if texture < 0 else _mean_texel(model, rgb_texture(model, material), means)
            (r, g, b), gloss = wet_colour((r, g, b), mean, wet[geom]), wet_gloss(gloss, wet[geom])
        scenery.add_geom((r, g, b), emission, texture, repeat[0], repeat[1], uniform, *gloss, relief)
    return scenery


def _mean_texel(
    model: mujoco.MjModel, texture: int, means: dict[int, tuple[float, float, float]]
) -> tuple[float, float, float]:
    """Return the mean sRGB code / 255 of a texture; `means`: of those before."""
    if texture not in means:
        texels = texels_of(model, texture).reshape(-1, 3)
        r, g, b = (int(total) / (255.0 * len(texels)) for total in texels.sum(axis=0, dtype=np.int64))
        means[texture] = (r, g, b)
    return means[texture]


def _gloss(model: mujoco.MjModel, material: int) -> tuple[float, float, float]:
    """Return specular, shininess and metallic of a material, each 0 to 1; MuJoCo's metallic of -1 is none."""
    values = (model.mat_specular[material], model.mat_shininess[material], model.mat_metallic[material])
    specular, shininess, metallic = (min(max(float(value), 0.0), 1.0) for value in values)
    return specular, shininess, metallic


def rgb_texture(model: mujoco.MjModel, material: int) -> int:
    """Return the texture of a material's colour; -1: none."""
    roles = model.mat_texid[material]
    for role in (mujoco.mjtTextureRole.mjTEXROLE_RGB, mujoco.mjtTextureRole.mjTEXROLE_RGBA):
        source = int(roles[role])
        if source >= 0 and model.tex_type[source] != mujoco.mjtTexture.mjTEXTURE_SKYBOX:
            return source
    return -1


def relief_of(
    model: mujoco.MjModel, material: int, appearance: SurfaceAppearance | None
) -> tuple[int, tuple[float, float]]:
    """Return the texture of a material's normals, -1 for none, and its shift, which is that of the colour."""
    source = int(model.mat_texid[material][mujoco.mjtTextureRole.mjTEXROLE_NORMAL])
    if source < 0 or model.tex_type[source] == _CUBE:
        return -1, NO_SHIFT
    colour = rgb_texture(model, material)
    stays = appearance is None or (colour >= 0 and not _can_shift(model, colour))
    return source, NO_SHIFT if appearance is None or stays else appearance.shift


def open_texels(model: mujoco.MjModel) -> dict[int, NDArray[np.bool_]]:
    """Return the holes in the texture of each geom that has some, (height, width); row 0 is the texture's first."""
    of_texture: dict[int, NDArray[np.bool_] | None] = {}
    found: dict[int, NDArray[np.bool_]] = {}
    for geom in np.flatnonzero((model.geom_type == _MESH) & (model.geom_matid >= 0)).tolist():
        texture = rgb_texture(model, int(model.geom_matid[geom]))
        if texture < 0 or model.mesh_texcoordadr[model.geom_dataid[geom]] < 0:
            continue
        if texture not in of_texture:
            texels = _texels(model, texture)
            has_holes = texels.shape[2] == 4 and bool((texels[:, :, 3] < _OPAQUE).any())
            of_texture[texture] = _powers_of_two(texels[:, :, 3:])[:, :, 0] < _OPAQUE if has_holes else None
        holes = of_texture[texture]
        if holes is not None:
            found[geom] = holes
    return found


def alpha_masks(model: mujoco.MjModel, geometry: Geometry) -> dict[int, int]:
    """Add the masks of all textures with holes to `geometry`; return the mask of each geom that has one."""
    masks: dict[int, int] = {}
    found: dict[int, int] = {}
    for geom, is_open in open_texels(model).items():
        if id(is_open) not in masks:
            masks[id(is_open)] = geometry.add_mask((~is_open).astype(np.uint8))
        found[geom] = masks[id(is_open)]
    return found


def texels_of(model: mujoco.MjModel, texture: int) -> NDArray[np.uint8]:
    """Return the texels (H, W, 3). A texture of one channel is grey, one of two channels grey and alpha."""
    texels = _texels(model, texture)
    return np.repeat(texels[:, :, :1], 3, axis=2) if texels.shape[2] < 3 else texels[:, :, :3]


def _texels(model: mujoco.MjModel, texture: int) -> NDArray[np.uint8]:
    height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
    channels = int(model.tex_nchannel[texture])
    begin = int(model.tex_adr[texture])
    texels: NDArray[np.uint8] = model.tex_data[begin : begin + height * width * channels].reshape(
        height, width, channels
    )
    return texels


def _without_holes(rgb: NDArray[np.uint8], alpha: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the texels with the mean colour of the opaque ones in the holes, so that no hole tints a coarser level."""
    opaque = alpha >= _OPAQUE
    count = int(opaque.sum())
    if count in (0, opaque.size):
        return rgb
    filled = rgb.copy()
    filled[~opaque] = (rgb[opaque].sum(axis=0, dtype=np.int64) // count).astype(np.uint8)
    return filled


def _is_cube(model: mujoco.MjModel, texture: int) -> bool:
    return bool(model.tex_type[texture] == _CUBE and model.tex_height[texture] == 6 * model.tex_width[texture])


def _can_shift(model: mujoco.MjModel, texture: int) -> bool:
    return not _is_cube(model, texture) and model.tex_nchannel[texture] != 4


def texture_image(
    model: mujoco.MjModel, texture: int, appearance: SurfaceAppearance | None
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None, bool]:
    """Return the texels (H, W, 3) of a colour as they are drawn, their alpha (H, W) if stored, and True for a cube."""
    rgb, texels = texels_of(model, texture), _texels(model, texture)
    alpha = texels[:, :, 3] if texels.shape[2] == 4 else None
    if alpha is not None:
        rgb = _without_holes(rgb, alpha)
    if appearance is not None:
        rgb = appearance.texels(rgb, shifts=_can_shift(model, texture))
    return rgb, alpha, _is_cube(model, texture)


def _add_texture(scenery: Scenery, model: mujoco.MjModel, texture: int, appearance: SurfaceAppearance | None) -> int:
    rgb, _, cube = texture_image(model, texture, appearance)
    return int(scenery.add_texture(_pyramid(np.split(rgb, 6) if cube else [rgb]), cube))


def _pyramid(images: list[NDArray[np.uint8]]) -> list[NDArray[np.uint8]]:
    """Return the levels of a texture, each with all faces below each other."""
    faces = [_powers_of_two(image) for image in images]
    levels = []
    while True:
        levels.append(np.ascontiguousarray(np.concatenate(faces)))
        if min(faces[0].shape[:2]) <= _MIN_EDGE:
            return levels
        faces = [_halved(face) for face in faces]


def _powers_of_two(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    for axis in (0, 1):
        size = image.shape[axis]
        new_size = min(_MAX_EDGE, max(_MIN_EDGE, 1 << (size - 1).bit_length()))
        if new_size != size:
            image = image.take((np.arange(new_size) * size) // new_size, axis=axis)
    return image


def _halved(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    total = image.astype(np.uint16)
    total = total[0::2] + total[1::2]
    total = total[:, 0::2] + total[:, 1::2]
    return ((total + 2) // 4).astype(np.uint8)
