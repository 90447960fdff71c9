"""dataset.json: what the data set is made from, and, once it is finished, what is in it.

The part `made_from` is there from the beginning: an attempt that goes on with another's files must be of the same.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from hil.config import save_bench
from hil.dataset.formats.datasheet import LICENCE
from hil.dataset.plan import BATCH_FRAMES, EPOCH_NS, DatasetPlan
from hil.dataset.tree import MANIFEST, WORK, TreeWriter
from hil.signals.documents.yaml_lines import parse_yaml
from hil.signals.errors import ConfigError, Problem, RecordingError

FORMAT = 2
BENCH_NAME = "bench.yaml"
_MAY_DIFFER = frozenset({"frames"})  # more of them than before
_SHOWN = 5


def made_from(plan: DatasetPlan, bench_files: Mapping[str, bytes]) -> dict[str, Any]:
    """What decides every byte. `bench_files`: the saved bench, by name."""
    digest = hashlib.sha256()
    for name in sorted(bench_files):
        digest.update(name.encode() + b"\0" + hashlib.sha256(bench_files[name]).digest())
    return {
        "config_sha256": digest.hexdigest(),
        "seed": plan.config.seed,
        "scene": plan.bench.scene.name,
        "quality": plan.quality,
        "frames": plan.frames,
        "batch_frames": BATCH_FRAMES,
        "epoch_ns": EPOCH_NS,
        "format": FORMAT,
        "versions": {"hil": _version("hil-bench"), **{name: _version(name) for name in ("isal", "numpy", "zstandard")}},
    }


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "unknown"


def write_manifest(tree: TreeWriter, values: Mapping[str, Any]) -> None:
    tree.write(MANIFEST, (json.dumps(values, indent=2) + "\n").encode())


def first_manifest(made: Mapping[str, Any]) -> dict[str, Any]:
    """Of a data set that is only begun."""
    return {"complete": False, "made_from": dict(made), "licence": LICENCE}


def saved_bench(plan: DatasetPlan) -> dict[str, bytes]:
    """The bench as files, by name. RecordingError."""
    with tempfile.TemporaryDirectory(prefix="hil-dataset-") as name:
        folder = Path(name)
        try:
            save_bench(plan.bench, folder)
            paths = sorted(path for path in folder.rglob("*") if path.is_file())
            return {str(path.relative_to(folder)): path.read_bytes() for path in paths}
        except OSError as error:
            raise RecordingError(f"{folder}: the bench cannot be saved here ({error.strerror or error})") from error


def check_resumable(root: Path, made: Mapping[str, Any], bench_files: Mapping[str, bytes]) -> None:
    """Fine where `root` holds an attempt at the same data set, or nothing was begun. ConfigError: what differs."""
    if all(entry.name == WORK for entry in root.iterdir()):
        return
    path = root / MANIFEST
    try:
        before = json.loads(path.read_text())["made_from"]
        assert isinstance(before, dict)
    except FileNotFoundError:
        hint = "give the folder of an earlier `hil dataset`, or leave out --resume and choose an empty one"
        raise ConfigError([Problem(str(root), f"holds no data set: there is no {MANIFEST} in it", hint)]) from None
    except (OSError, ValueError, KeyError, AssertionError):
        raise ConfigError([Problem(str(path), "cannot be read as what `hil dataset` writes", "begin anew")]) from None
    problems = []
    for key, value in made.items():
        if key in ("config_sha256", *_MAY_DIFFER) or before.get(key) == value:
            continue
        problems.append(Problem(str(path), f"was made with another {key}: {before.get(key)!r}, now {value!r}"))
    if before.get("config_sha256") != made["config_sha256"]:
        problems += [Problem(str(root), text) for text in _differences(root, bench_files)]
    if int(before.get("frames", 0)) > made["frames"]:
        hint = f"--frames {before['frames']} or more"
        problems.append(Problem(str(path), f"is of {before['frames']} frames, now {made['frames']} are wanted", hint))
    if problems:
        raise ConfigError(problems)


def _differences(root: Path, bench_files: Mapping[str, bytes]) -> list[str]:
    found = []
    for name, data in bench_files.items():
        try:
            old = (root / name).read_bytes()
        except OSError:
            found.append(f"has no {name}, which the bench has now")
            continue
        if old == data:
            continue
        if name != BENCH_NAME:
            found.append(f"was made with another {name}")
            continue
        keys = _different_keys(_plain(old), _plain(data))
        found += [f"was made with another {key}" for key in keys[:_SHOWN]]
        if len(keys) > _SHOWN:
            found.append(f"and {len(keys) - _SHOWN} more keys of the bench differ")
    return found or ["was made with another bench"]


def _plain(data: bytes) -> Any:
    try:
        return parse_yaml(data.decode(), BENCH_NAME).data
    except (ConfigError, UnicodeError):
        return None


def _different_keys(old: Any, new: Any, place: str = "") -> list[str]:
    if isinstance(old, dict) and isinstance(new, dict):
        keys = list(dict.fromkeys([*old, *new]))
        return [d for key in keys for d in _different_keys(old.get(key), new.get(key), f"{place}.{key}".lstrip("."))]
    return [] if old == new else [f"{place} ({_short(old)}, now {_short(new)})"]


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def refuse_full(root: Path) -> None:
    """ConfigError where a new data set has no empty folder."""
    try:
        if root.exists() and (not root.is_dir() or any(os.scandir(root))):
            hint = "choose another --out, or go on with what is there: --resume"
            raise ConfigError([Problem(f"--out {root}", "is not an empty folder", hint)])
    except OSError as error:
        raise ConfigError([Problem(f"--out {root}", f"cannot be looked into ({error.strerror or error})")]) from None
