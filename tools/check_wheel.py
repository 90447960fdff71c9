"""Check the wheel as a user installs it: build, install in a clean environment, fly and test in another folder.

Run by `make wheel` and by continuous integration, with the Python of `.venv`. Ends with status 0 and the wheel in
`dist/`, or with status 1 and the reason. It builds in the folder of `make setup`, so nothing is compiled twice.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = {"firmware_bridge", "hil", "rigs", "signals", "sim"}
CPP_SUFFIXES = {".cpp", ".hpp"}
EXAMPLES = "docs/examples"  # in the wheel as hil/examples
MODULES = ("firmware_bridge/_native", "hil/apps/identify/_programs", "signals/_kernel", "sim/_kernels")
DEFAULT_BENCH = "rigs/benches/hil.yaml"
MAX_SIZE_MB = 36.0  # 30 MB of them models and textures
Command = list[str | Path]


class WheelError(Exception):
    """Defect of the wheel."""


def say(text: str) -> None:
    sys.stdout.write(f"[wheel] {text}\n")
    sys.stdout.flush()


def run(command: Command, folder: Path, title: str) -> str:
    """Run a command in a folder and return its output. Raises WheelError with title and output if it fails."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "HIL_", "VIRTUAL_ENV"))}
    # The locked cmake and ninja come first.
    environment["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{environment['PATH']}"
    process = subprocess.run(
        command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )
    if process.returncode:
        raise WheelError(f"{title} ended with status {process.returncode}:\n{process.stdout}")
    return process.stdout


def build(folder: Path) -> Path:
    """Build the wheel of this checkout into a folder and return its path."""
    pip: Command = [sys.executable, "-m", "pip", "wheel", "-q", "--disable-pip-version-check"]
    run([*pip, "--no-build-isolation", "--no-deps", "--wheel-dir", folder, ROOT], ROOT, "building the wheel")
    (wheel,) = folder.glob("*.whl")
    return wheel


def checked_out() -> set[str]:
    """Return the files of the packages that a wheel has to hold: all but C++ sources and files of a build or a run."""
    excluded = {".pyi", ".so", ".pyd"} | CPP_SUFFIXES
    files = {path.relative_to(ROOT) for package in PACKAGES for path in (ROOT / package).rglob("*") if path.is_file()}
    caches = {path for path in files if any(part.startswith((".", "__pycache__")) for part in path.parts)}
    found = {path.as_posix() for path in files - caches if path.suffix not in excluded}
    examples = run(["git", "ls-files", EXAMPLES], ROOT, "listing the examples").splitlines()
    return found | {f"hil/examples/{name.removeprefix(EXAMPLES + '/')}" for name in examples}


def check_content(wheel: Path) -> None:
    """Raise WheelError if a file is missing, if one should not be there, or if the tag is not the intended one."""
    abi = "cp312-abi3" if sys.version_info >= (3, 12) else "cp311-cp311"
    if f"-{abi}-" not in wheel.name:
        raise WheelError(f"{wheel.name}: its tag should be {abi} when built by Python {sys.version.split()[0]}")
    names = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    suffix = ".abi3." if abi.endswith("abi3") else f".{sys.implementation.cache_tag}-"
    modules = {name for name in names if name.startswith(tuple(module + suffix for module in MODULES))}
    stubs = {f"{module}.pyi" for module in MODULES}
    if len(modules) != len(MODULES):
        raise WheelError(f"{wheel.name} should hold {MODULES}, each once and for {abi}, but holds {sorted(modules)}")
    expected = checked_out() | modules | stubs | {DEFAULT_BENCH}
    if missing := expected - names:
        raise WheelError(f"{wheel.name} lacks {sorted(missing)}")
    if extra := names - expected:
        raise WheelError(f"{wheel.name} holds files that should not be in it: {sorted(extra)}")
    size_mb = wheel.stat().st_size / 1e6
    if size_mb > MAX_SIZE_MB:
        raise WheelError(f"{wheel.name} has {size_mb:.1f} MB, the limit is {MAX_SIZE_MB:g} MB")
    say(f"{wheel.name}: {len(names)} files, {size_mb:.1f} MB")


def install(wheel: Path, folder: Path) -> Path:
    """Install the wheel, its locked dependencies and pytest in a clean environment. Return its folder of commands."""
    venv.create(folder, with_pip=True)
    commands = folder / ("Scripts" if os.name == "nt" else "bin")
    pip: Command = [commands / "python", "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-compile"]
    run([*pip, "--constraint", ROOT / "requirements.lock", wheel, "pytest"], folder, "installing the wheel")
    return commands


def fly(hil: Path, folder: Path) -> str:
    """Fly the default mission in a folder and return the digest. Raises WheelError unless it passes."""
    folder.mkdir()
    run([hil, "run", "--quiet", "--out", folder / "run"], folder, f"`{hil} run`")
    flight = json.loads((folder / "run/run.json").read_text())
    if flight["status"] != "PASS":
        raise WheelError(f"`{hil} run` ended as {flight['status']}: {flight['error']}")
    return str(flight["digest"])


def check_benchmarks(hil: Path, folder: Path) -> None:
    """Run a benchmark of the wheel and ask for one of the laboratory, which is in a checkout only."""
    folder.mkdir()
    run([hil, "bench", "radar", "--quick", "--errors-only"], folder, "`hil bench radar`")
    asked = subprocess.run([hil, "bench", "airsim"], cwd=folder, capture_output=True, text=True, check=False)
    if asked.returncode != 2 or "needs a checkout" not in asked.stderr:
        raise WheelError(f"`hil bench airsim` ended with status {asked.returncode}:\n{asked.stdout}{asked.stderr}")
    say("hil bench: radar met, airsim needs a checkout")


def run_example(commands: Path, folder: Path) -> None:
    """Run the tests of the example firmware_team, with the plugin that pytest finds by itself.

    The project has packages with the names of the bench's, and its folder is first on the import path.
    """
    place = run([commands / "python", "-P", "-c", "import hil; print(hil.__path__[0])"], folder.parent, "import hil")
    shutil.copytree(Path(place.strip()) / "examples/firmware_team", folder)
    (folder / "pytest.ini").write_text("[pytest]\ntestpaths = tests\n")
    for name in ("sim/__init__.py", "rigs/__init__.py", "signals.py"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("raise ImportError('this is the project, not the bench')\n")
    output = run([commands / "python", "-m", "pytest", "-q"], folder, "pytest on the firmware team's tests")
    run([commands / "python", "-m", "hil.cli", "check"], folder, "`python -m hil.cli check` in the same folder")
    say(f"pytest: {output.strip().splitlines()[-1]}")


def main() -> None:
    started = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="hil-wheel-") as name:
        folder = Path(name)
        wheel = build(folder)
        check_content(wheel)
        commands = install(wheel, folder / "venv")
        installed, checkout = fly(commands / "hil", folder / "flight"), fly(ROOT / ".venv/bin/hil", folder / "checkout")
        if installed != checkout:
            raise WheelError(f"digests of the default flight differ: {installed} installed, {checkout} in the checkout")
        say(f"default flight, installed and in the checkout: PASS, {installed}")
        check_benchmarks(commands / "hil", folder / "bench")
        run_example(commands, folder / "firmware_team")
        (ROOT / "dist").mkdir(exist_ok=True)
        shutil.copy(wheel, ROOT / "dist")
    say(f"the wheel works and is in dist/ ({time.monotonic() - started:.0f} s)")


if __name__ == "__main__":
    try:
        main()
    except WheelError as error:
        sys.stderr.write(f"[wheel] error: {error}\n")
        raise SystemExit(1) from None
