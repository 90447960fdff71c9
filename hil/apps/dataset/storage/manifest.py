"""Manifest of a data set, dataset.json: its provenance and, once it is complete, its contents.

The section `made_from` is written before the first frame, so that an attempt to resume can compare it.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hil.apps.dataset.formats.datasheet import LICENCE
from hil.apps.dataset.plan import BATCH_FRAMES, EPOCH_NS, DatasetPlan
from hil.apps.dataset.storage.tree import WORK, TreeWriter
from hil.cluster.program import installed_version
from hil.config.saved import save_with_vehicles
from hil.data_set_files import MANIFEST
from hil.run_files import BENCH_NAME
from signals.documents.yaml_lines import parse_yaml
from signals.errors import ConfigError, Problem, file_errors

FORMAT = 4
LIBRARIES = ("isal", "numpy", "zstandard")  # whose versions change the bytes
_MAY_DIFFER = frozenset({"frames"})  # a resumed data set may have more frames
_MAX_KEYS_SHOWN = 5
_REMEDY = "continue it with the files and options it was made with, or name another folder with --out"


def provenance(plan: DatasetPlan, bench_files: Mapping[str, bytes]) -> dict[str, Any]:
    """Return everything that determines the bytes of the data set; `bench_files` is the saved bench, by file name."""
    digest = hashlib.sha256()
    for name in sorted(bench_files):
        digest.update(name.encode() + b"\0" + hashlib.sha256(bench_files[name]).digest())
    return {
        "config_sha256": digest.hexdigest(),
        "seed": plan.config.seed,
        "scene": plan.bench.scene.name,
        **({"vehicle": plan.vehicle} if plan.vehicle else {}),
        "quality": plan.quality,
        "frames": plan.frames,
        "batch_frames": BATCH_FRAMES,
        "epoch_ns": EPOCH_NS,
        "format": FORMAT,
        "versions": {"hil": installed_version("hil-bench"), **{name: installed_version(name) for name in LIBRARIES}},
    }


def write_manifest(tree: TreeWriter, values: Mapping[str, Any]) -> None:
    """Write `values` as dataset.json. Raises RecordingError."""
    tree.write(MANIFEST, (json.dumps(values, indent=2) + "\n").encode())


def initial_manifest(made_from: Mapping[str, Any]) -> dict[str, Any]:
    """Return the manifest of an incomplete data set."""
    return {"complete": False, "made_from": dict(made_from), "licence": LICENCE}


def saved_bench(plan: DatasetPlan) -> dict[str, bytes]:
    """Return the bench as files, by name. Raises RecordingError if no temporary folder can be written."""
    with tempfile.TemporaryDirectory(prefix="hil-dataset-") as name:
        folder = Path(name)
        with file_errors(folder, "the bench cannot be saved here"):
            save_with_vehicles(plan.group or plan.bench, folder)
            paths = sorted(path for path in folder.rglob("*") if path.is_file())
            return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


def check_resumable(root: Path, made_from: Mapping[str, Any], bench_files: Mapping[str, bytes]) -> None:
    """Check that `root` is unused or holds an attempt at the same data set. Raises ConfigError with all differences."""
    if all(entry.name == WORK for entry in root.iterdir()):
        return
    path = root / MANIFEST
    try:
        earlier = json.loads(path.read_text())["made_from"]
        assert isinstance(earlier, dict)
    except FileNotFoundError:
        hint = "give the folder of an earlier `hil dataset`, or leave out --resume and choose an empty one"
        raise ConfigError.at(str(root), f"holds no data set: there is no {MANIFEST} in it", hint) from None
    except (OSError, ValueError, KeyError, AssertionError):
        hint = "make the data set again in another folder"
        raise ConfigError.at(str(path), "is not a manifest of `hil dataset`", hint) from None
    problems = []
    for key, value in made_from.items():
        if key in ("config_sha256", *_MAY_DIFFER) or earlier.get(key) == value:
            continue
        text = f"was made with another {key}: {earlier.get(key)!r}, now {value!r}"
        problems.append(Problem(str(path), text, _REMEDY))
    if earlier.get("config_sha256") != made_from["config_sha256"]:
        problems += [Problem(str(root), text, _REMEDY) for text in _differences(root, bench_files)]
    if int(earlier.get("frames", 0)) > made_from["frames"]:
        hint = f"give --frames {earlier['frames']} or more"
        message = f"has {earlier['frames']} frames, more than the {made_from['frames']} wanted now"
        problems.append(Problem(str(path), message, hint))
    if problems:
        raise ConfigError(problems)


def _differences(root: Path, bench_files: Mapping[str, bytes]) -> list[str]:
    texts = []
    for name, data in bench_files.items():
        try:
            old = (root / name).read_bytes()
        except OSError:
            texts.append(f"has no {name}, which the bench has now")
            continue
        if old == data:
            continue
        folder, _, file_name = name.rpartition("/")
        if file_name != BENCH_NAME:
            texts.append(f"was made with another {name}")
            continue
        keys = _different_keys(_parsed(old), _parsed(data), folder)
        texts += [f"was made with another {key}" for key in keys[:_MAX_KEYS_SHOWN]]
        if len(keys) > _MAX_KEYS_SHOWN:
            texts.append(f"and {len(keys) - _MAX_KEYS_SHOWN} more keys of the bench differ")
    return texts or ["was made with another bench"]


def _parsed(data: bytes) -> Any:
    try:
        return parse_yaml(data.decode(), BENCH_NAME).data
    except (ConfigError, UnicodeError):
        return None


def _different_keys(old: Any, new: Any, path: str = "") -> list[str]:
    if isinstance(old, dict) and isinstance(new, dict):
        keys = list(dict.fromkeys([*old, *new]))
        return [d for key in keys for d in _different_keys(old.get(key), new.get(key), f"{path}.{key}".lstrip("."))]
    return [] if old == new else [f"{path} ({_short(old)}, now {_short(new)})"]


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def require_empty(root: Path) -> None:
    """Raise ConfigError if `root` exists and is not an empty folder."""
    try:
        if root.exists() and (not root.is_dir() or any(os.scandir(root))):
            hint = "choose another --out, or continue the data set in it with --resume"
            raise ConfigError.at(f"--out {root}", "is not an empty folder", hint)
    except OSError as error:
        raise ConfigError.at(f"--out {root}", f"cannot be listed ({error.strerror or error})") from None
