"""Materials of a glTF file as materials of a map.

The base colour becomes the colour and the texture. Roughness r and metalness m become MuJoCo's specular and shininess:

    shininess = 1 - r,   specular = (1 - r) (1 + m) / 2

which gives 0.5 and 0.25 for paint (m = 0, r = 0.5), and 0.8 and 0.8 for polished metal (m = 1, r = 0.2). The surface
for LiDAR and radar follows from whole words in the material's name, else from its metalness.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.scene.imports.gltf_file import GltfFile
from sim.scene.imports.gltf_schema import Material, TextureInfo
from sim.scene.imports.pictures import decoded_picture
from sim.scene.maps.texture_tools import encoded_png
from sim.scene.scene_map import Surface
from sim.scene.srgb import srgb
from sim.scene.surfaces import DEFAULT_SURFACE, SURFACES

MAX_EDGE = 2048  # of a texture; larger ones are made smaller
_MAX_UV = 1e9  # of what moves texture coordinates
_INVISIBLE = 0.05  # alpha below which a blended material is not there
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")  # of a name such as RoofTiles_01
_WORDS = {  # in this order; "tiles" counts as "tile"
    "glass": "glass", "window": "glass", "metal": "painted_metal", "steel": "metal", "iron": "painted_metal",
    "wood": "wood", "timber": "wood", "brick": "brick", "concrete": "concrete", "cement": "concrete",
    "asphalt": "asphalt", "road": "asphalt", "grass": "grass", "lawn": "grass", "leaf": "foliage", "leaves": "foliage",
    "foliage": "foliage", "tree": "foliage", "bark": "wood", "water": "water", "plaster": "plaster",
    "stucco": "plaster", "roof": "roof_tile", "tile": "roof_tile", "stone": "stone", "rock": "stone",
    "gravel": "gravel", "sand": "sand",
    "soil": "soil", "dirt": "soil", "earth": "soil", "rubber": "rubber", "tire": "rubber", "plastic": "plastic",
    "car": "painted_metal", "skin": "skin_clothes", "cloth": "skin_clothes", "clothes": "skin_clothes",
    "fabric": "skin_clothes", "brickwork": "brick", "brickwall": "brick", "cobblestone": "stone", "sandstone": "stone",
    "limestone": "stone", "plywood": "wood", "hardwood": "wood", "rooftop": "roof_tile",
}  # fmt: skip


@dataclass(frozen=True)
class Look:
    """A material of the file, ready for the map."""

    name: str
    rgb: tuple[float, float, float]  # sRGB codes / 255
    texture: int | None  # index of the image
    holes: float | None  # alpha below this is open; None: closed
    uv_set: int
    uv: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    specular: float
    shininess: float
    surface: Surface
    visible: bool


def look_of(file: GltfFile, index: int | None) -> Look:
    """Return the look of a material; without one, that of the glTF default."""
    gltf = file.gltf
    if index is not None and index >= len(gltf.materials):
        raise file.error("a primitive", f"names materials[{index}], which does not exist")
    material = gltf.materials[index] if index is not None else Material()
    pbr = material.pbrMetallicRoughness
    factor, colour_map = pbr.baseColorFactor, pbr.baseColorTexture
    metal, rough = pbr.metallicFactor, pbr.roughnessFactor
    older = material.extensions.get("KHR_materials_pbrSpecularGlossiness")
    if isinstance(older, dict):
        factor, colour_map = _older_colour(file, older, f"materials[{index}]")
        metal, rough = 0.0, 1.0
    elif pbr.metallicRoughnessTexture is not None:
        image = _image_of(file, pbr.metallicRoughnessTexture)
        if image is not None:
            mean = _mean_colour(file, image)
            metal, rough = metal * float(mean[0]), rough * float(mean[1])
    if index is None:
        metal = 0.0
    texture = _image_of(file, colour_map) if colour_map is not None else None
    holes = None
    if material.alphaMode == "MASK":
        holes = min(max(material.alphaCutoff / max(factor[3], 1e-3), 1.0 / 255.0), 1.0)
    elif material.alphaMode == "BLEND" and texture is not None:
        holes = 0.5
    visible = material.alphaMode != "BLEND" or factor[3] >= _INVISIBLE
    if material.alphaMode == "MASK" and factor[3] < material.alphaCutoff:
        visible = False
    name = material.name or ("default" if index is None else f"material_{index}")
    gloss = 1.0 - rough
    transform = colour_map.extensions.get("KHR_texture_transform") if colour_map is not None else None
    uv_set = colour_map.texCoord if colour_map is not None else 0
    if isinstance(transform, dict) and transform.get("texCoord") in (0, 1):
        uv_set = int(transform["texCoord"])
    return Look(
        name,
        (srgb(factor[0]), srgb(factor[1]), srgb(factor[2])),
        texture,
        holes,
        uv_set,
        _uv_transform(file, transform, f"materials[{index}]"),
        0.5 * gloss * (1.0 + metal),
        gloss,
        _surface(name, metal, material.alphaMode == "BLEND" and factor[3] < 0.8),
        visible,
    )


def _older_colour(
    file: GltfFile, older: dict, part: str
) -> tuple[tuple[float, float, float, float], TextureInfo | None]:
    """Return the diffuse colour of the extension KHR_materials_pbrSpecularGlossiness."""
    try:
        info = TextureInfo.model_validate(older["diffuseTexture"]) if "diffuseTexture" in older else None
        r, g, b, a = (min(max(float(v), 0.0), 1.0) for v in older.get("diffuseFactor", (1.0, 1.0, 1.0, 1.0)))
    except (ValueError, TypeError):
        raise file.error(part, "has a wrong KHR_materials_pbrSpecularGlossiness") from None
    return (r, g, b, a), info


def _image_of(file: GltfFile, info: TextureInfo) -> int | None:
    if info.index >= len(file.gltf.textures):
        raise file.error("a material", f"names textures[{info.index}], which does not exist")
    texture = file.gltf.textures[info.index]
    webp = texture.extensions.get("EXT_texture_webp")
    if isinstance(webp, dict) and isinstance(webp.get("source"), int) and webp["source"] >= 0:
        return int(webp["source"])
    if texture.source is None and "KHR_texture_basisu" in texture.extensions:
        raise file.error(f"textures[{info.index}]", "needs KHR_texture_basisu, which is not read", "write it as PNG")
    return texture.source


def srgb_of(colour: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return the sRGB code / 255 of a linear colour."""
    r, g, b = (srgb(min(max(float(v), 0.0), 1.0)) for v in colour)
    return r, g, b


