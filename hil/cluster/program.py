"""The program that makes a result, as a hash of its source files and the versions of libraries; imports neither."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

_PACKAGES = ("signals", "sim", "firmware_bridge", "hil.config", "hil.run", "rigs")  # what a flight is made of
_CODE = (".py", ".onnx")  # settings in YAML files are in the resolved bench


class OtherProgram(Exception):
    """A node has another program than this machine; the text names the difference."""


@dataclass(frozen=True)
class Program:
    """A program that nodes must have too. `packages`: those that it needs besides the ones of a flight."""

    sources: str  # hash of the source files
    packages: tuple[str, ...] = ()
    libraries: Mapping[str, str] = field(default_factory=dict)  # versions by name

    @classmethod
    def here(cls, *, packages: tuple[str, ...] = (), libraries: tuple[str, ...] = ()) -> Program:
        """Return the program of this machine; `libraries`: those whose versions change the bytes of a result."""
        return cls(source_digest(*packages), packages, {name: installed_version(name) for name in libraries})

    def require(self) -> None:
        """Compare this program with that of this machine. Raises OtherProgram."""
        if source_digest(*self.packages) != self.sources:
            raise OtherProgram("another version of hil-bench")
        for name, wanted in self.libraries.items():
            if installed_version(name) != wanted:
                raise OtherProgram(f"{name} {installed_version(name)}, not {wanted}")


@cache
def source_digest(*packages: str) -> str:
    """Return a hash of the version and of the source files that make a flight, the same for every build of them.

    `packages`: others that are hashed too.
    """
    digest = hashlib.blake2b(installed_version("hil-bench").encode(), digest_size=16)
    for package in (*_PACKAGES, *packages):
        spec = find_spec(package)
        for folder in map(Path, (spec.submodule_search_locations or ()) if spec is not None else ()):
            for path in sorted(folder.rglob("*")):
                if path.suffix in _CODE and path.is_file():
                    digest.update(f"{path.relative_to(folder).as_posix()}\0".encode())
                    digest.update(hashlib.blake2b(path.read_bytes(), digest_size=16).digest())
    return digest.hexdigest()


def installed_version(package: str) -> str:
    """Return the version of an installed package, or "unknown"."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"
