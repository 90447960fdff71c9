"""`make check` finds what changed in any clone, with a branch `main` or `origin/main` only, or says what to do."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tools.check import changed_files


def git(folder: Path, *arguments: str) -> None:
    who = ("-c", "user.name=n", "-c", "user.email=n@example.org")
    subprocess.run(["git", "-C", str(folder), *who, *arguments], check=True, capture_output=True)


def test_changes_since_the_main_of_this_clone_or_of_its_origin(tmp_path: Path) -> None:
    origin, clone = tmp_path / "origin", tmp_path / "clone"
    origin.mkdir()
    git(origin, "init", "-q", "-b", "main")
    (origin / "a.py").write_text("1\n")
    git(origin, "add", "a.py")
    git(origin, "commit", "-q", "-m", "a")
    git(origin, "checkout", "-q", "-b", "work")
    git(tmp_path, "clone", "-q", str(origin), str(clone))
    (clone / "a.py").write_text("2\n")
    (clone / "new.py").write_text("")
    assert changed_files(clone) == [Path("a.py"), Path("new.py")]
    (origin / "a.py").write_text("3\n")
    assert changed_files(origin) == [Path("a.py")]
    git(clone, "remote", "remove", "origin")
    with pytest.raises(SystemExit, match=r"main or origin/main.*git fetch"):
        changed_files(clone)
