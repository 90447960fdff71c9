"""The determinism contract (docs/determinism.md): the same inputs give the same digest."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from hil.config import load_bench
from hil.run.bench_run import run_bench
from tests.worlds import cpu_masks
from tests.worlds.strained_machine import busy_processors

ROOT = Path(__file__).resolve().parents[2]
# Long enough to boot, upload, arm, take off from contact and turn towards the first vertex.
SETTINGS = ["duration_s=24", "record.report=false", "record.tlog=false"]
LOOPBACK = "autopilot.transport=loopback"


def digest(out: Path, *settings: str, seed: int = 1, seconds: int = 24) -> str:
    bench = load_bench(seed=seed, settings=[*SETTINGS, f"duration_s={seconds}", *settings])
    outcome = run_bench(bench, out, quiet=True)
    assert outcome.run["error"] is None, outcome.run["error"]
    assert outcome.run["sim_s"] == seconds
    assert outcome.run["deterministic"] is True
    return outcome.run["digest"]


def digest_in_process(out: Path, environment: dict[str, str]) -> str:
    arguments = [x for s in SETTINGS for x in ("--set", s)]
    command = [sys.executable, "-m", "hil.cli", "run", "--quiet", "--out", str(out), *arguments]
    subprocess.run(command, cwd=ROOT, env=os.environ | environment, capture_output=True, timeout=200, check=False)
    run = json.loads((out / "run.json").read_text())
    assert run["error"] is None, run["error"]
    return run["digest"]


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> str:
    return digest(tmp_path_factory.mktemp("reference"), LOOPBACK)


@pytest.mark.parametrize("runs", [1, pytest.param(20, marks=pytest.mark.slow)])
def test_repeated_runs_have_the_same_digest(reference: str, tmp_path: Path, runs: int) -> None:
    digests = {digest(tmp_path / str(n), LOOPBACK, "record.mcap=false") for n in range(runs)}
    assert digests == {reference}


# The first ends in the climb, the others as the reference does.
@pytest.mark.parametrize(
    ("cores", "seconds"), [(2, 8), *(pytest.param(n, 24, marks=pytest.mark.slow) for n in (0, 1, 2))]
)
def test_over_the_pty_with_busy_cores(tmp_path: Path, cores: int, seconds: int) -> None:
    in_memory = digest(tmp_path / "in_memory", LOOPBACK, seconds=seconds)
    with busy_processors(cores):
        assert digest(tmp_path / "pty", seconds=seconds) == in_memory


THREADS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONHASHSEED": "12345"}
# The older spelling of glibc's tunables.
USABLE = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2_Usable,-FMA_Usable,-AVX_Usable,-FMA4_Usable"}
ALONE = [cpu_masks.GLIBC, USABLE, cpu_masks.NUMPY, THREADS]
MASKS = [cpu_masks.ALL | THREADS, *(pytest.param(mask, marks=pytest.mark.slow) for mask in ALONE)]


@pytest.mark.parametrize("environment", MASKS, ids=lambda e: ",".join(e))
def test_with_cpu_features_masked(reference: str, tmp_path: Path, environment: dict[str, str]) -> None:
    assert digest_in_process(tmp_path, environment) == reference


def test_another_seed_gives_another_digest(reference: str, tmp_path: Path) -> None:
    assert digest(tmp_path, LOOPBACK, seed=2) != reference


def test_recorders_and_a_further_sensor_do_not_change_the_digest(reference: str, tmp_path: Path) -> None:
    # The digest covers every other sensor's messages to the autopilot, so one changed draw would show.
    extra = ["sensors.imu2={preset: icm20689}", "sensors.gps2={preset: m8n, rate_hz: 5}"]
    assert digest(tmp_path, LOOPBACK, *extra, "record.tlog=true", "record.mcap=false") == reference


def test_skipping_changes_no_digest(reference: str, tmp_path: Path) -> None:
    settings = ["physics.contact_skipping=false", "sensors.gps2={preset: m8n, rate_hz: 5}", "record.mcap=false"]
    outcome = run_bench(load_bench(settings=[*SETTINGS, LOOPBACK, *settings]), tmp_path, quiet=True)
    assert outcome.run["digest"] == reference
    assert outcome.run["sensors"]["gps2"] == {"samples": 0, "skipped": 120, "ms": {"p50": 0.0, "p99": 0.0}}
    assert {"what": "gps2", "why": "no consumer for gps2", "saved": "120 samples"} in outcome.run["skipped"]
