"""Hash of the source files that make a flight, without importing them."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

_PACKAGES = ("signals", "sim", "firmware_bridge", "hil.config", "hil.run", "rigs")  # what a flight is made of
_CODE = (".py", ".onnx")  # settings in YAML files are in the resolved bench


@cache
def source_digest() -> str:
    """Return a hash of the version and of the source files that make a flight, the same for every build of them."""
    digest = hashlib.blake2b(_installed_version().encode(), digest_size=16)
    for package in _PACKAGES:
        spec = find_spec(package)
        for folder in map(Path, (spec.submodule_search_locations or ()) if spec is not None else ()):
            for path in sorted(folder.rglob("*")):
                if path.suffix in _CODE and path.is_file():
                    digest.update(f"{path.relative_to(folder).as_posix()}\0".encode())
                    digest.update(hashlib.blake2b(path.read_bytes(), digest_size=16).digest())
    return digest.hexdigest()


def _installed_version() -> str:
    try:
        return version("hil-bench")
    except PackageNotFoundError:
        return "unknown"
