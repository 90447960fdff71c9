"""Check that a file is a program of the expected firmware, before anything is started."""

from __future__ import annotations

import mmap
import os
import platform
import struct
from pathlib import Path

from firmware_bridge.autopilots.profile import Program

# e_machine of the ELF header, by platform.machine()
_MACHINES = {"x86_64": 62, "aarch64": 183, "armv7l": 40, "riscv64": 243, "i686": 3}
_NAMES = {3: "x86 (32 bits)", 40: "ARM (32 bits)", 62: "x86-64", 183: "ARM (64 bits)", 243: "RISC-V"}


def program_problem(path: Path, program: Program, other: Program | None = None) -> str | None:
    """Return what is wrong with the file at `path` as this program; None if nothing is found.

    `other`: a program that it may be mistaken for. A script is taken as it is. On systems whose programs are not ELF
    files only the contents are checked.
    """
    if os.path.isdir(path):
        return f"names a folder, not a program: {path}"
    if not os.path.isfile(path):
        return f"names a program that does not exist: {path}"
    if not os.access(path, os.X_OK):
        return f"names a file that is not executable: {path}"
    try:
        with path.open("rb") as file:
            head = file.read(20)
            if head[:2] == b"#!":
                return None
            machine = struct.unpack_from("<H", head, 18)[0] if head[:4] == b"\x7fELF" and len(head) == 20 else None
            if machine is not None and machine != _MACHINES.get(platform.machine(), machine):
                built_for = _NAMES.get(machine, f"processor type {machine}")
                return f"names a program built for {built_for}, this computer is {platform.machine()}: {path}"
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as contents:
                if contents.find(program.mark) < 0:
                    if other is not None and contents.find(other.mark) >= 0:
                        return f"names {other.name}, and this vehicle needs {program.name}: {path}"
                    return f"names a program that is not {program.name}: {path}"
    except (OSError, ValueError) as error:  # ValueError: an empty file
        return f"names a file that cannot be read as a program: {path} ({error})"
    return None
