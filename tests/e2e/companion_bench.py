"""Short flights with companions: a hop of a few metres by the mock, and what a run leaves behind on the machine."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hil.bench import RunResult, run_bench
from hil.config import load_bench

ROOT = Path(__file__).resolve().parents[2]
RECTANGLE = ROOT / "rigs" / "missions" / "rectangle.plan"
# Up to 3 m, 5 m to the north, and down.
HOP = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t47.39774200\t8.54559400\t488.0\t1
1\t0\t3\t22\t0\t0\t0\t0\t47.39774200\t8.54559400\t3.0\t1
2\t0\t3\t16\t0\t0\t0\t0\t47.39778700\t8.54559400\t3.0\t1
3\t0\t3\t21\t0\t0\t0\t0\t47.39778700\t8.54559400\t0.0\t1
"""
CAMERAS = """sensors:
  imu: {preset: icm20689}
  gps: {preset: here_plus, rate_hz: 10}
  baro: {preset: ms5611, rate_hz: 50}
  mag: {preset: ist8310, rate_hz: 50}
  front: {kind: camera, resolution: [32, 24], fov_deg: 90, rate_hz: 10, channels: [rgb, depth]}
  rear: {kind: camera, resolution: [32, 24], fov_deg: 90, rate_hz: 10, channels: [rgb]}
"""


def write_bench(folder: Path, companion: str, more: str = "", *, mission: Path | None = None) -> Path:
    """A bench file with this companion; flies the hop unless another mission is named."""
    folder.mkdir(parents=True, exist_ok=True)
    hop = folder / "hop.waypoints"
    hop.write_text(HOP)
    file = folder / "b.yaml"
    record = "" if "record:" in more else "record: {mcap: false, report: false, tlog: false}\n"
    file.write_text(
        f"mission: {mission or hop}\nautopilot: {{transport: loopback}}\n{record}"
        f"companion: {{port: 0, {companion}}}\n{more}"
    )
    return file


def fly(
    folder: Path, companion: str, more: str = "", *, settings: tuple[str, ...] = (), mission: Path | None = None
) -> RunResult:
    """What came of it, in `folder`/run."""
    bench = load_bench(write_bench(folder, companion, more, mission=mission), settings=settings)
    return run_bench(bench, folder / "run", quiet=True)


def saved(out: Path) -> dict[str, Any]:
    """run.json."""
    run: dict[str, Any] = json.loads((out / "run.json").read_text())
    return run


def marked_processes(mark: str) -> set[int]:
    """Clients that were started with this text in their environment, by whatever bench."""
    found = set()
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            ours = mark.encode() in (folder / "environ").read_bytes()
            if ours and b"hil_companion" in (folder / "cmdline").read_bytes():
                found.add(int(folder.name))
        except OSError:
            continue  # it ended while we looked, or is somebody else's
    return found


def mapped_rings(pid: int) -> set[Path]:
    """Shared memory of companion links that a process has."""
    try:
        lines = Path(f"/proc/{pid}/maps").read_text().splitlines()
    except OSError:
        return set()
    return {Path(line.split()[5]) for line in lines if "/hil-companion-" in line}
