"""Old keys of a bench file: an error with file, line and the new key, which exists."""

from __future__ import annotations

import pytest

from hil.config import resolved_yaml
from hil.config.renamed import RENAMED_KEYS
from hil.config.schema import BenchConfig
from signals.documents.validate import legal_keys
from tests.worlds.bench_files import elsewhere, load, refused  # noqa: F401 (the fixture is for every test)


@pytest.mark.parametrize("old", RENAMED_KEYS)
def test_an_old_key_is_an_error_that_names_the_new_one(old: str) -> None:
    section, key = old.split(".")
    message = f"is now called {RENAMED_KEYS[old]} (rename it)"
    for problems, where in (
        (refused(f"seed: 2\n{section}:\n  {key}: true\n"), f"b.yaml:3: {old}"),
        (refused("seed: 2\n", settings=[f"{old}=true"]), f"--set {old}:"),
    ):
        assert f"{where} {message}" in problems
        assert "unknown key" not in "".join(problems)


@pytest.mark.parametrize(("old", "new"), RENAMED_KEYS.items())
def test_the_new_key_exists_and_the_old_one_does_not(old: str, new: str) -> None:
    section, key = new.split(".")
    assert key in legal_keys(BenchConfig, (section,))
    assert old.split(".")[1] not in legal_keys(BenchConfig, (section,))


def test_other_mistakes_are_reported_beside_an_old_key() -> None:
    assert refused("sed: 1\nrouter: {hold_heartbeats: true, gcs: 3}\nsearch: [1]\n") == [
        "b.yaml:1: sed: unknown key (did you mean 'seed'?)",
        "b.yaml:2: router.hold_heartbeats is now called router.repeat_heartbeats (rename it)",
        "b.yaml:2: router.gcs must be text, not 3 (put it in quotes)",
        "b.yaml:3: search must be a mapping of keys, not [1]",
    ]


def test_a_run_of_an_earlier_version_can_still_be_loaded() -> None:
    text = resolved_yaml(load("router: {repeat_heartbeats: false}\n").config)
    assert "repeat_heartbeats: false" in text
    old = text.replace("repeat_heartbeats", "hold_heartbeats")
    assert load(old).config.router.repeat_heartbeats is False
    wrong = refused(old.replace("hold_heartbeats: false", "hold_heartbeats: 3"))
    assert [problem.partition(": ")[2] for problem in wrong] == [
        "router.repeat_heartbeats must be true or false, not 3"
    ]
