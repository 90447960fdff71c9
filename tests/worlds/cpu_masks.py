"""Environments in which the C library and numpy pretend to be on an older CPU, and scripts run in them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from numpy._core import _multiarray_umath as numpy_cpu

from tests.worlds.patience import PATIENCE_S

ROOT = Path(__file__).resolve().parents[2]

GLIBC = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F,-AVX512VL,-AVX,-FMA4,-SSE4_2,-ERMS,-BMI2"}
# Only features that numpy can switch and this CPU has may be named.
NUMPY = {
    "NPY_DISABLE_CPU_FEATURES": " ".join(f for f in numpy_cpu.__cpu_dispatch__ if numpy_cpu.__cpu_features__.get(f))
}
ALL = GLIBC | NUMPY


def output_of(script: str, environment: dict[str, str] | None = None) -> str:
    """Run a Python script in a process of its own at the root of the checkout and return its output."""
    result = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT,
        env=os.environ | (environment or {}),
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout.strip()
