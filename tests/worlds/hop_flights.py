"""Short flights of the mock with companions (5 m to the north), and the processes and memory that a run left behind."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hil.config import load_bench
from hil.run.bench_run import RunResult, run_bench
from tests.worlds.patience import PATIENCE_S

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
    """Write a bench file with this companion; it flies the hop unless another mission is named."""
    folder.mkdir(parents=True, exist_ok=True)
    hop = folder / "hop.waypoints"
    hop.write_text(HOP)
    file = folder / "b.yaml"
    for limit in ("connect_timeout_s", "reply_timeout_s"):
        companion += "" if limit in companion else f", {limit}: {PATIENCE_S}"
    record = "" if "record:" in more else "record: {mcap: false, report: false, tlog: false}\n"
    file.write_text(
        f"mission: {mission or hop}\nautopilot: {{transport: loopback}}\n{record}"
        f"companion: {{port: 0, {companion}}}\n{more}"
    )
    return file


def fly(
    folder: Path, companion: str, more: str = "", *, settings: tuple[str, ...] = (), mission: Path | None = None
) -> RunResult:
    """Fly that bench with its output in `folder`/run."""
    bench = load_bench(write_bench(folder, companion, more, mission=mission), settings=settings)
    return run_bench(bench, folder / "run", quiet=True)


def saved(out: Path) -> dict[str, Any]:
    """Read a run's run.json."""
    run: dict[str, Any] = json.loads((out / "run.json").read_text())
    return run


def marked_processes(mark: str) -> set[int]:
    """Return the process ids of clients whose environment holds this text, whichever bench started them."""
    found = set()
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            ours = mark.encode() in (folder / "environ").read_bytes()
            if ours and b"hil_companion" in (folder / "cmdline").read_bytes():
                found.add(int(folder.name))
        except OSError:
            continue  # it has ended, or belongs to another user
    return found


def mapped_rings(pid: int) -> set[Path]:
    """Return the shared memory of companion links that a process has mapped."""
    try:
        lines = Path(f"/proc/{pid}/maps").read_text().splitlines()
    except OSError:
        return set()
    return {Path(line.split()[5]) for line in lines if "/hil-companion-" in line}
