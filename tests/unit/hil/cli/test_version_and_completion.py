"""`hil --version`, and the completions that a shell asks for."""

from __future__ import annotations

from importlib import metadata

import pytest

from hil.cli.app import run_command_line


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["--version"]) == 0
    assert capsys.readouterr().out == f"hil-bench {metadata.version('hil-bench')}\n"


def test_a_shell_gets_completions(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("_HIL_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "hil re")
    monkeypatch.setenv("COMP_CWORD", "1")
    assert run_command_line([]) == 0
    assert capsys.readouterr().out.split() == ["replay"]


def test_the_completion_of_a_shell_is_shown(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")
    assert run_command_line(["--show-completion", "bash"]) == 0
    assert "_HIL_COMPLETE=complete_bash" in capsys.readouterr().out