def _surface(name: str, metal: float, see_through: bool) -> Surface:
    words = {word.lower() for word in _WORD.findall(name)}
    words |= {word[:-1] for word in words if word.endswith("s")}
    for word, surface in _WORDS.items():
        if word in words:
            return SURFACES[surface]
    if see_through:
        return SURFACES["glass"]
    return SURFACES["metal"] if metal > 0.5 else DEFAULT_SURFACE


def _uv_transform(file: GltfFile, transform: object, part: str) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Return the function of KHR_texture_transform: uv' = offset + R(rotation) (scale uv)."""
    if not isinstance(transform, dict):
        return lambda uv: uv
    try:
        offset = np.array(transform.get("offset", (0.0, 0.0)), float)
        scale = np.array(transform.get("scale", (1.0, 1.0)), float)
        angle = float(transform.get("rotation", 0.0))
    except (TypeError, ValueError, OverflowError):
        offset, scale, angle = np.empty(0), np.empty(0), 0.0
    if offset.shape != (2,) or scale.shape != (2,) or not (np.abs([*offset, *scale, angle]) < _MAX_UV).all():
        raise file.error(part, "has a wrong KHR_texture_transform: offset and scale are two numbers, rotation is one")
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, s], [-s, c]])
    return lambda uv: (uv * scale) @ turn.T + offset


def _mean_colour(file: GltfFile, index: int) -> NDArray[np.float64]:
    """Return the mean of an image, 0..1: blue, green, red. Many materials may share one."""
    if index not in file.means:
        file.means[index] = decoded(file, index)[:, :, :3].reshape(-1, 3).mean(axis=0) / 255.0
    return file.means[index]


def decoded(file: GltfFile, index: int) -> NDArray[np.uint8]:
    """Return an image as (H, W, 3 or 4), blue first. Raises ConfigError."""
    data = file.image(index)
    part = f"images[{index}]"
    if file.gltf.images[index].name:
        part += f" ({file.gltf.images[index].name[:60]!r})"
    image = decoded_picture(data, file.budget, part)
    if image is None:
        raise file.error(part, "cannot be decoded", "it must be a whole PNG, JPEG or WebP file")
    if image.dtype == np.uint16:
        image = np.floor_divide(image, 257, out=image).astype(np.uint8)
    if image.ndim == 2:
        image = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    edge = max(image.shape[:2])
    if edge > MAX_EDGE:
        width, height = (max(1, round(n * MAX_EDGE / edge)) for n in (image.shape[1], image.shape[0]))
        image = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(image, np.uint8)


def png_of(image: NDArray[np.uint8], holes: float | None) -> tuple[bytes, bool]:
    """Return the PNG of a texture, and whether it has holes: with them, its alpha is 0 or 255."""
    if holes is not None and image.shape[2] == 4:
        alpha = np.where(image[:, :, 3] >= holes * 255.0, 255, 0).astype(np.uint8)
        if not alpha.all():
            return encoded_png(np.dstack([image[:, :, :3], alpha])), True
    return encoded_png(image[:, :, :3]), False
