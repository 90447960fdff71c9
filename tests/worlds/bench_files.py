"""Bench files of tests: written, loaded, or refused with what is wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hil.config import Bench, load_bench
from signals.errors import ConfigError


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Every test works in an empty folder: what it finds comes from the installed rigs."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def load(text: str, **options: Any) -> Bench:
    """The bench of b.yaml with this text."""
    Path("b.yaml").write_text(text, encoding="utf-8")
    return load_bench("b.yaml", **options)


def refused(text: str, **options: Any) -> list[str]:
    """What is wrong with it."""
    with pytest.raises(ConfigError) as caught:
        load(text, **options)
    return [str(problem) for problem in caught.value.problems]
