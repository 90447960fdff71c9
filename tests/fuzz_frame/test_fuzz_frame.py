"""The frame kernels under AddressSanitizer and UndefinedBehaviorSanitizer: a minute of random, degenerate scenes.

Building that takes minutes: `make test` compiles its own source alone, and CI builds and runs all of it (.ci/run).
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
BUILD = ROOT / "build" / "fuzz_frame"  # kept: compiling takes minutes, once
SECONDS = 60


@pytest.fixture(scope="module")
def fuzz_frame() -> Path:
    # The environment's own cmake, which built the kernels.
    cmake = shutil.which("cmake", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")]))
    if cmake is None:
        pytest.skip("no cmake, neither in the environment nor on the PATH")
    for command in ([cmake, "-S", str(HERE), "-B", str(BUILD)], [cmake, "--build", str(BUILD), "--parallel", "2"]):
        made = subprocess.run(command, capture_output=True, text=True, check=False)
        if made.returncode != 0 and "asan" in made.stderr:
            pytest.skip("this compiler has no AddressSanitizer")
        assert made.returncode == 0, made.stdout[-4000:] + made.stderr[-4000:]
    return BUILD / "fuzz_frame"


def test_the_source_fits_the_kernels() -> None:
    """A kernel whose interface changes would break the fuzz target unseen."""
    compiler = shutil.which(os.environ.get("CXX", "c++"))
    if compiler is None:
        pytest.skip("no C++ compiler on the PATH")
    flags = [
        "-std=c++20",
        "-fsyntax-only",
        *(f"-I{ROOT / f}" for f in ("sim/native/frame", "sim/native", "signals/native")),
    ]
    made = subprocess.run([compiler, *flags, str(HERE / "fuzz_frame.cpp")], capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr[-4000:]


@pytest.mark.slow
@pytest.mark.timeout(1500)
def test_random_scenes_neither_crash_nor_write_out_of_bounds(fuzz_frame: Path) -> None:
    first_seed = os.environ.get("FUZZ_FRAME_SEED", "1")
    ran = subprocess.run([str(fuzz_frame), str(SECONDS), first_seed], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, (ran.stdout + ran.stderr)[-6000:]
    assert int(ran.stdout.split()[0]) >= 20  # number of scenes, reached by slow machines too


@pytest.mark.slow
@pytest.mark.timeout(1500)
def test_hits_that_rounding_puts_before_a_triangle_are_culled_exactly(fuzz_frame: Path) -> None:
    """Scene 77306 has a triangle from 12 m to 100 km that a table of rays met at 4.9 m."""
    ran = subprocess.run([str(fuzz_frame), "seed", "77306"], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, (ran.stdout + ran.stderr)[-6000:]


@pytest.mark.slow
@pytest.mark.timeout(1500)
def test_the_picture_of_sixteen_million_pixels(fuzz_frame: Path) -> None:
    """Seed 7 and every 500th after it take one of 4096 x 4096."""
    ran = subprocess.run([str(fuzz_frame), "seed", "507"], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, (ran.stdout + ran.stderr)[-6000:]
