"""A wrong program is named by its path and fault before anything is started."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import pytest

from firmware_bridge.autopilots.ardupilot.copter import PROGRAM as ARDUCOPTER
from firmware_bridge.autopilots.px4.px4_sitl import PROFILE
from hil.config.checks import program_checks
from hil.config.checks.program_checks import program_problem

PX4 = PROFILE.program
assert PX4 is not None


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    monkeypatch.setattr(program_checks.platform, "machine", lambda: "x86_64")

    def make(contents: bytes, *, machine: int | None = 62, mode: int = 0o755) -> Path:
        path = tmp_path / "program"
        head = b"" if machine is None else b"\x7fELF" + bytes(14) + struct.pack("<H", machine)
        path.write_bytes(head + contents)
        path.chmod(mode)
        return path

    return make


def test_right_programs_are_accepted(program: Callable[..., Path]) -> None:
    assert program_problem(program(b"..SYS_AUTOSTART.."), PX4) is None
    assert program_problem(program(b"..ArduCopter V4.6.."), ARDUCOPTER) is None
    assert program_problem(program(b"#!/bin/sh\nexec px4\n", machine=None), PX4) is None


@pytest.mark.parametrize(
    ("contents", "settings", "says"),
    [
        (b"..ArduCopter..", {}, "is not PX4"),
        (b"SYS_AUTOSTART", {"machine": 40}, "built for ARM (32 bits), this computer is x86_64"),
        (b"SYS_AUTOSTART", {"mode": 0o644}, "not executable"),
        (b"", {"machine": None}, "cannot be read as a program"),
        (b"just text", {"machine": None}, "is not PX4"),
    ],
)
def test_wrong_programs_are_named(
    program: Callable[..., Path], contents: bytes, settings: dict[str, int], says: str
) -> None:
    path = program(contents, **settings)
    problem = program_problem(path, PX4)
    if settings.get("mode") == 0o644 and problem is None:
        pytest.skip("the superuser may execute it")
    assert problem is not None
    assert says in problem
    assert str(path) in problem


def test_a_folder_and_a_missing_file_are_named(tmp_path: Path) -> None:
    assert "names a folder, not a program" in str(program_problem(tmp_path, PX4))
    assert "does not exist" in str(program_problem(tmp_path / "px4", PX4))
