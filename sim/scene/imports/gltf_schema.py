"""The parts of a glTF 2.0 file that the bench reads, as models that check types and ranges.

Khronos Group, glTF 2.0 Specification (ISO/IEC 12113). Unknown keys are ignored.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

Index = Annotated[int, Field(ge=0)]
Share = Annotated[FiniteFloat, Field(ge=0.0, le=1.0)]
Numbers3 = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
Numbers4 = tuple[FiniteFloat, FiniteFloat, FiniteFloat, FiniteFloat]
Matrix4 = Annotated[tuple[FiniteFloat, ...], Field(min_length=16, max_length=16)]
COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
COMPONENT_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)

    name: str = ""
    extensions: dict[str, Any] = Field(default_factory=dict)


class Buffer(_Part):
    uri: str | None = None
    byteLength: Annotated[int, Field(ge=1)]


class BufferView(_Part):
    buffer: Index
    byteOffset: Index = 0
    byteLength: Annotated[int, Field(ge=1)]
    byteStride: Annotated[int, Field(ge=4, le=252)] | None = None


class SparseIndices(_Part):
    bufferView: Index
    byteOffset: Index = 0
    componentType: Literal[5121, 5123, 5125]


class SparseValues(_Part):
    bufferView: Index
    byteOffset: Index = 0


class Sparse(_Part):
    count: Annotated[int, Field(ge=1)]
    indices: SparseIndices
    values: SparseValues


class Accessor(_Part):
    bufferView: Index | None = None
    byteOffset: Index = 0
    componentType: Literal[5120, 5121, 5122, 5123, 5125, 5126]
    normalized: bool = False
    count: Annotated[int, Field(ge=1)]
    type: Literal["SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"]
    sparse: Sparse | None = None


class Image(_Part):
    uri: str | None = None
    bufferView: Index | None = None


class Texture(_Part):
    source: Index | None = None


class TextureInfo(_Part):
    index: Index
    texCoord: Index = 0


class Metallic(_Part):
    baseColorFactor: tuple[Share, Share, Share, Share] = (1.0, 1.0, 1.0, 1.0)
    baseColorTexture: TextureInfo | None = None
    metallicFactor: Share = 1.0
    roughnessFactor: Share = 1.0
    metallicRoughnessTexture: TextureInfo | None = None


class Material(_Part):
    pbrMetallicRoughness: Metallic = Metallic()
    alphaMode: Literal["OPAQUE", "MASK", "BLEND"] = "OPAQUE"
    alphaCutoff: Annotated[FiniteFloat, Field(ge=0.0)] = 0.5


class Primitive(_Part):
    attributes: dict[str, Index]
    indices: Index | None = None
    material: Index | None = None
    mode: Annotated[int, Field(ge=0, le=6)] = 4


class Mesh(_Part):
    primitives: Annotated[list[Primitive], Field(min_length=1)]


class Node(_Part):
    mesh: Index | None = None
    children: list[Index] = Field(default_factory=list)
    matrix: Matrix4 | None = None
    translation: Numbers3 = (0.0, 0.0, 0.0)
    rotation: Numbers4 = (0.0, 0.0, 0.0, 1.0)
    scale: Numbers3 = (1.0, 1.0, 1.0)
    skin: Index | None = None


class SceneNodes(_Part):
    nodes: list[Index] = Field(default_factory=list)


class Asset(_Part):
    version: str


class Gltf(_Part):
    """Root of the file."""

    asset: Asset
    extensionsRequired: list[str] = Field(default_factory=list)
    scene: Index | None = None
    scenes: list[SceneNodes] = Field(default_factory=list)
    nodes: list[Node] = Field(default_factory=list)
    meshes: list[Mesh] = Field(default_factory=list)
    accessors: list[Accessor] = Field(default_factory=list)
    bufferViews: list[BufferView] = Field(default_factory=list)
    buffers: list[Buffer] = Field(default_factory=list)
    materials: list[Material] = Field(default_factory=list)
    textures: list[Texture] = Field(default_factory=list)
    images: list[Image] = Field(default_factory=list)
