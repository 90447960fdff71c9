"""Make the environment of the project: `.venv` with the locked dependencies and the built C++ kernels.

Run by `make setup` with any Python >= 3.11; needs nothing else but a package index. Steps that are already
done are skipped (a stamp per step holds a hash of what the step depends on).
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
# Byte code is written when a module is first imported: most of what is installed never is in one environment.
PIP_INSTALL: Command = [PYTHON, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-compile"]
# As pyproject.toml and CMakeLists.txt ask; numpy is casadi's.
BUILD_TOOLS = ["casadi", "cmake", "nanobind", "ninja", "numpy", "scikit-build-core"]
MIN_PYTHON = (3, 11)
# std::bit_cast and concepts are what old "C++20" compilers lack.
CXX20_PROBE = (
    "#include <bit>\n#include <concepts>\n#include <cstdint>\n"
    "static_assert(std::bit_cast<std::uint64_t>(1.0) != 0);\nint main() { return 0; }\n"
)


def say(text: str) -> None:
    sys.stdout.write(f"[setup] {text}\n")
    sys.stdout.flush()


class SetupError(Exception):
    """Setup cannot go on; the text says why and what to do."""


def run(command: Command, **kwargs: object) -> None:
    try:
        subprocess.run(command, check=True, cwd=ROOT, **kwargs)  # type: ignore[call-overload]
    except subprocess.CalledProcessError as error:
        raise SetupError(
            f"`{' '.join(map(str, command))}` ended with status {error.returncode}; its output is above"
        ) from None


def digest_of(paths: list[Path]) -> str:
    h = hashlib.blake2b(digest_size=16)
    for path in sorted(paths):
        h.update(path.relative_to(ROOT).as_posix().encode())
        h.update(path.read_bytes())
    h.update(sys.version.encode())
    h.update(str(ROOT).encode())  # a moved checkout has a broken venv
    return h.hexdigest()


def stamped(name: str, digest: str) -> bool:
    stamp = VENV / f".hil-{name}"
    return stamp.exists() and stamp.read_text() == digest


def stamp(name: str, digest: str) -> None:
    (VENV / f".hil-{name}").write_text(digest)


def make_venv() -> None:
    """Create `.venv` and install what builds the kernels; the other dependencies are for `install_dependencies`."""
    if PYTHON.exists() and stamped("deps", digest_of([LOCK])):
        return
    if not PYTHON.exists() or not any(VENV.glob(".hil-*")):
        say(f"creating .venv with Python {sys.version.split()[0]}")
        try:
            run([sys.executable, "-m", "venv", "--clear", VENV])
        except SetupError:
            raise SetupError("no virtual environment could be made; Debian, Ubuntu: apt install python3-venv") from None
    say("installing what builds the C++ kernels")
    run([*PIP_INSTALL, "--constraint", LOCK, *BUILD_TOOLS])


def install_dependencies() -> None:
    """Install requirements.lock, which is complete: nothing is left for pip to resolve."""
    digest = digest_of([LOCK])
    if stamped("deps", digest):
        return
    say("installing the locked dependencies (requirements.lock)")
    run([*PIP_INSTALL, "--no-deps", "--requirement", LOCK])
    stamp("deps", digest)


def usable_compiler() -> str | None:
    """First C++ compiler of this machine that handles C++20, or None. `CXX=none` asks for the wheel's."""
    if os.environ.get("CXX") == "none":
        return None
    for name in filter(None, [os.environ.get("CXX"), "c++", "g++", "clang++"]):
        command = name.split()
        if shutil.which(command[0]) is None:
            continue
        with tempfile.TemporaryDirectory() as folder:
            source = Path(folder) / "probe.cpp"
            source.write_text(CXX20_PROBE)
            done = subprocess.run(
                [*command, "-std=c++20", "-o", str(Path(folder) / "probe"), str(source)],
                capture_output=True,
                check=False,
            )
        if done.returncode == 0:
            return name
        say(f"compiler {name} cannot build C++20, trying the next")
    return None


def zig_compiler() -> dict[str, str]:
    """Install the compiler of the `ziglang` wheel and return the CC/CXX that use it."""
    say("no C++20 compiler on this machine: using the one in the ziglang wheel")
    run([*PIP_INSTALL, "--requirement", ROOT / "tools/requirements-zig.lock"])
    found = {}
    for variable, command in (("CC", "cc"), ("CXX", "c++"), ("AR", "ar"), ("RANLIB", "ranlib")):
        wrapper = VENV / "bin" / f"zig-{command}"
        wrapper.write_text(f'#!/bin/sh\nexec "{PYTHON}" -m ziglang {command} "$@"\n')
        wrapper.chmod(wrapper.stat().st_mode | stat.S_IXUSR | stat.S_IXGRP | stat.S_IXOTH)
        found[variable] = str(wrapper)
    return found


def build_kernels() -> None:
    native = [
        p
        for folder in ("signals", "sim", "firmware_bridge")
        for p in (ROOT / folder).glob("**/native/**/*")
        if p.is_file()
    ]
    model = ROOT / "firmware_bridge/mock_pixhawk/estimate/ekf_model.py"  # the build generates C++ from it
    digest = digest_of([*native, model, ROOT / "CMakeLists.txt", ROOT / "pyproject.toml"])
    if stamped("kernels", digest):
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
    stamp("kernels", digest)


def main() -> None:
    if sys.version_info < MIN_PYTHON:
        raise SetupError(
            f"Python {'.'.join(map(str, MIN_PYTHON))} or newer is needed, this is {sys.version.split()[0]}; "
            "name another with `make PYTHON=/path/to/python3.12 ...`"
        )
    make_venv()
    # Side by side: the compilers keep the cores busy, pip mostly waits for the network and the disk.
    with ThreadPoolExecutor(2) as both:
        steps = [both.submit(build_kernels), both.submit(install_dependencies)]
    for step in steps:
        step.result()


if __name__ == "__main__":
    try:
        main()
    except SetupError as error:  # after both steps have ended: the last thing that is said
        sys.stderr.write(f"[setup] error: {error}\n")
        raise SystemExit(2) from None
