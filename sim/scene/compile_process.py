"""Compiles an MJCF text in a process of its own, with limits of time and memory.

MuJoCo's compiler cannot be interrupted. The process can: a signal to the bench ends it at once.
"""

from __future__ import annotations

import contextlib
import resource
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import mujoco

MAX_COMPILE_S = 120  # of processor time
_MAX_MEMORY_BYTES = 8 << 30
_TEXT, _ASSETS, _MODEL, _ERROR = "map.xml", "assets", "map.mjb", "error.txt"


def compile_with_limits(mjcf: str, assets: Mapping[str, bytes]) -> mujoco.MjModel:
    """Return the compiled model. Raises ValueError with MuJoCo's message, or one that names the limit."""
    with tempfile.TemporaryDirectory(prefix="hil-map-") as name:
        folder = Path(name)
        (folder / _TEXT).write_text(mjcf, encoding="utf-8")
        (folder / _ASSETS).mkdir()
        for asset, data in assets.items():
            (folder / _ASSETS / asset).write_bytes(data)
        with subprocess.Popen(
            [sys.executable, "-m", __name__, name],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C reaches the bench only, which then ends this process
        ) as process:
            try:
                status = process.wait()
            except BaseException:
                process.kill()
                raise
        if status == 0:
            return mujoco.MjModel.from_binary_path(str(folder / _MODEL))
        with contextlib.suppress(OSError):
            raise ValueError((folder / _ERROR).read_text(encoding="utf-8"))
        raise ValueError(
            f"MuJoCo's compiler ended with status {status}: the map needs more than {MAX_COMPILE_S} s of processor "
            f"time or {_MAX_MEMORY_BYTES >> 30} GB of memory, or it crashes the compiler"
        )


def main() -> int:
    """Compile the map in the folder that is the only argument."""
    folder = Path(sys.argv[1])
    resource.setrlimit(resource.RLIMIT_CPU, (MAX_COMPILE_S, MAX_COMPILE_S))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with contextlib.suppress(ValueError, OSError):  # macOS has no such limit
        resource.setrlimit(resource.RLIMIT_AS, (_MAX_MEMORY_BYTES, _MAX_MEMORY_BYTES))
    assets = {path.name: path.read_bytes() for path in (folder / _ASSETS).iterdir()}
    mujoco.set_mju_user_warning(lambda _: None)  # by default MuJoCo writes a log file into the working directory
    try:
        model = mujoco.MjModel.from_xml_string((folder / _TEXT).read_text(encoding="utf-8"), assets)
    except (ValueError, mujoco.FatalError, UnicodeError, MemoryError) as error:
        (folder / _ERROR).write_text(str(error) or type(error).__name__, encoding="utf-8")
        return 1
    mujoco.mj_saveModel(model, str(folder / _MODEL))
    return 0


if __name__ == "__main__":
    sys.exit(main())
