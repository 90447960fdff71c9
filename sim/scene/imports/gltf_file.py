"""Read a glTF 2.0 file (.gltf with its buffers and images, or .glb) with checks, and give its accessors as arrays.

Sizes are checked before anything is read. Every mistake is a ConfigError that names the file and the part of it.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import struct
import urllib.parse
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pydantic
from numpy.typing import NDArray

from signals.documents.document import shown_path
from signals.errors import ConfigError, Problem
from sim.scene.budget import Budget
from sim.scene.files_below import file_below
from sim.scene.imports.gltf_schema import COMPONENT_TYPES, COMPONENTS, Accessor, Gltf

MAX_JSON_BYTES = 64_000_000
_OBJECT_BYTES, _VALUE_BYTES = 2000, 100  # of the JSON text, once it is checked
MAX_NODES = 65_000
_GLB, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942
_MAX_PROBLEMS = 8
# Extensions that change where vertices or colours are; those that only add to the look need no support.
_COMPRESSED = {
    "KHR_draco_mesh_compression": "gltf-transform copy IN.glb OUT.glb, or: Blender, export without compression",
    "EXT_meshopt_compression": "gltf-transform copy IN.glb OUT.glb",
    "KHR_meshopt_compression": "gltf-transform copy IN.glb OUT.glb",
    "KHR_texture_basisu": "gltf-transform ktxdecompress IN.glb OUT.glb",
}
_READ = frozenset({"KHR_texture_transform", "KHR_mesh_quantization", "EXT_mesh_gpu_instancing", "EXT_texture_webp"})


@dataclass(frozen=True)
class GltfFile:
    """A checked glTF file with the contents of its buffers and images."""

    source: str
    gltf: Gltf
    raw: dict[str, Any]
    buffers: tuple[bytes, ...]
    images: dict[int, bytes]  # of those that a URI names
    budget: Budget
    means: dict[int, NDArray] = field(default_factory=dict, repr=False)  # colours of images, as they are found
    _arrays: dict[int, NDArray] = field(default_factory=dict, repr=False)

    def error(self, part: str, message: str, hint: str = "") -> ConfigError:
        return ConfigError.at(self.source, f"{part} {message}" if part else message, hint)

    def key(self) -> str:
        """Return a hash of the file and of everything that it names."""
        state = hashlib.sha256(json.dumps(self.raw).encode())
        for data in (*self.buffers, *self.images.values()):
            state.update(len(data).to_bytes(8, "little"))
            state.update(data)
        return state.hexdigest()

    def view(self, index: int, part: str) -> memoryview:
        """Return the bytes of a buffer view."""
        if index >= len(self.gltf.bufferViews):
            raise self.error(part, f"names bufferViews[{index}], which does not exist")
        view = self.gltf.bufferViews[index]
        data = self.buffers[view.buffer]
        if view.byteOffset + view.byteLength > len(data):
            message = f"ends at byte {view.byteOffset + view.byteLength} of a buffer of {len(data)} bytes"
            raise self.error(f"bufferViews[{index}]", message, "the file is cut off, or its buffer is another one")
        return memoryview(data)[view.byteOffset : view.byteOffset + view.byteLength]

    def image(self, index: int) -> bytes | memoryview:
        """Return the file of an image."""
        part = f"images[{index}]"
        if index >= len(self.gltf.images):
            raise self.error("a texture", f"names {part}, which does not exist")
        if index in self.images:
            return self.images[index]
        view = self.gltf.images[index].bufferView
        if view is None:
            raise self.error(part, "has neither a URI nor a buffer view")
        return self.view(view, part)

    def array(self, index: int, part: str) -> NDArray:
        """Return an accessor as (count, components): float64 if it is real or normalized, else int64."""
        if index >= len(self.gltf.accessors):
            raise self.error(part, f"names accessors[{index}], which does not exist")
        if index not in self._arrays:
            self._arrays[index] = self._read(self.gltf.accessors[index], f"accessors[{index}]")
        return self._arrays[index]

    def _read(self, accessor: Accessor, part: str) -> NDArray:
        kind = np.dtype(COMPONENT_TYPES[accessor.componentType])
        width = COMPONENTS[accessor.type]
        if accessor.bufferView is None:
            raw: NDArray = np.zeros((accessor.count, width), kind)
        else:
            data = self.view(accessor.bufferView, part)
            stride = self.gltf.bufferViews[accessor.bufferView].byteStride or kind.itemsize * width
            raw = self._rows(data, accessor.byteOffset, accessor.count, width, kind, stride, part).copy()
        if accessor.sparse is not None:
            places, values, count = accessor.sparse.indices, accessor.sparse.values, accessor.sparse.count
            index_kind = np.dtype(COMPONENT_TYPES[places.componentType])
            at = self._rows(
                self.view(places.bufferView, part), places.byteOffset, count, 1, index_kind, index_kind.itemsize, part
            )[:, 0].astype(np.int64)
            if int(at.max()) >= accessor.count:
                raise self.error(part, f"replaces value {int(at.max())} of {accessor.count}")
            raw[at] = self._rows(
                self.view(values.bufferView, part), values.byteOffset, count, width, kind, kind.itemsize * width, part
            )
        if kind.kind == "f":
            return raw.astype(np.float64)
        if accessor.normalized:
            return np.maximum(raw.astype(np.float64) / float(np.iinfo(kind).max), -1.0)
        return raw.astype(np.int64)

    def _rows(
        self, data: memoryview, offset: int, count: int, width: int, kind: np.dtype, stride: int, part: str
    ) -> NDArray:
        row = kind.itemsize * width
        end = offset + (count - 1) * stride + row
        if stride < row or end > len(data):
            message = f"needs {end} bytes of a buffer view of {len(data)}"
            raise self.error(part, message, "the file is cut off, or was written wrongly")
        return np.ndarray((count, width), kind, data, offset, (stride, kind.itemsize))

    def packed(self) -> bytes:
        """Return the file with all its buffers and images as one GLB."""
        raw = json.loads(json.dumps(self.raw))
        body, starts = bytearray(), []
        for data in self.buffers:
            starts.append(len(body))
            body += data + b"\0" * (-len(data) % 4)
        for view, checked in zip(raw.get("bufferViews", []), self.gltf.bufferViews, strict=True):
            view |= {"buffer": 0, "byteOffset": checked.byteOffset + starts[checked.buffer]}
        for index, data in self.images.items():
            image = raw["images"][index]
            image.pop("uri")
            image["bufferView"] = len(raw.setdefault("bufferViews", []))
            image.setdefault("mimeType", _mime_type(data))
            raw["bufferViews"].append({"buffer": 0, "byteOffset": len(body), "byteLength": len(data)})
            body += data + b"\0" * (-len(data) % 4)
        if body:
            raw["buffers"] = [{"byteLength": len(body)}]
        text = json.dumps(raw).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), _JSON) + text
        if body:
            chunks += struct.pack("<II", len(body), _BIN) + bytes(body)
        return struct.pack("<III", _GLB, 2, 12 + len(chunks)) + chunks


def _mime_type(image: bytes) -> str:
    if image[:4] == b"\x89PNG":
        return "image/png"
    return "image/webp" if image[:4] == b"RIFF" and image[8:12] == b"WEBP" else "image/jpeg"


def read_gltf(path: Path, budget: Budget | None = None) -> GltfFile:
    """Read and check a .gltf or .glb file. Raises ConfigError with what is wrong, and where."""
    return _Reader(path, budget or Budget(shown_path(path))).read()


class _Reader:
    def __init__(self, path: Path, budget: Budget) -> None:
        self._path, self._budget = path, budget
        self._source = shown_path(path)

    def _error(self, message: str, hint: str = "", *, line: int = 0) -> ConfigError:
        return ConfigError.at(f"{self._source}:{line}" if line else self._source, message, hint)

    def read(self) -> GltfFile:
        data = self._file(self._path, "")
        if not data:
            raise self._error("is empty", "a glTF file is JSON text (.gltf) or begins with 'glTF' (.glb)")
        binary = None
        if data[:4] == b"glTF":
            text, binary = self._chunks(data)
        else:
            text = data
        raw = self._json(text)
        gltf = self._checked(raw)
        self._check_extensions(gltf)
        buffers = tuple(self._buffer(gltf, i, binary) for i in range(len(gltf.buffers)))
        images = {}
        for i, image in enumerate(gltf.images):
            if image.uri is not None:
                images[i] = self._uri(image.uri, f"images[{i}]")
        file = GltfFile(self._source, gltf, raw, buffers, images, self._budget)
        self._check_sizes(file)
        return file

    def _file(self, path: Path, part: str) -> bytes:
        name = "" if not part else f"{part} names a file that "
        try:
            if not path.is_file():
                if not part:
                    raise self._error("is not a file")
                message = f"{name}does not exist: {shown_path(path)}"
                raise self._error(message, "put it there: a .gltf needs its buffers and images; a .glb holds them")
            self._budget.memory(path.stat().st_size, part or "the file itself")
            return path.read_bytes()
        except (OSError, ValueError) as error:
            raise self._error(f"{name or 'it '}cannot be read: {error}") from None

    def _chunks(self, data: bytes) -> tuple[bytes, bytes | None]:
        if len(data) < 20:
            raise self._error(f"is cut off: a GLB file has at least 20 bytes, not {len(data)}")
        _, version, length = struct.unpack_from("<III", data)
        if version != 2:
            raise self._error(f"is glTF {version}; version 2 is read", "export it as glTF 2.0")
        if length != len(data):
            raise self._error(f"is cut off: its header says {length} bytes, but it has {len(data)}")
        text, binary, at = None, None, 12
        while at + 8 <= length:
            size, kind = struct.unpack_from("<II", data, at)
            if at + 8 + size > length:
                raise self._error(f"is cut off: the chunk at byte {at} has {size} bytes")
            chunk = data[at + 8 : at + 8 + size]
            if kind == _JSON and text is None:
                text = chunk
            elif kind == _BIN and binary is None:
                binary = chunk
            at += 8 + size
        if text is None:
            raise self._error("has no JSON chunk")
        return text, binary

    def _json(self, text: bytes) -> dict[str, Any]:
        if len(text) > MAX_JSON_BYTES:
            message = f"has more than {MAX_JSON_BYTES / 1e6:g} MB of JSON"
            raise self._error(message, "keep vertices in a buffer file or as GLB, not as data: URIs")
        objects, values = text.count(b"{") + text.count(b"["), text.count(b",")
        self._budget.memory(_OBJECT_BYTES * objects + _VALUE_BYTES * values, "its JSON")

        def no_constant(name: str) -> None:
            raise ValueError(f"{name} is not a number of JSON")

        try:
            raw = json.loads(text.decode("utf-8-sig"), parse_constant=no_constant)
        except json.JSONDecodeError as error:
            raise self._error(f"is not valid JSON: {error.msg}", line=error.lineno) from None
        except (ValueError, RecursionError) as error:
            raise self._error(f"is not valid JSON: {error}") from None
        if not isinstance(raw, dict):
            raise self._error("is JSON but not glTF: it is not an object with the key 'asset'")
        return raw

    def _checked(self, raw: dict[str, Any]) -> Gltf:
        if "asset" not in raw:
            raise self._error("is JSON but not glTF: it has no key 'asset'")
        nodes = raw.get("nodes")
        if isinstance(nodes, list) and len(nodes) > MAX_NODES:
            raise self._error(f"has {len(nodes)} nodes; {MAX_NODES} are allowed", "join them")
        try:
            gltf = Gltf.model_validate(raw)
        except pydantic.ValidationError as error:
            problems = []
            for item in error.errors()[:_MAX_PROBLEMS]:
                place = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in item["loc"]).lstrip(".")
                problems.append(Problem(self._source, f"{place}: {item['msg'][:1].lower()}{item['msg'][1:]}"))
            raise ConfigError(problems) from None
        if not gltf.asset.version.startswith("2."):
            raise self._error(f"is glTF {gltf.asset.version[:20]}; version 2.0 is read", "export it as glTF 2.0")
        return gltf

    def _check_extensions(self, gltf: Gltf) -> None:
        for name in gltf.extensionsRequired:
            if name in _COMPRESSED:
                raise self._error(
                    f"needs {name}, which is not read", f"write it without compression: {_COMPRESSED[name]}"
                )
            if name not in _READ and not name.startswith(("KHR_materials_", "KHR_lights_")):
                raise self._error(f"needs the extension {name[:60]}, which is not read")

    def _buffer(self, gltf: Gltf, index: int, binary: bytes | None) -> bytes:
        part, buffer = f"buffers[{index}]", gltf.buffers[index]
        if buffer.uri is not None:
            data = self._uri(buffer.uri, part)
        elif index == 0 and binary is not None:
            data = binary
        elif "EXT_meshopt_compression" in buffer.extensions:
            return b""  # a placeholder for readers that decompress
        else:
            raise self._error(f"{part} has no URI, and the file has no binary chunk")
        if len(data) < buffer.byteLength:
            message = f"{part} has {len(data)} bytes instead of {buffer.byteLength}"
            raise self._error(message, "the file is cut off, or its buffer is another one")
        return data

    def _uri(self, uri: str, part: str) -> bytes:
        if uri.startswith("data:"):
            head, _, body = uri.partition(",")
            self._budget.memory(len(body), part)
            try:
                if head.endswith(";base64"):
                    return base64.b64decode(body, validate=True)
                return urllib.parse.unquote_to_bytes(body)
            except (binascii.Error, ValueError) as error:
                raise self._error(f"{part} has a data: URI that cannot be decoded: {error}") from None
        folder = self._path.parent
        try:
            path = file_below(folder, folder, urllib.parse.unquote(uri))
        except ValueError as error:
            hint = f"copy it to {shown_path(folder)}, and name it without a path"
            raise self._error(f"{part} {error}", hint) from None
        return self._file(path, part)

    def _check_sizes(self, file: GltfFile) -> None:
        gltf = file.gltf
        for i, view in enumerate(gltf.bufferViews):
            if view.buffer >= len(gltf.buffers):
                raise self._error(f"bufferViews[{i}] names buffers[{view.buffer}], which does not exist")
        needed = 0
        for accessor in gltf.accessors:
            stored_bytes = np.dtype(COMPONENT_TYPES[accessor.componentType]).itemsize
            needed += accessor.count * COMPONENTS[accessor.type] * (stored_bytes + 8)
        self._budget.memory(needed, f"the values of accessors[0] to accessors[{len(gltf.accessors) - 1}]")
