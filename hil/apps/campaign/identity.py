"""Identity of a case: a hash of the program, the resolved bench, the files that it names, and the firmware.

Two flights with the same identity have the same conditions, so one result serves both. Files are the bench's own, those
that a text of it names, such as weights in `companion.settings`, and the Python files of clients that it starts. A text
names a file if it looks like a path: `low` is a setting, whatever lies in the current folder. Left out is what changes
no flight: recordings, who follows it, pace, the number of a simulated autopilot's instance, and where files lie.
"""

from __future__ import annotations

import hashlib
import json
import os
import stat
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import signals._kernel
import sim._kernels
from hil.cluster.program import source_digest
from hil.config import Bench
from hil.config.companion.clients import source_files
from hil.config.saved import resolved_data
from hil.config.scenes import save_scene
from hil.config.schema import Foxglove, Record, Ros2
from signals.documents.document import Place

_KERNELS = (signals._kernel, sim._kernels)
_ID_BYTES = 10
_FILES: tuple[Place, ...] = (("autopilot", "binary"), ("companion", "trace"))  # paths, whatever they look like


@cache
def program_digest() -> str:
    """Return a hash of the version, and of the source files and native kernels that make a flight."""
    digest = hashlib.blake2b(source_digest().encode(), digest_size=16)
    for kernel in _KERNELS:
        digest.update(hashlib.blake2b(Path(str(kernel.__file__)).read_bytes(), digest_size=16).digest())
    return digest.hexdigest()


def case_id(bench: Bench) -> str:
    """Return the identity of a flight of `bench`, 20 hexadecimal digits. Raises ConfigError."""
    digest = hashlib.blake2b(program_digest().encode(), digest_size=_ID_BYTES)
    _add(digest, bench)
    return digest.hexdigest()


def _add(digest: hashlib.blake2b, bench: Bench) -> None:
    config = bench.config
    autopilot = config.autopilot.model_copy(update={"instance": 0})
    names = {kind: _content(str(path)) for kind, path in bench.files.items() if kind in ("vehicle", "mission")}
    if "scene" in bench.files:
        path = bench.files["scene"]
        names["scene"] = _scene_content(bench, path)
    same: dict[str, Any] = {"autopilot": autopilot, "record": Record(), "pace": None, "vehicles": {}, **names}
    same |= {"foxglove": Foxglove(), "ros2": config.ros2 if config.ros2.flies else Ros2()}
    digest.update(json.dumps(_with_contents(resolved_data(config.model_copy(update=same)))).encode())
    for client in config.companion.start:
        for name, path in source_files(client.name):
            digest.update(f"\0{name}\0{_content(str(path))}".encode())
    if "plan" in bench.files:
        digest.update(_content(str(bench.files["plan"])).encode())
    for name, vehicle in bench.vehicles.items():
        digest.update(f"\0{name}\0".encode())
        _add(digest, vehicle)


def _with_contents(data: Any, place: Place = ()) -> Any:
    """Return settings with a hash of its content in place of every file that a text names."""
    if isinstance(data, dict):
        return {key: _with_contents(value, (*place, key)) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_with_contents(value, (*place, index)) for index, value in enumerate(data)]
    is_path = isinstance(data, str) and (place in _FILES or "/" in data or Path(data).suffix)
    return _content(data) if is_path else data


def _content(path: str) -> str:
    """Return a hash of a file's content; the text itself if there is no such file."""
    file = Path(os.path.expanduser(path))
    try:
        state = file.stat()
        return _hash_of(file, state.st_mtime_ns, state.st_size) if stat.S_ISREG(state.st_mode) else path
    except (OSError, ValueError):
        return path


@cache
def _hash_of(path: Path, mtime_ns: int, size: int) -> str:  # noqa: ARG001 (a changed file is read again)
    with path.open("rb") as file:
        return hashlib.file_digest(file, "blake2b").hexdigest()[:32]


_scenes: dict[tuple[Path, int], str] = {}


def _scene_content(bench: Bench, path: Path) -> str:
    """Return a hash of a scene and the files of its map."""
    key = (path, path.stat().st_mtime_ns)
    if key not in _scenes:
        digest = hashlib.blake2b(digest_size=16)
        with tempfile.TemporaryDirectory() as folder:
            save_scene(bench.scene, path, Path(folder))
            for file in sorted(Path(folder).rglob("*")):
                if file.is_file():
                    digest.update(file.relative_to(folder).as_posix().encode() + b"\0" + file.read_bytes())
        _scenes[key] = digest.hexdigest()
    return _scenes[key]
