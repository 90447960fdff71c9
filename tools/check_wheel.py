"""Check the wheel as a user meets it: built, installed in a clean environment, flown and tested in another folder.

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
SOURCES_OF_MODULES = {".cpp", ".hpp"}
MODULES = ("firmware_bridge/_native", "signals/_kernel", "sim/_kernels")
DEFAULT_BENCH = "rigs/benches/hil.yaml"
SIZE_LIMIT_MB = 20.0
Command = list[str | Path]


class WheelError(Exception):
    """The wheel is not what a user needs; the text says why."""


def say(text: str) -> None:
    sys.stdout.write(f"[wheel] {text}\n")
    sys.stdout.flush()


def run(command: Command, folder: Path, log: str) -> str:
    """Run a command in a folder and return its output. Raises WheelError with the output if it fails."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "HIL_", "VIRTUAL_ENV"))}
    # The locked cmake and ninja come first.
    environment["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{environment['PATH']}"
    done = subprocess.run(
        command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )
    if done.returncode:
        raise WheelError(f"{log} ended with status {done.returncode}:\n{done.stdout}")
    return done.stdout


def build(folder: Path) -> Path:
    """Build the wheel of this checkout into a folder and return its path."""
    pip: Command = [sys.executable, "-m", "pip", "wheel", "-q", "--disable-pip-version-check"]
    run([*pip, "--no-build-isolation", "--no-deps", "--wheel-dir", folder, ROOT], ROOT, "building the wheel")
    (wheel,) = folder.glob("*.whl")
    return wheel


def checked_out() -> set[str]:
    """Return the files of the packages that a wheel has to hold: all but C++ sources and what a build or a run made."""
    made = {".pyi", ".so", ".pyd"} | SOURCES_OF_MODULES
    files = {path.relative_to(ROOT) for package in PACKAGES for path in (ROOT / package).rglob("*") if path.is_file()}
    caches = {path for path in files if any(part.startswith((".", "__pycache__")) for part in path.parts)}
    return {path.as_posix() for path in files - caches if path.suffix not in made}


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
        raise WheelError(f"{wheel.name} should hold {MODULES}, each once and for {abi}, and holds {sorted(modules)}")
    expected = checked_out() | modules | stubs | {DEFAULT_BENCH}
    if missing := expected - names:
        raise WheelError(f"{wheel.name} lacks {sorted(missing)}")
    if extra := names - expected:
        raise WheelError(f"{wheel.name} holds what the checkout lacks or a user does not need: {sorted(extra)}")
    size_mb = wheel.stat().st_size / 1e6
    if size_mb > SIZE_LIMIT_MB:
        raise WheelError(f"{wheel.name} has {size_mb:.1f} MB, the limit is {SIZE_LIMIT_MB:g} MB")
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


def run_example(commands: Path, folder: Path) -> None:
    """Run the tests of docs/examples/firmware_team, with the plugin that pytest finds by itself."""
    shutil.copytree(ROOT / "docs/examples/firmware_team", folder)
    (folder / "pytest.ini").write_text("[pytest]\ntestpaths = tests\n")
    output = run([commands / "python", "-P", "-m", "pytest", "-q"], folder, "pytest on the firmware team's tests")
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
            raise WheelError(f"the installed bench flies another flight: {installed}, the checkout's is {checkout}")
        say(f"default flight, installed and in the checkout: PASS, {installed}")
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
