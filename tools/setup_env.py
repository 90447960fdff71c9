"""Make the environment of the project: `.venv` with the locked dependencies and the built C++ kernels.

Run by `make setup` with any Python >= 3.11; needs only a package index. A finished step is skipped: its stamp file
holds a hash of the files on which the step depends.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import stat
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PYTHON = VENV / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
LOCK = ROOT / "requirements.lock"
Command = list[str | os.PathLike[str]]
# No byte code at installation: Python writes it at a module's first import, and most modules are never imported.
PIP_INSTALL: Command = [PYTHON, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-compile"]
# Required by pyproject.toml and CMakeLists.txt; numpy is required by casadi.
BUILD_TOOLS = ["casadi", "cmake", "nanobind", "ninja", "numpy", "scikit-build-core"]
MIN_PYTHON = (3, 11)
# Old compilers that accept -std=c++20 lack std::bit_cast or concepts.
CXX20_PROBE = (
    "#include <bit>\n#include <concepts>\n#include <cstdint>\n"
    "static_assert(std::bit_cast<std::uint64_t>(1.0) != 0);\nint main() { return 0; }\n"
)


def say(text: str) -> None:
    sys.stdout.write(f"[setup] {text}\n")
    sys.stdout.flush()


class SetupError(Exception):
    """Failure of the setup, with the cause and what to do."""


def run(command: Command, **kwargs: object) -> None:
    try:
        subprocess.run(command, check=True, cwd=ROOT, **kwargs)  # type: ignore[call-overload]
    except subprocess.CalledProcessError as error:
        raise SetupError(
            f"`{' '.join(map(str, command))}` ended with status {error.returncode}; its output is above"
        ) from None


def digest_of(paths: list[Path]) -> str:
    digest = hashlib.blake2b(digest_size=16)
    for path in sorted(paths):
        digest.update(path.relative_to(ROOT).as_posix().encode())
        digest.update(path.read_bytes())
    digest.update(sys.version.encode())
    digest.update(str(ROOT).encode())  # a virtual environment breaks when its checkout is moved
    return digest.hexdigest()


def is_stamped(name: str, digest: str) -> bool:
    stamp = VENV / f".hil-{name}"
    return stamp.exists() and stamp.read_text() == digest


def write_stamp(name: str, digest: str) -> None:
    (VENV / f".hil-{name}").write_text(digest)


def make_venv() -> None:
    """Create `.venv` and install the tools that build the kernels; `install_dependencies` installs the rest."""
    if PYTHON.exists() and is_stamped("deps", digest_of([LOCK])):
        return
    if not PYTHON.exists() or not any(VENV.glob(".hil-*")):
        say(f"creating .venv with Python {sys.version.split()[0]}")
        try:
            run([sys.executable, "-m", "venv", "--clear", VENV])
        except SetupError:
            raise SetupError("no virtual environment could be made; Debian, Ubuntu: apt install python3-venv") from None
    say("installing the tools that build the C++ kernels")
    run([*PIP_INSTALL, "--constraint", LOCK, *BUILD_TOOLS])


def install_dependencies() -> None:
    """Install requirements.lock, which is complete: nothing is left for pip to resolve."""
    digest = digest_of([LOCK])
    if is_stamped("deps", digest):
        return
    say("installing the locked dependencies (requirements.lock)")
    run([*PIP_INSTALL, "--no-deps", "--requirement", LOCK])
    write_stamp("deps", digest)


def usable_compiler() -> str | None:
    """Return the first C++20 compiler of this machine, or None. `CXX=none` selects that of the ziglang wheel."""
    if os.environ.get("CXX") == "none":
        return None
    for name in filter(None, [os.environ.get("CXX"), "c++", "g++", "clang++"]):
        command = name.split()
        if shutil.which(command[0]) is None:
            continue
        with tempfile.TemporaryDirectory() as folder:
            source = Path(folder) / "probe.cpp"
            source.write_text(CXX20_PROBE)
            process = subprocess.run(
                [*command, "-std=c++20", "-o", str(Path(folder) / "probe"), str(source)],
                capture_output=True,
                check=False,
            )
        if process.returncode == 0:
            return name
        say(f"compiler {name} cannot build C++20, trying the next")
    return None


def zig_compiler() -> dict[str, str]:
    """Install the compiler of the `ziglang` wheel and return its commands: CC, CXX, AR, RANLIB."""
    say("no C++20 compiler on this machine: using the one in the ziglang wheel")
    run([*PIP_INSTALL, "--requirement", ROOT / "tools/requirements-zig.lock"])
    commands = {}
    for variable, command in (("CC", "cc"), ("CXX", "c++"), ("AR", "ar"), ("RANLIB", "ranlib")):
        wrapper = VENV / "bin" / f"zig-{command}"
        wrapper.write_text(f'#!/bin/sh\nexec "{PYTHON}" -m ziglang {command} "$@"\n')
        wrapper.chmod(wrapper.stat().st_mode | stat.S_IXUSR | stat.S_IXGRP | stat.S_IXOTH)
        commands[variable] = str(wrapper)
    return commands


def build_kernels() -> None:
    native = [
        p
        for folder in ("signals", "sim", "firmware_bridge", "hil")
        for p in (ROOT / folder).glob("**/native/**/*")
        if p.is_file()
    ]
    model = ROOT / "firmware_bridge/mock_pixhawk/estimate/ekf_model.py"  # the build generates C++ from it
    digest = digest_of([*native, model, ROOT / "CMakeLists.txt", ROOT / "pyproject.toml"])
    if is_stamped("kernels", digest):
        return
    environment = dict(os.environ)
    environment["PATH"] = f"{PYTHON.parent}{os.pathsep}{environment['PATH']}"  # the locked cmake and ninja
    compiler = usable_compiler()
    arguments: list[str] = []
    if compiler is None:
        zig = zig_compiler()
        environment |= {k: zig[k] for k in ("CC", "CXX")}
        arguments = [f"--config-settings=cmake.define.CMAKE_{tool}={zig[tool]}" for tool in ("AR", "RANLIB")]
    else:
        environment["CXX"] = compiler
    say(f"building the C++ kernels with {compiler or 'zig c++'}")
    shutil.rmtree(ROOT / "build", ignore_errors=True)
    run([*PIP_INSTALL, "--no-build-isolation", "--no-deps", *arguments, "--editable", ROOT], env=environment)
    write_stamp("kernels", digest)


def main() -> None:
    if sys.version_info < MIN_PYTHON:
        raise SetupError(
            f"Python {'.'.join(map(str, MIN_PYTHON))} or newer is needed, this is {sys.version.split()[0]}; "
            "name another with `make PYTHON=/path/to/python3.12 ...`"
        )
    make_venv()
    # In parallel: the compilers keep the cores busy, pip mostly waits for the network and the disk.
    with ThreadPoolExecutor(2) as pool:
        steps = [pool.submit(build_kernels), pool.submit(install_dependencies)]
    for step in steps:
        step.result()


if __name__ == "__main__":
    try:
        main()
    except SetupError as error:  # raised after both steps have ended, so this is the last line of the output
        sys.stderr.write(f"[setup] error: {error}\n")
        raise SystemExit(2) from None
