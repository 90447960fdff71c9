"""Packs jobs for nodes, and unpacks the recordings that come back."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from hil.apps.campaign.engines.parcel import TREES, Parcel
from hil.apps.campaign.flight import Job
from hil.cluster.trees import packed, tree_name, unpack
from hil.config import Bench
from hil.config.saved import save_bench
from hil.config.scenes import save_scene
from hil.run_files import BENCH_NAME
from signals.errors import RecordingError, file_errors

_PX4_DATA = ("../etc", "etc", "../share/px4/etc")  # places of PX4's start scripts beside its binary
_KEPT = ". Everything stored so far is kept; continue with --resume"


class Packer:
    """Makes parcels. `archives` holds each tree once."""

    def __init__(self) -> None:
        self.archives: dict[str, bytes] = {}
        self._scenes: dict[tuple[Path, int], str] = {}
        self._firmware: dict[tuple[Path, int], str] = {}
        self._sources: dict[str, str] = {}  # firmware's path by its place in a tree

    def pack(self, job: Job, bench: Bench) -> Parcel:
        """Return the parcel of a job. Raises RecordingError."""
        try:
            with tempfile.TemporaryDirectory(prefix="hil-campaign-") as name:
                folder, trees = Path(name), set[str]()
                self._save(bench, folder, trees)
                files = {
                    path.relative_to(folder).as_posix(): path.read_bytes()
                    for path in sorted(folder.rglob("*"))
                    if path.is_file()
                }
        except OSError as error:
            raise RecordingError(f"{error.filename}: a bench cannot be packed for a node ({error.strerror})") from error
        return Parcel(replace(job, bench=None, texts=(), folder=""), files, tuple(sorted(trees)))

    def unpack_recording(self, recording: bytes, folder: Path) -> None:
        """Write the recording of a flight into `folder`, in place of an earlier one. Raises RecordingError."""
        with file_errors(folder, "a recording cannot be written", hint=_KEPT):
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            unpack(recording, folder)
            for path in folder.rglob(BENCH_NAME):
                text = path.read_text(encoding="utf-8")
                for place, source in self._sources.items():
                    text = text.replace(place, source)
                path.write_text(text, encoding="utf-8")

    def _save(self, bench: Bench, folder: Path, trees: set[str]) -> None:
        scene = None
        if "scene" in bench.files:
            tree, name = self._scene(bench).split("/")
            trees.add(tree)
            scene = f"{TREES}/{tree}/{name}"
        autopilot = bench.config.autopilot
        binary = None if autopilot.binary is None else Path(autopilot.binary).expanduser().resolve()
        if binary is not None and binary.is_file():
            place = self._firmware_place(binary)
            trees.add(place.split("/")[0])
            named = autopilot.model_copy(update={"binary": f"{TREES}/{place}"})
            bench = replace(bench, config=bench.config.model_copy(update={"autopilot": named}))
        save_bench(bench, folder, scene=scene)
        for name, vehicle in bench.vehicles.items():
            self._save(vehicle, folder / name, trees)

    def _scene(self, bench: Bench) -> str:
        """Return the place of a scene: its tree and the name of the file in it."""
        path = bench.files["scene"]
        key = path, path.stat().st_mtime_ns
        if key not in self._scenes:
            with tempfile.TemporaryDirectory(prefix="hil-campaign-") as folder:
                name = save_scene(bench.scene, path, Path(folder))
                self._scenes[key] = f"{self._add((file, file.name) for file in Path(folder).iterdir())}/{name}"
        return self._scenes[key]

    def _firmware_place(self, binary: Path) -> str:
        """Return the place of a program: its tree and the name in it. PX4's start scripts and commands go with it."""
        key = binary, binary.stat().st_mtime_ns
        if key not in self._firmware:
            folders = [binary.parent / place for place in _PX4_DATA]
            data = [folder for folder in folders if (folder / "init.d-posix" / "rcS").is_file()][:1]
            programs = sorted(binary.parent.glob(f"{binary.name}*")) if data else [binary]
            entries = [(file, f"bin/{file.name}") for file in programs] + [(folder, "etc") for folder in data]
            self._firmware[key] = f"{self._add(entries)}/bin/{binary.name}"
            self._sources[f"{TREES}/{self._firmware[key]}"] = str(binary)
        return self._firmware[key]

    def _add(self, entries: Iterable[tuple[Path, str]]) -> str:
        archive = packed(entries)
        name = tree_name(archive)
        self.archives[name] = archive
        return name
