"""Writes a bench to files from which the same bench can be loaded."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from hil.config.bench import Bench
from hil.config.scenes import save_scene
from hil.config.schema import BenchConfig
from hil.run_files import BENCH_NAME
from signals.documents.yaml_lines import dump_yaml, read_yaml


def resolved_data(config: BenchConfig) -> dict[str, Any]:
    """Return the content of a bench file with every setting; loading it gives an equal `BenchConfig`."""
    data = config.model_dump(mode="json", exclude={"sensors"})
    data["complete"] = True
    data["sensors"] = {
        name: {
            "kind": sensor.kind,
            **({"preset": sensor.preset} if sensor.preset is not None else {}),
            "autopilot": sensor.autopilot,
            "rate_hz": sensor.rate_hz,
            **sensor.parameters.model_dump(mode="json"),
        }
        for name, sensor in config.sensors.items()
    }
    return data


def resolved_yaml(config: BenchConfig) -> str:
    """Return the text of a bench file with every setting."""
    head = "# Complete settings of one run; no rig file is merged with them.\n"
    return head + dump_yaml(resolved_data(config))


def save_with_vehicles(bench: Bench, folder: Path) -> None:
    """Write a bench as `save_bench` does, and the benches of its vehicles."""
    scene = scene_of_vehicles(bench, save_bench(bench, folder))
    for name, vehicle in bench.vehicles.items():
        save_bench(vehicle, folder / name, scene=scene)


def scene_of_vehicles(bench: Bench, saved: Path) -> str | None:
    """Return the path of the copied scene from the folder of a vehicle; None: the bench has no scene file."""
    return f"../{read_yaml(saved).data['scene']}" if "scene" in bench.files else None


def save_bench(bench: Bench, folder: Path, *, scene: str | None = None) -> Path:
    """Write bench.yaml with every setting, and copy the files that it names into `folder`. Returns its path.

    Copied are the vehicle, the scene with its map, the mission and the plan of a script, so that the folder can be
    loaded on any machine. `scene`: path of a copy of the scene that is there already. Of a bench with several vehicles
    the file names NAME/bench.yaml for each of them, which the caller writes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    names: dict[str, Any] = {}
    if bench.vehicles:
        names |= {"vehicles": {name: f"{name}/{BENCH_NAME}" for name in bench.vehicles}, "count": None}
    if scene is not None:
        names["scene"] = scene
    elif "scene" in bench.files:
        names["scene"] = save_scene(bench.scene, bench.files["scene"], folder)
    for kind in ("vehicle", "mission"):
        if kind in bench.files:
            source = bench.files[kind]
            names[kind] = f"{kind}{source.suffix}"
            (folder / names[kind]).write_bytes(source.read_bytes())
    if "plan" in bench.files:  # a script finds its plan by name beside itself
        (folder / bench.files["plan"].name).write_bytes(bench.files["plan"].read_bytes())
    path = folder / BENCH_NAME
    text = resolved_yaml(bench.config.model_copy(update=names))
    temporary = path.with_suffix(".part")
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)
    return path
